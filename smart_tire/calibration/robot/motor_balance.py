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
Regressions of the measured torque: on the ground against the force balance, and of lifted wheels.

With kappa, the measured torque over the true one, the sum over the wheels on the ground is
``kappa (r m f + J sum(dw/dt)) + resistance + offset``: the body is the weight that calibrates the
torque constant. The specific force f contains the slope of the ground. Wheels off the ground give
kappa J, and kappa times the friction of gear and bearings, of each motor. On the ground alone the
inertia of the wheels acts like mass, and their friction like rolling resistance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.robot.motor_drive import hac_lags, MIN_ROWS
from smart_tire.calibration.robot.motor_rows import MotorRows, own_columns
from smart_tire.errors import EstimatorError
from smart_tire.models.constants import GRAVITY
from smart_tire.numerics.regression import Prior, robust_regression, RobustFit
from smart_tire.parameters import RobotParams
from smart_tire.samples import LEFT, RIGHT, WHEELS
from smart_tire.uncertain import Uncertain

MAX_TURN_SHARE = 0.2      # of the speed: half the difference of the sides; tires scrub in turns
INERTIA_SIGMA = 0.1       # relative, of the configured inertia: from data sheets; assumed
VISCOUS_SIGMA = 0.01      # N m s/rad, of the configured viscous friction; assumed
TORQUE_OFFSET_SIGMA = 0.02  # N m, of a measured torque; assumed
GROUND_SLOPE_SIGMA = 0.01   # rad, of the ground at the rests, against which the force is measured
TORQUE_DELAY_SIGMA = 0.01   # s, of the measured torque against the IMU; assumed
ALL_WHEELS = tuple(range(len(WHEELS)))
TYPICAL_NOISE = 0.1         # N m, first value of the standard deviation of a row
BRAKING_FACTOR = 2.0        # times the configured friction: motors must brake, too
MIN_BRAKING_ROWS = 10
MIN_FOLLOWED_ACCELERATION = 0.2  # m/s2 rms of the wheels, to compare them with the body
MIN_FOLLOWING, MAX_FOLLOWING = 0.5, 0.3  # body over wheels: on the ground, and lifted


@dataclass(frozen=True)
class Run:
    """Rows of one recording with the torque to explain."""

    rows: MotorRows
    torque: Array  # (n, 4) N m, mean torques as measured
    torque_sigma: Array    # (n, 4) N m, model error of the torque, common to all motors
    rest_force: Uncertain  # m/s2, forward specific force at rest


class Lifted(IntEnum):
    """Coefficients of a lifted wheel; an offset of each recording follows."""

    INERTIA = 0   # kappa J
    COULOMB = 1   # kappa tau_c
    VISCOUS = 2   # kappa b


class Ground(IntEnum):
    """Coefficients on the ground; resistance and offset of each recording follow."""

    KAPPA = 0
    VISCOUS = 1   # kappa b
    DELAY = 2     # kappa r m times the delay of the torque


@dataclass(frozen=True)
class LiftedFit:
    """Means over the motors, in the unit of the measured torque, and each motor's inertia."""

    inertia: Uncertain          # kg m2
    coulomb: Uncertain          # N m
    viscous: Uncertain          # N m s/rad
    inertias: list[Uncertain]   # kg m2, of each motor
    max_speed: float            # rad/s


@dataclass(frozen=True)
class GroundFit:
    """The force balance of the robot on the ground."""

    kappa: Uncertain            # measured over true torque
    inertia_shift: float        # change of kappa for an inertia larger by its sigma
    resistance: list[Uncertain]  # N m per wheel at low speed, each recording, as measured
    scales: list[Uncertain]     # kappa of each motor, if all tires push equally
    balance: Array              # (n,) N m, torque of all wheels that force and inertia require
    torque: Array               # (n,) N m, as measured, without resistance and offset


def fit_lifted(runs: Sequence[Run], robot: RobotParams) -> LiftedFit:
    """Return inertia and friction of lifted wheels; EstimatorError if there are too few rows."""
    for run in runs:
        following = _following(run.rows, robot)
        if following > MAX_FOLLOWING:
            raise EstimatorError('the body accelerates with its wheels: they are not lifted')
    if sum(len(run.rows.time) for run in runs) < MIN_ROWS:
        raise EstimatorError(_too_few(runs))
    fits = [_fit_lifted_wheel(runs, wheel) for wheel in range(len(WHEELS))]

    def mean(index: Lifted) -> Uncertain:
        estimates = [fit.estimate(index) for fit in fits]
        return Uncertain(float(np.mean([item.value for item in estimates])),
                         float(np.sqrt(np.mean([item.sigma ** 2 for item in estimates]))) / 2.0)

    return LiftedFit(mean(Lifted.INERTIA), mean(Lifted.COULOMB), mean(Lifted.VISCOUS),
                     [fit.estimate(Lifted.INERTIA) for fit in fits],
                     max(float(np.abs(run.rows.speed).max(initial=0.0)) for run in runs))


