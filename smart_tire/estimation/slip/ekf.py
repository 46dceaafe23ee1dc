"""
Extended Kalman filter for the slip, the pose and the sensor biases of a skid-steer robot.

The IMU drives the prediction, B(5); wheel speeds, the lateral constraint (ICR) and standstill are
the corrections, B(6)-(8). Three choices make it robust:

- The slip of a side is represented by its slip velocity ``r w - v_x`` [m/s]. Wheel speeds are then
  linear in the state, for locked and for spinning wheels too, and no noisy wheel speed enters a
  Jacobian. The slip ratio B(3) is derived on output.
- The robot moves in the plane of the ground, so B(6) holds by construction.
- The timestamp errors of the last two wheel samples are states: one late stamp makes one wheel
  speed too high and the next one too low, so that the errors cancel.
"""

from __future__ import annotations

import math
from typing import Protocol

from filterpy.kalman import ExtendedKalmanFilter
import numpy as np

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.estimation.slip.kinematics import SlipKinematics
from smart_tire.estimation.slip.slip_process import (
    FreeRollingPrior, InnovationChangeDetector, MIN_SLIP_VELOCITY, SlipChangeDetector, SlipPrior)
from smart_tire.estimation.slip.state import (
    DelayedSpeed, ImuStep, N, SIDE_SIGNS, SLIP_VEL_ROWS, SLIP_VELS, State, WheelMeasurement)
from smart_tire.models.vehicle.skid_steer import GRAVITY
from smart_tire.parameters import SlipEstimatorParams


MOUNTING_TILT_SIGMA = 0.009     # rad, of the IMU: half a degree
MIN_POSE_SIGMA = 1e-4           # m, rad: the origin is exact, but P must not be singular
INITIAL_SPEED_SIGMA = 0.5       # m/s
SPEED_RANDOM_WALK = 0.002       # m/s per sqrt(s), errors of the planar model
GYRO_BIAS_RANDOM_WALK = 2e-5    # rad/s per sqrt(s): 10 degrees per hour after five minutes
ACCEL_BIAS_RANDOM_WALK = 5e-4   # m/s2 per sqrt(s)
SLOPE_CORRELATION_LENGTH = 5.0  # m, of the ground
WHEEL_SPEED_SIGMA = 0.003       # m/s, of a side, in addition to quantization and timestamps
NIS_INFLATION = 0.1             # share of wheel speed added to sigma per unit NIS above 1
ICR_CHANGE_SHARE = 0.1          # sigma of the change of S with the slips, over the wheelbase
ICR_CHANGE_SIGMAS = 1.5         # exceeded twice in a row with one sign: S has changed
ZERO_VELOCITY_SIGMA = 0.003     # m/s, of the zero-velocity update
FREE_ROLLING_CORRELATION_TIME = 2.0  # s, of the slip of freely rolling wheels
MIN_PRIOR_WEIGHT = 1e-6         # below, the free-rolling prior is not worth a correction
STRAIGHT_YAW_RATE = 0.1         # rad/s, below which S is hardly observable
OUTLIER_SIGMAS = 3.0            # beyond, the variance of a measurement is inflated
MIN_STAMP_JITTER = 1e-6         # s, standard deviation of timestamps that count as exact
NIS_GAIN = 0.05                 # weight of a new value in the smoothed NIS

STAMP_SHIFT = np.eye(N)         # the last stamp error becomes the previous one
STAMP_SHIFT[State.PREV_STAMP_ERROR, State.PREV_STAMP_ERROR] = 0.0
STAMP_SHIFT[State.STAMP_ERROR, State.STAMP_ERROR] = 0.0
STAMP_SHIFT[State.PREV_STAMP_ERROR, State.STAMP_ERROR] = 1.0


class StateRecorder(Protocol):
    """Records state transitions for the RTS smoother."""

    def record_transition(self, x: Array, P: Array, F: Array, next_x: Array,
                          next_P: Array) -> None:
        """Record the transition of ``x`` (N,), ``P`` (N, N) by ``F`` to ``next_x``, ``next_P``."""


