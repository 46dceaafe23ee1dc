"""Side speed model: Jacobian against finite differences, and the printed constraint."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.state import N, SLIP_VELS, State, WheelMeasurement
from smart_tire.estimation.slip.wheel_model import (
    plain_constraint, printed_constraint, SideSpeedModel)
from smart_tire.parameters import RobotParams
from support.slip_state import random_state

WHEELS = WheelMeasurement(0.0625, (1.1, 0.6), 0.8, 0.9, 1e-6, from_positions=True)
MODEL = SideSpeedModel(RobotParams())


@pytest.mark.parametrize('seed', range(3))
def test_jacobian_equals_finite_differences(seed):
    state, step = random_state(seed), 1e-6
    _, expected, H, _ = MODEL.linearize(state.tolist(), WHEELS, 0.0)
    for column in (State.SLIP_VEL_L, State.SLIP_VEL_R, State.STAMP_ERROR, State.PREV_STAMP_ERROR):
        moved = state.copy()
        moved[column] += step
        derivative = (MODEL.linearize(moved.tolist(), WHEELS, 0.0).expected - expected) / step
        assert derivative == pytest.approx(H[:, column], abs=0.3)


def test_velocities_carry_timestamp_jitter_in_their_covariance():
    by_velocity = WheelMeasurement(0.0625, (1.1, 0.6), 0.8, 0.9, 1e-6, from_positions=False)
    exact = MODEL.linearize([0.0] * N, WHEELS, 0.0)
    jittered = MODEL.linearize([0.0] * N, by_velocity, 0.0)
    assert np.all(np.diag(jittered.R) > np.diag(exact.R))
    assert not jittered.H[:, State.STAMP_ERROR].any()
    assert np.diag(MODEL.linearize([0.0] * N, WHEELS, 1.0).R) == pytest.approx(
        np.diag(exact.R) + 1.0)


def test_the_printed_constraint_drops_slip_of_a_faster_braking_or_slower_driving_side():
    x = np.zeros(N)
    x[list(SLIP_VELS)] = -0.1, -0.05  # left is faster and brakes, right is slower and brakes
    sides = MODEL.linearize(x.tolist(), WHEELS, 0.0)
    printed = printed_constraint(sides, x)
    assert printed.z == pytest.approx([0.85, -0.5])  # mean and difference
    assert printed.H[0, State.SLIP_VEL_L] == 0.0 and printed.H[0, State.SLIP_VEL_R] == 0.5
    assert printed.expected[0] == pytest.approx(sides.expected.mean() + 0.05)
    assert plain_constraint(sides, x) is sides