def _fit_lifted_wheel(runs: Sequence[Run], wheel: int) -> RobustFit:
    matrix = np.column_stack([
        np.concatenate([run.rows.acceleration[:, wheel] for run in runs]),
        np.concatenate([run.rows.direction[:, wheel] for run in runs]),
        np.concatenate([run.rows.speed[:, wheel] for run in runs]),
        own_columns([run.rows for run in runs])])
    sigma = np.full(matrix.shape[1], np.inf)
    sigma[len(Lifted):] = TORQUE_OFFSET_SIGMA
    target = np.concatenate([run.torque[:, wheel] for run in runs])
    return _regression(runs, matrix, target, Prior(np.zeros(len(sigma)), sigma), [wheel])


def fit_ground(runs: Sequence[Run], robot: RobotParams, lifted: LiftedFit | None) -> GroundFit:
    """
    Return the force balance; the inertia comes from ``lifted`` wheels or from the parameters.

    The recording does not change the inertia: the difference between the accelerations of wheels
    and body is slip and noise. Raises EstimatorError if the wheels are lifted or slide, or rows
    are too few.
    """
    straight = [_straight(run) for run in runs]
    if sum(len(run.rows.time) for run in straight) < MIN_ROWS:
        raise EstimatorError(_too_few(straight))
    for run in straight:
        if _following(run.rows, robot) < MIN_FOLLOWING:
            raise EstimatorError('the body does not accelerate with its wheels: they slide, or '
                                 'are lifted')
        _check_braking(run, robot)
    nominal, heavier = (_GroundProblem(straight, robot, lifted, sigmas) for sigmas in (0.0, 1.0))
    torque = np.concatenate([run.torque for run in straight])
    fit = nominal.fit(torque, ALL_WHEELS)
    kappa = fit.estimate(Ground.KAPPA)
    shift = float(heavier.fit(torque, ALL_WHEELS).coefficients[Ground.KAPPA]) - kappa.value
    resistance = [fit.estimate(len(Ground) + number) for number in range(len(straight))]
    single = [nominal.fit(torque, [wheel]).estimate(Ground.KAPPA) for wheel in ALL_WHEELS]
    balance = nominal.balance(kappa.value)
    other = fit.coefficients.copy()
    other[Ground.KAPPA] = 0.0
    return GroundFit(
        _with_attenuation(kappa, straight), shift, resistance,
        single, balance, torque.sum(axis=1) - nominal.columns(ALL_WHEELS) @ other)


class _GroundProblem:
    """
    Regression of the torque of all wheels, or of one, on the ground.

    The inertia is larger than its best estimate by a number of ``sigmas``.
    """

    def __init__(self, runs: Sequence[Run], robot: RobotParams, lifted: LiftedFit | None,
                 sigmas: float) -> None:
        self._runs, self._robot = runs, robot
        configured = Uncertain(robot.motor.inertia, INERTIA_SIGMA * robot.motor.inertia)
        inertia = configured if lifted is None else lifted.inertia
        value = inertia.value + sigmas * inertia.sigma
        # from lifted wheels it is known in the unit of the measured torque, otherwise in kg m2
        self._true, self._measured = (value, 0.0) if lifted is None else (0.0, value)
        self._viscous = (Uncertain(robot.motor.viscous_friction, VISCOUS_SIGMA)
                         if lifted is None else lifted.viscous)
        self._rows = [run.rows for run in runs]
        self._force = robot.mass * robot.wheel_radius * np.concatenate([
            run.rows.force - run.rest_force.value for run in runs])
        self._force_rate = np.concatenate([rows.force_rate for rows in self._rows])
        self._acceleration, self._direction, self._speed = (
            np.concatenate([getattr(rows, name) for rows in self._rows])
            for name in ('acceleration', 'direction', 'speed'))

    def columns(self, wheels: Sequence[int]) -> Array:
        """Return the regressors of the torque of ``wheels``."""
        share, own = len(wheels) / len(WHEELS), own_columns(self._rows)
        direction = self._direction[:, wheels].sum(axis=1)
        return np.column_stack([
            share * self._force + self._true * self._acceleration[:, wheels].sum(axis=1),
            self._speed[:, wheels].sum(axis=1), share * self._force_rate,
            own * direction[:, None], own])

    def fit(self, torque: Array, wheels: Sequence[int]) -> RobustFit:
        """Return the fit of the ``torque`` (n, 4) of ``wheels``."""
        target = (torque - self._measured * self._acceleration)[:, wheels].sum(axis=1)
        return _regression(self._runs, self.columns(wheels), target, self._prior(len(wheels)),
                           wheels)

    def _prior(self, wheels: int) -> Prior:
        robot, bags = self._robot, len(self._runs)
        lever = wheels / len(WHEELS) * robot.mass * robot.wheel_radius
        mean = np.zeros(len(Ground) + 2 * bags)
        sigma = np.full(len(mean), np.inf)
        mean[Ground.VISCOUS], sigma[Ground.VISCOUS] = self._viscous
        sigma[Ground.DELAY] = robot.mass * robot.wheel_radius * TORQUE_DELAY_SIGMA
        sigma[len(Ground) + bags:] = [
            math.hypot(lever * run.rest_force.sigma, math.sqrt(wheels) * TORQUE_OFFSET_SIGMA)
            for run in self._runs]
        return Prior(mean, sigma)

    def balance(self, kappa: float) -> Array:
        """Return the true torque [N m] (n,) that force and inertia require."""
        inertia = self._true + self._measured / kappa
        return np.asarray(self._force + inertia * self._acceleration.sum(axis=1))


