# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
The ground with its errors considered: corrections with the forces, and changes of the ground.

Its values and their errors are those of the prior until a ``GroundState`` gives others. With the
covariance P of the errors of the ground g and the innovation y, ``P_yg P_gg^-1`` is the effect of
a change of the ground on the innovation, through all corrections since (sensitivity of Friedland's
separate bias filter). The change that explains the innovations best is a least squares fit, its
likelihood ratio the test of Willsky and Jones.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.inputs import ImuInput, WheelSpeeds
from smart_tire.estimation.slip.kalman import FORCES_HELD, KalmanFilter, LearnedVariance
from smart_tire.estimation.slip.state import (
    BALANCE_SIGMA, EVIDENCE, EXPIRY_TIME, FORCE_ERROR, GROUND, ImuReading, LEARNING_TIME,
    MAX_NIS, MAX_REPEATS, MIN_SIGMA, MIN_SLIP_SPEED, MODEL_TIME, N, PUSH_SIGMAS,
    PUSH_TIME, SLIP_VELS, State, SUDDEN)
from smart_tire.estimation.slip.tire_forces import TireForces
from smart_tire.models.tire.brush_tire import (
    LATERAL_SHARE, LN_FRICTION, LN_LATERAL_RATIO, LN_RESISTANCE, LN_STIFFNESS)
from smart_tire.models.vehicle.drive import torque_errors, traction_force
from smart_tire.parameters import RobotParams
from smart_tire.samples import Four, GroundState
from smart_tire.uncertain import log_normal, Uncertain

RELATIVE = [row - GROUND.start for row in (
    State.LN_STIFFNESS, State.LN_FRICTION, State.LN_LATERAL)]  # errors of the ground as given
# ln of the rolling resistance of any ground: the window finds it, and begins with firm ground,
# where its errors are smaller (concrete without films); the filter does not (starvation, sand)
UNKNOWN_RESISTANCE = LN_RESISTANCE._replace(value=math.log(0.035))
FOLLOWED = FORCES_HELD.copy()  # after a change the ground is estimated
FOLLOWED[SUDDEN] = 0.0


class MotorTorques:
    """Traction forces of the wheels by the motor torques, with their errors."""

    def __init__(self, robot: RobotParams) -> None:
        self._nominal, self._radius = robot.motor, robot.wheel_radius
        self._set_motor(Uncertain(1.0, 0.0), 1.0)
        least = math.sqrt(2.0) * torque_errors(robot.motor)[0] / self._radius
        self._noise = [LearnedVariance(least, least, LEARNING_TIME) for _ in SLIP_VELS]
        self._last: Four = (math.nan,) * 4
        self._repeats = [0] * 4
        self._innovations = [0.0, 0.0]      # N, the last ones

    def set_ground(self, ground: GroundState) -> None:
        """Take the friction of gears and axles and the scale of the torques, where given."""
        friction, scale = ground.motor_friction, ground.torque_scale.value
        if math.isfinite(friction.value) and math.isfinite(friction.sigma) and math.isfinite(
                scale):
            self._set_motor(friction, scale)

    def _set_motor(self, friction: Uncertain, scale: float) -> None:
        motor, factor = self._nominal, friction.value
        self._motor, self._scale = replace(
            motor, coulomb_friction=factor * motor.coulomb_friction,
            axle_friction=factor * motor.axle_friction), scale
        self._offset = math.hypot(torque_errors(self._motor)[1],
                                  friction.sigma * motor.coulomb_friction)  # N m

    def forces(self, torques: Four, speeds: Four, loads: Sequence[float]) -> list[float] | None:
        """
        Return the forces [N] on the robot; None if a torque is not measured, or is stuck.

        ``torques`` are in N m, ``speeds`` r w in m/s, ``loads`` in N.
        """
        self._repeats = [count + 1 if new == old else 0
                         for count, new, old in zip(self._repeats, torques, self._last)]
        self._last = torques
        if max(self._repeats) >= MAX_REPEATS or not all(map(math.isfinite, torques)):
            return None
        rates = np.array(speeds) / self._radius
        found: list[float] = traction_force(
            self._scale * np.array(torques), rates, 0.0, loads, self._motor,
            self._radius).tolist()
        return found

    def variance(self, side: int, y: float, size: float, step: float, dt: float) -> float:
        """
        Return the variance [N2] of the force of a side as of a white error.

        ``y`` [N] is its innovation, ``size`` [N] the sum of the forces of its wheels. Steady
        innovations differ by their noise.
        """
        noise, last = self._noise[side], self._innovations[side]
        self._innovations[side] = y
        if not step:
            noise.add_square(min(0.5 * (y - last) ** 2, MAX_NIS * noise.variance), dt)
        lasting = 2.0 * (self._offset / self._radius) ** 2 + (FORCE_ERROR * size) ** 2
        return noise.variance + 2.0 * MODEL_TIME / dt * lasting