class SlipFilter:
    """
    Prediction and corrections of the slip EKF; time enters as durations only.

    Every change of the state that is not a correction goes through ``_transition``, a linear map
    with noise, which is passed to the ``recorder`` if there is one.
    """

    def __init__(self, params: SlipEstimatorParams, recorder: StateRecorder | None = None) -> None:
        self._params = params
        robot = params.robot
        self._recorder = recorder
        self._kinematics = SlipKinematics(robot)
        self._half_track = 0.5 * robot.track_width
        self._x_imu, self._y_imu = robot.imu.position[0], robot.imu.position[1]
        self._ekf = ExtendedKalmanFilter(dim_x=N, dim_z=1)
        self._F = np.eye(N)
        self._Q = np.zeros(N)
        self._slip_changes = [SlipChangeDetector(params) for _ in SIDE_SIGNS]
        self._slip_prior = SlipPrior(params)
        self._icr_change = InnovationChangeDetector(ICR_CHANGE_SIGMAS)
        self._accel_density = 0.0  # (m/s2)^2 s, of the last prediction
        # s, correlation time of a slip whose random walk is bounded by slip_sigma
        self._slip_correlation_time = 2.0 * (params.slip_sigma / max(params.slip_drift, 1e-6)) ** 2
        self.nis = 1.0  # normalized innovation squared of the wheel speeds, smoothed
        sigma = np.full(N, MIN_POSE_SIGMA)
        sigma[State.ROLL] = sigma[State.PITCH] = params.slope_sigma
        sigma[State.V_X] = sigma[State.V_Y] = INITIAL_SPEED_SIGMA
        sigma[State.GYRO_BIAS_Z] = robot.imu.gyro_bias
        sigma[State.ACCEL_BIAS_X] = sigma[State.ACCEL_BIAS_Y] = math.hypot(
            robot.imu.accel_bias, GRAVITY * MOUNTING_TILT_SIGMA)
        sigma[State.SLIP_VEL_L] = sigma[State.SLIP_VEL_R] = INITIAL_SPEED_SIGMA
        sigma[State.ICR_X] = params.icr_sigma * robot.wheelbase
        sigma[State.STAMP_ERROR] = sigma[State.PREV_STAMP_ERROR] = robot.encoder.stamp_jitter
        self._ekf.x[State.ICR_X] = params.icr
        self._ekf.P = np.diag(sigma ** 2)

    @property
    def x(self) -> list[float]:
        """Return the state in the order of ``State``."""
        values: list[float] = self._ekf.x[:, 0].tolist()
        return values

    @property
    def P(self) -> Array:
        """Return the covariance of the state, shape (N, N)."""
        covariance: Array = self._ekf.P
        return covariance

    def reset_pose(self) -> None:
        """Set the pose to the origin of ``odom``."""
        pose = [State.X, State.Y, State.YAW]
        self._ekf.x[pose] = 0.0
        self._ekf.P[pose, :] = 0.0
        self._ekf.P[:, pose] = 0.0
        self._ekf.P[pose, pose] = MIN_POSE_SIGMA ** 2

    def predict(self, dt: float, imu: ImuStep) -> None:
        """Predict over ``dt`` [s] with B(5) in body axes, with the estimated biases removed."""
        self._accel_density = imu.accel_variance
        x = self.x
        W = imu.yaw_rate - x[State.GYRO_BIAS_Z]
        v_x, v_y = x[State.V_X], x[State.V_Y]
        roll, pitch = x[State.ROLL], x[State.PITCH]
        a_x = imu.force_x - x[State.ACCEL_BIAS_X] + W * v_y + GRAVITY * pitch
        a_y = imu.force_y - x[State.ACCEL_BIAS_Y] - W * v_x - GRAVITY * roll
        b_x = v_x + 0.5 * a_x * dt + self._y_imu * W  # of base_link, at the center of the step
        b_y = v_y + 0.5 * a_y * dt - self._x_imu * W
        yaw = x[State.YAW] + 0.5 * W * dt
        cos, sin = math.cos(yaw), math.sin(yaw)
        speed = math.hypot(b_x, b_y)
        fade = math.exp(-speed * dt / SLOPE_CORRELATION_LENGTH)
        keep = math.exp(-dt / self._slip_correlation_time)

        state = self._ekf.x.copy()
        state[State.X, 0] += (cos * b_x - sin * b_y) * dt
        state[State.Y, 0] += (sin * b_x + cos * b_y) * dt
        state[State.YAW, 0] += W * dt
        state[State.V_X, 0] += a_x * dt
        state[State.V_Y, 0] += a_y * dt
        state[State.ROLL, 0] = fade * (roll + W * pitch * dt)
        state[State.PITCH, 0] = fade * (pitch - W * roll * dt)
        state[State.SLIP_VEL_L, 0] *= keep
        state[State.SLIP_VEL_R, 0] *= keep
        self._fill_jacobian(dt, W, v_x, v_y, b_x, b_y, cos, sin, fade, keep)
        self._fill_noise(dt, imu, v_x, v_y, fade, x)
        self._transition(state, self._F, self._Q)

    def _transition(self, next_x: Array, F: Array, Q: Array,
                    slip_Q: Array | None = None) -> None:
        """
        Replace the state by ``next_x`` (N, 1), with the Jacobian ``F`` (N, N).

        ``Q`` (N,) are the variances of independent process noise, ``slip_Q`` (2, 2) the
        covariance of additional noise of the two slip velocities.
        """
        ekf = self._ekf
        P = F @ ekf.P @ F.T
        P.flat[::N + 1] += Q
        if slip_Q is not None:
            P[SLIP_VEL_ROWS, SLIP_VEL_ROWS] += slip_Q
        P = 0.5 * (P + P.T)
        if self._recorder is not None:
            self._recorder.record_transition(ekf.x[:, 0], ekf.P, F, next_x[:, 0], P)
        ekf.x, ekf.P = next_x, P

    def _fill_jacobian(self, dt: float, W: float, v_x: float, v_y: float, b_x: float, b_y: float,
                       cos: float, sin: float, fade: float, keep: float) -> None:
        F = self._F
        F[State.X, State.YAW] = (-sin * b_x - cos * b_y) * dt
        F[State.X, State.V_X] = cos * dt
        F[State.X, State.V_Y] = -sin * dt
        F[State.X, State.GYRO_BIAS_Z] = (-cos * self._y_imu - sin * self._x_imu) * dt
        F[State.Y, State.YAW] = (cos * b_x - sin * b_y) * dt
        F[State.Y, State.V_X] = sin * dt
        F[State.Y, State.V_Y] = cos * dt
        F[State.Y, State.GYRO_BIAS_Z] = (-sin * self._y_imu + cos * self._x_imu) * dt
        F[State.YAW, State.GYRO_BIAS_Z] = -dt
        F[State.V_X, State.V_Y] = W * dt
        F[State.V_X, State.GYRO_BIAS_Z] = -v_y * dt
        F[State.V_X, State.ACCEL_BIAS_X] = -dt
        F[State.V_X, State.PITCH] = GRAVITY * dt
        F[State.V_Y, State.V_X] = -W * dt
        F[State.V_Y, State.GYRO_BIAS_Z] = v_x * dt
        F[State.V_Y, State.ACCEL_BIAS_Y] = -dt
        F[State.V_Y, State.ROLL] = -GRAVITY * dt
        F[State.ROLL, State.ROLL] = F[State.PITCH, State.PITCH] = fade
        F[State.ROLL, State.PITCH] = fade * W * dt
        F[State.PITCH, State.ROLL] = -fade * W * dt
        F[State.SLIP_VEL_L, State.SLIP_VEL_L] = F[State.SLIP_VEL_R, State.SLIP_VEL_R] = keep

    def _fill_noise(self, dt: float, imu: ImuStep, v_x: float, v_y: float, fade: float,
                    x: list[float]) -> None:
        Q, params = self._Q, self._params
        gyro, accel = imu.gyro_variance * dt, imu.accel_variance * dt
        Q[State.YAW] = gyro
        Q[State.ROLL] = Q[State.PITCH] = imu.slope_sigma ** 2 * (1.0 - fade ** 2)
        Q[State.V_X] = accel + gyro * v_y ** 2 + SPEED_RANDOM_WALK ** 2 * dt
        Q[State.V_Y] = accel + gyro * v_x ** 2 + SPEED_RANDOM_WALK ** 2 * dt
        Q[State.GYRO_BIAS_Z] = GYRO_BIAS_RANDOM_WALK ** 2 * dt
        Q[State.ACCEL_BIAS_X] = Q[State.ACCEL_BIAS_Y] = ACCEL_BIAS_RANDOM_WALK ** 2 * dt
        for row, wheel in zip(SLIP_VELS, self._kinematics.wheel_speeds(x, imu.yaw_rate)):
            Q[row] = params.slip_drift ** 2 * (wheel ** 2 + MIN_SLIP_VELOCITY ** 2) * dt
        Q[State.ICR_X] = (params.icr_drift * params.robot.wheelbase) ** 2 * dt

    def correct_wheels(self, wheels: WheelMeasurement) -> None:
        """Correct with the mean side speeds between two wheel samples, B(7)."""
        self._shift_stamp_errors()
        H, expected = self._wheel_model(wheels)
        variance = (wheels.variance + WHEEL_SPEED_SIGMA ** 2
                    + self._wheel_noise_inflation(wheels))
        R = np.diag([variance] * 2)
        if not wheels.from_positions:
            jitter = math.sqrt(2.0) * self._params.robot.encoder.stamp_jitter / wheels.duration
            R += np.diag([(jitter * speed) ** 2 for speed in wheels.side_speeds])
        z = np.array(wheels.side_speeds)
        self._inflate_slip(wheels, z - expected, np.diag(H @ self._ekf.P @ H.T + R))
        H, expected = self._wheel_model(wheels)
        if self._params.constraint == 'printed':
            H, z, expected, R = self._printed_model(H, z, expected, R)
        self._correct(z, expected, H, R)
        if max(map(abs, wheels.side_speeds)) < self._params.robot.slip.standstill_speed:
            return  # stationary wheels have no noise
        nis = (self._ekf.y.T @ self._ekf.SI @ self._ekf.y).item() / len(z)
        self.nis += NIS_GAIN * (nis - self.nis)

    def _wheel_noise_inflation(self, wheels: WheelMeasurement) -> float:
        """
        Return extra wheel-speed variance [m2/s2] while the smoothed NIS exceeds 1.

        Timestamp errors and latency of recordings from other robots are poorly known.
        """
        return (NIS_INFLATION * max(0.0, self.nis - 1.0) * max(map(abs, wheels.side_speeds))) ** 2

    def _wheel_model(self, wheels: WheelMeasurement) -> tuple[Array, Array]:
        x, H, expected = self.x, np.zeros((2, N)), np.zeros(2)
        for row, (side, slip_vel) in enumerate(zip(SIDE_SIGNS, SLIP_VELS)):
            arm = self._y_imu + side * self._half_track
            expected[row] = wheels.ground_speed + arm * wheels.yaw_rate + x[slip_vel]
            H[row, State.V_X] = H[row, slip_vel] = 1.0
            H[row, State.GYRO_BIAS_Z] = -arm
            if wheels.from_positions:
                rate = expected[row] / wheels.duration
                expected[row] -= rate * (x[State.STAMP_ERROR] - x[State.PREV_STAMP_ERROR])
                H[row, State.STAMP_ERROR], H[row, State.PREV_STAMP_ERROR] = -rate, rate
        return H, expected

    def _shift_stamp_errors(self) -> None:
        """Move the last stamp error to the previous one; the new one is independent."""
        Q = np.zeros(N)
        Q[State.STAMP_ERROR] = max(self._params.robot.encoder.stamp_jitter, MIN_STAMP_JITTER) ** 2
        self._transition(STAMP_SHIFT @ self._ekf.x, STAMP_SHIFT, Q)

    def _inflate_slip(self, wheels: WheelMeasurement, innovation: Array,
                      variance: Array) -> None:
        """
        Inflate the slip velocities after a change of wheel or ground speed, or of innovations.

        They decay towards zero by the same share: with inflation alone the wheels would no longer
        constrain the speed, which the accelerometer of a vibrating robot would let diverge.
        """
        changes = []
        for row, (side, detector) in enumerate(zip(SIDE_SIGNS, self._slip_changes)):
            ground = wheels.ground_speed + (
                self._y_imu + side * self._half_track) * wheels.yaw_rate
            changes.append(detector.update(
                wheels.duration, wheels.side_speeds[row], ground, float(innovation[row]),
                math.sqrt(variance[row]), self._accel_density))
        prior = self._slip_prior.covariance(changes)
        share = min(1.0, max(change.variance / prior[row, row]
                             for row, change in enumerate(changes)))
        F, Q = np.eye(N), np.zeros(N)
        for row in SLIP_VELS:
            F[row, row] = math.sqrt(1.0 - share)
        Q[State.ICR_X] = share * (ICR_CHANGE_SHARE * self._params.robot.wheelbase) ** 2
        self._transition(F @ self._ekf.x, F, Q, share * prior)

    def _printed_model(self, H: Array, z: Array, expected: Array, R: Array
                       ) -> tuple[Array, Array, Array, Array]:
        """
        Return the wheel model as printed in B(7): the mean speed, with lambda', and the yaw rate.

        Lambda' is 0 for a faster side that brakes and for a slower side that drives.
        """
        mix = np.array([[0.5, 0.5], [-1.0, 1.0]])
        slip_vels = self._ekf.x[list(SLIP_VELS), 0]
        faster = np.abs(z) >= np.abs(z[::-1])
        dropped = np.where(faster, slip_vels * z < 0.0, slip_vels * z > 0.0)
        H, expected = mix @ H, mix @ expected
        expected[0] -= 0.5 * slip_vels[dropped].sum()
        H[0, np.array(SLIP_VELS)[dropped]] = 0.0
        return H, mix @ z, expected, mix @ R @ mix.T

    def correct_free_rolling(self, duration: float, gyro_z: float,
                             radius_variance: float = 0.0) -> FreeRollingPrior | None:
        """
        Correct with a pseudo-measurement: freely rolling wheels have near-zero common slip.

        In straight driving the common slip is otherwise unobservable. The weight is the
        probability of firm ground given the estimated slip, so that slip observed before (when
        starting, in a turn, on another surface) is kept. ``radius_variance`` [-] is the variance
        of apparent slip due to the wheel radius. Return the prior; None if the wheels are
        stationary.
        """
        x, P = self.x, self._ekf.P
        left, right = self._kinematics.wheel_speeds(x, gyro_z)
        speed = 0.5 * (abs(left) + abs(right))
        if speed < self._params.robot.slip.standstill_speed:
            return None
        H = np.zeros((1, N))
        H[0, SLIP_VEL_ROWS] = 0.5 / speed
        slip = float(H[0] @ self._ekf.x[:, 0])
        variance = float(H[0] @ P @ H[0])
        self._slip_prior.update_soft_ground(slip, variance, duration)
        prior = self._slip_prior.free_rolling(
            slip, variance, (right - left) / speed, radius_variance)
        if prior.weight > MIN_PRIOR_WEIGHT:
            R = prior.prior_variance * FREE_ROLLING_CORRELATION_TIME / (prior.weight * duration)
            self._correct(np.zeros(1), np.array([slip]), H, np.array([[R]]))
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
            Q = np.zeros(N)
            Q[State.ICR_X] = change / (W ** 2 + STRAIGHT_YAW_RATE ** 2)
            self._transition(self._ekf.x, np.eye(N), Q)
            variance += change / (1.0 + (W / STRAIGHT_YAW_RATE) ** 2)
        self._correct(np.zeros(1), np.array([expected]), H, np.array([[variance]]))

    def correct_delayed_speed(self, delayed: DelayedSpeed) -> None:
        """Correct with a speed over ground at an earlier time, as measured by the films."""
        x, H = self.x, np.zeros((1, N))
        arm = self._y_imu + SIDE_SIGNS[delayed.side] * self._half_track
        expected = (x[State.V_X] - delayed.speed_change
                    + arm * (delayed.gyro_z - x[State.GYRO_BIAS_Z]))
        H[0, State.V_X], H[0, State.GYRO_BIAS_Z] = 1.0, -arm
        H[0, State.V_Y] = -delayed.yaw_change
        H[0, State.ACCEL_BIAS_X] = delayed.elapsed
        self._correct(np.array([delayed.speed]), np.array([expected]), H,
                      np.array([[delayed.variance]]))

    def correct_zero_velocity(self) -> None:
        """Correct with zero velocity over ground and of the wheels."""
        rows = [State.V_X, State.V_Y, State.SLIP_VEL_L, State.SLIP_VEL_R]
        self._correct_states(rows, np.zeros(4), np.full(4, ZERO_VELOCITY_SIGMA ** 2))

    def correct_gyro_bias(self, rate: float, sigma: float) -> None:
        """Correct with the mean measured yaw ``rate`` [rad/s] at standstill."""
        self._correct_states([State.GYRO_BIAS_Z], np.array([rate]), np.array([sigma ** 2]))

    def _correct_states(self, rows: list[State], z: Array, variances: Array) -> None:
        """Correct with direct measurements of states."""
        H = np.zeros((len(rows), N))
        H[range(len(rows)), rows] = 1.0
        self._correct(z, self._ekf.x[rows, 0], H, np.diag(variances))

    def _correct(self, z: Array, expected: Array, H: Array, R: Array) -> None:
        """
        Correct with ``z`` (m,), given its expectation ``expected`` (m,) and ``H`` (m, N).

        The variance of an innovation beyond ``OUTLIER_SIGMAS`` grows with its square: a single
        outlier hardly changes the state, persistent innovations prevail in the end.
        """
        ekf = self._ekf
        y = z - expected
        S = H @ ekf.P @ H.T + R
        excess = np.maximum(y ** 2 / np.diag(S) / OUTLIER_SIGMAS ** 2, 1.0)
        if excess.max() > 1.0:
            R = R + np.diag((excess - 1.0) * np.diag(S))
        ekf.update(z[:, None], lambda x: H, lambda x: expected[:, None], R=R)
        if ekf.x.shape != (N, 1) or ekf.P.shape != (N, N):  # filterpy broadcasts silently
            raise EstimatorError(f'state {ekf.x.shape}, covariance {ekf.P.shape}, expected {N}')
        ekf.P = 0.5 * (ekf.P + ekf.P.T)
