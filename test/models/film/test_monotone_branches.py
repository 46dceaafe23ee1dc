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

"""Monotone branches of a signal, strict and with a dead band."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from smart_tire.errors import ParameterError
from smart_tire.models.film.monotone_branches import dead_band_branches, monotone_branches, series

PATHS = st.lists(st.integers(-5, 5).map(float), min_size=1, max_size=40).map(np.array)


@given(PATHS)
def test_a_branch_is_monotone_and_the_next_one_has_the_opposite_direction(path):
    branches = monotone_branches(path)
    assert np.all(np.diff(path) * branches.signs[branches.numbers] >= 0.0)
    assert np.all(np.diff(branches.signs) != 0.0)
    assert branches.signs.size == branches.starts.size + 1
    for number, start in enumerate(branches.starts, 1):
        assert branches.numbers[start] == number
        assert start == 0 or branches.numbers[start - 1] == number - 1


@given(PATHS)
def test_a_dead_band_of_zero_changes_nothing(path):
    strict, found = monotone_branches(path), dead_band_branches(path, 0.0)
    # where the path is constant at a reversal, either end of that part may be the turning point
    np.testing.assert_array_equal(path[found.starts], path[strict.starts])
    np.testing.assert_array_equal(found.signs, strict.signs)


@given(PATHS, st.integers(0, 6))
def test_reversals_are_larger_than_the_dead_band(path, dead_band):
    branches = dead_band_branches(path, dead_band)
    turning_points = path[branches.starts]
    assert np.all(np.abs(np.diff(turning_points)) > dead_band)
    assert np.all(np.diff(turning_points) * branches.signs[1:-1] > 0.0)
    # a branch starts at its lowest value, and no reversal on it exceeds the dead band
    for number in range(1, branches.signs.size):
        part = np.concatenate([path[[branches.starts[number - 1]]],
                              path[1:][branches.numbers == number]]) * branches.signs[number]
        assert part.min() == part[0]
        assert np.all(np.maximum.accumulate(part) - part <= dead_band)


def test_a_ripple_stays_on_its_branch():
    ramp = np.concatenate([np.arange(0.0, 50.0), np.arange(50.0, -1.0, -1.0)])
    rippled = ramp + 0.9 * (-1.0) ** np.arange(ramp.size)
    assert monotone_branches(rippled).starts.size > 90
    branches = dead_band_branches(rippled, 3.0)
    np.testing.assert_array_equal(branches.signs, [0.0, 1.0, -1.0])
    assert abs(branches.starts[1] - 50) <= 1


@pytest.mark.parametrize('values, message', [
    ([1.0, np.nan], r'u\[1\] is nan'), ([np.inf], r'u\[0\] is inf'),
    (np.zeros((2, 3)), r'shape \(2, 3\)'), (['one'], 'not numeric')])
def test_an_invalid_series_is_rejected(values, message):
    with pytest.raises(ParameterError, match=message):
        series('u', values)


def test_a_negative_dead_band_is_rejected():
    with pytest.raises(ParameterError, match=r'dead_band is -1'):
        dead_band_branches(np.zeros(3), -1.0)
