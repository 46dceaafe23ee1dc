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

"""Odometry, slip and ICR from a state of the slip EKF or of its smoother."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.kinematics import SlipKinematics
from smart_tire.estimation.slip.motion_model import MotionModel
from smart_tire.estimation.slip.state import ImuReading, State
from smart_tire.estimation.slip.stiffness_prior import StiffnessPrior
from smart_tire.estimation.streams import GROUND_STATE_PERIOD_NS
from smart_tire.models.vehicle.skid_steer import wheel_slip_ratio
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.rotation import quaternion
from smart_tire.samples import Four, GroundState, Icr, Odometry, Vector3, WheelSlip
from smart_tire.uncertain import Uncertain

MIN_YAW_RATE = 0.05        # rad/s; below, the ICR is too far away to be observable
OTHER_GROUND_SIGMA = 0.12  # of ln C_x far from the calibrated value, model; from simulated runs
DRIVE_ACCELERATION = 1.0   # m/s2, typical of a robot; not observable under more vibration
PLANAR_VARIANCE = 1e-6     # m^2, rad^2 and per s: height and its rate, zero in the plane

PLANAR_COVARIANCE = PLANAR_VARIANCE * np.eye(6)
POSE_INDICES = np.ix_([0, 1, 3, 4, 5], [0, 1, 3, 4, 5])  # of the planar pose in a ROS covariance
TWIST_INDICES = np.ix_([0, 1, 5], [0, 1, 5])
POSE_STATES = np.ix_(*[[State.X, State.Y, State.ROLL, State.PITCH, State.YAW]] * 2)

EstimateRecord = Odometry | WheelSlip | Icr | GroundState


@dataclass(frozen=True, slots=True)
class OutputContext:
    """Values needed for an output in addition to the state."""

    instant_ns: int       # of the output grid
    extrapolation: float  # s, from the time of the state to the instant
    imu: ImuReading       # last IMU sample
    vibration: float      # m/s2, standard deviation of its force in excess of the IMU's noise
    wheel_residual: Four  # m/s, speed of each wheel minus the mean of its side
    time: float           # s, of the state
    wheel_time: float     # s, center of the period of the last wheel measurement
    by_forces: bool = False  # the force balance is active: the slip is that of ``time``
    ground_known: bool = False  # the force balance is in use


class SlipOutputBuilder:
    """Builds the output records of the slip estimator."""

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._robot = params.robot
        self._measured = params.robot.joints.measured
        self._kinematics = SlipKinematics(params.robot)
        self._motion_model = MotionModel(params)
        self._stiffness_prior = StiffnessPrior(params)

    def build(self, context: OutputContext, x: Sequence[float], P: Array,
              slip_change_sigma: tuple[float, float] = (0.0, 0.0)) -> list[EstimateRecord]:
        """
        Return the records for a state ``x`` (N numbers) with covariance ``P`` (N, N).

        ``slip_change_sigma`` [m/s] is the standard deviation of each side's slip velocity change
        since the last wheel measurement, which ``P`` does not contain.
        """
        # vibration hides the acceleration of the robot, which is then extrapolated less
        accel_share = 1.0 / (1.0 + (context.vibration / DRIVE_ACCELERATION) ** 2)
        if context.ground_known:
            x, P = self._stiffness_prior.condition(x, P)
        x = self._motion_model.extrapolate(
            x, context.imu, context.extrapolation, accel_share)
        twist, covariance = self._kinematics.base_twist(x, P, context.imu.yaw_rate)
        records: list[EstimateRecord] = [
            self._odometry(context, x, P, twist, covariance),
            self._slip(context, x, P, slip_change_sigma)]
        if abs(twist[2]) > MIN_YAW_RATE:
            S = -twist[1] / twist[2] if context.by_forces else x[State.ICR_X]
            records.append(Icr(context.instant_ns, S, twist[0] / twist[2]))
        if context.ground_known and context.instant_ns % GROUND_STATE_PERIOD_NS == 0:
            records.append(self._ground(context, x, P))
        return records

    def _ground(self, context: OutputContext, x: Sequence[float], P: Array) -> GroundState:
        row, nominal = State.LN_STIFFNESS, self._robot.tire.longitudinal_stiffness
        sigma = math.sqrt(P[row, row])
        stiffness = nominal * math.exp(x[row])
        departure = min(1.0, abs(x[row]) / (
            2.0 * max(self._robot.tire.longitudinal_stiffness_sigma, 1e-3)))
        total = math.hypot(sigma, departure * OTHER_GROUND_SIGMA)
        covariances = self._kinematics.slip_covariances(x, P, context.imu.yaw_rate, row)
        slip_sigmas = self._kinematics.slip_sigmas(x, P, context.imu.yaw_rate)
        left, right = (min(max(covariance / max(total * slip_sigma, 1e-12), -1.0), 1.0)
                       for covariance, slip_sigma in zip(covariances, slip_sigmas))
        return GroundState(
            context.instant_ns, Uncertain(stiffness, stiffness * total),
            Uncertain(x[State.DRAG], math.sqrt(P[State.DRAG, State.DRAG])),
            (left, right))

    def _odometry(self, context: OutputContext, x: Sequence[float], P: Array, twist: Vector3,
                  covariance: Array) -> Odometry:
        v_x, v_y, W = twist
        pose, rates = PLANAR_COVARIANCE.copy(), PLANAR_COVARIANCE.copy()
        pose[POSE_INDICES] = P[POSE_STATES]
        rates[TWIST_INDICES] = covariance
        rates[5, 5] += self._robot.imu.gyro_noise ** 2  # of the sample that is published
        return Odometry(
            context.instant_ns, (x[State.X], x[State.Y], 0.0),
            quaternion(x[State.ROLL], x[State.PITCH], x[State.YAW]),
            (v_x, v_y, 0.0), (0.0, 0.0, W),
            tuple(pose.ravel().tolist()), tuple(rates.ravel().tolist()))

    def _slip(self, context: OutputContext, x: Sequence[float], P: Array,
              slip_change_sigma: tuple[float, float]) -> WheelSlip:
        ground = self._kinematics.side_speeds(x, context.imu.yaw_rate)
        sides = self._kinematics.wheel_speeds(x, context.imu.yaw_rate)
        sigmas: Sequence[float] = self._kinematics.slip_sigmas(x, P, context.imu.yaw_rate)
        standstill = self._robot.slip.standstill_speed
        # wheel i is on side i % 2: left, right, left, right
        wheels = [sides[i % 2] + context.wheel_residual[i] if measured else math.nan
                  for i, measured in enumerate(self._measured)]
        over_ground = (ground[0], ground[1], ground[0], ground[1])
        ratio = [wheel_slip_ratio(r, v, standstill) for r, v in zip(wheels, over_ground)]
        slip_velocity = [r - v for r, v in zip(wheels, over_ground)]
        sigmas = [min(1.0, math.hypot(sigma, change / max(abs(speed), standstill)))
                  for sigma, change, speed in zip(sigmas, slip_change_sigma, sides)]
        sigma = [1.0 if math.isnan(ratio[i]) else sigmas[i % 2] for i in range(4)]
        return WheelSlip(
            context.instant_ns, *(_four(values) for values in (ratio, slip_velocity, sigma)))


def _four(values: Sequence[float]) -> Four:
    a, b, c, d = values
    return a, b, c, d
