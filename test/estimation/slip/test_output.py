"""A report is of the grid instant, not of the last sample before it."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest

from smart_tire.estimation.slip.ekf import SlipFilter
from smart_tire.estimation.slip.output import OutputContext, SlipReport
from smart_tire.estimation.slip.state import ImuStep, N, State
from smart_tire.models.vehicle.skid_steer import GRAVITY
from smart_tire.parameters import build, RobotParams, SlipEstimatorParams
from smart_tire.samples import Icr

SEEN = OutputContext(0, 0.008, 0.8, (1.4, 0.9), 0.0, (0.0,) * 4, 1.0, 0.95)
REPORT = SlipReport(RobotParams())


def filter_at(seed=1):
    """Return a filter that has driven a little."""
    moved = SlipFilter(build(SlipEstimatorParams, {}))
    rng = np.random.default_rng(seed)
    for _ in range(200):
        moved.predict(0.01, ImuStep(0.5 + 0.1 * rng.normal(), 0.4, 0.2, 1e-6, 2.5e-5, 1e-3))
    return moved


def test_pose_and_speeds_are_those_that_the_filter_would_predict():
    moved = filter_at()
    odometry = REPORT.estimates(SEEN, moved.x, moved.P)[0]
    moved.predict(SEEN.ahead, ImuStep(SEEN.gyro_z, *SEEN.force, 1e-6, 2.5e-5, 1e-3))
    expected = REPORT.estimates(replace(SEEN, ahead=0.0), moved.x, moved.P)[0]
    assert odometry.position == pytest.approx(expected.position, abs=1e-6)
    assert odometry.linear == pytest.approx(expected.linear, abs=1e-4)
    assert odometry.orientation == pytest.approx(expected.orientation, abs=1e-4)


def test_a_robot_that_shakes_is_not_carried_away_by_one_reading():
    moved = filter_at()
    calm, shaken = (REPORT.estimates(replace(SEEN, shaking=shaking), moved.x, moved.P)[0]
                    for shaking in (0.0, 10.0))
    change = [odometry.linear[0] - REPORT.estimates(
        replace(SEEN, ahead=0.0), moved.x, moved.P)[0].linear[0] for odometry in (calm, shaken)]
    assert abs(change[1]) < 0.02 * abs(change[0])


def test_gravity_and_biases_do_not_accelerate():
    x = [0.0] * N
    x[State.V_X], x[State.ACCEL_BIAS_X], x[State.PITCH] = 0.5, 0.05, 0.02
    seen = replace(SEEN, gyro_z=0.0, force=(0.05 - GRAVITY * 0.02, 0.0))
    odometry, slip = REPORT.estimates(seen, x, 1e-4 * np.eye(N))
    assert odometry.linear[0] == pytest.approx(0.5)
    assert slip.ratio == pytest.approx((0.0,) * 4)


def test_the_centre_of_rotation_shows_only_while_the_robot_turns():
    x = [0.0] * N
    x[State.V_X], x[State.ICR_X] = 0.5, 0.03
    for rate, shown in ((0.5, True), (0.01, False)):
        estimates = REPORT.estimates(replace(SEEN, gyro_z=rate, ahead=0.0), x, 1e-4 * np.eye(N))
        centres = [estimate for estimate in estimates if isinstance(estimate, Icr)]
        assert bool(centres) == shown
        assert all(math.isclose(centre.x, 0.03) for centre in centres)


def test_what_the_wheels_may_do_unseen_widens_the_slip_but_never_beyond_one():
    x = [0.0] * N
    x[State.V_X] = 0.5
    sigmas = [REPORT.estimates(SEEN, x, 1e-6 * np.eye(N), unseen)[1].sigma
              for unseen in ((0.0, 0.0), (0.05, 0.0), (9.0, 0.0))]
    assert sigmas[1][1] == sigmas[0][1]
    speed = 0.5 + SEEN.gyro_z * (RobotParams().imu.position[1] - 0.19) + SEEN.force[0] * 0.008
    assert sigmas[1][0] == pytest.approx(math.hypot(sigmas[0][0], 0.05 / speed), rel=0.02)
    assert sigmas[2][0] == 1.0
