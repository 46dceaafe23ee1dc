# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Duhem operator and the branches of a signal: equations and invariants."""

import math

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from smart_tire.errors import ParameterError
from smart_tire.models.film.hysteresis import (
    DuhemParams, monotone_branches, respond, series, TABLE_I, TABLE_I_GAIN)

NC = 1e-9  # C
PARAMS = st.builds(
    lambda alpha, a, share: DuhemParams(alpha=alpha, a=a, b=share * a),
    st.floats(0.01, 10.0), st.floats(0.1, 10.0), st.floats(0.51, 0.99))
INPUTS = st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=60).map(np.array)
PATHS = st.lists(st.integers(-5, 5).map(float), min_size=1, max_size=40).map(np.array)


def sine(periods, per_period=400, amplitude=0.25 * TABLE_I_GAIN):
    """Return the charge of a film under cyclic compression from the flat state."""
    return -0.5 * amplitude * (1.0 - np.cos(np.linspace(0.0, math.tau * periods,
                                                        per_period * periods + 1)))


def test_it_solves_its_differential_equation():
    alpha, a, b = 0.15, 0.54, 0.28  # Table I in nC

    def slope(t, y):
        u, du = 8.0 * math.sin(t), 8.0 * math.cos(t)
        return alpha * abs(du) * (a * u - y) + b * du
    # from turning point to turning point: the right-hand side has a kink there
    corners, y, u = [0.0, 0.5 * math.pi, 1.5 * math.pi, 2.5 * math.pi, 3.2 * math.pi], [1.0], []
    for begin, end in zip(corners, corners[1:]):
        y = solve_ivp(slope, (begin, end), y, method='DOP853', rtol=1e-12, atol=1e-13).y[:, -1]
        u += (8.0 * NC * np.sin(np.linspace(begin, end, 50))).tolist()
        assert respond(u, TABLE_I, start=(0.0, NC))[-1] / NC == pytest.approx(y[0], abs=1e-10)


@given(PARAMS, INPUTS, st.integers(2, 5))
def test_the_operator_is_rate_independent(params, u, times):
    path = np.concatenate([[0.0], u])
    slow = np.interp(np.arange(times * u.size + 1) / times, np.arange(path.size), path)[1:]
    np.testing.assert_allclose(respond(slow, params)[times - 1::times], respond(u, params),
                               rtol=0.0, atol=1e-11 * params.a * 20.0)


@given(PARAMS, INPUTS, st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
def test_the_effect_of_the_initial_state_decays_with_the_path_length(params, u, one, other):
    path = np.abs(np.diff(u, prepend=0.0)).cumsum()
    apart = respond(u, params, start=(0.0, one)) - respond(u, params, start=(0.0, other))
    np.testing.assert_allclose(apart, (one - other) * np.exp(-params.alpha * path),
                               rtol=0.0, atol=1e-12 * (20.0 + params.a * 20.0))


@given(PARAMS, INPUTS, st.floats(-1.0, 1.0))
def test_states_stay_in_the_band_and_the_output_is_monotone_there(params, u, share):
    start = (0.0, share * params.band)
    y = respond(u, params, start=start)
    assert np.all(np.abs(y - params.a * u) <= params.band * (1.0 + 1e-9) + 1e-12 * params.a)
    du, dy = np.diff(u, prepend=0.0), np.diff(y, prepend=start[1])
    assert np.all(dy * np.sign(du) >= -1e-12 * params.a * 20.0)


def test_a_reversal_within_the_dead_band_does_not_end_a_branch():
    u = sine(3)
    noise = 1e-3 * NC * np.random.default_rng(4).standard_normal(u.size)
    calm = respond(u + noise, TABLE_I, dead_band=0.02 * NC)
    np.testing.assert_allclose(calm, respond(u, TABLE_I), rtol=0.0, atol=5e-3 * NC)
    many = respond(u + 100.0 * noise, TABLE_I)
    assert np.abs(many - respond(u, TABLE_I)).max() > 0.3 * NC


@pytest.mark.parametrize('values, name', [
    ((0.0, 0.54, 0.28), 'alpha is 0'), ((1.0, -0.54, 0.28), 'a is -0.54'),
    ((1.0, 0.54, 0.54), 'b is 0.54'), ((1.0, 0.54, 0.26), 'b is 0.26'),
    ((math.nan, 0.54, 0.28), 'alpha is nan'), ((1.0, math.inf, 0.28), 'a is inf')])
def test_parameters_outside_their_range_are_rejected(values, name):
    with pytest.raises(ParameterError, match=name):
        DuhemParams(alpha=values[0], a=values[1], b=values[2])


@settings(max_examples=30)
@given(st.floats(1e-12, 1e12), st.sampled_from([-1.0, 1.0]), PARAMS, INPUTS)
def test_the_operator_is_odd_and_does_not_depend_on_the_units(unit, sign, params, u):
    other = DuhemParams(alpha=params.alpha / unit, a=params.a, b=params.b)
    np.testing.assert_allclose(respond(sign * u * unit, other), sign * unit * respond(u, params),
                               rtol=1e-9, atol=1e-11 * unit * params.a * 20.0)


@given(PATHS, st.integers(0, 6))
def test_branches_are_monotone_but_for_the_dead_band_and_change_direction(path, dead_band):
    branches = monotone_branches(path, dead_band)
    turning_points = path[branches.starts]
    assert np.all(np.diff(branches.signs) != 0.0)
    assert branches.signs.size == branches.starts.size + 1
    assert branches.numbers[branches.starts].tolist() == list(range(1, branches.signs.size))
    assert np.all(np.abs(np.diff(turning_points)) > dead_band)
    assert np.all(np.diff(turning_points) * branches.signs[1:-1] > 0.0)
    # a branch starts at its lowest value, and no reversal on it exceeds the dead band
    for number in range(1, branches.signs.size):
        part = np.concatenate([path[[branches.starts[number - 1]]],
                              path[1:][branches.numbers == number]]) * branches.signs[number]
        assert part.min() == part[0]
        assert np.all(np.maximum.accumulate(part) - part <= dead_band)


@pytest.mark.parametrize('values, message', [
    ([1.0, np.nan], r'u\[1\] is nan'), ([np.inf], r'u\[0\] is inf'),
    (np.zeros((2, 3)), r'shape \(2, 3\)'), (['one'], 'not numeric')])
def test_an_invalid_series_is_rejected(values, message):
    with pytest.raises(ParameterError, match=message):
        series('u', values)


def test_values_that_are_not_finite_and_a_negative_dead_band_are_rejected():
    with pytest.raises(ParameterError, match=r'\[2\] is inf'):
        respond([0.0, 1.0, np.inf], TABLE_I)
    with pytest.raises(ParameterError, match=r'dead_band is -1'):
        respond([0.0], TABLE_I, dead_band=-1.0)
