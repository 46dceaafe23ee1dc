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
The ground with its errors considered: corrections with the forces, and changes of the ground.

Its values and their errors are those of the prior until a ``GroundState`` gives others. With the
covariance P of the errors of the ground g and the innovation y, ``P_yg P_gg^-1`` is the effect of
a change of the ground on the innovation, through all corrections since (sensitivity of Friedland's
separate bias filter). The change that explains the innovations best is a least squares fit, its
likelihood ratio the test of Willsky and Jones.

This is plain Python; ``setup.py`` compiles it with Cython where there is a compiler.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip import state
from smart_tire.estimation.slip.inputs import ImuInput, WheelSpeeds
from smart_tire.estimation.slip.kalman import FORCES_HELD
from smart_tire.estimation.slip.state import (
    BALANCE_SIGMA, FORCE_ERROR, GROUND, ImuReading, LEARNING_TIME, MAX_REPEATS,
    N, SLIP_VELS, State, SUDDEN)
from smart_tire.models.tire import brush_tire
from smart_tire.models.vehicle.drive import torque_errors, traction_force
from smart_tire.parameters import RobotParams
from smart_tire.samples import Four, GroundState
from smart_tire.uncertain import log_normal, Uncertain

try:
    import cython
except ImportError:
    from smart_tire.numerics import uncompiled as cython

if cython.compiled:
    from cython.cimports.libc.math import exp, expm1, log, sqrt
    from cython.cimports.smart_tire.estimation.slip.kalman import KalmanFilter, LearnedVariance
    from cython.cimports.smart_tire.estimation.slip.tire_forces import TireForces
else:
    from math import exp, expm1, log, sqrt
    from smart_tire.estimation.slip.kalman import KalmanFilter, LearnedVariance
    from smart_tire.estimation.slip.tire_forces import TireForces

COMPILED: bool = cython.compiled

# constants and rows of the state that are numbers of C
cython.declare(
    EXPIRY_TIME=cython.double, MAX_NIS=cython.double, MIN_SLIP_SPEED=cython.double,
    MODEL_TIME=cython.double, PUSH_TIME=cython.double, PUSH=cython.double, EVIDENCE=cython.double,
    MIN_VARIANCE=cython.double, V_X=cython.int,
    V_Y=cython.int, GYRO_BIAS_Z=cython.int, SLIP_VEL_L=cython.int, SLIP_VEL_R=cython.int,
    LN_STIFFNESS=cython.int)
EXPIRY_TIME, MAX_NIS, MIN_SLIP_SPEED = state.EXPIRY_TIME, state.MAX_NIS, state.MIN_SLIP_SPEED
MODEL_TIME, PUSH_TIME = state.MODEL_TIME, state.PUSH_TIME
PUSH = state.PUSH_SIGMAS * state.PUSH_SIGMAS  # of a variance
EVIDENCE, MIN_VARIANCE = state.EVIDENCE, state.MIN_SIGMA * state.MIN_SIGMA
V_X, V_Y, GYRO_BIAS_Z, SLIP_VEL_L, SLIP_VEL_R, LN_STIFFNESS = map(int, (
    State.V_X, State.V_Y, State.GYRO_BIAS_Z, State.SLIP_VEL_L, State.SLIP_VEL_R,
    State.LN_STIFFNESS))

RELATIVE = [row - GROUND.start for row in (
    State.LN_STIFFNESS, State.LN_FRICTION, State.LN_LATERAL)]  # errors of the ground as given
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
    prior, share = brush_tire.LN_STIFFNESS, brush_tire.LATERAL_SHARE
    logs = ((prior.value + math.log(tire.longitudinal_stiffness), math.hypot(
        prior.sigma, tire.longitudinal_stiffness_sigma)),
            brush_tire.LN_FRICTION, brush_tire.LN_LATERAL_RATIO)
    stiffness, friction, lateral = (
        Uncertain(math.exp(mean), sigma * math.exp(mean)) for mean, sigma in logs)
    share = Uncertain(0.5 + 0.25 * share.value, 0.25 * share.sigma)
    return (stiffness, friction, log_normal(*state.UNKNOWN_RESISTANCE), share, lateral,
            *map(Uncertain, robot.center_of_mass[:2], robot.center_of_mass_sigma))


