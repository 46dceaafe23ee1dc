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

"""Lag compensation: smoothed slip velocity belongs to the center of each wheel period."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.lag_compensation import compensate_lag, MAX_WHEEL_GAP
from smart_tire.estimation.slip.output import OutputContext
from smart_tire.estimation.slip.rts_smoother import SmoothedState
from smart_tire.estimation.slip.state import ImuReading, N, SLIP_VELS, State

STEP = 0.01
PERIOD = 0.1  # s, of the wheel samples


def state(time, wheel_time, slip_velocities, segment=0, by_forces=False):
    x = [float(row) for row in range(N)]
    x[State.SLIP_VEL_L], x[State.SLIP_VEL_R] = slip_velocities
    context = OutputContext(
        round(time * 1e9), 0.0, ImuReading(0.0, 0.0, 0.0), 0.0, (0.0,) * 4, time, wheel_time,
        by_forces)
    return SmoothedState(segment, context, x, 1e-4 * np.eye(N))


def run(slip_velocity, end=2.0, latency=0.0, segment=0):
    """Return states with the slip velocity of the latest wheel sample, delayed by ``latency``."""
    states = []
    for k in range(round(end / STEP)):
        time = k * STEP
        center = max(0.0, (np.floor((time - latency) / PERIOD + 1e-9) - 0.5) * PERIOD)
        states.append(state(
            time, center, (slip_velocity(center), -slip_velocity(center)), segment))
    return states


def slip_velocities(states):
    return np.array([[s.x[row] for row in SLIP_VELS] for s in states])


def times(states):
    return np.array([s.context.time for s in states])


@pytest.mark.parametrize('latency', [0.0, 0.2])
def test_a_linear_change_of_slip_velocity_no_longer_lags(latency):
    states = run(lambda t: 0.3 * t, latency=latency)
    moved = list(compensate_lag(states))
    assert times(moved).tolist() == times(states).tolist()
    inside = (times(moved) > 0.1) & (times(moved) < 2.0 - 2.0 * PERIOD - latency)
    expected = 0.3 * np.stack([times(moved), -times(moved)], axis=1)
    assert np.abs(slip_velocities(moved) - expected)[inside].max() < 1e-9
    assert np.abs(slip_velocities(states) - expected)[inside].max() > 0.3 * (PERIOD + latency)


def test_only_slip_velocities_change_and_their_variance_during_a_change():
    def step(t):
        return 0.0 if t < 1.0 else 0.2
    for before, after in zip(run(step), compensate_lag(run(step)), strict=True):
        others = [row for row in range(N) if row not in SLIP_VELS]
        assert [before.x[row] for row in others] == [after.x[row] for row in others]
        extra = after.P - before.P
        assert np.count_nonzero(extra) == np.count_nonzero(np.diag(extra)[list(SLIP_VELS)])
        changing = 0.951 < after.context.time < 1.049
        assert np.all(np.diag(extra)[list(SLIP_VELS)] > 0.0) == changing
        assert extra.max() <= 0.25 * 0.2 ** 2 + 1e-12


def test_constant_slip_velocity_is_unchanged():
    states = run(lambda t: 0.1)
    assert slip_velocities(compensate_lag(states)) == pytest.approx(slip_velocities(states))


def test_segments_are_not_interpolated_into_each_other():
    states = run(lambda t: 0.1) + run(lambda t: 0.5, segment=1)
    assert np.abs(slip_velocities(compensate_lag(states)) - slip_velocities(states)).max() < 1e-12


def test_states_that_the_force_balance_follows_are_unchanged():
    lagging = run(lambda t: 0.3 * t, end=1.0)
    exact = [state(1.0 + STEP * k, 0.95, (0.5, -0.5), by_forces=True) for k in range(50)]
    later = [state(1.5 + STEP * k, 1.5 + PERIOD * (k // 10), (0.1 * (k // 10), 0.0))
             for k in range(50)]
    moved = list(compensate_lag(lagging + exact + later))
    assert times(moved).tolist() == times(lagging + exact + later).tolist()
    assert moved[100:150] == exact
    # neither side of them is interpolated into them
    assert slip_velocities(moved[:100]).max() <= slip_velocities(lagging).max()
    assert slip_velocities(moved[150:160]) == pytest.approx(0.0, abs=0.1)
    assert np.abs(slip_velocities(moved[:85]) - slip_velocities(lagging[:85])).max() > 0.01


def test_a_long_gap_of_wheel_samples_does_not_delay_the_output():
    states = run(lambda t: 0.3 * t, end=0.5)
    states += [state(0.5 + k * STEP, 0.35, (0.2, 0.2))
               for k in range(round(2 * MAX_WHEEL_GAP / STEP))]
    given, taken = 0, 0

    def source():
        nonlocal given
        for item in states:
            given += 1
            yield item
    for item in compensate_lag(source()):
        taken += 1
        assert given - taken <= MAX_WHEEL_GAP / STEP + 2
        if item.context.time > 0.5:
            assert item.x[State.SLIP_VEL_L] == 0.2
    assert taken == len(states)
