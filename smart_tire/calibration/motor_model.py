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
One fit of the motors: duty, torque, speed and force of recordings on the ground and lifted.

The torque of a brushed motor is ``tau = k (duty - w / w_0)``, with stall torque k and free speed
w_0; the boards report kappa tau. It accelerates a wheel of inertia J against friction, and on the
ground it drives a share p of the body, whose weight calibrates the torque constant:

    ``tau = J dw/dt + viscous w + resistance sign(w) + p r m f / 4``

with the specific force f, which contains the slope; lifted wheels have no last term. On the ground
alone J acts like mass, and friction like rolling resistance. Means of the duty over windows are
compared with this torque, and measured torques with duty and speed at the same instant: between
two commands the torque falls while the wheel accelerates, so that readings at the rate of the
commands see it always at the same phase (their mean is wrong by up to 20 % for the paper's robot
at 16 Hz). Without duties these means must do.

What the recordings do not determine has a prior, and thereby its part in all standard errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
import math
from typing import Any

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.motor_rows import COMMAND_DELAY, MotorRows
from smart_tire.calibration.priors import PRIORS
from smart_tire.calibration.recording import Mask
from smart_tire.calibration.results import MIN_ROWS
from smart_tire.errors import EstimatorError
from smart_tire.numerics.least_squares import (
    Errors, Fit, HAC_TIME, nonlinear_fit, Prior, regression, Rows)
from smart_tire.parameters import RobotParams
from smart_tire.samples import GRAVITY, LEFT, RIGHT

Runs = Sequence[MotorRows]

WIDE = 10.0              # times a start value: sigma of what the recordings determine
MAX_TURN_SHARE = 0.2     # of the speed: half the difference of the sides; tires scrub in turns
SAMPLING_FACTOR = 2.0    # error of the torque over the ripple of the force, which tires smooth
MIN_FOLLOWED_ACCELERATION = 0.2  # m/s2 rms of the wheels, to compare them with the body
MIN_FOLLOWING = 0.4      # acceleration of the body over that of the wheels: on the ground
BRAKING_FACTOR, MIN_BRAKING_ROWS = 2.0, 10  # times the configured friction: motors must brake, too

# fitted values: six of each motor, those of all, then five of each run on the ground
SPEED_GAIN, DUTY_GAIN, KAPPA, OFFSET, SHARE, COULOMB = (
    slice(4 * i, 4 * i + 4) for i in range(6))
(INERTIA, VISCOUS, FORCE_SCALE, TORQUE_DELAY, COMMAND_ERROR, READING_ERROR, SLIP_ERROR,
 COMMON) = range(24, 32)


def load_torque(robot: RobotParams) -> float:
    """Return the torque [N m] of one wheel that drives with its share of the weight."""
    return 0.25 * robot.mass * GRAVITY * robot.wheel_radius