@cython.cclass
class LastingError:
    """
    Lasting error of the balance along one axis.

    Its ``variance`` [(m/s2)^2] is learned from the mean innovation over ``MODEL_TIME``: of slopes,
    suspension, and of a tire and a robot that are not those of the model. A push, or a wheel that
    loses its load, changes the mean innovation within ``PUSH_TIME``, before the correction has
    made a speed of it. From such a change on, the error is as large as the change, ``push``
    [(m/s2)^2], and ends as any lasting error does.
    """

    _recent: cython.double  # m/s2, innovations over PUSH_TIME ...
    _mean: cython.double    # ... and MODEL_TIME
    _usual: LearnedVariance
    _lasting: LearnedVariance
    push = cython.declare(cython.double, visibility='readonly')

    def __init__(self) -> None:
        self._recent = self._mean = self.push = 0.0
        self._usual = LearnedVariance(BALANCE_SIGMA, BALANCE_SIGMA, LEARNING_TIME)
        self._lasting = LearnedVariance(BALANCE_SIGMA, BALANCE_SIGMA, LEARNING_TIME)

    @property
    def variance(self) -> float:
        """Return the variance [(m/s2)^2] without that of a push."""
        return self._lasting.variance

    @cython.ccall
    def add_innovation(self, y: cython.double, dt: cython.double) -> None:
        """Add an innovation ``y`` [m/s2] over ``dt`` [s]."""
        self._recent -= expm1(-dt / PUSH_TIME) * (y - self._recent)
        kept = exp(-dt / MODEL_TIME)
        self._mean += (1.0 - kept) * (y - self._mean)
        change, usual = self._recent - self._mean, self._usual.variance
        change *= change
        self._usual.add_square(min(change, MAX_NIS * usual), dt)
        self.push *= kept
        if change > PUSH * usual:
            self.push = max(self.push, change)

    @cython.ccall
    def learn(self, explained: cython.double, dt: cython.double) -> None:
        """Learn from the mean innovation, with the variance ``explained`` by white errors."""
        self._lasting.add_square(min(max(self._mean * self._mean - explained, 0.0),
                                     MAX_NIS * self._lasting.variance), dt)


@cython.cfunc
def adjugate(A: cython.p_double, out: cython.p_double) -> cython.double:
    """Set ``out`` to the adjugate of ``A``, 9 numbers each; return its determinant."""
    out[0], out[1], out[2] = (A[4] * A[8] - A[5] * A[7], A[2] * A[7] - A[1] * A[8],
                              A[1] * A[5] - A[2] * A[4])
    out[3], out[4], out[5] = (A[5] * A[6] - A[3] * A[8], A[0] * A[8] - A[2] * A[6],
                              A[2] * A[3] - A[0] * A[5])
    out[6], out[7], out[8] = (A[3] * A[7] - A[4] * A[6], A[1] * A[6] - A[0] * A[7],
                              A[0] * A[4] - A[1] * A[3])
    return A[0] * out[0] + A[1] * out[3] + A[2] * out[6]


