"""Monotone branches of a signal, strict and with a dead band."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from smart_tire.errors import ParameterError
from smart_tire.models.film.monotone_branches import lasting_branches, monotone_branches, series

PATHS = st.lists(st.integers(-5, 5).map(float), min_size=1, max_size=40).map(np.array)


@given(PATHS)
def test_a_branch_never_turns_and_its_neighbour_goes_the_other_way(path):
    branches = monotone_branches(path)
    assert np.all(np.diff(path) * branches.signs[branches.numbers] >= 0.0)
    assert np.all(np.diff(branches.signs) != 0.0)
    assert branches.signs.size == branches.starts.size + 1
    for number, start in enumerate(branches.starts, 1):
        assert branches.numbers[start] == number
        assert start == 0 or branches.numbers[start - 1] == number - 1


@given(PATHS)
def test_a_dead_band_of_zero_changes_nothing(path):
    strict, lasting = monotone_branches(path), lasting_branches(path, 0.0)
    # where the path rests at its turn either end of the rest may be called the turning point
    np.testing.assert_array_equal(path[lasting.starts], path[strict.starts])
    np.testing.assert_array_equal(lasting.signs, strict.signs)


@given(PATHS, st.integers(0, 6))
def test_what_lasts_turns_by_more_than_the_dead_band(path, dead_band):
    branches = lasting_branches(path, dead_band)
    turns = path[branches.starts]
    assert np.all(np.abs(np.diff(turns)) > dead_band)
    assert np.all(np.diff(turns) * branches.signs[1:-1] > 0.0)
    # on a branch nothing lies before its start, and no way back is longer than the band
    for number in range(1, branches.signs.size):
        way = np.concatenate([path[[branches.starts[number - 1]]],
                              path[1:][branches.numbers == number]]) * branches.signs[number]
        assert way.min() == way[0]
        assert np.all(np.maximum.accumulate(way) - way <= dead_band)


def test_a_ripple_stays_on_its_branch():
    ramp = np.concatenate([np.arange(0.0, 50.0), np.arange(50.0, -1.0, -1.0)])
    rippled = ramp + 0.9 * (-1.0) ** np.arange(ramp.size)
    assert monotone_branches(rippled).starts.size > 90
    branches = lasting_branches(rippled, 3.0)
    np.testing.assert_array_equal(branches.signs, [0.0, 1.0, -1.0])
    assert abs(branches.starts[1] - 50) <= 1


@pytest.mark.parametrize('values, message', [
    ([1.0, np.nan], r'u\[1\] is nan'), ([np.inf], r'u\[0\] is inf'),
    (np.zeros((2, 3)), r'shape \(2, 3\)'), (['one'], 'no number')])
def test_what_is_no_series_is_refused(values, message):
    with pytest.raises(ParameterError, match=message):
        series('u', values)


def test_a_negative_dead_band_is_refused():
    with pytest.raises(ParameterError, match=r'dead_band is -1'):
        lasting_branches(np.zeros(3), -1.0)
