"""Measurement model of the side speeds, B(7), plain and as printed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.robust_ekf import Measurement
from smart_tire.estimation.slip.state import N, SIDE_SIGNS, SLIP_VELS, State, WheelMeasurement
from smart_tire.parameters import RobotParams

WHEEL_SPEED_SIGMA = 0.003  # m/s, of a side, in addition to quantization and timestamps


class SideSpeedModel:
    """
    Speed of each side: that of its wheel centers over ground plus its slip velocity.

    Differenced positions also depend on the errors of both timestamps, which are states.
    """

    def __init__(self, robot: RobotParams) -> None:
        self._stamp_jitter = robot.encoder.stamp_jitter
        # m, lever arms of the yaw rate in v_x of the left and of the right side, at the IMU
        self.arms = [robot.imu.position[1] + sign * 0.5 * robot.track_width
                     for sign in SIDE_SIGNS]

    def ground_speeds(self, wheels: WheelMeasurement) -> list[float]:
        """Return the mean v_x [m/s] of both sides' wheel centers over the period of ``wheels``."""
        return [wheels.ground_speed + arm * wheels.yaw_rate for arm in self.arms]

    def linearize(self, x: Sequence[float], wheels: WheelMeasurement,
                  extra_variance: float) -> Measurement:
        """Return the side speeds as a measurement; ``extra_variance`` [m2/s2] is added to R."""
        H, expected = np.zeros((2, N)), np.zeros(2)
        for row, (arm, ground, slip_vel) in enumerate(
                zip(self.arms, self.ground_speeds(wheels), SLIP_VELS)):
            expected[row] = ground + x[slip_vel]
            H[row, State.V_X] = H[row, slip_vel] = 1.0
            H[row, State.GYRO_BIAS_Z] = -arm
            if wheels.from_positions:
                rate = expected[row] / wheels.duration
                expected[row] -= rate * (x[State.STAMP_ERROR] - x[State.PREV_STAMP_ERROR])
                H[row, State.STAMP_ERROR], H[row, State.PREV_STAMP_ERROR] = -rate, rate
        return Measurement(np.array(wheels.side_speeds), expected, H,
                           self._covariance(wheels, extra_variance))

    def _covariance(self, wheels: WheelMeasurement, extra_variance: float) -> Array:
        R = np.diag([wheels.variance + WHEEL_SPEED_SIGMA ** 2 + extra_variance] * 2)
        if not wheels.from_positions:
            jitter = math.sqrt(2.0) * self._stamp_jitter / wheels.duration
            R += np.diag([(jitter * speed) ** 2 for speed in wheels.side_speeds])
        return R


def plain_constraint(measurement: Measurement, x: Array) -> Measurement:
    """Return the side speeds unchanged."""
    return measurement


def printed_constraint(measurement: Measurement, x: Array) -> Measurement:
    """
    Return the side speeds as printed in B(7): the mean speed, with lambda', and the yaw rate.

    Lambda' is 0 for a faster side that brakes and for a slower side that drives. ``x`` (N,) is
    the state at which ``measurement`` was linearized.
    """
    z, expected, H, R = measurement
    mix = np.array([[0.5, 0.5], [-1.0, 1.0]])
    slip_vels = x[list(SLIP_VELS)]
    faster = np.abs(z) >= np.abs(z[::-1])
    dropped = np.where(faster, slip_vels * z < 0.0, slip_vels * z > 0.0)
    H, expected = mix @ H, mix @ expected
    expected[0] -= 0.5 * slip_vels[dropped].sum()
    H[0, np.array(SLIP_VELS)[dropped]] = 0.0
    return Measurement(mix @ z, expected, H, mix @ R @ mix.T)


CONSTRAINTS: dict[str, Callable[[Measurement, Array], Measurement]] = {
    'plain': plain_constraint, 'printed': printed_constraint}