def ground_prior(robot: RobotParams) -> tuple[Uncertain, ...]:
    """Return C_x, mu, rolling resistance, its lateral share, C_y / C_x and center of mass."""
    tire = robot.tire
    logs = (LN_STIFFNESS.value + math.log(tire.longitudinal_stiffness), math.hypot(
        LN_STIFFNESS.sigma, tire.longitudinal_stiffness_sigma)), LN_FRICTION, LN_LATERAL_RATIO
    stiffness, friction, lateral = (
        Uncertain(math.exp(mean), sigma * math.exp(mean)) for mean, sigma in logs)
    share = Uncertain(0.5 + 0.25 * LATERAL_SHARE.value, 0.25 * LATERAL_SHARE.sigma)
    return (stiffness, friction, log_normal(*UNKNOWN_RESISTANCE), share, lateral,
            *map(Uncertain, robot.center_of_mass[:2], robot.center_of_mass_sigma))


class LastingError:
    """
    Lasting error of the balance along one axis.

    Its ``variance`` [(m/s2)^2] is learned from the mean innovation over ``MODEL_TIME``: of slopes,
    suspension, and of a tire and a robot that are not those of the model. A push, or a wheel that
    loses its load, changes the mean innovation within ``PUSH_TIME``, before the correction has
    made a speed of it. From such a change on, the error is as large as the change, ``push``
    [(m/s2)^2], and ends as any lasting error does.
    """

    def __init__(self) -> None:
        self._recent, self._mean = 0.0, 0.0  # m/s2, innovations over PUSH_TIME and MODEL_TIME
        self._usual, self._lasting = (LearnedVariance(
            BALANCE_SIGMA, BALANCE_SIGMA, LEARNING_TIME) for _ in range(2))
        self.push = 0.0

    @property
    def variance(self) -> float:
        """Return the variance [(m/s2)^2] without that of a push."""
        return self._lasting.variance

    def add_innovation(self, y: float, dt: float) -> None:
        """Add an innovation ``y`` [m/s2] over ``dt`` [s]."""
        self._recent -= math.expm1(-dt / PUSH_TIME) * (y - self._recent)
        kept = math.exp(-dt / MODEL_TIME)
        self._mean += (1.0 - kept) * (y - self._mean)
        change, usual = (self._recent - self._mean) ** 2, self._usual.variance
        self._usual.add_square(min(change, MAX_NIS * usual), dt)
        self.push *= kept
        if change > PUSH_SIGMAS ** 2 * usual:
            self.push = max(self.push, change)

    def learn(self, explained: float, dt: float) -> None:
        """Learn from the mean innovation, with the variance ``explained`` by white errors."""
        self._lasting.add_square(
            min(max(self._mean ** 2 - explained, 0.0), MAX_NIS * self.variance), dt)


