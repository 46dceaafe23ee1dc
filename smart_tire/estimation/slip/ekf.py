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

"""
Extended Kalman filter for the slip, the pose and the sensor biases of a skid-steer robot.

The IMU drives the prediction, B(5); wheel speeds, the lateral constraint (ICR) and standstill are
the corrections, B(6)-(8). Three choices make it robust:

- The slip of a side is represented by its slip velocity ``r w - v_x`` [m/s]. Wheel speeds are then
  linear in the state, for locked and for spinning wheels too, and no noisy wheel speed enters a
  Jacobian. The slip ratio B(3) is derived on output.
- The robot moves in the plane of the ground, so B(6) holds by construction.
- The distance rolled since the last wheel sample is a state: one late timestamp makes one wheel
  speed too high and the next one too low, so that the errors cancel, and the slip may change
  between two samples.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.force_update import ForceUpdate
from smart_tire.estimation.slip.kinematics import SlipKinematics
from smart_tire.estimation.slip.motion_model import (
    DRAG_MEAN, DRAG_SIGMA, IDLE_SIGMAS, MotionModel, SOFT_GROUND_CORRELATION)
from smart_tire.estimation.slip.robust_ekf import Measurement, RobustEkf, StateRecorder
from smart_tire.estimation.slip.slip_process import (
    FreeRollingPrior, InnovationChangeDetector, SLIP_SETTLING_TIME, SlipProcess)
from smart_tire.estimation.slip.slope_spread import SLOPE_CORRELATION_LENGTH
from smart_tire.estimation.slip.state import (
    DelayedSpeed, ImuStep, N, SLIP_VEL_ROWS, SLIP_VELS, State, TORQUE_OFFSETS, TRAVELS,
    WheelMeasurement)
from smart_tire.estimation.slip.wheel_model import (
    CONSTRAINTS, plain_constraint, travel_after, TravelModel)
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import SlipEstimatorParams

MOUNTING_TILT_SIGMA = 0.009     # rad, of the IMU: half a degree
MIN_POSE_SIGMA = 1e-4           # m, rad: the origin is exact, but P must not be singular
INITIAL_SPEED_SIGMA = 0.5       # m/s
NIS_INFLATION = 0.1             # share of wheel speed added to sigma per unit NIS above 1
ICR_CHANGE_SHARE = 0.1          # sigma of the change of S with the slips, over the wheelbase
ICR_CHANGE_SIGMAS = 1.5         # exceeded twice in a row with one sign: S has changed
ZERO_VELOCITY_SIGMA = 0.003     # m/s, of the zero-velocity update
FREE_ROLLING_CORRELATION_TIME = 2.0  # s, of the slip of freely rolling wheels
MIN_PRIOR_INFORMATION = 0.01    # -, below, the free-rolling prior is not worth a correction
STRAIGHT_YAW_RATE = 0.1         # rad/s, below which S is hardly observable
SLIP_CHANGE_SIGMAS = 2.0        # of an innovation, beyond which a difference of slips changed
NIS_GAIN = 0.05                 # weight of a new value in the smoothed NIS
TRAVEL_RESET_SIGMA = 1e-5       # m, so that P is not singular
TORQUE_OFFSET_SIGMA = 0.02      # N m, of measured torques
FRICTION_ERROR_SHARE = 0.1      # relative sigma of the Coulomb friction: temperature, wear


class SlipFilter:
    """Prediction and corrections of the slip EKF; time enters as durations only."""

    def __init__(self, params: SlipEstimatorParams, recorder: StateRecorder | None = None) -> None:
        self._params = params
        self._x_imu = params.robot.imu.position[0]
        self._kinematics = SlipKinematics(params.robot)
        self.motion_model = MotionModel(params)
        self._travel_model = TravelModel(params.robot)
        self._constraint = CONSTRAINTS[params.constraint]
        self._slip_process = SlipProcess(params)
        self._icr_change = InnovationChangeDetector(ICR_CHANGE_SIGMAS)
        self._accel_density = 0.0  # (m/s2)^2 s, of the last prediction
        self._slope_sigma = params.slope_sigma  # rad, of the last prediction
        self._ekf = RobustEkf(*initial_state(params), recorder, considered=(State.TORQUE_SCALE,))
        self.forces = ForceUpdate(params, self._ekf)
        self.nis = 1.0  # normalized innovation squared of the wheel speeds, smoothed

    @property
    def x(self) -> list[float]:
        """Return the state in the order of ``State``."""
        values: list[float] = self._ekf.x.tolist()
        return values

    @property
    def P(self) -> Array:
        """Return the covariance of the state, shape (N, N)."""
        return self._ekf.P

    def reset_pose(self) -> None:
        """Set the pose to the origin of ``odom``."""
        self._ekf.set_states([State.X, State.Y, State.YAW], 0.0, MIN_POSE_SIGMA)

    def predict(self, dt: float, step: ImuStep) -> None:
        """Predict over ``dt`` [s] with the motion model."""
        self._accel_density, self._slope_sigma = step.accel_variance, step.slope_sigma
        self.motion_model.by_forces = self.forces.active
        predicted, F, Q = self.motion_model.predict(self.x, step, dt)
        self._ekf.predict(np.array(predicted), F, Q)

    def correct_wheels(self, wheels: WheelMeasurement) -> None:
        """Correct with the distances rolled between two wheel samples, B(7)."""
        extra_variance = self._wheel_noise_inflation(wheels)
        sides = self._travel_model.linearize(self.x, wheels, extra_variance)
        if self.forces.active:  # they show a change of the common slip at once
            self._inflate_slip_difference(wheels, sides)
        else:
            self._inflate_slip(wheels, sides)
        sides = self._travel_model.linearize(self.x, wheels, extra_variance)
        self.forces.detect_ground_change(sides)
        nis = self._ekf.correct(self._constraint(sides, self._ekf.x, wheels.duration))
        self._restart_travel(wheels)
        if max(map(abs, wheels.side_speeds)) >= self._params.robot.slip.standstill_speed:
            self.nis += NIS_GAIN * (nis - self.nis)  # stationary wheels have no noise

    def _wheel_noise_inflation(self, wheels: WheelMeasurement) -> float:
        """
        Return extra wheel-speed variance [m2/s2] while the smoothed NIS exceeds 1.

        Timestamp errors and latency of recordings from other robots are poorly known.
        """
        return (NIS_INFLATION * max(0.0, self.nis - 1.0) * max(map(abs, wheels.side_speeds))) ** 2

    def _restart_travel(self, wheels: WheelMeasurement) -> None:
        """
        Count the rolled distance from the wheel sample on.

        Positions are exact references, whatever the error of their timestamps. Without them, and
        with the constraint as printed, which is one of speeds, it is counted from the timestamp.
        """
        x, F, Q = self._ekf.x.copy(), np.eye(N), np.zeros((N, N))
        for travel, slip_vel, speed, after in zip(
                TRAVELS, SLIP_VELS, wheels.side_speeds, travel_after(self.x, wheels)):
            Q[travel, travel] = TRAVEL_RESET_SIGMA ** 2
            if wheels.from_positions and self._constraint is plain_constraint:
                x[travel] -= wheels.duration * speed
            else:
                x[travel] = after
                F[travel, travel] = 0.0
                F[travel, State.V_X] = F[travel, slip_vel] = wheels.lag
        self._ekf.predict(x, F, Q)

    def _inflate_slip(self, wheels: WheelMeasurement, sides: Measurement) -> None:
        """
        Inflate the slip velocities after a change of wheel or ground speed, or of innovations.

        They decay towards zero by the same share: with inflation alone the wheels would no longer
        constrain the speed, which the accelerometer of a vibrating robot would let diverge.
        """
        dt = wheels.duration
        variance = np.diag(sides.H @ self._ekf.P @ sides.H.T + sides.R) / dt ** 2
        slope_density = (GRAVITY ** 2 * float(self._ekf.P[State.PITCH, State.PITCH])
                         * SLIP_SETTLING_TIME)
        share, prior = self._slip_process.update(
            wheels, self._travel_model.ground_speeds(wheels), (sides.z - sides.expected) / dt,
            np.sqrt(variance), self._accel_density + slope_density)
        F, Q = np.eye(N), np.zeros((N, N))
        since = dt + wheels.lag  # s, from a change at the start of the period to the state's time
        for row, travel in zip(SLIP_VELS, TRAVELS):
            F[row, row] = math.sqrt(1.0 - share)
            F[travel, row] = since * (F[row, row] - 1.0)
        rows = [*SLIP_VELS, *TRAVELS]
        Q[np.ix_(rows, rows)] = share * np.kron([[1.0, since], [since, since ** 2]], prior)
        Q[State.ICR_X, State.ICR_X] = share * (
            ICR_CHANGE_SHARE * self._params.robot.wheelbase) ** 2
        self._ekf.predict(F @ self._ekf.x, F, Q)

    def _inflate_slip_difference(self, wheels: WheelMeasurement, sides: Measurement) -> None:
        """
        Inflate the difference of the slip velocities if the wheels contradict it.

        It changes with the wheel speeds in turns, which no force shows; it may have changed at
        the start of the period.
        """
        difference = np.array([-1.0, 1.0])
        variance = difference @ (sides.H @ self._ekf.P @ sides.H.T + sides.R) @ difference
        innovation = float(difference @ (sides.z - sides.expected))
        if innovation ** 2 < SLIP_CHANGE_SIGMAS ** 2 * variance:
            return
        since = wheels.duration + wheels.lag
        change = np.zeros(N)
        change[SLIP_VEL_ROWS] = 0.5 * difference * innovation / wheels.duration
        change[list(TRAVELS)] = since * change[SLIP_VEL_ROWS]
        self._ekf.predict(self._ekf.x, np.eye(N), np.outer(change, change))

    def inflate_slope(self, before: float, after: float) -> None:
        """
        Inflate slope and common slip: the standard deviation of the slope has been too small.

        It changes from ``before`` to ``after`` [rad]. Common slip has been inferred from the
        accelerometer as if the ground were more level; with the speed over ground it loses its
        evidence in proportion, while the wheel speeds stay.
        """
        common = np.zeros(N)
        common[State.V_X], common[SLIP_VEL_ROWS] = 1.0, -1.0
        slip_vel = 0.5 * float(self._ekf.x[SLIP_VEL_ROWS].sum())
        Q = (1.0 - (before / after) ** 2) * slip_vel ** 2 * np.outer(common, common)
        Q[State.ROLL, State.ROLL] = Q[State.PITCH, State.PITCH] = after ** 2 - before ** 2
        self._ekf.predict(self._ekf.x, np.eye(N), Q)

    def correct_free_rolling(self, duration: float, gyro_z: float,
                             radius_variance: float = 0.0) -> FreeRollingPrior | None:
        """
        Correct with a pseudo-measurement: freely rolling wheels have near-zero common slip.

        In straight driving the common slip is otherwise unobservable. The prior depends on the
        probability of firm ground given the estimated slip, so that slip observed before (when
        starting, in a turn, on another surface) is kept. ``radius_variance`` [-] is the variance
        of apparent slip due to the wheel radius. Return the prior; None if the wheels are
        stationary.
        """
        left, right = self._kinematics.wheel_speeds(self.x, gyro_z)
        speed = 0.5 * (abs(left) + abs(right))
        if speed < self._params.robot.slip.standstill_speed:
            return None
        H = np.zeros((1, N))
        H[0, SLIP_VEL_ROWS] = 0.5 / speed
        slip = float(H[0] @ self._ekf.x)
        variance = float(H[0] @ self._ekf.P @ H[0])
        self._slip_process.prior.update_soft_ground(slip, variance, duration)
        prior = self._slip_process.prior.free_rolling(
            slip, variance, (right - left) / speed, radius_variance, self._slope_sigma)
        if prior.information > MIN_PRIOR_INFORMATION:
            R = FREE_ROLLING_CORRELATION_TIME / (prior.information * duration)
            self._correct_scalar(0.0, slip, H, R)
        return prior

    def correct_lateral(self, gyro_z: float, duration: float) -> None:
        """Correct with B(8): the lateral speed of base_link is -S times the yaw rate."""
        x = self.x
        W = gyro_z - x[State.GYRO_BIAS_Z]
        H = np.zeros((1, N))
        H[0, State.V_Y] = 1.0
        H[0, State.ICR_X] = W
        H[0, State.GYRO_BIAS_Z] = self._x_imu - x[State.ICR_X]
        expected = x[State.V_Y] - (self._x_imu - x[State.ICR_X]) * W
        variance = self._params.lateral_sigma ** 2 * 0.1 / max(duration, 1e-3)
        change = self._icr_change.update(
            expected, math.sqrt(float((H @ self._ekf.P @ H.T)[0, 0]) + variance))
        if change > 0.0:  # S has changed, or, in straight driving, the robot slips sideways
            Q = np.zeros((N, N))
            Q[State.ICR_X, State.ICR_X] = change / (W ** 2 + STRAIGHT_YAW_RATE ** 2)
            self._ekf.predict(self._ekf.x, np.eye(N), Q)
            variance += change / (1.0 + (W / STRAIGHT_YAW_RATE) ** 2)
        self._correct_scalar(0.0, expected, H, variance)

    def correct_delayed_speed(self, delayed: DelayedSpeed) -> None:
        """Correct with a speed over ground at an earlier time, as measured by the films."""
        x, H = self.x, np.zeros((1, N))
        arm = self._travel_model.arms[delayed.side]
        expected = (x[State.V_X] - delayed.speed_change
                    + arm * (delayed.gyro_z - x[State.GYRO_BIAS_Z]))
        H[0, State.V_X], H[0, State.GYRO_BIAS_Z] = 1.0, -arm
        H[0, State.V_Y] = -delayed.yaw_change
        H[0, State.ACCEL_BIAS_X] = delayed.elapsed
        H[0, State.PITCH] = -GRAVITY * delayed.elapsed
        slope_change = (2.0 * abs(delayed.speed) * delayed.elapsed / SLOPE_CORRELATION_LENGTH
                        * self._slope_sigma ** 2)  # rad^2, variance since then
        variance = delayed.variance + (GRAVITY * delayed.elapsed) ** 2 * slope_change / 3.0
        self._correct_scalar(delayed.speed, expected, H, variance)

    def correct_zero_velocity(self) -> None:
        """Correct with zero velocity over ground and of the wheels."""
        rows = [State.V_X, State.V_Y, State.SLIP_VEL_L, State.SLIP_VEL_R]
        self._ekf.correct_states(rows, np.zeros(4), np.full(4, ZERO_VELOCITY_SIGMA ** 2))

    def correct_gyro_bias(self, rate: float, sigma: float) -> None:
        """Correct with the mean measured yaw ``rate`` [rad/s] at standstill."""
        self._ekf.correct_states([State.GYRO_BIAS_Z], np.array([rate]), np.array([sigma ** 2]))

    def _correct_scalar(self, z: float, expected: float, H: Array, variance: float) -> None:
        self._ekf.correct(Measurement(
            np.array([z]), np.array([expected]), H, np.array([[variance]])))


def initial_state(params: SlipEstimatorParams) -> tuple[Array, Array]:
    """Return state (N,) and covariance (N, N) of a robot at the origin of ``odom``."""
    robot = params.robot
    x, sigma = np.zeros(N), np.full(N, MIN_POSE_SIGMA)
    sigma[State.ROLL] = sigma[State.PITCH] = params.slope_sigma
    sigma[State.V_X] = sigma[State.V_Y] = INITIAL_SPEED_SIGMA
    sigma[State.GYRO_BIAS_Z] = robot.imu.gyro_bias
    sigma[State.ACCEL_BIAS_X] = sigma[State.ACCEL_BIAS_Y] = math.hypot(
        robot.imu.accel_bias, GRAVITY * MOUNTING_TILT_SIGMA)
    sigma[State.SLIP_VEL_L] = sigma[State.SLIP_VEL_R] = INITIAL_SPEED_SIGMA
    sigma[State.ICR_X] = params.icr_x_sigma * robot.wheelbase
    sigma[State.TRAVEL_L] = sigma[State.TRAVEL_R] = TRAVEL_RESET_SIGMA
    x[State.ICR_X] = params.icr_x
    sigma[list(IDLE_SIGMAS)] = list(IDLE_SIGMAS.values())
    sigma[State.LN_STIFFNESS] = params.ground_stiffness_sigma
    sigma[State.LN_RATIO] = params.ground_friction_sigma
    x[State.DRAG], sigma[State.DRAG] = DRAG_MEAN, DRAG_SIGMA
    sigma[State.TORQUE_SCALE] = robot.motor.torque_constant_sigma
    sigma[TORQUE_OFFSETS] = math.hypot(
        TORQUE_OFFSET_SIGMA, FRICTION_ERROR_SHARE * robot.motor.coulomb_friction)
    P = np.diag(sigma ** 2)
    stiffness, drag = State.LN_STIFFNESS, State.DRAG
    P[stiffness, drag] = P[drag, stiffness] = (
        SOFT_GROUND_CORRELATION * sigma[stiffness] * sigma[drag])
    return x, P
