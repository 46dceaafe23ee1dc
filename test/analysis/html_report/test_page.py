# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The HTML file: sections, tables, what was left out, escaping, no network."""

from __future__ import annotations

from base64 import b64encode
from hashlib import sha256
from html.parser import HTMLParser
import json
import math
import re

import plotly.graph_objects as go
import pytest

from smart_tire.analysis.figure import Figure
from smart_tire.analysis.html_report.content import left_out_table, report_of, skipped_lines
from smart_tire.analysis.html_report.page import (
    Folded, html_page, Note, Picture, Report, script_json, Section)
from smart_tire.analysis.html_report.plots import plotly_spec
from smart_tire.analysis.offline import Analysis, analyze, BagContents
from smart_tire.analysis.result import Result
from smart_tire.analysis.tables import Table, text
from smart_tire.parameters import build, SimulatorParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import Friction, WheelSlip
from smart_tire.simulation.offline import simulate
from smart_tire.uncertain import Uncertain, UNKNOWN
from support.recordings import write_bag

SECTIONS = [
    'recording', 'motion', 'slip', 'friction', 'errors', 'left_out', 'parameters', 'about']
PLOTS = [
    'wheel_speeds', 'path', 'velocity', 'slip', 'friction', 'adhesion', 'crossing', 'ground',
    'normalized', 'error_pose', 'error_velocity', 'error_slip']

INPUTS = {'imu/data': {'late': 0, 'rejected': 3}, 'tire_samples': {'late': 7, 'rejected': 0}}


