"""
Extended Kalman filter for the slip, the pose and the sensor biases of a skid-steered robot.

The state moves with the inertial unit, B(5); wheels, the ICR line and standstill correct it,
B(6)-(8). Three choices make it robust:

- The slip of a side is carried as its sliding speed ``r w - v_x`` [m/s]. Wheel speeds are then
  linear in the state, for locked and for spinning wheels too, and no noisy wheel speed enters a
  Jacobian. The slip ratio B(3) is derived on output.
- The robot moves in the plane of the ground, so B(6) holds by construction.
- The stamp errors of the last two wheel readings are states: one late stamp makes one reading
  too fast and the next one too slow, which averages out if one knows it.
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
    FreeRollingPrior, InnovationChangeDetector, SLIDE_FLOOR, SlipChangeDetector, SlipPrior)
from smart_tire.estimation.slip.state import (
    DelayedSpeed, ImuStep, N, SIDE_SIGNS, SLIP_VEL_ROWS, SLIP_VELS, State, WheelMeasurement)
from smart_tire.models.vehicle.skid_steer import GRAVITY
from smart_tire.parameters import SlipEstimatorParams


MOUNTING_TILT = 0.009     # rad, one sigma of the unit's unknown tilt: half a degree
POSE_FLOOR = 1e-4         # m, rad: an origin is by definition, yet no covariance may be singular
UNKNOWN_SPEED = 0.5       # m/s, one sigma where nothing is known of the speed
SPEED_DRIFT = 0.002       # m/s per sqrt(s), what the planar model leaves out
GYRO_BIAS_DRIFT = 2e-5    # rad/s per sqrt(s): 10 degrees per hour after five minutes
ACCEL_BIAS_DRIFT = 5e-4   # m/s2 per sqrt(s), likewise
SLOPE_LENGTH = 5.0        # m, over which the slope of the ground is forgotten
WHEEL_NOISE = 0.003       # m/s, wheel speed of a side beyond quantisation and stamps
DOUBT = 0.1               # of the wheels' speed, per normalised innovation squared above one
ICR_CHANGE = 0.1          # of the wheelbase, by which S changes where slips do, one sigma
SIDEWAYS = 1.5            # sigmas; beyond, twice in a row, S has changed
STILL_SPEED = 0.003       # m/s, one sigma of the speed of a robot that stands
ROLLING_MEMORY = 2.0      # s, over which the slip of rolling wheels stays the same
LEAST_WEIGHT = 1e-6       # below, what is usual is not worth an update
STRAIGHT_RATE = 0.1       # rad/s, below which S hardly shows
OUTLIER = 3.0             # sigmas; beyond, a measurement counts less and less
SHORTEST_JITTER = 1e-6    # s, one sigma of stamps that are said to be exact
NIS_MEMORY = 0.05         # share of a new value in the smoothed innovation statistic

SHIFT = np.eye(N)         # makes the last reading's stamp the one before
SHIFT[State.PREV_STAMP_ERROR, State.PREV_STAMP_ERROR] = 0.0
SHIFT[State.STAMP_ERROR, State.STAMP_ERROR] = 0.0
SHIFT[State.PREV_STAMP_ERROR, State.STAMP_ERROR] = 1.0


class StateRecorder(Protocol):
    """Takes down how the state moves, for a smoother that goes back along the same way."""

    def move(self, x: Array, P: Array, F: Array, moved_x: Array, moved_P: Array) -> None:
        """Note that ``x`` (N,), ``P`` (N, N) went by ``F`` to ``moved_x``, ``moved_P``."""


class SlipFilter:
    """
    The filter alone: one method per piece of knowledge, time only as durations.

    All that is not a measurement goes through ``_move``: a linear map and noise, noted on the
    ``tape`` if there is one.
    """

    def __init__(self, params: SlipEstimatorParams, tape: StateRecorder | None = None) -> None:
        self._params = params
        robot = params.robot
        self._tape = tape
        self._kinematics = SlipKinematics(robot)
        self._half_track = 0.5 * robot.track_width
        self._x_imu, self._y_imu = robot.imu.position[0], robot.imu.position[1]
        self._ekf = ExtendedKalmanFilter(dim_x=N, dim_z=1)
        self._F = np.eye(N)
        self._Q = np.zeros(N)
        self._changes = [SlipChangeDetector(params) for _ in SIDE_SIGNS]
        self._spread = SlipPrior(params)
        self._sideways = InnovationChangeDetector(SIDEWAYS)
        self._accel_density = 0.0  # (m/s2)^2 s, of the last step
        # a wandering slip with this memory spreads over slip_sigma in the long run
        self._slip_time = 2.0 * (params.slip_sigma / max(params.slip_drift, 1e-6)) ** 2
        self.nis = 1.0  # normalised innovation squared of the wheel readings, smoothed
        sigma = np.full(N, POSE_FLOOR)
        sigma[State.ROLL] = sigma[State.PITCH] = params.slope_sigma
        sigma[State.V_X] = sigma[State.V_Y] = UNKNOWN_SPEED
        sigma[State.GYRO_BIAS_Z] = robot.imu.gyro_bias
        sigma[State.ACCEL_BIAS_X] = sigma[State.ACCEL_BIAS_Y] = math.hypot(
            robot.imu.accel_bias, GRAVITY * MOUNTING_TILT)
        sigma[State.SLIP_VEL_L] = sigma[State.SLIP_VEL_R] = UNKNOWN_SPEED
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
        """Make the present pose the origin of ``odom``."""
        pose = [State.X, State.Y, State.YAW]
        self._ekf.x[pose] = 0.0
        self._ekf.P[pose, :] = 0.0
        self._ekf.P[:, pose] = 0.0
        self._ekf.P[pose, pose] = POSE_FLOOR ** 2

    def predict(self, dt: float, motion: ImuStep) -> None:
        """Advance by ``dt`` [s] with B(5) in body axes; biases come from the state."""
        self._accel_density = motion.accel_variance
        x = self.x
        W = motion.yaw_rate - x[State.GYRO_BIAS_Z]
        v_x, v_y = x[State.V_X], x[State.V_Y]
        roll, pitch = x[State.ROLL], x[State.PITCH]
        a_x = motion.force_x - x[State.ACCEL_BIAS_X] + W * v_y + GRAVITY * pitch
        a_y = motion.force_y - x[State.ACCEL_BIAS_Y] - W * v_x - GRAVITY * roll
        b_x = v_x + 0.5 * a_x * dt + self._y_imu * W  # of base_link, in the middle of the step
        b_y = v_y + 0.5 * a_y * dt - self._x_imu * W
        yaw = x[State.YAW] + 0.5 * W * dt
        cos, sin = math.cos(yaw), math.sin(yaw)
        speed = math.hypot(b_x, b_y)
        fade = math.exp(-speed * dt / SLOPE_LENGTH)
        keep = math.exp(-dt / self._slip_time)

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
        self._fill_noise(dt, motion, v_x, v_y, fade, x)
        self._move(state, self._F, self._Q)

    def _move(self, moved: Array, F: Array, Q: Array, sliding: Array | None = None) -> None:
        """
        Replace the state by ``moved`` (N, 1), where ``F`` leads.

        ``Q`` (N,) are the variances of what is added; ``sliding`` (2, 2) the covariance of what
        is added to the two slides.
        """
        ekf = self._ekf
        P = F @ ekf.P @ F.T
        P.flat[::N + 1] += Q
        if sliding is not None:
            P[SLIP_VEL_ROWS, SLIP_VEL_ROWS] += sliding
        P = 0.5 * (P + P.T)
        if self._tape is not None:
            self._tape.move(ekf.x[:, 0], ekf.P, F, moved[:, 0], P)
        ekf.x, ekf.P = moved, P

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

    def _fill_noise(self, dt: float, motion: ImuStep, v_x: float, v_y: float, fade: float,
                    x: list[float]) -> None:
        Q, params = self._Q, self._params
        gyro, accel = motion.gyro_variance * dt, motion.accel_variance * dt
        Q[State.YAW] = gyro
        Q[State.ROLL] = Q[State.PITCH] = motion.slope_sigma ** 2 * (1.0 - fade ** 2)
        Q[State.V_X] = accel + gyro * v_y ** 2 + SPEED_DRIFT ** 2 * dt
        Q[State.V_Y] = accel + gyro * v_x ** 2 + SPEED_DRIFT ** 2 * dt
        Q[State.GYRO_BIAS_Z] = GYRO_BIAS_DRIFT ** 2 * dt
        Q[State.ACCEL_BIAS_X] = Q[State.ACCEL_BIAS_Y] = ACCEL_BIAS_DRIFT ** 2 * dt
        for slide, wheel in zip(SLIP_VELS, self._kinematics.wheel_speeds(x, motion.yaw_rate)):
            Q[slide] = params.slip_drift ** 2 * (wheel ** 2 + SLIDE_FLOOR ** 2) * dt
        Q[State.ICR_X] = (params.icr_drift * params.robot.wheelbase) ** 2 * dt

    def update_wheels(self, travel: WheelMeasurement) -> None:
        """Correct with the wheels' travel between two readings: B(7) and the yaw rate."""
        self._shift_stamps()
        H, expected = self._wheel_model(travel)
        R = np.diag([travel.variance + WHEEL_NOISE ** 2 + self._doubt(travel)] * 2)
        if not travel.stamped:
            jitter = math.sqrt(2.0) * self._params.robot.encoder.stamp_jitter / travel.duration
            R += np.diag([(jitter * speed) ** 2 for speed in travel.speed])
        z = np.array(travel.speed)
        self._inflate_slip(travel, z - expected, np.diag(H @ self._ekf.P @ H.T + R))
        H, expected = self._wheel_model(travel)
        if self._params.constraint == 'printed':
            H, z, expected, R = self._printed(H, z, expected, R)
        self._correct(z, expected, H, R)
        if max(map(abs, travel.speed)) < self._params.robot.slip.standstill_speed:
            return  # wheels at rest are exact, and say nothing of the noise
        nis = (self._ekf.y.T @ self._ekf.SI @ self._ekf.y).item() / len(z)
        self.nis += NIS_MEMORY * (nis - self.nis)

    def _doubt(self, travel: WheelMeasurement) -> float:
        """
        Return variance [m2/s2] of wheel speeds that have contradicted their sigmas of late.

        Foreign recordings have stamps and latencies that nobody knows well.
        """
        return (DOUBT * max(0.0, self.nis - 1.0) * max(map(abs, travel.speed))) ** 2

    def _wheel_model(self, travel: WheelMeasurement) -> tuple[Array, Array]:
        x, H, expected = self.x, np.zeros((2, N)), np.zeros(2)
        for row, (side, slide) in enumerate(zip(SIDE_SIGNS, SLIP_VELS)):
            arm = self._y_imu + side * self._half_track
            expected[row] = travel.ground_speed + arm * travel.yaw_rate + x[slide]
            H[row, State.V_X] = H[row, slide] = 1.0
            H[row, State.GYRO_BIAS_Z] = -arm
            if travel.stamped:
                rate = expected[row] / travel.duration
                expected[row] -= rate * (x[State.STAMP_ERROR] - x[State.PREV_STAMP_ERROR])
                H[row, State.STAMP_ERROR], H[row, State.PREV_STAMP_ERROR] = -rate, rate
        return H, expected

    def _shift_stamps(self) -> None:
        """Make room for a new reading's stamp, whose error is independent of all."""
        Q = np.zeros(N)
        Q[State.STAMP_ERROR] = max(self._params.robot.encoder.stamp_jitter, SHORTEST_JITTER) ** 2
        self._move(SHIFT @ self._ekf.x, SHIFT, Q)

    def _inflate_slip(self, travel: WheelMeasurement, innovation: Array,
                      variance: Array) -> None:
        """
        Forget the sliding as far as wheels and ground change their speeds, or surprise.

        It fades towards zero as it becomes unknown: were it only widened, nothing would tie the
        speed to the wheels on a robot that shakes, and the accelerometer would carry it away.
        """
        changes = []
        for row, (side, change) in enumerate(zip(SIDE_SIGNS, self._changes)):
            ground = travel.ground_speed + (
                self._y_imu + side * self._half_track) * travel.yaw_rate
            changes.append(change.update(
                travel.duration, travel.speed[row], ground, float(innovation[row]),
                math.sqrt(variance[row]), self._accel_density))
        spread = self._spread.of(changes)
        share = min(1.0, max(change.variance / spread[row, row]
                             for row, change in enumerate(changes)))
        F, Q = np.eye(N), np.zeros(N)
        for slide in SLIP_VELS:
            F[slide, slide] = math.sqrt(1.0 - share)
        Q[State.ICR_X] = share * (ICR_CHANGE * self._params.robot.wheelbase) ** 2
        self._move(F @ self._ekf.x, F, Q, share * spread)

    def _printed(self, H: Array, z: Array, expected: Array, R: Array
                 ) -> tuple[Array, Array, Array, Array]:
        """
        Return the sides' model as B(7) has it: their mean with lambda' for lambda, and the yaw.

        Lambda' is 0 for a faster side that brakes and for a slower side that drives.
        """
        mix = np.array([[0.5, 0.5], [-1.0, 1.0]])
        slides = self._ekf.x[list(SLIP_VELS), 0]
        faster = np.abs(z) >= np.abs(z[::-1])
        dropped = np.where(faster, slides * z < 0.0, slides * z > 0.0)
        H, expected = mix @ H, mix @ expected
        expected[0] -= 0.5 * slides[dropped].sum()
        H[0, np.array(SLIP_VELS)[dropped]] = 0.0
        return H, mix @ z, expected, mix @ R @ mix.T

    def update_rolling(self, duration: float, gyro_z: float,
                       unsure: float = 0.0) -> FreeRollingPrior | None:
        """
        Correct with what is usual: on firm ground, wheels that only roll hardly slip.

        Driving straight, nothing else tells the slip that both sides share. Soft ground is as
        possible: the more the slip speaks for it, the less this counts, so that slip that was
        seen (when starting, in a turn, on other ground) is kept. ``unsure`` [-] is the variance
        of slip that a wrong radius feigns. Return what was seen; None where the wheels stand.
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
        self._spread.watch(slip, variance, duration)
        seen = self._spread.rolling(slip, variance, (right - left) / speed, unsure)
        if seen.weight > LEAST_WEIGHT:
            R = seen.usual * ROLLING_MEMORY / (seen.weight * duration)
            self._correct(np.zeros(1), np.array([slip]), H, np.array([[R]]))
        return seen

    def update_lateral(self, gyro_z: float, duration: float) -> None:
        """Correct with B(8): the lateral speed of base_link is -S times the yaw rate."""
        x = self.x
        W = gyro_z - x[State.GYRO_BIAS_Z]
        H = np.zeros((1, N))
        H[0, State.V_Y] = 1.0
        H[0, State.ICR_X] = W
        H[0, State.GYRO_BIAS_Z] = self._x_imu - x[State.ICR_X]
        expected = x[State.V_Y] - (self._x_imu - x[State.ICR_X]) * W
        variance = self._params.lateral_sigma ** 2 * 0.1 / max(duration, 1e-3)
        surprise = self._sideways.update(
            expected, math.sqrt(float((H @ self._ekf.P @ H.T)[0, 0]) + variance))
        if surprise > 0.0:  # S has changed, or, driving straight, the robot drifts sideways
            Q = np.zeros(N)
            Q[State.ICR_X] = surprise / (W ** 2 + STRAIGHT_RATE ** 2)
            self._move(self._ekf.x, np.eye(N), Q)
            variance += surprise / (1.0 + (W / STRAIGHT_RATE) ** 2)
        self._correct(np.zeros(1), np.array([expected]), H, np.array([[variance]]))

    def update_past_speed(self, past: DelayedSpeed) -> None:
        """Correct with a speed over ground of a while ago, such as the films tell of it."""
        x, H = self.x, np.zeros((1, N))
        arm = self._y_imu + SIDE_SIGNS[past.side] * self._half_track
        expected = x[State.V_X] - past.gained + arm * (past.gyro_z - x[State.GYRO_BIAS_Z])
        H[0, State.V_X], H[0, State.GYRO_BIAS_Z] = 1.0, -arm
        H[0, State.V_Y] = -past.turned
        H[0, State.ACCEL_BIAS_X] = past.since
        self._correct(np.array([past.speed]), np.array([expected]), H,
                      np.array([[past.variance]]))

    def update_standstill(self) -> None:
        """Correct with zero velocity over ground and of the wheels."""
        rows = [State.V_X, State.V_Y, State.SLIP_VEL_L, State.SLIP_VEL_R]
        self._observe(rows, np.zeros(4), np.full(4, STILL_SPEED ** 2))

    def update_gyro_bias(self, rate: float, sigma: float) -> None:
        """Correct with the unit's ``rate`` [rad/s] about z, a mean at rest."""
        self._observe([State.GYRO_BIAS_Z], np.array([rate]), np.array([sigma ** 2]))

    def _observe(self, rows: list[State], z: Array, variances: Array) -> None:
        """Correct with states that are seen directly."""
        H = np.zeros((len(rows), N))
        H[range(len(rows)), rows] = 1.0
        self._correct(z, self._ekf.x[rows, 0], H, np.diag(variances))

    def _correct(self, z: Array, expected: Array, H: Array, R: Array) -> None:
        """
        Update with ``z`` whose model is ``expected`` (shape (m,)) and ``H`` (m, N).

        A row further off than ``OUTLIER`` sigmas counts less in proportion to its square: one
        bad reading hardly moves the state, a lasting contradiction always wins in the end.
        """
        ekf = self._ekf
        y = z - expected
        S = H @ ekf.P @ H.T + R
        excess = np.maximum(y ** 2 / np.diag(S) / OUTLIER ** 2, 1.0)
        if excess.max() > 1.0:
            R = R + np.diag((excess - 1.0) * np.diag(S))
        ekf.update(z[:, None], lambda x: H, lambda x: expected[:, None], R=R)
        if ekf.x.shape != (N, 1) or ekf.P.shape != (N, N):  # filterpy broadcasts silently
            raise EstimatorError(f'state {ekf.x.shape}, covariance {ekf.P.shape}, expected {N}')
        ekf.P = 0.5 * (ekf.P + ekf.P.T)