class MotorModel:
    """
    Residuals of the recordings; those of windows are of the ``duty`` or of the measured torque.

    Raises EstimatorError with the reason if recordings are swapped, too short, or have no signs.
    """

    def __init__(self, grounds: Runs, lifted: Runs, robot: RobotParams, *, duty: bool,
                 scale_sigma: float) -> None:
        """``scale_sigma`` is the relative standard deviation of measured accelerations."""
        self._robot, self._grounds, self._duty = robot, grounds, duty
        self._scale_sigma = scale_sigma
        self.ground = _joined(grounds)
        self.lifted = _joined(lifted) if lifted else self.ground.where(np.zeros(0, np.intp))
        self._run = np.repeat(np.arange(len(grounds)), [len(rows.time) for rows in grounds])
        self._lifted_duty = duty and not np.isnan(self.lifted.duty).any()
        straight = _is_straight(self.ground)
        for count in (int(straight.sum()), *([len(self.lifted.time)] if lifted else [])):
            if count < MIN_ROWS:
                raise EstimatorError(
                    f'{count} readings in straight motion, expected at least {MIN_ROWS}: each '
                    'needs half a second in one direction')
        _check_motion([rows.where(_is_straight(rows)) for rows in grounds], lifted, robot)
        #: relative error of a torque from readings in step with the commands
        self.sampling_error = 0.0 if duty else _sampling_error(self.ground.where(straight))
        ground, n = self.ground, len(self.ground.time)
        known = np.concatenate([
            straight[:, None] & ~np.isnan(ground.duty if duty else ground.torque),
            ~np.isnan(ground.center_torque + ground.center_duty) & duty,
            ~np.isnan(self.lifted.duty if self._lifted_duty else self.lifted.torque)])
        self._known = known.ravel()
        #: instants at which torque and duty of a motor are known, at least
        self.instants = int(known[n:2 * n].sum(axis=0).min())
        self._group = np.repeat([0, 1, 2], [4 * n, 4 * n, 4 * len(self.lifted.time)])
        self._instant = np.repeat(np.concatenate(
            [np.arange(n), np.arange(n), n + np.arange(len(self.lifted.time))]), 4)

    def fit(self, known_kappa: float = WIDE) -> Fit:
        """
        Return the fit of all values; ``known_kappa`` is the sigma of the prior of kappa.

        The four wheels and the neighbors of a row share their errors: together they count as one.
        """
        lags = max(math.ceil(HAC_TIME / self.ground.step), self.ground.lags)
        prior = self._prior(known_kappa)
        # wheels accelerate more than the body by their slip: that shows nothing of their inertia
        self._slipping = prior.mean[DUTY_GAIN] * self._robot.motor.inertia * (
            self.ground.acceleration - self.ground.force[:, None] / self._robot.wheel_radius)
        return nonlinear_fit(
            lambda x: self._residual(x)[self._known], prior.mean, prior,
            lambda x: self._sigma(x)[self._known],
            Errors(lags, group=self._group[self._known], instant=self._instant[self._known],
                   repeats=4.0 * (2.0 * self.ground.lags + 1.0)))

    def _prior(self, known_kappa: float) -> Prior:
        """Return the prior of all values, at which the fit starts."""
        robot, motor, load = self._robot, self._robot.motor, load_torque(self._robot)
        ground, lifted = self.ground, len(self.lifted.time) > 0
        acting = np.ones(4), np.ones(4)
        if self._duty:
            gain = np.nanmedian(ground.duty / ground.speed, axis=0)
            held = np.where(np.isnan(ground.center_duty), ground.duty, ground.center_duty)
            acting = gain, np.std(held - gain * ground.center_speed, axis=0) / np.maximum(
                np.nanstd(ground.center_torque, axis=0), 1e-9 * load)
        start = np.concatenate([*acting, np.ones(4), np.zeros(8), np.full(
            4, motor.coulomb_friction), [motor.inertia, motor.viscous_friction],
            np.zeros(5 + 5 * len(self._grounds))])
        sigma = np.full(len(start), np.inf)
        sigma[:8] = WIDE * np.abs(start[:8])
        sigma[KAPPA], sigma[SHARE] = known_kappa, PRIORS['force on one wheel'].sigma
        sigma[OFFSET] = PRIORS['offset of a measured torque'].sigma * load
        sigma[COULOMB] = WIDE * load
        sigma[INERTIA:COMMON] = (
            (WIDE if lifted else PRIORS['motor parameters'].sigma) * motor.inertia,
            PRIORS['viscous friction at top speed'].sigma * load / np.abs(ground.speed).max(),
            math.hypot(robot.wheel_radius_sigma, self._scale_sigma, self.sampling_error,
                       self._attenuation()),
            *(PRIORS[name].sigma for name in ('delay of the torque', 'delay of a command',
                                              'delay of a reading', 'slip in a wheel speed')))
        sigma[COMMON + 4::5] = [  # the force at rest may be that of a slope, or a bias
            math.hypot(*rows.rest_force) for rows in self._grounds]
        return Prior(start, sigma)

    def _attenuation(self) -> float:
        """Return the relative bias of kappa from noise and vibration of the IMU."""
        force = self.ground.force
        return float(np.sum(self.ground.force_noise ** 2) / max(
            float(np.sum((force - force.mean()) ** 2)), 1e-9))

    def push(self, x: Array) -> Array:
        """Return the torque [N m] (n, 4) that moves body and wheels on the ground."""
        ground, share = self.ground, 1.0 + x[SHARE] - x[SHARE].mean()
        slope = x[COMMON + 4::5][self._run]
        force = ground.force - slope + x[TORQUE_DELAY] * ground.force_rate
        radius = self._robot.wheel_radius
        lever = 0.25 * self._robot.mass * radius * (1.0 + x[FORCE_SCALE])
        return np.asarray(force[:, None] * (lever * share + x[INERTIA] / radius))

    def _residual(self, x: Array) -> Array:
        """Return windows and instants on the ground, and windows of lifted wheels; one array."""
        ground, lifted = self.ground, self.lifted
        resistance = x[COMMON:].reshape(-1, 5)[self._run, :4]
        load = self.push(x) + x[VISCOUS] * ground.speed + resistance * ground.direction
        free = (x[INERTIA] * lifted.acceleration + x[VISCOUS] * lifted.speed
                + x[COULOMB] * lifted.direction)
        speed = (ground.center_speed + x[SLIP_ERROR] * ground.center_slip
                 + (PRIORS['delay of a reading'].value + x[READING_ERROR]) * ground.acceleration)
        instants = ground.center_torque - x[OFFSET] - x[KAPPA] / x[DUTY_GAIN] * (
            ground.center_duty - x[SPEED_GAIN] * speed)
        windows = _window(x, ground, load, duty=self._duty) - self._slipping
        return np.concatenate([
            windows, instants, _window(x, lifted, free, duty=self._lifted_duty)]).ravel()

    def _sigma(self, x: Array) -> Array:
        """Return the standard deviations of effects that the residuals omit."""
        def window(rows: MotorRows, duty: bool) -> Array:
            return (np.abs(x[SPEED_GAIN]) * rows.speed_sigma if duty else np.abs(
                x[KAPPA] * PRIORS['mean of torque readings'].sigma * self._robot.motor.inertia
                * rows.acceleration))
        slip = (PRIORS['slip in a wheel speed'].sigma * x[KAPPA] / x[DUTY_GAIN] * x[SPEED_GAIN]
                * self.ground.center_slip)
        return np.concatenate([window(self.ground, self._duty), np.abs(slip),
                               window(self.lifted, self._lifted_duty)]).ravel()

    def balance(self, fit: Fit) -> tuple[Array, Array]:
        """Return torques [N m] (n,) of all wheels: by mass and inertia, and as measured."""
        x, straight = fit.values, _is_straight(self.ground)
        push, n = self.push(x), 4 * len(self.ground.time)
        rest = self._residual(x)[:n].reshape(-1, 4)
        measured = x[KAPPA] * (push + rest / x[DUTY_GAIN]) if self._duty else (
            x[KAPPA] * push + rest)
        return push.sum(axis=1)[straight], measured.sum(axis=1)[straight]