class GroundChange:
    """The likelihood ratio of a change in the last ``MODEL_TIME``."""

    def __init__(self, kalman: KalmanFilter, spread: Array) -> None:
        self._kalman, self._spread = kalman, spread  # (3, 3), of the change
        self._restart()

    def _restart(self) -> None:
        self._vector, self._matrix = np.zeros(3), np.zeros((3, 3))
        self._forget_interval()

    def _forget_interval(self) -> None:
        self._new_vector, self._new_matrix = [0.0] * 3, [0.0] * 9

    def age(self, dt: float, time: float) -> None:
        """Let ``dt`` [s] pass: the errors have an effect since the last ``time`` [s] only."""
        self._kalman.fade_ground(math.exp(-dt / time))

    def add_innovation(self, covariance: Sequence[float], y: float, variance: float) -> None:
        """Add an innovation ``y`` with its ``covariance`` (3,) with the errors of the ground."""
        limit = math.sqrt(MAX_NIS * variance)
        y = min(max(y, -limit), limit) / variance
        vector, matrix = self._new_vector, self._new_matrix
        for i, c in enumerate(covariance):
            vector[i] += c * y
            for j, other in enumerate(covariance):
                matrix[3 * i + j] += c * (other / variance)

    def find(self, steady: bool, dt: float) -> Array | None:
        """
        Return the change (3,) of the ground, None if there is none.

        The innovations since the last call, ``dt`` [s] ago, count if the motion was ``steady``.
        """
        own, keep = self._kalman.P[SUDDEN, SUDDEN], math.exp(-dt / MODEL_TIME)
        inverse = np.linalg.inv(own + MIN_SIGMA ** 2 * np.eye(3))
        self._vector *= keep
        self._matrix *= keep
        if steady:
            self._vector += inverse @ self._new_vector
            self._matrix += inverse @ np.reshape(self._new_matrix, (3, 3)) @ inverse
        self._forget_interval()
        ratio = np.eye(3) + self._spread @ self._matrix
        change = np.linalg.solve(ratio, self._spread @ self._vector)
        if self._vector @ change - np.linalg.slogdet(ratio)[1] < EVIDENCE:
            return None
        self._restart()
        return np.asarray(change, dtype=np.float64)

    def replace(self, change: Array, covariance: Array) -> None:
        """
        Replace the errors of the ground by those (7, 7) of a ground that is ``change`` (7,) away.

        What the errors so far have caused in the state moves with the ground.
        """
        kalman, own = self._kalman, self._kalman.P[GROUND, GROUND]
        effect = kalman.P[:, GROUND] @ np.linalg.inv(own + MIN_SIGMA ** 2 * np.eye(len(own)))
        effect[GROUND] = np.eye(len(own))
        rest = np.eye(N)
        rest[:, GROUND] -= effect
        kalman.P[:] = rest @ kalman.P @ rest.T + effect @ covariance @ effect.T
        x = np.array(kalman.x) + effect @ change
        x[GROUND] = 0.0
        kalman.x[:] = array('d', x)
        self._forget_interval()


