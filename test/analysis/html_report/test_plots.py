# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Plots: bands per run of values, digits, gaps, legends, and the number of points."""

import math
from pathlib import Path
import re

import numpy as np
import pytest

from smart_tire.analysis.figure import (
    COLORS, Curve, decimated, Figure, Mark, MAX_POINTS, Panel, truth_marks)
from smart_tire.analysis.html_report import plots
from smart_tire.analysis.html_report.plots import plotly_spec

CURVE = Curve(np.array([0.0, 1.0, 2.0, 3.00049]), np.array([1.0, 1.23456789, math.nan, 3.0]),
              np.array([0.5, 0.1, 0.2, 0.25]))
COUNT = 60_000


def test_the_page_has_each_color_of_the_palette():
    script = Path(plots.__file__).with_name('page.js').read_text(encoding='utf-8')
    light = re.search(r'LIGHT = \{(.*?)\}', script, re.DOTALL)[1]
    found = dict(re.findall(r"(\w+): '(#\w+)'", light))
    assert found.keys() >= COLORS.keys()
    assert {name: found[name] for name in COLORS if name not in ('ink', 'shade')} == {
        name: color for name, color in COLORS.items() if name not in ('ink', 'shade')}


def test_an_area_has_the_opacity_of_a_band_once():
    trace, = spec(Mark(CURVE, 'ellipse', 'blue', 'area', opacity=0.2))['data']
    assert trace['opacity'] == 1.0 and trace['fillcolor'] == '@blue_band'


def spec(*marks, panels=1, **options):
    rows = [[Panel(marks, 'time [s]', 'speed [m/s]', **options)] for _ in range(panels)]
    return plotly_spec(Figure('name', 'title', 'caption', rows), (0.0, 9.0))


def test_the_band_is_a_polygon_of_two_standard_deviations_per_run_of_values():
    band, line = spec(Mark(CURVE, 'estimate'))['data']
    assert band['x'] == [0.0, 1.0, 1.0, 0.0, None, 3.0, 3.0, None]
    assert band['y'] == [2.0, 1.43457, 1.03457, 0.0, None, 3.5, 2.5, None]
    assert band['fillcolor'] == '@blue_band' and not band['showlegend']
    assert line['y'] == [1.0, 1.23457, None, 3.0] and line['x'] == [0.0, 1.0, 2.0, 3.0]
    assert line['customdata'] == [1.0, 0.2, 0.4, 0.5]
    assert line['hovertemplate'].endswith(' m/s')
    assert band['legendgroup'] == line['legendgroup'] == 'estimate'


def test_an_unknown_standard_deviation_interrupts_the_band_and_that_of_an_error_is_around_zero():
    sigma = np.array([0.5, math.inf, 0.5])
    band = spec(Mark(Curve(np.arange(3.0), np.ones(3), sigma), around_zero=True))['data'][0]
    assert band['x'] == [0.0, 0.0, None, 2.0, 2.0, None]
    assert band['y'] == [1.0, -1.0, None, 1.0, -1.0, None]


def test_points_without_value_are_left_out_and_bars_are_two_standard_deviations():
    [shown] = spec(Mark(CURVE, 'single', 'orange', 'points'))['data']
    assert shown['x'] == [0.0, 1.0, 3.0] and shown['mode'] == 'markers'
    assert shown['error_y']['array'] == [1.0, 0.2, 0.5]


def test_panels_share_time_and_legend():
    found = spec(*truth_marks(CURVE, 'mid'), panels=2, y_limits=(0.0, 4.0))
    first, second = found['data']
    assert (first['showlegend'], second['showlegend']) == (True, False)
    assert first['line']['dash'] == 'dash' and first['line']['shape'] == 'hvh'
    layout = found['layout']
    assert layout['xaxis']['range'] == [0.0, 9.0] and layout['xaxis2']['matches'] == 'x'
    assert layout['yaxis2']['range'] == [0.0, 4.0] and second['yaxis'] == 'y2'
    assert layout['yaxis']['domain'][0] > layout['yaxis2']['domain'][1]


def noisy():
    """Return a noisy curve with a long gap, single extremes and a large standard deviation."""
    value = np.random.default_rng(0).normal(size=COUNT)
    value[3000:9000] = np.nan
    value[[777, 40_000]] = 50.0, -60.0
    sigma = np.full(COUNT, 0.1)
    sigma[12_345] = 7.0
    return Curve(np.arange(COUNT) * 0.008, value, sigma)


@pytest.mark.parametrize('limit', [100, 1000, 5000])
def test_extremes_ends_and_gaps_of_original_points_are_kept_within_the_limit(limit):
    curve = noisy()
    shown = decimated(curve, limit)
    assert 0.4 * limit < len(shown.y) <= limit
    assert np.nanmax(shown.y) == 50.0 and np.nanmin(shown.y) == -60.0
    assert shown.sigma.max() == 7.0
    assert np.isnan(shown.y).sum() == 1
    assert (shown.x[0], shown.x[-1]) == (curve.x[0], curve.x[-1])
    rows = np.searchsorted(curve.x, shown.x)
    assert (np.diff(rows) > 0).all()
    assert np.array_equal(shown.y, curve.y[rows], equal_nan=True)
    assert np.array_equal(shown.sigma, curve.sigma[rows])


def test_each_interval_keeps_its_envelope():
    time = np.arange(10_000) * 1.0
    shown = decimated(Curve(time, np.sin(time)), 402)  # 100 intervals of 100 values
    for first in range(0, 10_000, 1000):
        part = (shown.x >= first) & (shown.x < first + 1000)
        assert shown.y[part].max() > 0.999 and shown.y[part].min() < -0.999


def test_a_short_curve_is_complete_except_for_repeated_nan():
    shown = decimated(Curve(np.arange(5.0), np.array([np.nan, 1.0, np.nan, np.nan, 2.0])), 10)
    assert shown.x.tolist() == [1.0, 2.0, 4.0] and shown.sigma is None
    for value in (np.empty(0), np.full(20_000, np.nan)):
        assert not np.isfinite(decimated(Curve(np.arange(len(value)) * 1.0, value)).y).any()


def test_long_curves_are_limited_in_every_trace():
    band, line = spec(Mark(noisy()))['data']
    assert len(line['x']) == len(line['y']) == len(line['customdata']) <= MAX_POINTS
    assert len(band['x']) == len(band['y']) <= 2 * MAX_POINTS + 3
    assert (max(filter(None, line['y'])), min(filter(None, line['y']))) == (50.0, -60.0)