def _window(x: Array, rows: MotorRows, load: Array, *, duty: bool) -> Array:
    """Return the residuals (n, 4) of means over windows, for a ``load`` [N m] (n, 4)."""
    if not duty:
        return rows.torque - x[OFFSET] - x[KAPPA] * load
    return (rows.duty - (COMMAND_DELAY + x[COMMAND_ERROR]) * rows.duty_rate
            - x[SPEED_GAIN] * rows.speed - x[DUTY_GAIN] * load)


def _joined(runs: Runs) -> MotorRows:
    """Return the rows of all runs, with forces relative to those at rest."""
    values: dict[str, Any] = {}
    for item in fields(MotorRows):
        parts = [getattr(rows, item.name) for rows in runs]
        if item.name == 'force':
            parts = [rows.force - rows.rest_force.value for rows in runs]
        values[item.name] = np.concatenate(parts) if isinstance(
            parts[0], np.ndarray) else parts[0]
    return MotorRows(**values)


def _is_straight(rows: MotorRows) -> Mask:
    """Return where all wheels rotate in one direction at similar speeds."""
    left, right = (rows.speed[:, side].mean(axis=1) for side in (LEFT, RIGHT))
    return np.asarray((np.abs(rows.direction.sum(axis=1)) == 4) & (
        np.abs(right - left) < MAX_TURN_SHARE * np.abs(left + right)))


def _check_motion(grounds: Runs, lifted: Runs, robot: RobotParams) -> None:
    """Raise EstimatorError if wheels slide, are lifted or not, or drive while the body brakes."""
    if any(_following(rows, robot) > MIN_FOLLOWING for rows in lifted):
        raise EstimatorError('the body accelerates with its wheels: they are not lifted')
    for rows in grounds:
        if _following(rows, robot) < MIN_FOLLOWING:
            raise EstimatorError('the body does not accelerate with its wheels: they slide, or '
                                 'are lifted')
        _check_braking(rows, robot)


def _following(rows: MotorRows, robot: RobotParams) -> float:
    """Return the acceleration of the body over that of its wheels; NaN if that is too small."""
    if not len(rows.time):
        return math.nan
    wheels = robot.wheel_radius * rows.acceleration.mean(axis=1)
    wheels, force = wheels - wheels.mean(), rows.force - rows.force.mean()
    if math.sqrt(float(np.mean(wheels ** 2))) < MIN_FOLLOWED_ACCELERATION:
        return math.nan
    return float(np.sum(force * wheels) / np.sum(wheels ** 2))


def _check_braking(rows: MotorRows, robot: RobotParams) -> None:
    """Raise EstimatorError if the torque drives while the body brakes harder than friction."""
    motor, direction = robot.motor, rows.direction[:, 0]
    balance = direction * (robot.mass * robot.wheel_radius * (
        rows.force - rows.rest_force.value) + motor.inertia * rows.acceleration.sum(axis=1))
    friction = 4.0 * (motor.coulomb_friction + motor.axle_friction * load_torque(robot))
    braking = balance < -BRAKING_FACTOR * friction
    if braking.sum() >= MIN_BRAKING_ROWS and float(np.median(
            (direction * rows.torque.sum(axis=1))[braking])) > 0.0:
        raise EstimatorError('the motor torque is positive while the robot brakes: the boards '
                             'report magnitudes of currents')


def _sampling_error(rows: MotorRows) -> float:
    """
    Return the relative error of the mean torque from readings in step with the commands.

    In step, the force has a ripple with the period of the readings, of an amplitude in proportion
    to the acceleration. Its values at the readings and a quarter of a period away give the
    amplitude, independent of the phase.
    """
    force = (rows.force - rows.force.mean())[:, None]
    errors = Errors(max(math.ceil(HAC_TIME / rows.step), rows.lags))
    shares = [regression(Rows(rows.time, force, ripple, np.zeros(len(force))), Prior.of(None),
                         errors).estimate(0) for ripple in rows.ripple.T]
    excess = sum(share.value ** 2 - share.sigma ** 2 for share in shares)  # over that of noise
    return SAMPLING_FACTOR * math.sqrt(max(excess, 0.0))
