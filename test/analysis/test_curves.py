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

"""Curves for drawing: gaps, unknown slip, axis limits and segments."""

import math

import numpy as np
import pytest

from smart_tire.analysis.curves import (
    Curve, interrupted, limits, MAX_SLIP_SIGMA, observable, segments, share_outside)


def test_a_line_is_interrupted_in_gaps_only():
    curve = Curve(np.array([0.0, 0.5, 1.01, 1.2]), np.arange(4.0), np.ones(4))
    drawn = interrupted(curve)
    assert np.isnan(drawn.value).tolist() == [False, False, True, False, False]
    assert np.isnan(drawn.sigma).tolist() == [False, False, True, False, False]
    assert 0.5 < drawn.time_s[2] < 1.01
    assert not np.isnan(interrupted(curve, max_gap=0.52).value).any()


def test_slip_with_a_large_standard_deviation_is_removed_and_counted():
    sigma = np.array([0.1, MAX_SLIP_SIGMA, 0.51, math.nan, 1.0])
    curve, share = observable(Curve(np.arange(5.0), np.array([0.1, 0.2, 1.0, 1.0, math.nan]),
                                    sigma))
    assert np.isnan(curve.value).tolist() == [False, False, True, True, True]
    assert share == 0.5  # of four finite values
    assert observable(Curve(np.arange(2.0), np.array([1.0, -1.0])))[1] == 0.0
    assert observable(Curve(np.arange(1.0), np.array([math.nan]), np.ones(1)))[1] == 0.0


def test_limits_ignore_a_few_extreme_values_and_count_them():
    values = np.append(np.linspace(0.0, 1.0, 999), 50.0)
    low, high = limits([values, np.array([math.nan])], 0.1)
    assert -0.25 < low < -0.15 and 1.15 < high < 1.25
    assert share_outside([values], low, high) == pytest.approx(0.001)
    assert share_outside([np.array([math.nan])], low, high) == 0.0


@pytest.mark.parametrize('values', [[], [np.full(3, math.nan)], [np.full(3, 0.0)]])
def test_limits_of_nothing_have_the_smallest_margin(values):
    assert limits(values, 0.1) == (-0.1, 0.1)


def active(*times, duration=300.0):
    """Return a curve that changes for 5 s after each of ``times``."""
    time = np.arange(0.0, duration, 0.05)
    value = sum(np.sin(3.0 * time) * ((time > start) & (time < start + 5.0)) for start in times)
    return Curve(time, value)


def test_segments_are_where_the_curve_changes_in_order_of_time():
    found = segments([active(200.0, 40.0, 120.0)], duration=10.0)
    assert len(found) == 3
    for (begin, end), start in zip(found, (40.0, 120.0, 200.0)):
        assert begin <= start + 0.2 and end >= start + 4.8
        assert end - begin == pytest.approx(10.0)


def test_segments_do_not_overlap_and_need_activity():
    found = segments([active(100.0, 104.0, 108.0)], duration=10.0)
    assert 1 <= len(found) <= 3
    assert all(first[1] <= second[0] for first, second in zip(found, found[1:]))
    assert segments([Curve(np.arange(100.0), np.zeros(100))]) == []


def test_short_recordings_have_no_segments():
    assert segments([active(10.0, duration=59.0)]) == []
    assert segments([]) == []
    assert segments([Curve(np.zeros(1), np.zeros(1))]) == []
