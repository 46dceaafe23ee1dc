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

"""Travel model: Jacobian against finite differences, timestamps, the printed constraint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from smart_tire.estimation.slip.state import N, SLIP_VELS, State, TRAVELS, WheelMeasurement
from smart_tire.estimation.slip.wheel_model import (
    plain_constraint, printed_constraint, TravelModel)
from smart_tire.parameters import RobotParams
from support.slip_state import random_state

DURATION = 0.0625
WHEELS = WheelMeasurement(
    DURATION, (1.1, 0.6), 0.8, 0.9, 1e-6, 0.004, (0.0002, -0.0001), from_positions=True)
MODEL = TravelModel(RobotParams())


@pytest.mark.parametrize('seed', range(3))
def test_jacobian_equals_finite_differences(seed):
    state, step = random_state(seed), 1e-6
    _, expected, H, _ = MODEL.linearize(state.tolist(), WHEELS, 0.0)
    for column in range(N):
        moved = state.copy()
        moved[column] += step
        derivative = (MODEL.linearize(moved.tolist(), WHEELS, 0.0).expected - expected) / step
        assert derivative == pytest.approx(H[:, column], abs=1e-6), State(column)


def test_the_distance_until_the_sample_is_that_of_the_state_without_the_one_since_then():
    x = [0.0] * N
    x[State.V_X], x[State.SLIP_VEL_L], x[State.SLIP_VEL_R] = 0.8, 0.25, -0.175
    x[State.TRAVEL_L], x[State.TRAVEL_R] = 0.0744, 0.0374
    z, expected, _, _ = MODEL.linearize(x, WHEELS, 0.0)
    assert z == pytest.approx([DURATION * 1.1, DURATION * 0.6])
    assert expected == pytest.approx([0.07, 0.035])


def test_velocities_carry_timestamp_jitter_of_both_samples_in_their_covariance():
    exact = MODEL.linearize([0.0] * N, WHEELS, 0.0)
    jittered = MODEL.linearize([0.0] * N, replace(WHEELS, from_positions=False), 0.0)
    assert np.all(np.diag(jittered.R) > np.diag(exact.R))
    assert jittered.R[0, 1] == 0.0
    assert np.diag(MODEL.linearize([0.0] * N, WHEELS, 1.0).R) == pytest.approx(
        np.diag(exact.R) + DURATION ** 2)


def test_a_late_timestamp_displaces_both_sides_by_their_speeds():
    R = MODEL.linearize([0.0] * N, WHEELS, 0.0).R
    jitter = RobotParams().encoder.stamp_jitter
    assert R[0, 1] == pytest.approx(jitter ** 2 * 1.1 * 0.6)
    assert R[0, 0] - R[1, 1] == pytest.approx(jitter ** 2 * (1.1 ** 2 - 0.6 ** 2))


def test_the_printed_constraint_drops_slip_of_a_faster_braking_or_slower_driving_side():
    x = np.zeros(N)
    x[list(SLIP_VELS)] = -0.1, -0.05  # left is faster and brakes, right is slower and brakes
    x[list(TRAVELS)] = 0.07, 0.035
    wheels = replace(WHEELS, lag=0.0, travel_change=(0.0, 0.0))
    sides = MODEL.linearize(x.tolist(), wheels, 0.0)
    printed = printed_constraint(sides, x, DURATION)
    assert printed.z == pytest.approx([0.85 * DURATION, -0.5 * DURATION])  # mean and difference
    # travel contains the slip: without it the distance rolled is that over ground
    assert printed.H[0, State.SLIP_VEL_L] == pytest.approx(-0.5 * DURATION)
    assert printed.H[0, State.SLIP_VEL_R] == 0.0
    assert printed.expected[0] == pytest.approx(sides.expected.mean() + 0.05 * DURATION)
    assert plain_constraint(sides, x, DURATION) is sides
