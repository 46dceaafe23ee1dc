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

"""Decimation: extremes, gaps and order remain, values are original ones."""

import numpy as np
import pytest

from smart_tire.analysis.curves import Curve
from smart_tire.analysis.html_report.decimation import decimated, equidistant

COUNT = 60_000


def noisy():
    """Return a noisy curve with a long gap, single extremes and a large standard deviation."""
    value = np.random.default_rng(0).normal(size=COUNT)
    value[3000:9000] = np.nan
    value[[777, 40_000]] = 50.0, -60.0
    sigma = np.full(COUNT, 0.1)
    sigma[12_345] = 7.0
    return Curve(np.arange(COUNT) * 0.008, value, sigma)


@pytest.mark.parametrize('limit', [100, 1000, 5000])
def test_extremes_ends_and_gaps_are_kept_within_the_limit(limit):
    curve = noisy()
    shown = decimated(curve, limit)
    assert 0.4 * limit < len(shown.value) <= limit
    assert np.nanmax(shown.value) == 50.0 and np.nanmin(shown.value) == -60.0
    assert shown.sigma.max() == 7.0
    assert np.isnan(shown.value).sum() == 1
    assert (shown.time_s[0], shown.time_s[-1]) == (curve.time_s[0], curve.time_s[-1])
    assert (np.diff(shown.time_s) > 0.0).all()


def test_every_point_is_an_original_one():
    curve = noisy()
    shown = decimated(curve, 1000)
    rows = np.searchsorted(curve.time_s, shown.time_s)
    assert np.array_equal(shown.value, curve.value[rows], equal_nan=True)
    assert np.array_equal(shown.sigma, curve.sigma[rows])


def test_each_interval_keeps_its_envelope():
    time = np.arange(10_000) * 1.0
    shown = decimated(Curve(time, np.sin(time)), 402)  # 100 intervals of 100 values
    for first in range(0, 10_000, 1000):
        part = (shown.time_s >= first) & (shown.time_s < first + 1000)
        assert shown.value[part].max() > 0.999 and shown.value[part].min() < -0.999


def test_a_short_curve_is_complete_except_for_repeated_nan():
    value = np.array([np.nan, 1.0, np.nan, np.nan, 2.0])
    shown = decimated(Curve(np.arange(5.0), value), 10)
    assert shown.time_s.tolist() == [1.0, 2.0, 4.0] and shown.sigma is None


@pytest.mark.parametrize('value', [np.empty(0), np.full(20_000, np.nan)])
def test_a_curve_without_values_is_empty(value):
    assert not np.isfinite(decimated(Curve(np.arange(len(value)) * 1.0, value)).value).any()


def test_a_path_is_thinned_at_equal_distances_and_keeps_its_ends():
    travel = np.concatenate([np.zeros(5000), np.linspace(0.0, 10.0, 20_000)])
    path = np.column_stack([travel, np.zeros(len(travel))])
    rows = equidistant(path, 101)
    assert len(rows) <= 101 and rows[0] == 0 and rows[-1] == len(path) - 1
    assert np.diff(path[rows, 0]).max() < 0.11


def test_a_path_that_does_not_move_has_two_rows():
    assert equidistant(np.zeros((10_000, 2)), 100).tolist() == [0, 9999]
