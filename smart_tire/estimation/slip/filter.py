# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

# cython: language_level=3, cdivision=True, infer_types=True, initializedcheck=False
# cython: show_performance_hints=False

"""
Kalman filter for slip, pose and sensor biases of a skid-steer robot.

The IMU drives the prediction, B(5); rolled distances, ICR kinematics, standstill and the balance
of forces are the corrections, B(6) to B(8). Three choices:

- The slip of a side is represented by its slip velocity ``r w - v_x`` [m/s]. Wheel speeds are then
  linear in the state, for locked and for spinning wheels too. B(3) is derived on output.
- The robot moves in the plane of the ground, so B(6) holds by construction.
- The distance rolled since the last wheel sample is a state: one late timestamp makes one wheel
  speed too high and the next one too low, so that the errors cancel, and the slip may change
  between two samples.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip import state
from smart_tire.estimation.slip.ground import ForceBalance
from smart_tire.estimation.slip.inputs import ImuInput, WheelSpeeds
from smart_tire.estimation.slip.kalman import (
    CONSIDERED, GYRO_HELD, IDENTITY, SENSORS_HELD, StateRecorder)
from smart_tire.estimation.slip.motion import Noise
from smart_tire.estimation.slip.state import (
    BALANCE_SIGMA, common_slip, COMMON_SLIP_SHARE, ICR_WALK_SHARE, ImuReading, ImuStep,
    initial_state, LEARNING_TIME, N, QUIET_TIME, SLIP_LEARNING_TIME, SLIP_VELS, SPEED_SIGMA,
    START_SLIP, State)
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.rotation import yaw_of
from smart_tire.samples import Four, GroundState, MAX_WHEEL_SPEED, Odometry
from smart_tire.samples import GRAVITY as G
from smart_tire.uncertain import Uncertain

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if cython.compiled:
    from cython.cimports.libc.math import expm1, sqrt
    from cython.cimports.smart_tire.estimation.slip.kalman import KalmanFilter, LearnedVariance
    from cython.cimports.smart_tire.estimation.slip.motion import (
        MotionModel, RollingHistory, slip_speed)
else:
    from math import expm1, sqrt
    from smart_tire.estimation.slip.kalman import KalmanFilter, LearnedVariance
    from smart_tire.estimation.slip.motion import MotionModel, RollingHistory, slip_speed

COMPILED: bool = cython.compiled

# constants and rows of the state that are numbers of C
cython.declare(
    MAX_NIS=cython.double, MIN_SIGMA=cython.double, OUTLIER_SIGMAS=cython.double,
    SLIP_CORRELATION_TIME=cython.double, TYPICAL_PERIOD=cython.double, ROLL=cython.int,
    PITCH=cython.int, V_X=cython.int, V_Y=cython.int, GYRO_BIAS_Z=cython.int,
    SLIP_VEL_L=cython.int, SLIP_VEL_R=cython.int, TRAVEL_L=cython.int, TRAVEL_R=cython.int,
    ICR_X=cython.int, ICR_L=cython.int, ICR_R=cython.int, RADIUS=cython.int, IMU_X=cython.int,
    IMU_Y=cython.int)
MAX_NIS, MIN_SIGMA, OUTLIER_SIGMAS = state.MAX_NIS, state.MIN_SIGMA, state.OUTLIER_SIGMAS
SLIP_CORRELATION_TIME, TYPICAL_PERIOD = state.SLIP_CORRELATION_TIME, state.TYPICAL_PERIOD
(ROLL, PITCH, V_X, V_Y, GYRO_BIAS_Z, SLIP_VEL_L, SLIP_VEL_R, TRAVEL_L, TRAVEL_R, ICR_X, ICR_L,
 ICR_R, RADIUS, IMU_X, IMU_Y) = map(int, (
     State.ROLL, State.PITCH, State.V_X, State.V_Y, State.GYRO_BIAS_Z, State.SLIP_VEL_L,
     State.SLIP_VEL_R, State.TRAVEL_L, State.TRAVEL_R, State.ICR_X, State.ICR_L, State.ICR_R,
     State.RADIUS, State.IMU_X, State.IMU_Y))

POSE = State.X, State.Y, State.YAW
# where the forces show the lateral speed, B(8) does not: sliding tires leave their ICRs
ICR_LEARNED = np.ones(N)
ICR_LEARNED[State.ICR_X] = 0.0


class SlipFilter:
    """Prediction and corrections, B(5) to B(8)."""

    def __init__(self, params: SlipEstimatorParams, recorder: StateRecorder | None = None) -> None:
        robot = params.robot
        self._robot = robot
        self._x_imu = robot.imu.position[0]
        self.kalman = KalmanFilter(*initial_state(params), recorder)
        self.motion = MotionModel(robot)
        self.forces = ForceBalance(robot, self.kalman)
        self._history = RollingHistory()
        # of roll and pitch; a smaller slope is one of the errors of the balance
        self._slopes = [LearnedVariance(params.slope_sigma, BALANCE_SIGMA / G, SLIP_LEARNING_TIME)
                        for _ in range(2)]
        self._icr_walk = ICR_WALK_SHARE * robot.track_width
        self._lateral_sigma = params.lateral_sigma
        self._standstill_speed = robot.slip.standstill_speed
        self._common, self._difference = [LearnedVariance(
            sigma, params.free_rolling_slip_sigma, SLIP_LEARNING_TIME)
            for sigma in (params.common_slip_sigma, params.differential_slip_sigma)]
        self._slip_difference_prior = self._difference.variance
        self._wheel_noise = LearnedVariance(SPEED_SIGMA, SPEED_SIGMA, LEARNING_TIME)
        self._time, self._gyro_z = 0.0, 0.0  # s and rad/s, of the last step
        self._mean_difference = 0.0  # -, half of that of both slips about the ICRs
        self._sides = [0.0, 0.0]  # m/s, side speeds of the last wheel sample
        self._step = 0.0          # m/s, of the slip of a side by a change at the last wheel sample
        self._balanced = False    # the forces were used at the last step
        self._turned = 0.0        # rad^2, of the heading by gyro noise that no mean has shown yet
        self._at_origin = True    # no pose was given: that of the first wheel sample is the origin
        self._started = False     # there has been a wheel sample ...
        self._provisional = False  # ... only one, with a speed that later ones do not continue
        self.blind = False        # the IMU was missing at the last step
        # errors of the gyro bias that have the effect of those of the states on that yaw rate
        self._blind_row = np.zeros(N)
        self._blind_row[[State.GYRO_BIAS_Z, *SLIP_VELS]] = (
            -1.0, -1.0 / robot.track_width, 1.0 / robot.track_width)
        # of a restart of the travels; other rows stay
        self._restart_jacobian, self._restart_noise = np.eye(N), np.zeros((N, N))
        self._restart_noise[TRAVEL_L, TRAVEL_L] = MIN_SIGMA * MIN_SIGMA
        self._restart_noise[TRAVEL_R, TRAVEL_R] = MIN_SIGMA * MIN_SIGMA
        self._blind_slip = 0.0    # m/s, slip difference beyond the ICR kinematics in a dropout
        self.nis = LearnedVariance(1.0, MIN_SIGMA, LEARNING_TIME)  # of the wheel speeds

    def status(self) -> dict[str, str | int | float]:
        """Return what was learned, for diagnostics."""
        x, radius = self.kalman.x, self._robot.wheel_radius
        return {
            'ground': 'given' if self.forces.given else 'prior',
            'rolling_radius': round(radius * (1.0 + x[State.RADIUS]), 6),
            'effective_track': round(
                self._robot.track_width + x[State.ICR_L] + x[State.ICR_R], 4),
            'icr_x': round(x[State.ICR_X], 4),
            'slip_difference_sigma': round(math.sqrt(self._difference.variance), 4),
            'slope_sigma': round(math.sqrt(max(one.variance for one in self._slopes)), 5),
            'wheel_speed_sigma': round(math.sqrt(self._wheel_noise.variance), 4)}

    @property
    def _common_variance(self) -> float:
        """
        Return the variance [-] of the common slip; on ice the difference is large, too.

        Tires that slide can do so at any slip: it changes by as much as it is, and at most by the
        speed of the wheels.
        """
        x: cython.double[::1] = self.kalman.x
        left, right = self._sides
        slip = 0.5 * (x[SLIP_VEL_L] + x[SLIP_VEL_R]) / slip_speed(left, right)
        share = min(abs(slip), 1.0)
        common: LearnedVariance = self._common
        difference: LearnedVariance = self._difference
        return common.variance + difference.variance + share * share

    @property
    def hidden_variance(self) -> tuple[float, float]:
        """
        Return variances [(m/s)^2] of common slip and lateral speed that nothing shows.

        A difference of the sides beyond its prior shows that tires slide; the balance of forces
        limits their slip where friction is known better than its prior. As part of the noise,
        these variances would let the accelerometer rule.
        """
        beyond = self._difference.variance - self._slip_difference_prior
        if not beyond > 0.0:
            return 0.0, 0.0
        shown = beyond * (0.5 * sum(self._sides)) ** 2 * self.forces.friction_ignorance
        return COMMON_SLIP_SHARE ** 2 * shown, shown

    def reset_pose(self) -> None:
        """Set the pose to the origin of ``odom``."""
        self.kalman.set_states(POSE, 0.0, MIN_SIGMA)
        self._turned = 0.0

    def set_ground(self, ground: GroundState) -> None:
        """Take the ground and the position of the IMU as given, with their errors."""
        given = ground.imu_x, ground.imu_y
        if all(math.isfinite(one.value) and math.isfinite(one.sigma) for one in given):
            self._set_imu(given)
        self.forces.set_ground(ground)

    def _set_imu(self, position: tuple[Uncertain, Uncertain]) -> None:
        """Set the position [m] of the IMU in base_link, whose velocity stays."""
        x, F, Q = self.kalman.x[:], np.eye(N), np.zeros((N, N))
        W = self._gyro_z - x[State.GYRO_BIAS_Z]
        for one, nominal, row, velocity, by_arm in zip(
                position, self._robot.imu.position, (State.IMU_X, State.IMU_Y),
                (State.V_Y, State.V_X), (W, -W)):
            F[velocity, row], F[row, row] = -by_arm, 0.0
            x[velocity] += by_arm * (one.value - nominal - x[row])
            x[row] = one.value - nominal
            effect = np.eye(N)[row] + by_arm * np.eye(N)[velocity]
            Q += one.sigma ** 2 * np.outer(effect, effect)
        self.kalman.predict(x, F, Q)

    @property
    def is_sound(self) -> bool:
        """Return whether the state is finite and no variance is negative."""
        return self.kalman.is_sound()

    def set_pose(self, odometry: Odometry) -> None:
        """Set the pose, and its variances, to those in ``odometry``."""
        pose = (*odometry.position[:2], yaw_of(odometry.orientation))
        for row, value, i in zip(POSE, pose, (0, 1, 5)):
            self.kalman.set_states([row], value, math.sqrt(odometry.pose_covariance[7 * i]))
        self._at_origin = False

    def predict(self, time: float, step: ImuStep, *, blind: bool = False) -> None:
        """
        Predict to ``time`` [s] through a step of the IMU.

        In a ``blind`` one its yaw rate is by the wheels, so that its error is that of the slip,
        which lasts, and not that of the gyro bias.
        """
        kalman: KalmanFilter = self.kalman
        motion: MotionModel = self.motion
        history: RollingHistory = self._history
        x: cython.double[::1] = kalman.x
        dt: cython.double = step.dt
        rate: cython.double = step.mean[0]
        W: cython.double = self._gyro_z - x[GYRO_BIAS_Z]
        self.forces.age(dt)
        slope_x: LearnedVariance = self._slopes[0]
        slope_y: LearnedVariance = self._slopes[1]
        difference: LearnedVariance = self._difference
        noise = Noise((sqrt(slope_x.variance), sqrt(slope_y.variance)),
                      sqrt(self._common_variance), sqrt(difference.variance), self._icr_walk)
        left, right = motion.rolling_rate(x, W, 0), motion.rolling_rate(x, W, 1)
        after = motion.predict(kalman.x, step, noise)
        self.blind = blind
        if blind:
            F = self._by_slip(np.asarray(motion.F))
            F[GYRO_BIAS_Z] = np.eye(N)[GYRO_BIAS_Z]
            kalman.predict(after, F, motion.Q)
        else:
            self._turned += step.gyro_variance * dt
            kalman.predict(after, motion.F, motion.Q)
        W = rate - x[GYRO_BIAS_Z]
        history.add_step(time, dt, motion.rolling_rate(x, W, 0) - left,
                         motion.rolling_rate(x, W, 1) - right)
        self._gyro_z, self._time = rate, time

    def correct_forces(self, imu: ImuInput, residual: Four, dt: float) -> None:
        """Correct with the balance of forces after a step of ``dt`` [s] unless wheels lock."""
        left, right = self._sides
        slowest: cython.double = min(abs(left), abs(right))
        self._balanced = slowest >= self._standstill_speed and self.forces.correct(
            imu, residual, dt)
        if self._balanced:
            x: cython.double[::1] = self.kalman.x
            P: cython.double[:, ::1] = self.kalman.P
            for i in range(2):
                row, slope = ROLL + i, self._slopes[i]
                slope.add_square(x[row] * x[row] + P[row, row], dt)

    def find_change(self, imu: ImuInput, torques: Four | None, wheels: WheelSpeeds) -> None:
        """Look for a change of the ground, with the motor torques [N m] if they are measured."""
        self.forces.find_change(imu, torques, wheels, self._step)

    def blind_reading(self, dt: float, sides: tuple[float, float], turn_rate: float
                      ) -> ImuReading:
        """
        Return what the IMU would measure in the next ``dt`` [s] of a dropout.

        The yaw rate is that of the wheels' ``sides`` [m/s] about the ICRs, with the slip beyond
        their kinematics, which the last ``turn_rate`` [rad/s] of the gyroscope has shown.
        """
        x = self.kalman.x
        icrs = x[State.ICR_L] + x[State.ICR_R]
        if not self.blind:
            self._blind_slip = (x[State.SLIP_VEL_R] - x[State.SLIP_VEL_L]
                                - icrs * (turn_rate - x[State.GYRO_BIAS_Z]))
        self._blind_slip *= math.exp(-dt / SLIP_CORRELATION_TIME)
        W = (sides[1] - sides[0] - self._blind_slip) / (self._robot.track_width + icrs)
        return ImuReading(W + x[State.GYRO_BIAS_Z], *self.motion.steady_force(x, W))

    def blind_rate_variance(self, side_variance: float) -> float:
        """Return the variance [(rad/s)^2] of that yaw rate; (m/s)^2 of the speed of a side."""
        P = self.kalman.P
        a, b = SLIP_VELS
        slip = float(P[a, a] + P[b, b] - 2.0 * P[a, b])
        return (slip + 2.0 * side_variance) / self._robot.track_width ** 2

    def _by_slip(self, jacobian: Array) -> Array:
        """Return a Jacobian (..., N) with the yaw rate by the wheels in a dropout of the IMU."""
        if not self.blind:
            return jacobian
        return jacobian + np.multiply.outer(jacobian[..., State.GYRO_BIAS_Z], self._blind_row)

    def correct_wheels(self, time: float, wheels: WheelSpeeds, gyro_z: float,
                       independent: bool) -> None:
        """
        Correct with the distances rolled up to ``time`` [s], B(7).

        ``independent`` sides were measured each; otherwise both carry their mean.
        """
        kalman: KalmanFilter = self.kalman
        motion: MotionModel = self.motion
        dt: cython.double = wheels.duration
        lag: cython.double = self._time - time
        x: cython.double[::1] = kalman.x
        W: cython.double = gyro_z - x[GYRO_BIAS_Z]
        speeds = wheels.side_speeds
        sides = [speed * (1.0 + x[RADIUS]) for speed in speeds]
        change = self._history.travel_change(time)
        provisional, self._provisional = self._provisional, not self._started
        if not self._started or provisional and wheels.from_positions:
            self._start(wheels, sides, W)
            self._restart_travel(wheels, sides, lag, change, W, continued=False)
            return
        innovations, jacobian = np.zeros(2), np.zeros((2, N))
        y: cython.double[::1] = innovations
        H: cython.double[:, ::1] = jacobian
        for i in range(2):
            side: cython.double = sides[i]
            speed: cython.double = speeds[i]
            more: cython.double = change[i]
            y[i] = dt * side - (x[TRAVEL_L + i] - (lag * motion.rolling_rate(x, W, i) + more))
            H[i, TRAVEL_L + i], H[i, V_X], H[i, SLIP_VEL_L + i] = 1.0, -lag, -lag
            H[i, GYRO_BIAS_Z], H[i, RADIUS] = lag * motion.arm(x, i), -dt * speed
            H[i, IMU_Y] = -lag * W
        if self.blind:
            jacobian = H = self._by_slip(jacobian)
        # the yaw rate by the wheels is no measurement of their difference
        R = own = self._wheel_covariance(wheels, sides, True)
        if not independent or self.blind:
            R = self._wheel_covariance(wheels, sides, False)
        self._add_slip_change(sides, own, dt, lag)
        moving = max(map(abs, sides)) >= self._standstill_speed
        if not moving:
            left, both, right = kalman.covariance(H, R)  # of y
            self._add_sliding(0.5 * (y[0] + y[1]), H, 0.25 * (left + both + both + right), dt)
        nis = self._correct_distances(innovations, jacobian, R, sides, dt)
        if moving:
            self.nis.add_square(nis, dt)  # stationary wheels have no noise
            self._wheel_noise.add_square(self._wheel_noise.variance * min(nis, MAX_NIS), dt)
            if not self.blind:
                self._learn_slip(W, dt, independent)
        self._restart_travel(wheels, sides, lag, change, W)

    def _start(self, wheels: WheelSpeeds, sides: list[float], W: float) -> None:
        """
        Begin with the mean speed of the first wheel sample: the robot may be in motion.

        Where later speeds come from positions, the second one begins again: the reported velocity
        of the first one may be filtered, of another time, or that of a driver that just started.
        """
        x, F, Q = self.kalman.x[:], np.eye(N), np.zeros((N, N))
        if self._at_origin and not self._started:  # estimates begin here
            for row in POSE:
                x[row], F[row], Q[row, row] = 0.0, 0.0, MIN_SIGMA ** 2
            self._turned = 0.0
        self._sides, self._started = sides, True
        x[State.V_X] = 0.5 * sum(sides[i] - x[slip] - self.motion.arm(x, i) * W
                                 for i, slip in enumerate(SLIP_VELS))
        F[State.V_X, State.V_X] = 0.0
        F[State.V_X, SLIP_VELS], F[State.V_X, State.IMU_Y] = -0.5, -W
        F[State.V_X, State.RADIUS] = 0.5 * sum(wheels.side_speeds)
        # nothing has shown yet whether a robot in motion slides
        Q += (START_SLIP * 0.5 * sum(sides)) ** 2 * common_slip(N)
        Q[State.V_X, State.V_X] += wheels.variance + self._wheel_noise.variance
        self.kalman.predict(x, F, Q)

    def _wheel_covariance(self, wheels: WheelSpeeds, sides: list[float],
                          independent: bool) -> Array:
        """Return the covariance (2, 2) of both rolled distances [m2]."""
        # a mean velocity depends on two timestamps, of which each also enters its neighbor
        jitter = self._robot.encoder.stamp_jitter * (
            1.0 if wheels.from_positions else math.sqrt(2.0))
        left, right = [jitter * side for side in sides]  # m, one timestamp for both sides
        own = wheels.duration ** 2 * (wheels.variance + self._wheel_noise.variance)
        # of the difference, if it is unknown: that of any two wheels
        unknown = 0.0 if independent else (
            MAX_WHEEL_SPEED * self._robot.wheel_radius * wheels.duration) ** 2
        both = left * right - unknown
        R = np.empty((2, 2))
        R[0, 0], R[1, 1] = left * left + own + unknown, right * right + own + unknown
        R[0, 1] = R[1, 0] = both
        return R

    def _add_slip_change(self, sides: list[float], R: Array, dt: float, lag: float) -> None:
        """
        Inflate the slip of both sides after a change of their speeds since the last sample.

        A change is slip until the tire has rolled its relaxation length, which its force takes to
        follow. It has happened at some time of the period: of a way ``w`` in relaxation lengths,
        ``(1 - exp(-w)) / w`` of it are still slip.
        """
        noise: cython.double = OUTLIER_SIGMAS * sqrt(2.0 * R[0, 0]) / dt
        since: cython.double = 0.5 * dt + lag
        relaxation: cython.double = self.forces.relaxation
        self._step = 0.0
        noise_added = np.zeros((N, N))
        Q: cython.double[:, ::1] = noise_added
        for i in range(2):
            now: cython.double = sides[i]
            before: cython.double = self._sides[i]
            way = max(0.5 * (abs(now) + abs(before)) * dt / relaxation, MIN_SIGMA)
            step = -expm1(-way) / way * max(abs(now - before) - noise, 0.0)
            a, b, late = SLIP_VEL_L + i, TRAVEL_L + i, step * since
            Q[a, a], Q[b, b] = step * step, late * late
            Q[a, b] = Q[b, a] = step * step * since
            self._step = max(self._step, step)
        self._sides = sides
        if self._step:
            self.kalman.add_noise(noise_added)

    def _add_sliding(self, innovation: float, H: Array, variance: float, dt: float) -> None:
        """Inflate the common slip after a mean innovation beyond noise: locked wheels slide."""
        least = self._standstill_speed * max(dt, TYPICAL_PERIOD)
        if innovation ** 2 > max(MAX_NIS * variance, least ** 2):
            g = np.zeros(N)
            g[list(SLIP_VELS)] = innovation / (0.5 * dt)
            g[[TRAVEL_L, TRAVEL_R]] = innovation / (0.5 * dt) * (0.5 * dt - H[0, V_X])
            self.kalman.add_noise(np.outer(g, g))

    def _correct_distances(self, y: Array, H: Array, R: Array, sides: list[float], dt: float
                           ) -> float:
        """Correct with the innovations of both rolled distances; return the NIS over 2."""
        return self.kalman.correct_jointly(y, H, R, GYRO_HELD)

    def _learn_slip(self, W: float, dt: float, independent: bool) -> None:
        """
        Learn the spread of slip and slope from the slip about the ICR kinematics.

        The gyroscope shows the slip difference, the forces the common slip.
        """
        motion: MotionModel = self.motion
        x: cython.double[::1] = self.kalman.x
        P: cython.double[:, ::1] = self.kalman.P
        speed = slip_speed(motion.rolling_rate(x, W, 0), motion.rolling_rate(x, W, 1))
        left, right = x[SLIP_VEL_L] + x[ICR_L] * W, x[SLIP_VEL_R] - x[ICR_R] * W
        variance = (P[SLIP_VEL_L, SLIP_VEL_L] + P[SLIP_VEL_R, SLIP_VEL_R]
                    + 2.0 * P[SLIP_VEL_L, SLIP_VEL_R])
        common = 0.25 * ((left + right) * (left + right) + variance) / (speed * speed)
        # a mean over the correlation time has half the variance, and no noise of single samples
        gain = dt / (dt + SLIP_CORRELATION_TIME)
        mean: cython.double = self._mean_difference
        mean += gain * (0.5 * (right - left) / speed - mean)
        self._mean_difference = mean
        if independent:
            self._difference.add_square(2.0 * (mean * mean), dt)
        self._common.add_square(common, dt)

    def _restart_travel(self, wheels: WheelSpeeds, sides: list[float], lag: float,
                        change: tuple[float, float], W: float, *, continued: bool = True) -> None:
        """
        Count the rolled distance from the wheel sample on.

        Positions are exact references, whatever the error of their timestamps. Without them, or
        if it is not ``continued``, it is counted from the timestamp.
        """
        kalman: KalmanFilter = self.kalman
        motion: MotionModel = self.motion
        moved = kalman.x[:]
        x: cython.double[::1] = moved
        F: cython.double[:, ::1] = self._restart_jacobian
        Q: cython.double[:, ::1] = self._restart_noise
        dt: cython.double = wheels.duration
        from_positions: cython.bint = wheels.from_positions and continued
        for i in range(2):
            travel, slip = TRAVEL_L + i, SLIP_VEL_L + i
            F[travel, travel] = from_positions
            F[travel, V_X] = F[travel, slip] = F[travel, GYRO_BIAS_Z] = 0.0
            F[travel, IMU_Y] = F[travel, RADIUS] = 0.0
            if from_positions:
                side: cython.double = sides[i]
                speed: cython.double = wheels.side_speeds[i]
                x[travel] -= dt * side
                F[travel, RADIUS] = -dt * speed
            else:
                more: cython.double = change[i]
                x[travel] = lag * motion.rolling_rate(x, W, i) + more
                F[travel, V_X] = F[travel, slip] = lag
                F[travel, GYRO_BIAS_Z] = -lag * motion.arm(x, i)
                F[travel, IMU_Y] = lag * W
        kalman.predict(moved, F, Q)

    def correct_lateral(self, gyro_z: float, duration: float) -> None:
        """Correct with B(8): the lateral speed of base_link is -S times the yaw rate."""
        x: cython.double[::1] = self.kalman.x
        W: cython.double = gyro_z - x[GYRO_BIAS_Z]
        arm: cython.double = self._x_imu + x[IMU_X] - x[ICR_X]
        h = np.zeros(N)
        h[V_Y], h[ICR_X], h[IMU_X], h[GYRO_BIAS_Z] = 1.0, W, -W, arm
        y = arm * W - x[V_Y]
        # slip that varies moves the ICRs forward and backward by a share of the wheelbase
        h = self._by_slip(h)
        # tires that slide share their force as their slip: F_y = F v_y / slip velocity
        sigma = math.hypot(self._lateral_sigma, math.sqrt(self._difference.variance)
                           * W * self._robot.wheelbase,
                           0.5 * (x[SLIP_VEL_L] + x[SLIP_VEL_R])
                           * math.sqrt(self._slopes[0].variance) / self.forces.least_friction)
        variance = sigma ** 2 * 2.0 * SLIP_CORRELATION_TIME / max(duration, 1e-3)
        known = self._balanced and self.forces.given and not self.forces.follows  # the ground
        self.kalman.correct(y, h, variance, ICR_LEARNED if known else SENSORS_HELD)

    def correct_zero_velocity(self) -> None:
        """Correct with zero velocity over ground and of the wheels."""
        for row in (State.V_X, State.V_Y, *SLIP_VELS):
            self.kalman.correct(-self.kalman.x[row], IDENTITY[row], SPEED_SIGMA ** 2, GYRO_HELD)

    def correct_gyro_bias(self, rate: Uncertain, unwinding: float, density: float) -> None:
        """
        Correct with the mean ``rate`` [rad/s] of readings at standstill.

        Their noise, of ``density`` [rad^2/s], has turned the heading: it returns by as much. The
        variance ``unwinding`` [(rad/s)^2] is that of a motion.
        """
        variance = rate.sigma ** 2
        # readings of the last QUIET_TIME are no part of the mean
        before = max(self._turned - QUIET_TIME * density, 0.0)
        shared = min(density, before * variance / density)
        self._turned -= shared * density / variance
        row = State.GYRO_BIAS_Z
        self.kalman.correct(rate.value - self.kalman.x[row], IDENTITY[row],
                            variance + unwinding, CONSIDERED, State.YAW, -shared)