class Outline(HTMLParser):
    """Elements with their attributes, texts by element, and scripts of a page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.texts, self.scripts, self._open = [], {}, [], ''
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._open = tag
        if tag == 'script':
            self.scripts.append((dict(attrs), ''))

    def handle_endtag(self, tag):
        self._open = ''

    def handle_data(self, data):
        self.texts.setdefault(self._open, []).append(data)
        if self._open == 'script':
            self.scripts[-1] = self.scripts[-1][0], data

    def values(self, name):
        """Return the values of the attribute ``name`` of all elements."""
        return [values[name] for _, values in self.tags if name in values]


@pytest.fixture(scope='module')
def events():
    """Return the events of one and a half seconds."""
    return simulate(build(SimulatorParams, {'film.wheels': ['front_left'], 'seed': 2}),
                    [(0.2, 120.0, 60.0)], 1.5)


@pytest.fixture(scope='module')
def outline(page):
    """Return the parsed page."""
    return Outline(page)


def blocks(report, kind):
    """Return the figures or tables of the report, also the folded ones."""
    every = [block.table if isinstance(block, Folded) else block
             for section in report.sections for block in section.blocks]
    return [block for block in every if isinstance(block, kind)]


def row_of(report, head, first):
    """Return the row that starts with ``first`` of the table whose head contains ``head``."""
    return next(row for table in blocks(report, Table) if head in table.head
                for row in table.rows if row[0] == first)


def test_the_page_has_all_sections_in_the_order_of_the_navigation(outline):
    assert outline.values('href') == [f'#{name}' for name in SECTIONS]
    assert [values['id'] for tag, values in outline.tags if tag == 'h2'] == SECTIONS
    ids = outline.values('id')
    assert len(set(ids)) == len(ids)


@pytest.mark.parametrize('missing', [
    ('imu/data',), ('tire_samples',),
    ('ground_truth/odom', 'ground_truth/wheel_slip', 'ground_truth/tire_friction')],
    ids='+'.join)
def test_a_report_without_some_topics_has_all_sections(missing, events, used, tmp_path):
    bag = write_bag(tmp_path / 'bag', [event for event in events if event[1] not in missing])
    run = analyze(bag, None, used.params)
    outline = Outline(html_page(report_of(run, used, 'bag', ())))
    assert [values['id'] for tag, values in outline.tags if tag == 'h2'] == SECTIONS
    skipped = ' '.join(outline.texts['li'])
    for topic in missing[:2]:
        assert f'{topic} is not in the bag' in skipped or 'ground truth is not' in skipped


def test_a_recording_without_estimates_has_no_report(used):
    with pytest.raises(ValueError, match='nothing was estimated'):
        report_of(Analysis(), used, 'bag', ())


def test_nothing_is_loaded_from_elsewhere(outline):
    assert all(address.startswith('#') for name in ('src', 'href', 'action')
               for address in outline.values(name))
    tags = {tag for tag, _ in outline.tags}
    assert not tags & {'link', 'img', 'iframe', 'object', 'embed', 'base'}
    [policy] = [text for text in outline.values('content') if 'default-src' in text]
    assert policy.startswith("default-src 'none'") and 'http' not in policy
    scripts = {values['id']: text for values, text in outline.scripts if 'type' not in values}
    assert list(scripts) == ['plotly', 'page'] and len(scripts['plotly']) > 1e6
    hashes = [b64encode(sha256(text.encode()).digest()).decode() for text in scripts.values()]
    assert policy.endswith('script-src ' + ' '.join(f"'sha256-{one}'" for one in hashes))


def test_a_page_without_plots_runs_no_scripts():
    assert "script-src 'none'" in html_page(Report('a', (), (), ()))


def test_each_figure_has_a_plot_a_text_for_screen_readers_and_a_caption(outline):
    plots = [values for tag, values in outline.tags if values.get('class') == 'plot']
    assert [values['id'] for values in plots] == [f'{name}_plot' for name in PLOTS]
    assert all(values['aria-label'] and values['role'] == 'img' for values in plots)
    assert sum(tag == 'figcaption' for tag, _ in outline.tags) == len(PLOTS)
    assert {values['data-spec'] for values in plots} == {
        values['id'] for values, _ in outline.scripts
        if values.get('type') == 'application/json'}
    assert [values['id'] for values in plots if 'data-time' not in values] == [
        'path_plot', 'crossing_plot', 'normalized_plot']


def test_names_from_the_bag_are_escaped(page, outline, report):
    assert '<b>&"1"' not in page and '/odd<i>' not in page
    assert ''.join(outline.texts['h1']) == 'drive <b>&"1"</b></script>'
    assert row_of(report, 'role', '/odd<i>&amp;')[1:] == ['std_msgs/msg/Bool', 'not used', '1']
    assert ''.join(outline.texts['th']).count('/odd<i>&amp;') == 1


def test_json_cannot_end_its_script_element():
    text = script_json({'name': '</script><!--'})
    assert '<' not in text and json.loads(text) == {'name': '</script><!--'}
    with pytest.raises(ValueError, match='JSON'):
        script_json([float('nan')])


def test_the_tables_have_the_values_of_the_summary(report, analysis):
    summary = analysis.summary
    end, truth = summary['estimates']['odom'], summary['against_truth']
    assert row_of(report, 'estimate', 'y at the end [m]')[1:] == [
        text(end['end']['y_m'], '.3f'), text(end['end_sigma']['y_m'], '.3f')]
    assert row_of(report, 'rate [Hz]', 'imu/data')[1] == str(
        summary['inputs']['imu/data']['messages'])
    twist = truth['pose']['twist']['v_y']
    assert row_of(report, 'values', 'v_y [m/s]')[1:] == [text(twist[key], form) for key, form in (
        ('count', ''), ('mean', '+.4f'), ('rms', '.4f'), ('normalized_rms', '.2f'),
        ('within_one', '.0%'), ('within_two', '.0%'))]
    slip = truth['slip']['whole recording']['left']
    assert row_of(report, 'wheel or side', 'whole recording')[1:3] == [
        'left', text(slip['estimated_mean'], '.4f')]


def test_all_rows_of_a_table_are_as_long_as_its_head(report, outline):
    tables = blocks(report, Table)
    assert len(tables) == [tag for tag, _ in outline.tags].count('table') >= 10
    assert all(len(row) == len(table.head) for table in tables for row in table.rows)


def test_parameters_have_the_file_that_sets_them(report, params):
    assert row_of(report, 'from', 'wheel_radius')[1:5] == ['0.087', 'm', f'{params}:1', 'both']
    assert row_of(report, 'from', 'slope_sigma')[3:5] == ['default', 'slip_estimator']


def test_every_specification_is_valid_for_plotly_and_every_axis_has_a_unit(report):
    colors = re.compile(r'"@(\w+)"')
    figures = blocks(report, Figure)
    assert [figure.name for figure in figures] == PLOTS
    for figure in figures:
        spec = json.loads(colors.sub('"#123456"', script_json(plotly_spec(figure))))
        drawn = go.Figure(spec)
        assert len(drawn.data) >= len(figure.panels)
        assert all('[' in label and label.endswith(']') for panel in figure.panels
                   for label in (panel.x_label, panel.y_label))


def estimated():
    """Return slips of which a quarter is undefined and a quarter unknown, and three crossings."""
    series = SampleArrays()
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


def test_a_page_of_pictures_contains_them_and_no_plotly(tmp_path):
    (tmp_path / 'a.png').write_bytes(b'PNG')
    page = html_page(Report('a name', (), [Section('a', 'A', 'A: b', [
        Picture('a "picture"', tmp_path / 'a.png'), Note(['it <differs>'])])], ['introduction']))
    assert len(page) < 20_000 and 'introduction' in page
    assert '<img alt="a &quot;picture&quot;" src="data:image/png;base64,UE5H">' in page
    assert '<div class="notes" role="note"><p>it &lt;differs&gt;</p></div>' in page


def test_what_the_reader_warned_of_is_not_left_out_again():
    assert left_out_table(Result(SampleArrays()), {'odom': {'late': 0, 'rejected': 0}}).rows == []
    contents = BagContents(skipped=['a is not in the bag', 'file is truncated'],
                           warnings=['file is truncated'])
    assert skipped_lines(contents) == ['a is not in the bag']
