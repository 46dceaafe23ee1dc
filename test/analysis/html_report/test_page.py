# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The HTML file: sections, tables, what was left out, escaping, no network."""

from __future__ import annotations

from html.parser import HTMLParser
import json
import math
import re

import plotly.graph_objects as go
import pytest

from smart_tire.analysis.figure import Figure
from smart_tire.analysis.html_report.content import left_out_table, report_of, skipped_lines
from smart_tire.analysis.html_report.page import Facts, Folded, html_page, script_json
from smart_tire.analysis.html_report.plots import plotly_spec
from smart_tire.analysis.offline import Analysis, analyze, BagContents
from smart_tire.analysis.result import Result
from smart_tire.analysis.tables import Table, text
from smart_tire.bags import BagWriter
from smart_tire.parameters import build, SimulatorParams
from smart_tire.recording import Recording
from smart_tire.samples import Friction, WheelSlip
from smart_tire.simulation.offline import simulate
from smart_tire.uncertain import Uncertain, UNKNOWN

SECTIONS = [
    'recording', 'motion', 'slip', 'friction', 'errors', 'left_out', 'parameters', 'about']
PLOTS = [
    'wheel_speeds', 'path', 'velocity', 'slip', 'friction', 'adhesion', 'ground', 'normalized',
    'error_pose', 'error_velocity', 'error_slip']

INPUTS = {'imu/data': {'late': 0, 'rejected': 3}, 'tire_samples': {'late': 7, 'rejected': 0}}