@cython.cclass
class GroundChange:
    """The likelihood ratio of a change in the last ``MODEL_TIME``."""

    _kalman: KalmanFilter
    _spread: cython.double[3]  # variances of the change
    _vector: cython.double[3]
    _matrix: cython.double[9]
    _new_vector: cython.double[3]  # since the last call of ``find``
    _new_matrix: cython.double[9]

    def __init__(self, kalman: KalmanFilter, spread: Array) -> None:
        self._kalman, self._spread = kalman, spread.tolist()
        self._vector, self._new_vector = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        self._matrix = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        self._new_matrix = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]

    @cython.ccall
    def age(self, dt: cython.double, time: cython.double) -> None:
        """Let ``dt`` [s] pass: the errors have an effect since the last ``time`` [s] only."""
        self._kalman.fade_ground(exp(-dt / time))

    @cython.ccall
    def add_innovation(self, covariance: Sequence[float], y: cython.double,
                       variance: cython.double) -> None:
        """Add an innovation ``y`` with its ``covariance`` (3,) with the errors of the ground."""
        limit = sqrt(MAX_NIS * variance)
        clipped = min(max(y, -limit), limit) / variance
        for i in range(3):
            one: cython.double = covariance[i]
            self._new_vector[i] += one * clipped
            for j in range(3):
                other: cython.double = covariance[j]
                self._new_matrix[3 * i + j] += one * (other / variance)

    def find(self, steady: bool, dt: float) -> Array | None:
        """
        Return the change (3,) of the ground, None if there is none.

        The innovations since the last call, ``dt`` [s] ago, count if the motion was ``steady``.
        """
        keep = exp(-dt / MODEL_TIME)
        for i in range(9):
            self._matrix[i] *= keep
        for i in range(3):
            self._vector[i] *= keep
        if steady:
            self._add_interval()
        self._forget_interval()
        change: cython.double[3] = [0.0] * 3
        A: cython.double[9] = [0.0] * 9
        inverse: cython.double[9] = [0.0] * 9
        for i in range(9):
            A[i] = self._spread[i // 3] * self._matrix[i] + (i % 4 == 0)
        determinant = adjugate(A, inverse)
        evidence = -log(abs(determinant))
        for i in range(3):
            for j in range(3):
                change[i] += inverse[3 * i + j] / determinant * self._spread[j] * self._vector[j]
            evidence += self._vector[i] * change[i]
        if evidence < EVIDENCE:
            return None
        self._vector = [0.0, 0.0, 0.0]
        self._matrix = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        return np.array([change[0], change[1], change[2]])

    @cython.cfunc
    def _add_interval(self) -> cython.void:
        """Add the new innovations by their sensitivity to the ground, with its own covariance."""
        P: cython.double[:, ::1] = self._kalman.P
        own: cython.double[9] = [0.0] * 9
        inverse: cython.double[9] = [0.0] * 9
        for i in range(9):
            own[i] = P[LN_STIFFNESS + i // 3, LN_STIFFNESS + i % 3] + MIN_VARIANCE * (i % 4 == 0)
        determinant = adjugate(own, inverse)
        for i in range(9):
            inverse[i] /= determinant
        for i in range(3):
            for j in range(3):
                self._vector[i] += inverse[3 * i + j] * self._new_vector[j]
                product = 0.0  # of the inverse and the new matrix
                for k in range(3):
                    product += inverse[3 * i + k] * self._new_matrix[3 * k + j]
                for k in range(3):
                    self._matrix[3 * i + k] += product * inverse[3 * j + k]

    @cython.cfunc
    def _forget_interval(self) -> cython.void:
        for i in range(9):
            self._new_matrix[i] = 0.0
            self._new_vector[i // 3] = 0.0

    def replace(self, change: Array, covariance: Array) -> None:
        """
        Replace the errors of the ground by those (7, 7) of a ground that is ``change`` (7,) away.

        What the errors so far have caused in the state moves with the ground.
        """
        kalman, own = self._kalman, self._kalman.P[GROUND, GROUND]
        effect = kalman.P[:, GROUND] @ np.linalg.inv(own + MIN_VARIANCE * np.eye(len(own)))
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
        self._change = GroundChange(kalman, self._prior_variances[:3])
        self._torques = MotorTorques(robot)
        self._along, self._across = LastingError(), LastingError()
        self._slowest = 0.0            # m/s, least magnitude of r w of the wheels at the last step
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
        return variance / brush_tire.LN_FRICTION.sigma ** 2

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
            P: cython.double[:, ::1] = self._kalman.P
            priors: cython.double[::1] = self._prior_variances
            share = min(dt / EXPIRY_TIME, 1.0)
            for i in range(priors.shape[0]):
                row = LN_STIFFNESS + i
                P[row, row] += share * max(priors[i] - P[row, row], 0.0)

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
        if torques is not None and self._slowest >= MIN_SLIP_SPEED:
            self._correct_torques(imu.reading, torques, wheels, step)
        # the tires follow a change of speed between two samples before it is measured
        change = self._change.find(step == 0.0, wheels.duration)
        if change is None or self.follows:
            return
        covariance = self._kalman.P[GROUND, GROUND].copy()
        covariance[:3], covariance[:, :3] = 0.0, 0.0
        covariance[:3, :3] = np.diag(self._prior_variances[:3])
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

    def _correct(self, y: cython.double, axis: cython.int, variance: cython.double,
                 row: cython.int = 0, shared: cython.double = 0.0) -> None:
        """
        Correct with an innovation of the forces along ``axis``; the ground too while it follows.

        ``shared`` is the covariance with the error of the state in ``row``.
        """
        kalman: KalmanFilter = self._kalman
        forces: TireForces = self._forces
        change: GroundChange = self._change
        follows: cython.bint = self.follows
        total = kalman.correct(
            y, forces.H[axis], variance, FOLLOWED if follows else FORCES_HELD, row, shared)
        change.add_innovation(kalman.ground, y, total)
        if follows:
            self._add_to_ground(kalman.x[SUDDEN])
            kalman.x[SUDDEN] = array('d', bytes(24))

    def correct(self, imu: ImuInput, residual: Four, dt: float) -> bool:
        """
        Correct with the balance along x and y at the last IMU reading, after a step of ``dt`` [s].

        Return False if it does not hold: the robot is too slow, or speed and slip are so
        uncertain that the forces are no linear function of them.
        """
        reading = imu.reading
        assert reading is not None
        kalman: KalmanFilter = self._kalman
        forces: TireForces = self._forces
        x: cython.double[::1] = kalman.x
        P: cython.double[:, ::1] = kalman.P
        # a prior is that of all grounds: its errors last
        self._change.age(dt, MODEL_TIME if self.given else EXPIRY_TIME)
        W: cython.double = reading[0] - x[GYRO_BIAS_Z]
        slowest, speed = forces.roll(x, W, residual)
        speed = max(speed, MIN_SLIP_SPEED)
        relaxation: cython.double = self.relaxation
        transient: cython.double = self._transient * exp(-speed * dt / relaxation)
        self._slowest, self._transient = slowest, transient
        if slowest < MIN_SLIP_SPEED or max(
                P[V_X, V_X], P[SLIP_VEL_L, SLIP_VEL_L], P[SLIP_VEL_R, SLIP_VEL_R]
                ) > speed * speed:
            return False
        along, across = forces.balance(x, W, imu.yaw_accel, reading[1], reading[2])
        arm_x, arm_y = forces.center_arm(x)
        force_variance: cython.double = imu.force_variance
        turn_variance: cython.double = imu.yaw_accel_variance
        for axis in range(2):
            y = -across if axis else -along
            arm = arm_x if axis else arm_y
            lasting: LastingError = self._across if axis else self._along
            lasting.add_innovation(y, dt)
            late = (forces.H[axis, SLIP_VEL_L] + forces.H[axis, SLIP_VEL_R]) * transient
            white = (force_variance + arm * arm * turn_variance
                     + 2.0 * relaxation / (speed * dt) * late * late)
            # along x, starts and stops change the innovations as pushes do
            own = lasting._lasting.variance + (lasting.push if axis else 0.0)
            # an error that lasts: as white noise it has the same mean over its time; the sample
            # ends the step that was predicted
            self._correct(y, axis, 2.0 * MODEL_TIME / dt * own + white, V_Y if axis else V_X,
                          -0.5 * dt * force_variance)
            lasting.learn(0.5 * dt / MODEL_TIME * white, dt)
        return True

    def _correct_torques(self, reading: ImuReading, torques: Four, wheels: WheelSpeeds,
                         step: float) -> None:
        """Correct with the traction forces of both sides by the motor torques."""
        forces: TireForces = self._forces
        x: cython.double[::1] = self._kalman.x
        loads = forces.loads(x, reading.force_x, reading.force_y)
        measured = self._torques.forces(torques, wheels.wheel_speeds, loads)
        if measured is None:
            return
        transient: cython.double = self._transient
        rate: cython.double = reading.yaw_rate
        for side in range(2):
            front: cython.double = measured[side]
            rear: cython.double = measured[side + 2]
            W = rate - x[GYRO_BIAS_Z]
            expected: cython.double = forces.tractions(x, W, loads)[side]
            y = front + rear - expected
            late = forces.H[side, SLIP_VEL_L + side] * transient
            self._correct(y, side, late * late + self._torques.variance(
                side, y, abs(front) + abs(rear), step, wheels.duration))


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
