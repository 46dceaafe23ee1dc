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

"""Slip EKF: effect of each correction."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.ekf import SlipFilter
from smart_tire.estimation.slip.state import ImuReading, ImuStep, N, State, WheelMeasurement
from smart_tire.parameters import build, SlipEstimatorParams
from support.slip_state import random_state

IMU = ImuStep(ImuReading(0.8, 0.4, 0.9), 1e-6, 2.5e-5, 1e-3)


def new_filter(state=None, **values):
    slip_filter = SlipFilter(build(SlipEstimatorParams, values))
    if state is not None:
        slip_filter._ekf.predict(np.array(state, dtype=float), np.eye(N), np.zeros((N, N)))
    return slip_filter


def roll(slip_filter, side_speeds, duration=0.0625):
    """Predict without acceleration, then correct with the speeds of both sides [m/s]."""
    slip_filter.predict(duration, ImuStep(ImuReading(0.0, 0.0, 0.0), 1e-6, 2.5e-5, 1e-3))
    slip_filter.correct_wheels(WheelMeasurement(
        duration, side_speeds, slip_filter.x[State.V_X], 0.0, 1e-8, 0.0, (0.0, 0.0),
        from_positions=True))


def test_wheel_speeds_determine_the_speed_if_slip_is_impossible():
    slip_filter = new_filter(differential_slip_sigma=1e-3)
    for _ in range(20):
        roll(slip_filter, (0.5, 0.5))
    assert slip_filter.x[State.V_X] == pytest.approx(0.5, abs=0.02)


def test_a_late_timestamp_hardly_changes_the_slip_after_the_next_sample():
    state = np.zeros(N)
    state[State.V_X] = 0.5
    late = 3.0 * SlipEstimatorParams().robot.encoder.stamp_jitter / 0.0625
    slips = []
    for errors in (0.0, 0.0), (late, -late), (late, late):
        slip_filter = new_filter(state)
        for error in (*[0.0] * 40, *errors):
            roll(slip_filter, (0.5 * (1.0 + error),) * 2)
        slips.append(slip_filter.x[State.SLIP_VEL_L] + slip_filter.x[State.V_X])
    assert abs(slips[1] - slips[0]) < 0.2 * abs(slips[2] - slips[0])


def rolling_by_forces():
    """Return a filter that rolls straight at 0.8 m/s with the balance of forces."""
    state = np.zeros(N)
    state[State.V_X] = 0.8
    slip_filter = new_filter(state, force_balance='on')
    slip_filter.forces.active = True
    for _ in range(40):
        roll(slip_filter, (0.8, 0.8))
    return slip_filter


def test_wheels_that_contradict_the_difference_of_slips_change_it_within_one_sample():
    slip_filter = rolling_by_forces()
    roll(slip_filter, (0.6, 1.0))
    x, sigma = slip_filter.x, np.sqrt(np.diag(slip_filter.P))
    assert x[State.SLIP_VEL_R] - x[State.SLIP_VEL_L] == pytest.approx(0.4, abs=0.05)
    assert sigma[State.SLIP_VEL_R] > 0.05  # it may have changed before or after the mean
    for _ in range(5):
        roll(slip_filter, (0.6, 1.0))
    assert slip_filter.nis < 2.0  # the change has not cast doubt on the wheels
    x = slip_filter.x
    assert x[State.SLIP_VEL_R] - x[State.SLIP_VEL_L] == pytest.approx(0.4, abs=0.02)


def test_a_difference_within_two_sigmas_is_no_change_of_slip():
    slip_filter = rolling_by_forces()
    before = np.sqrt(slip_filter.P[State.SLIP_VEL_L, State.SLIP_VEL_L])
    roll(slip_filter, (0.799, 0.801))
    assert np.sqrt(slip_filter.P[State.SLIP_VEL_L, State.SLIP_VEL_L]) < 1.1 * before


def test_lateral_correction_converges_to_minus_s_times_the_yaw_rate():
    state = np.zeros(N)
    state[State.ICR_X] = 0.05
    slip_filter = new_filter(state, icr_x_sigma=1e-6, **{'imu.position': [0.0, 0.0, 0.0]})
    for _ in range(50):
        slip_filter.correct_lateral(1.0, 0.0625)
    assert slip_filter.x[State.V_Y] == pytest.approx(-0.05, abs=2e-3)


def test_a_sudden_change_of_the_icr_is_tracked_within_its_sigma():
    W, v_x, dt, S = 1.0, 0.8, 0.01, 0.03
    state = np.zeros(N)
    state[[State.V_X, State.V_Y, State.ICR_X]] = v_x, -S * W, S
    slip_filter = new_filter(
        state, **{'imu.position': [0.0, 0.0, 0.0], 'imu.accel_bias': 0.001})
    for step in range(600):
        before, S = S, 0.03 if step < 500 else min(S + 0.003, 0.10)  # in a quarter of a second
        slip_filter.predict(dt, ImuStep(
            ImuReading(W, S * W ** 2, W * v_x - W * (S - before) / dt), 1e-6, 2.5e-5, 1e-4))
        if step % 6 == 0:
            slip_filter.correct_lateral(W, 6 * dt)
        if step == 499:
            settled = np.sqrt(slip_filter.P[State.ICR_X, State.ICR_X])
            assert abs(slip_filter.x[State.ICR_X] - 0.03) < 2.0 * settled
    sigma = np.sqrt(slip_filter.P[State.ICR_X, State.ICR_X])
    assert abs(slip_filter.x[State.ICR_X] - 0.10) < min(2.0 * sigma, 0.03)
    assert abs(slip_filter.x[State.V_Y] + 0.10 * W) < 2.0 * np.sqrt(
        slip_filter.P[State.V_Y, State.V_Y])


def test_an_outlier_changes_the_state_less_than_a_measurement_at_the_gate():
    moved = []
    for speed in (0.5, 1e3):
        slip_filter = new_filter()
        slip_filter.correct_zero_velocity()
        slip_filter.correct_gyro_bias(speed, 0.01)
        moved.append(abs(slip_filter.x[State.GYRO_BIAS_Z]))
    assert moved[1] < moved[0]


def test_reset_pose_clears_the_pose_and_keeps_the_speed():
    slip_filter = new_filter(random_state(1))
    slip_filter.predict(0.1, IMU)
    speed = slip_filter.x[State.V_X]
    slip_filter.reset_pose()
    pose = [State.X, State.Y, State.YAW]
    assert [slip_filter.x[row] for row in pose] == [0.0, 0.0, 0.0]
    assert np.all(slip_filter.P[pose, pose] < 1e-7)
    assert np.count_nonzero(slip_filter.P[pose, :]) == 3
    assert slip_filter.x[State.V_X] == speed
