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

"""Traces: bands per run of values, digits, hidden gaps, and the number of points."""

import math

import numpy as np
import pytest

from smart_tire.analysis.curves import Curve
from smart_tire.analysis.html_report import traces
from smart_tire.analysis.html_report.decimation import MAX_POINTS

CURVE = Curve(np.array([0.0, 1.0, 2.0, 3.00049]), np.array([1.0, 1.23456789, math.nan, 3.0]),
              np.array([0.5, 0.1, 0.2, 0.25]))


def test_the_band_is_a_polygon_of_two_standard_deviations_per_run_of_values():
    band = traces.band(CURVE, 'blue', 'estimate')
    assert band['x'] == [0.0, 1.0, 1.0, 0.0, None, 3.0, 3.0, None]
    assert band['y'] == [2.0, 1.43457, 1.03457, 0.0, None, 3.5, 2.5, None]
    assert band['fillcolor'] == '@blue_band' and not band['showlegend']


def test_an_unknown_standard_deviation_interrupts_the_band():
    sigma = np.array([0.5, math.inf, 0.5])
    band = traces.band(Curve(np.arange(3.0), np.ones(3), sigma), 'blue', '')
    assert band['x'] == [0.0, 0.0, None, 2.0, 2.0, None]


def test_an_estimate_shows_two_standard_deviations_and_their_unit_on_hover():
    band, line = traces.estimate(CURVE, 'estimate', 'blue', ' m/s')
    assert line['y'] == [1.0, 1.23457, None, 3.0] and line['x'] == [0.0, 1.0, 2.0, 3.0]
    assert line['customdata'] == [1.0, 0.2, 0.4, 0.5]
    assert line['hovertemplate'].endswith(' m/s')
    assert band['legendgroup'] == line['legendgroup'] == 'estimate'


def test_points_without_value_are_left_out_and_bars_are_two_standard_deviations():
    shown = traces.points(CURVE, 'single', 'orange', '')
    assert shown['x'] == [0.0, 1.0, 3.0]
    assert shown['error_y']['array'] == [1.0, 0.2, 0.5]


def test_long_curves_are_limited_in_every_trace():
    count = 75_000  # ten minutes of estimates
    value = np.random.default_rng(1).normal(size=count)
    curve = Curve(np.arange(count) * 0.008, value, np.ones(count))
    band, line = traces.estimate(curve, 'estimate', 'blue', '')
    assert len(line['x']) == len(line['y']) == len(line['customdata']) <= MAX_POINTS
    assert len(band['x']) == len(band['y']) <= 2 * MAX_POINTS + 1
    assert len(traces.truth(curve, '')['x']) <= MAX_POINTS
    assert max(line['y']) == pytest.approx(value.max(), rel=1e-5)