def _regression(runs: Sequence[Run], matrix: Array, target: Array, prior: Prior,
                wheels: Sequence[int]) -> RobustFit:
    sigma = np.concatenate([run.torque_sigma[:, wheels].sum(axis=1) for run in runs])
    return robust_regression(
        matrix, target, prior, model_sigma=sigma, initial_sigma=TYPICAL_NOISE,
        hac_lags=hac_lags([run.rows for run in runs]))


def _straight(run: Run) -> Run:
    """Return the rows in which all wheels rotate in one direction at similar speeds."""
    speed = run.rows.speed
    left, right = speed[:, LEFT].mean(axis=1), speed[:, RIGHT].mean(axis=1)
    same = np.abs(run.rows.direction.sum(axis=1)) == len(WHEELS)
    selected = same & (0.5 * np.abs(right - left) < MAX_TURN_SHARE * 0.5 * np.abs(left + right))
    return Run(run.rows.where(selected), run.torque[selected], run.torque_sigma[selected],
               run.rest_force)


def _following(rows: MotorRows, robot: RobotParams) -> float:
    """Return the acceleration of the body over that of its wheels; NaN if that is too small."""
    if not len(rows.time):
        return math.nan
    wheels = robot.wheel_radius * rows.acceleration.mean(axis=1)
    wheels, force = wheels - wheels.mean(), rows.force - rows.force.mean()
    if math.sqrt(float(np.mean(wheels ** 2))) < MIN_FOLLOWED_ACCELERATION:
        return math.nan
    return float(np.sum(force * wheels) / np.sum(wheels ** 2))


def _check_braking(run: Run, robot: RobotParams) -> None:
    """Raise EstimatorError if the torque drives while the body brakes harder than friction."""
    motor, rows = robot.motor, run.rows
    direction = rows.direction[:, 0]
    balance = direction * (robot.mass * robot.wheel_radius * (
        rows.force - run.rest_force.value) + motor.inertia * rows.acceleration.sum(axis=1))
    friction = 4.0 * motor.coulomb_friction + (
        robot.wheel_radius * motor.axle_friction * robot.mass * GRAVITY)
    braking = balance < -BRAKING_FACTOR * friction
    if braking.sum() >= MIN_BRAKING_ROWS and float(np.median(
            (direction * run.torque.sum(axis=1))[braking])) > 0.0:
        raise EstimatorError('the motor torque is positive while the robot brakes: the boards '
                             'report magnitudes of currents')


def _with_attenuation(kappa: Uncertain, runs: Sequence[Run]) -> Uncertain:
    """Return ``kappa`` with the bias from noise and vibration of the IMU in its sigma."""
    noise = sum(len(run.rows.time) * run.rows.force_noise ** 2 for run in runs)
    signal = sum(float(np.sum((run.rows.force - run.rows.force.mean()) ** 2)) for run in runs)
    return Uncertain(kappa.value, math.hypot(
        kappa.sigma, kappa.value * noise / max(signal, 1e-9)))


def _too_few(runs: Sequence[Run]) -> str:
    found = sum(len(run.rows.time) for run in runs)
    return (f'{found} readings in straight motion, expected at least {MIN_ROWS}: each needs half '
            'a second in one direction')
