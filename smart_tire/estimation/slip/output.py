"""From a state of the slip filter, or of its smoother, to odometry, slip and ICR."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.kinematics import SlipKinematics
from smart_tire.estimation.slip.state import State
from smart_tire.models.vehicle.skid_steer import GRAVITY, wheel_slip_ratio
from smart_tire.parameters import RobotParams
from smart_tire.rotation import quaternion
from smart_tire.samples import Four, Icr, Odometry, Vector3, WheelSlip

TURNING = 0.05          # rad/s; slower, the ICR is too far away to be told
DRIVEN = 1.0            # m/s2, by which robots change their speed; shaking beyond hides it
PLANAR_VARIANCE = 1e-6  # m^2, rad^2 and per s: height and its rate, zero in the plane

PLANAR = PLANAR_VARIANCE * np.eye(6)
POSE_TO, TWIST_TO = np.ix_([0, 1, 3, 4, 5], [0, 1, 3, 4, 5]), np.ix_([0, 1, 5], [0, 1, 5])
POSE_FROM = np.ix_(*[[State.X, State.Y, State.ROLL, State.PITCH, State.YAW]] * 2)

Estimate = Odometry | WheelSlip | Icr


@dataclass(frozen=True, slots=True)
class OutputContext:
    """What was known besides the state when an estimate was made."""

    instant_ns: int    # of the grid
    ahead: float       # s, from the time of the state to the instant
    gyro_z: float      # rad/s, rate of the last sample in base axes, bias not removed
    force: tuple[float, float]  # m/s2, specific force x, y, likewise
    shaking: float     # m/s2, one sigma of what is in it beside the unit's noise
    beyond_side: Four  # m/s, speed of each wheel beyond its side's mean
    time: float        # s, of the state
    wheels_at: float   # s, middle of the time that the last wheel reading describes


class SlipReport:
    """Writes the messages of the slip estimator."""

    def __init__(self, robot: RobotParams) -> None:
        self._robot = robot
        self._kinematics = SlipKinematics(robot)
        self._x_imu, self._y_imu = robot.imu.position[0], robot.imu.position[1]

    def estimates(self, seen: OutputContext, x: Sequence[float], P: Array,
                  unseen: tuple[float, float] = (0.0, 0.0)) -> list[Estimate]:
        """
        Return what a state ``x`` (N numbers) and its covariance ``P`` (N, N) tell.

        ``unseen`` [m/s] is one sigma of each side's sliding beyond that, by which it may have
        changed since the wheels were read.
        """
        x = self._carried(seen, x)
        twist, covariance = self._kinematics.base_twist(x, P, seen.gyro_z)
        estimates: list[Estimate] = [
            self._odometry(seen, x, P, twist, covariance), self._slip(seen, x, P, unseen)]
        if abs(twist[2]) > TURNING:
            estimates.append(Icr(seen.instant_ns, x[State.ICR_X], twist[0] / twist[2]))
        return estimates

    def _carried(self, seen: OutputContext, x: Sequence[float]) -> list[float]:
        """Return the state carried ahead to the grid instant, as far as shaking lets one see."""
        dt, W = seen.ahead, seen.gyro_z - x[State.GYRO_BIAS_Z]
        v_x, v_y, yaw = x[State.V_X], x[State.V_Y], x[State.YAW] + 0.5 * W * dt
        share = 1.0 / (1.0 + (seen.shaking / DRIVEN) ** 2)
        a_x = share * (seen.force[0] - x[State.ACCEL_BIAS_X] + W * v_y + GRAVITY * x[State.PITCH])
        a_y = share * (seen.force[1] - x[State.ACCEL_BIAS_Y] - W * v_x - GRAVITY * x[State.ROLL])
        b_x = v_x + 0.5 * a_x * dt + self._y_imu * W
        b_y = v_y + 0.5 * a_y * dt - self._x_imu * W
        carried = list(x)
        carried[State.X] += (b_x * math.cos(yaw) - b_y * math.sin(yaw)) * dt
        carried[State.Y] += (b_x * math.sin(yaw) + b_y * math.cos(yaw)) * dt
        carried[State.YAW] += W * dt
        carried[State.V_X] += a_x * dt
        carried[State.V_Y] += a_y * dt
        return carried

    def _odometry(self, seen: OutputContext, x: Sequence[float], P: Array, twist: Vector3,
                  covariance: Array) -> Odometry:
        v_x, v_y, W = twist
        pose, rates = PLANAR.copy(), PLANAR.copy()
        pose[POSE_TO] = P[POSE_FROM]
        rates[TWIST_TO] = covariance
        rates[5, 5] += self._robot.imu.gyro_noise ** 2  # of the sample that is shown
        return Odometry(
            seen.instant_ns, (x[State.X], x[State.Y], 0.0),
            quaternion(x[State.ROLL], x[State.PITCH], x[State.YAW]),
            (v_x, v_y, 0.0), (0.0, 0.0, W),
            tuple(pose.ravel().tolist()), tuple(rates.ravel().tolist()))

    def _slip(self, seen: OutputContext, x: Sequence[float], P: Array,
              unseen: tuple[float, float]) -> WheelSlip:
        ground = self._kinematics.side_speeds(x, seen.gyro_z)
        sides = self._kinematics.wheel_speeds(x, seen.gyro_z)
        sigmas: Sequence[float] = self._kinematics.slip_sigmas(x, P, seen.gyro_z)
        standstill = self._robot.slip.standstill_speed
        # wheel i is on side i % 2: left, right, left, right
        rolling = [sides[i % 2] + seen.beyond_side[i] for i in range(4)]
        over = (ground[0], ground[1], ground[0], ground[1])
        ratio = [wheel_slip_ratio(r, v, standstill) for r, v in zip(rolling, over)]
        sliding = [r - v for r, v in zip(rolling, over)]
        sigmas = [min(1.0, math.hypot(sigma, more / max(abs(speed), standstill)))
                  for sigma, more, speed in zip(sigmas, unseen, sides)]
        sigma = [1.0 if math.isnan(ratio[i]) else sigmas[i % 2] for i in range(4)]
        return WheelSlip(seen.instant_ns, *(_four(values) for values in (ratio, sliding, sigma)))


def _four(values: Sequence[float]) -> Four:
    a, b, c, d = values
    return a, b, c, d