class Outline(HTMLParser):
    """Elements, attributes and texts of a page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.ids, self.addresses, self.tables = [], [], [], []
        self.texts, self.scripts, self._open = {}, [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.tags.append((tag, values))
        self._open = [tag] if tag not in ('br', 'meta') else self._open
        self.addresses += [values[name] for name in ('src', 'href', 'action') if name in values]
        if 'id' in values:
            self.ids.append(values['id'])
        if tag == 'table':
            self.tables.append([])
        if tag == 'tr':
            self.tables[-1].append([])
        if tag in ('th', 'td'):
            self.tables[-1][-1].append('')
        if tag == 'script':
            self.scripts.append((values, ''))

    def handle_endtag(self, tag):
        self._open = []

    def handle_data(self, data):
        if not self._open:
            return
        tag = self._open[-1]
        self.texts.setdefault(tag, []).append(data)
        if tag in ('th', 'td'):
            self.tables[-1][-1][-1] += data
        if tag == 'script':
            self.scripts[-1] = self.scripts[-1][0], self.scripts[-1][1] + data


@pytest.fixture(scope='module')
def events():
    """Return the events of one and a half seconds."""
    return simulate(build(SimulatorParams, {'film.wheels': ['front_left'], 'seed': 2}),
                    [(0.2, 120.0, 60.0)], 1.5)


@pytest.fixture(scope='module')
def outline(page):
    """Return the parsed page."""
    return Outline(page)


def row_of(outline, head, first):
    """Return the row that starts with ``first`` of the table whose head contains ``head``."""
    table = next(rows for rows in outline.tables if head in rows[0])
    return next(row for row in table if row[0] == first)


def test_the_page_has_all_sections_in_the_order_of_the_navigation(outline):
    links = [values['href'] for tag, values in outline.tags if tag == 'a']
    assert links == [f'#{name}' for name in SECTIONS]
    headings = [values['id'] for tag, values in outline.tags if tag == 'h2']
    assert headings == SECTIONS
    assert len(set(outline.ids)) == len(outline.ids)


@pytest.mark.parametrize('missing', [
    ('imu/data',), ('tire_samples',),
    ('ground_truth/odom', 'ground_truth/wheel_slip', 'ground_truth/tire_friction')],
    ids='+'.join)
def test_a_report_without_some_topics_has_all_sections(missing, events, used, tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        for receive_ns, topic, sample in events:
            if topic not in missing:
                writer.write_sample(topic, receive_ns, sample)
    run = analyze(tmp_path / 'bag', None, used.params)
    outline = Outline(html_page(report_of(run, used, Facts('bag', '', '', '', ''))))
    assert [values['id'] for tag, values in outline.tags if tag == 'h2'] == SECTIONS
    skipped = ' '.join(outline.texts['li'])
    for topic in missing[:2]:
        assert f'{topic} is not in the bag' in skipped or 'ground truth is not' in skipped


def test_a_recording_without_estimates_has_no_report(used):
    with pytest.raises(ValueError, match='nothing was estimated'):
        report_of(Analysis(), used, Facts('bag', '', '', '', ''))


def test_nothing_is_loaded_from_elsewhere(outline):
    assert all(address.startswith('#') for address in outline.addresses)
    tags = {tag for tag, _ in outline.tags}
    assert not tags & {'link', 'img', 'iframe', 'object', 'embed', 'base'}
    policy = next(values['content'] for tag, values in outline.tags
                  if values.get('http-equiv') == 'Content-Security-Policy')
    assert policy.startswith("default-src 'none'") and 'http' not in policy


def test_plotly_is_contained_once(outline):
    large = [values for values, text in outline.scripts if len(text) > 1_000_000]
    assert large == [{'id': 'plotly'}]


def test_each_figure_has_a_plot_a_text_for_screen_readers_and_a_caption(outline):
    plots = [values for tag, values in outline.tags if values.get('class') == 'plot']
    assert [values['id'] for values in plots] == [f'{name}_plot' for name in PLOTS]
    assert all(values['aria-label'] and values['role'] == 'img' for values in plots)
    assert sum(tag == 'figcaption' for tag, _ in outline.tags) == len(PLOTS)
    assert {values['data-spec'] for values in plots} == {
        values['id'] for values, _ in outline.scripts
        if values.get('type') == 'application/json'}
    assert [values['id'] for values in plots if 'data-time' not in values] == [
        'path_plot', 'normalized_plot']


def test_names_from_the_bag_are_escaped(page, outline):
    assert '<b>&"1"' not in page and '/odd<i>' not in page
    assert ''.join(outline.texts['h1']) == 'drive <b>&"1"</b></script>'
    assert row_of(outline, 'role', '/odd<i>&amp;')[1:] == ['std_msgs/msg/Bool', 'not used', '1']


def test_json_cannot_end_its_script_element():
    text = script_json({'name': '</script><!--'})
    assert '<' not in text and json.loads(text) == {'name': '</script><!--'}
    with pytest.raises(ValueError, match='JSON'):
        script_json([float('nan')])


def test_the_tables_have_the_values_of_the_summary(outline, analysis):
    summary = analysis.summary
    end, truth = summary['estimates']['odom'], summary['against_truth']
    assert row_of(outline, 'estimate', 'y at the end [m]')[1:] == [
        text(end['end']['y_m'], '.3f'), text(end['end_sigma']['y_m'], '.3f')]
    assert row_of(outline, 'rate [Hz]', 'imu/data')[1] == str(
        summary['inputs']['imu/data']['messages'])
    assert row_of(outline, 'patch crossings', 'front left')[1] == str(
        summary['estimates']['tire_friction']['front_left']['crossings'])
    assert row_of(outline, 'value', 'position error, rms [m]')[1] == text(
        truth['pose']['position_rms_m'], '.3f')
    slip = truth['slip']['whole recording']['left']
    assert row_of(outline, 'wheel or side', 'whole recording')[1:3] == [
        'left', text(slip['estimated_mean'], '.4f')]
    assert row_of(outline, 'kind', 'whole recording')[1] == next(iter(
        truth['friction']['whole recording']))


def test_the_errors_of_the_twist_agree_with_the_summary(outline, analysis):
    twist = analysis.summary['against_truth']['pose']['twist']['v_y']
    assert row_of(outline, 'values', 'v_y [m/s]')[1:] == [
        text(twist[key], form) for key, form in (
            ('count', ''), ('mean', '+.4f'), ('rms', '.4f'), ('normalized_rms', '.2f'),
            ('within_one', '.0%'), ('within_two', '.0%'))]


def test_all_rows_of_a_table_are_as_long_as_its_head(report):
    blocks = [block.table if isinstance(block, Folded) else block
              for section in report.sections for block in section.blocks]
    tables = [block for block in blocks if isinstance(block, Table)]
    assert len(tables) >= 10
    assert all(len(row) == len(table.head) for table in tables for row in table.rows)


def test_parameters_have_the_file_that_sets_them(outline, params):
    assert row_of(outline, 'from', 'wheel_radius')[1:5] == ['0.087', 'm', str(params), 'both']
    default = next(row for rows in outline.tables for row in rows if row[0] == 'slope_sigma')
    assert default[3:5] == ['default', 'slip_estimator']


def test_version_and_date_of_the_recording_are_on_the_page(outline):
    facts = outline.texts['dd']
    assert '2026-01-02 03:04:05 UTC' in facts and 'smart_tire 1.2.3' in facts


def test_every_specification_is_valid_for_plotly_and_every_axis_has_a_unit(report):
    colors = re.compile(r'"@(\w+)"')
    figures = [block for section in report.sections for block in section.blocks
               if isinstance(block, Figure)]
    assert [figure.name for figure in figures] == PLOTS
    for figure in figures:
        spec = json.loads(colors.sub('"#123456"', script_json(plotly_spec(figure))))
        drawn = go.Figure(spec)
        assert len(drawn.data) >= len(figure.panels)
        assert all('[' in label and label.endswith(']') for panel in figure.panels
                   for label in (panel.x_label, panel.y_label))


def estimated():
    """Return slips of which a quarter is undefined and a quarter unknown, and three crossings."""
    series = Recording()
    for i, (ratio, sigma) in enumerate(((0.1, 0.5), (0.1, 0.1), (math.nan, 1.0), (1.0, 0.6))):
        series.add_sample(WheelSlip(i, (ratio,) * 4, (0.0,) * 4, (sigma,) * 4))
    series.crossings = [
        Friction(i, 'front_left', friction_coefficient_single=single)
        for i, single in enumerate((Uncertain(0.5, 0.1), Uncertain(0.5, 0.4), UNKNOWN))]
    return Result(series)


def test_every_kind_is_counted_with_its_reason():
    rows = left_out_table(estimated(), INPUTS).rows
    assert [(row[0], row[1].split(':')[0], row[2]) for row in rows] == [
        ('imu/data', 'rejected', '3'), ('tire_samples', 'late', '7'),
        ('slip ratios of wheels', 'standstill', '4 (25%)'),
        ('slip ratios of wheels', 'σ above 0.5', '4 (25%)'),
        ('single crossings of front left', 'friction not observable, such as at low slip',
         '1 of 3'),
        ('single crossings of front left', 'uninformative', '1 of 3')]


def test_nothing_left_out_is_an_empty_table():
    assert left_out_table(Result(Recording()), {'odom': {'late': 0, 'rejected': 0}}).rows == []


def test_warnings_of_the_reader_are_not_listed_twice():
    contents = BagContents(skipped=['a is not in the bag', 'file is truncated'],
                           warnings=['file is truncated'])
    assert skipped_lines(contents) == ['a is not in the bag']