class ForceBalance:
    """The ground, from its prior on, and the corrections by the balance of forces."""

    def __init__(self, robot: RobotParams, kalman: KalmanFilter) -> None:
        self._kalman, self._forces = kalman, TireForces(robot, kalman.P)
        self._prior = ground_prior(robot)
        self._prior_variances = np.square(_sigmas(self._prior))
        kalman.P[GROUND, GROUND] = np.diag(self._prior_variances)
        self._set_given([one.value for one in self._prior])
        self._spread = np.diag(self._prior_variances[:3])
        self._change = GroundChange(kalman, self._spread)
        self._torques = MotorTorques(robot)
        self._along, self._across = LastingError(), LastingError()
        self._rolling = [0.0] * 4      # m/s, r w of the wheels at the last step
        self.relaxation = 0.5 * robot.tire.contact_length  # m, length of a brush tire
        self._transient = 0.0          # m/s, of the slip, that forces do not follow yet
        self._silent = math.inf        # s, since the last ground_state
        self._since_change = math.inf  # s, since the filter has found a change of the ground
        self.changes = 0               # of the ground, found by the filter

    @property
    def given(self) -> bool:
        """Return whether the ground is that of a ``ground_state``."""
        return self._silent < EXPIRY_TIME

    @property
    def least_friction(self) -> float:
        """Return the friction coefficient less two standard deviations."""
        sigma = math.sqrt(self._kalman.P[State.LN_FRICTION, State.LN_FRICTION])
        return self._given[1] * math.exp(float(self._kalman.x[State.LN_FRICTION]) - 2.0 * sigma)

    @property
    def friction_ignorance(self) -> float:
        """Return the share [-] of the prior variance of the friction that is left."""
        variance = float(self._kalman.P[State.LN_FRICTION, State.LN_FRICTION])
        return variance / LN_FRICTION.sigma ** 2

    @property
    def follows(self) -> bool:
        """Return whether the ground is estimated, after a change that the filter has found."""
        return self._since_change < EXPIRY_TIME

    def set_ground(self, ground: GroundState) -> None:
        """
        Take the ground as given, with its errors; what is not known has those of the prior.

        After a change that this filter has found, one that contradicts its own estimate, or is
        less certain, is not that of the new ground yet.
        """
        if not self.given:  # they were those of the prior
            self._along, self._across = LastingError(), LastingError()
        self._silent = 0.0
        self._torques.set_ground(ground)
        reported = (ground.stiffness, ground.friction_coefficient, ground.rolling_resistance,
                    ground.lateral_share, ground.lateral_stiffness_ratio,
                    ground.center_of_mass_x, ground.center_of_mass_y)
        taken = [one if math.isfinite(one.value) and math.isfinite(one.sigma) else prior
                 for one, prior in zip(reported, self._prior)]
        given, sigmas = [one.value for one in taken], _sigmas(taken)
        covariance = np.diag(np.square(sigmas))
        covariance[0, 1] = covariance[1, 0] = (
            ground.stiffness_friction_correlation * sigmas[0] * sigmas[1])
        change = _difference(given, self._given)
        own = self._kalman.P[GROUND, GROUND]
        if self.follows and (
                covariance[0, 0] > own[0, 0] or _contradict(change, covariance + own)):
            return
        self._since_change = math.inf
        self._set_given(given)
        self._change.replace(change, covariance)

    def age(self, dt: float) -> None:
        """Let the errors grow to the prior while ``ground_state`` is silent; ``dt`` [s] passed."""
        self._silent += dt
        self._since_change += dt
        if not self.given:
            share = min(dt / EXPIRY_TIME, 1.0)
            for row, prior in enumerate(self._prior_variances, int(State.LN_STIFFNESS)):
                variance = float(self._kalman.P[row, row])
                self._kalman.P[row, row] += share * max(float(prior) - variance, 0.0)

    def find_change(self, imu: ImuInput, torques: Four | None, wheels: WheelSpeeds, step: float
                    ) -> None:
        """
        Look for a change of the ground at a wheel sample.

        ``torques`` [N m] are those of the motors, ``step`` [m/s] is the slip of a side by a change
        of its speed since the last sample.
        """
        self._transient = max(self._transient, step)
        if not self.given or imu.reading is None:
            return  # the friction of the motors is part of it, and a prior does not change
        if torques is not None and min(map(abs, self._rolling)) >= MIN_SLIP_SPEED:
            self._correct_torques(imu.reading, torques, wheels, step)
        # the tires follow a change of speed between two samples before it is measured
        change = self._change.find(step == 0.0, wheels.duration)
        if change is None or self.follows:
            return
        covariance = self._kalman.P[GROUND, GROUND].copy()
        covariance[:3], covariance[:, :3] = 0.0, 0.0
        covariance[:3, :3] = self._spread
        self._change.replace(np.pad(change, (0, len(covariance) - 3)), covariance)
        self._add_to_ground(change)
        self._since_change = 0.0
        self.changes += 1

    def _add_to_ground(self, change: Sequence[float] | Array) -> None:
        """Add ``change`` (3,) of ln C_x, ln mu and rolling resistance to the ground as given."""
        stiffness, mu, resistance, *others = self._given
        self._set_given((stiffness * math.exp(change[0]), mu * math.exp(change[1]),
                         max(resistance + change[2], 0.0), *others))

    def _set_given(self, given: Sequence[float]) -> None:
        self._given = given  # in the order of State
        self._forces.set_ground(given)

    def _correct(self, y: float, h: Array, variance: float, shared: tuple[int, float] = (0, 0.0)
                 ) -> None:
        """Correct with an innovation of the forces; the ground too while it is followed."""
        kalman = self._kalman
        total = kalman.correct(y, h, variance, FOLLOWED if self.follows else FORCES_HELD, shared)
        self._change.add_innovation(kalman.ground, y, total)
        if self.follows:
            self._add_to_ground(kalman.x[SUDDEN])
            kalman.x[SUDDEN] = array('d', bytes(24))

    def correct(self, imu: ImuInput, residual: Four, dt: float) -> bool:
        """
        Correct with the balance along x and y at the last IMU reading, after a step of ``dt`` [s].

        Return False if it does not hold: the robot is too slow, or speed and slip are so
        uncertain that the forces are no linear function of them.
        """
        reading, x = imu.reading, self._kalman.x
        assert reading is not None
        # a prior is that of all grounds: its errors last
        self._change.age(dt, MODEL_TIME if self.given else EXPIRY_TIME)
        W = reading.yaw_rate - x[State.GYRO_BIAS_Z]
        self._rolling = self._forces.rolling_speeds(x, W, residual)
        speed = max(0.25 * sum(map(abs, self._rolling)), MIN_SLIP_SPEED)
        self._transient *= math.exp(-speed * dt / self.relaxation)
        P = self._kalman.P
        if min(map(abs, self._rolling)) < MIN_SLIP_SPEED or max(
                P[row, row] for row in (State.V_X, *SLIP_VELS)) > speed ** 2:
            return False
        expected = self._forces.balance(
            x, self._rolling, W, imu.yaw_accel, reading.force_x, reading.force_y)
        shared = -0.5 * dt * imu.force_variance  # the sample ends the step that was predicted
        arm_x, arm_y = self._forces.center_arm(x)
        for error, h, velocity, arm, lasting in zip(
                expected, self._forces.H, (State.V_X, State.V_Y), (arm_y, arm_x),
                (self._along, self._across)):
            lasting.add_innovation(-error, dt)
            late = float(h[SLIP_VELS[0]] + h[SLIP_VELS[1]]) * self._transient
            white = (imu.force_variance + arm * arm * imu.yaw_accel_variance
                     + 2.0 * self.relaxation / (speed * dt) * late * late)
            # along x, starts and stops change the innovations as pushes do
            own = lasting.variance + (lasting.push if velocity == State.V_Y else 0.0)
            # an error that lasts: as white noise it has the same mean over its time
            self._correct(-error, h, 2.0 * MODEL_TIME / dt * own + white, (velocity, shared))
            lasting.learn(0.5 * dt / MODEL_TIME * white, dt)
        return True

    def _correct_torques(self, reading: ImuReading, torques: Four, wheels: WheelSpeeds,
                         step: float) -> None:
        """Correct with the traction forces of both sides by the motor torques."""
        x = self._kalman.x
        loads = self._forces.loads(x, reading.force_x, reading.force_y)
        measured = self._torques.forces(torques, wheels.wheel_speeds, loads)
        if measured is None:
            return
        left, right = (abs(measured[side]) + abs(measured[side + 2]) for side in (0, 1))
        for side, size in enumerate((left, right)):
            W = reading.yaw_rate - x[State.GYRO_BIAS_Z]
            expected = self._forces.tractions(x, self._rolling, W, loads)[side]
            h, y = self._forces.H[side], measured[side] + measured[side + 2] - expected
            self._correct(y, h, (h[SLIP_VELS[side]] * self._transient) ** 2
                          + self._torques.variance(side, y, size, step, wheels.duration))


def _sigmas(ground: Sequence[Uncertain]) -> list[float]:
    """Return the standard deviations (7,) of the states of a ground."""
    return [one.sigma / one.value if row in RELATIVE else one.sigma
            for row, one in enumerate(ground)]


def _difference(given: Sequence[float], other: Sequence[float]) -> Array:
    """Return the difference (7,) of two grounds, of logarithms where their errors are relative."""
    return np.array([math.log(one / two) if row in RELATIVE else one - two
                     for row, (one, two) in enumerate(zip(given, other))])


def _contradict(difference: Array, covariance: Array) -> bool:
    """Return whether C_x, mu and rolling resistance differ by more than their errors."""
    off = difference[:3]
    return bool(off @ np.linalg.solve(covariance[:3, :3], off) > MAX_NIS)
