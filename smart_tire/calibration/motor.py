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
Torque constant, friction and inertia of the wheel drives, and feed-forward of their control.

The torque constant follows from starts and stops on firm ground, where the known mass of the robot
is the reference. Friction and inertia require a recording with lifted wheels: on the ground their
effect is that of rolling resistance and mass. How axle friction and rolling resistance share the
rest cannot be observed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.motor_model import (
    COMMON, COULOMB as COULOMB_VALUES, DUTY_GAIN, INERTIA as INERTIA_VALUE, KAPPA, load_torque,
    MotorModel, SPEED_GAIN, VISCOUS as VISCOUS_VALUE)
from smart_tire.calibration.motor_rows import motor_rows
from smart_tire.calibration.priors import LIMITS, PRIORS, require
from smart_tire.calibration.recording import CalibrationRecording
from smart_tire.calibration.results import Found, MIN_ROWS, SIGNIFICANT_SIGMAS
from smart_tire.errors import EstimatorError
from smart_tire.numerics.least_squares import Fit
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.samples import WHEELS
from smart_tire.uncertain import Uncertain

CONSTANT, INERTIA, COULOMB = 'torque constant', 'inertia', 'Coulomb friction'
VISCOUS, AXLE, FEED_FORWARD = 'viscous friction', 'axle friction', 'feed-forward'
RESISTANCE, STALL = 'resistance', 'stall torque'
IN_STEP = 'readings in step with the motor commands miss the torque in between'
SEVERAL_SPEEDS = 'requires lifted wheels at several speeds in both directions'
ACCEL_SCALE = Uncertain(*PRIORS['scale of the accelerometer'].prior)
MAX_SAMPLING_ERROR = 0.03  # relative; above it, readings are in step with the commands


@dataclass
class MotorFit(Found):
    """Identified quantities, reasons of those not observable, and data for figures."""

    balance: tuple[Array, Array] | None = None  # (n,) N m of all wheels: by mass, and as measured
    kappa: float = 1.0                          # measured over true torque
    sampling_error: float = 0.0                 # relative, of means of torque readings
    duty: tuple[Array, Array] | None = None  # (n,) rad/s and duty, of all wheels in motion

    @property
    def torques_used(self) -> bool:
        """Return whether means of the torque readings can be used, with the torque constant."""
        return self.get(CONSTANT) is not None and self.sampling_error <= MAX_SAMPLING_ERROR

    def parameters(self) -> list[Identified]:
        """Return the entries of a parameter file."""
        items = [Identified(item.parameter, max(item.estimate.value, 0.0), item.estimate.sigma,
                            item.note) for item in self.quantities if item.parameter]
        constant = self.get(CONSTANT)
        if constant is not None:
            items.append(Identified('motor.torque_constant_sigma',
                                    constant.sigma / constant.value))
        return items


def identify_motor(grounds: Sequence[CalibrationRecording], lifted: Sequence[CalibrationRecording],
                   robot: RobotParams, scale: Uncertain = ACCEL_SCALE) -> MotorFit:
    """
    Return the constants of the drives from recordings on the ground and with lifted wheels.

    ``scale`` is the measured over the true forward acceleration. Raises EstimatorError with the
    reason if a recording cannot be used at all.
    """
    for recording in (*grounds, *lifted):
        _check_torque(recording)
    on_ground = [motor_rows(one.scaled(1.0 / scale.value), robot) for one in grounds]
    off_ground = [motor_rows(one, robot) for one in lifted]
    model = MotorModel(on_ground, off_ground, robot, duty=False, scale_sigma=scale.sigma)
    found = MotorFit(sampling_error=model.sampling_error)
    if any(np.isnan(rows.duty).any() for rows in on_ground):
        found.refused[FEED_FORWARD] = between = 'requires motor_commands during straight motion'
    elif not np.nanmedian(np.abs(model.ground.duty), axis=0).all():
        found.refused[FEED_FORWARD] = between = 'the duty is zero while the wheels turn'
    else:
        driven = MotorModel(on_ground, off_ground, robot, duty=True, scale_sigma=scale.sigma)
        fit = driven.fit()
        _add_feed_forward(found, driven, fit)
        between = _drive_error(driven, fit)
    if between:
        fit = model.fit()
    else:
        model = driven
    in_step = model.sampling_error > MAX_SAMPLING_ERROR
    found.balance = model.balance(fit)
    kappa = _mean(fit, KAPPA)
    found.kappa = kappa.value
    relative = kappa.sigma / abs(kappa.value)
    # of two reasons the one with the larger part of the standard error, if that is too large
    steady = in_step and relative > max(
        robot.motor.torque_constant_sigma, math.sqrt(2.0) * model.sampling_error)
    _add_constant(found, fit, kappa, robot, lifted=bool(lifted),
                  in_step=f'{IN_STEP}: {between}' if in_step and not steady else '')
    if found.get(CONSTANT) is None:
        # friction and inertia rest on what is known already; the errors of motors are independent
        fit = model.fit(2.0 * robot.motor.torque_constant_sigma)
    if not lifted:
        found.refused[INERTIA] = 'acts like mass on the ground: requires lifted wheels'
        found.refused[COULOMB] = found.refused[VISCOUS] = (
            'acts like rolling resistance on the ground: requires lifted wheels')
    elif in_step:
        found.refused.update(dict.fromkeys((INERTIA, COULOMB, VISCOUS), IN_STEP))
    else:
        sampled = PRIORS['inertia without motor_commands'].sigma if between else 0.0
        _add_lifted(found, fit, sampled, float(np.abs(model.lifted.speed).max()))
    _add_resistance(found, fit, robot)
    if not between:
        inverse = fit.values[DUTY_GAIN]
        spread = _mean(fit, DUTY_GAIN, -inverse ** -2)
        found.add(STALL, Uncertain(float(np.mean(1.0 / inverse)), spread.sigma), 'N m',
                  'of one motor', 'pid.stall_torque')
    _add_scales(found, fit)
    return found


def _drive_error(model: MotorModel, fit: Fit) -> str:
    """Return why the torque is not known from the duty, '' if it is."""
    gains = [fit.estimate(row) for row in range(DUTY_GAIN.start, DUTY_GAIN.stop)]
    if model.instants < MIN_ROWS:
        return 'all torques are measured within a few milliseconds of a change of the duty'
    if not all(gain.determined for gain in gains):
        return 'the torque does not follow the duty, or the duty hardly changes'
    return '' if min(gains)[0] > 0.0 else 'the torque falls with the duty: a sign is wrong'


def _mean(fit: Fit, rows: slice, factor: Array | float = 1.0) -> Uncertain:
    """Return the mean of the motors' values in ``rows``, each times ``factor``."""
    factors = np.zeros(len(fit.values))
    factors[rows] = 0.25 * factor
    return fit.combined(factors)


def _check_torque(recording: CalibrationRecording) -> None:
    torque = recording.wheels.torque
    if torque is None or not np.isfinite(torque).any():
        raise EstimatorError('wheel_states without motor torque: effort is empty, or was the duty '
                             'in an old recording')
    missing = ', '.join(wheel for wheel, column in zip(WHEELS, torque.T)
                        if np.isnan(column).all())
    if missing:
        raise EstimatorError(f'the motor torque of {missing} was not measured')


def _add_constant(found: MotorFit, fit: Fit, kappa: Uncertain, robot: RobotParams, *,
                  lifted: bool, in_step: str) -> None:
    relative, known = kappa.sigma / abs(kappa.value), robot.motor.torque_constant_sigma
    if kappa.value > 0.0 and relative < known and not in_step:
        constant, inertia = robot.motor.torque_constant / kappa.value, PRIORS['motor parameters']
        found.add(CONSTANT, Uncertain(constant, constant * relative), 'N m/A',
                  f'proportional to the given mass of {robot.mass:g} kg' + (
                      '' if lifted else f'; inertia as configured, {inertia.sigma:.0%} sigma'),
                  'motor.torque_constant')
        return
    common = float(fit.covariance[KAPPA, INERTIA_VALUE].mean())
    inertial = common ** 2 > 0.25 * (kappa.sigma * fit.estimate(INERTIA_VALUE).sigma) ** 2
    found.refused[CONSTANT] = (
        f'standard error of {relative:.1%}, already known to {known:.1%}; ' + (in_step or (
            'mostly from the inertia of the wheels: requires a recording with lifted wheels'
            if inertial and not lifted else 'requires starts and stops')))


def _add_lifted(found: MotorFit, fit: Fit, inertia_error: float, max_speed: float) -> None:
    inertia = fit.estimate(INERTIA_VALUE)
    inertia = Uncertain(inertia.value, math.hypot(inertia.sigma, inertia_error * inertia.value))
    known = PRIORS['motor parameters'].sigma
    coulomb, viscous = _mean(fit, COULOMB_VALUES), fit.estimate(VISCOUS_VALUE)
    for name, value, unit, parameter in (
            (INERTIA, inertia, 'kg m2', 'motor.inertia'),
            (COULOMB, coulomb, 'N m', 'motor.coulomb_friction')):
        if 0.0 < value.sigma < known * value.value:
            found.add(name, value, unit, 'of one wheel with its drive, mean of four', parameter)
        else:
            found.refused[name] = (
                f'{value.value:.2g} ± {value.sigma:.1g} {unit}, expected a standard error below '
                f'{known:.0%}: {SEVERAL_SPEEDS}')
    if COULOMB not in found.refused and (
            viscous.sigma * max_speed < LIMITS[VISCOUS].sigma * coulomb.value):
        found.add(VISCOUS, viscous, 'N m s/rad', 'mean of four', 'motor.viscous_friction')
    else:
        found.refused[VISCOUS] = SEVERAL_SPEEDS


def _add_resistance(found: MotorFit, fit: Fit, robot: RobotParams) -> None:
    """Add what friction and rolling resistance are together, and their share of the load."""
    factors = np.zeros(len(fit.values))
    factors[COMMON:] = np.tile([1.0, 1.0, 1.0, 1.0, 0.0], (len(factors) - COMMON) // 5)
    factors /= factors.sum()
    found.add(RESISTANCE, fit.combined(factors), 'N m', 'of one wheel on the ground at low speed: '
              'friction of drive and axle, and rolling resistance; not written')
    reason = 'not separable from the rolling resistance of the ground'
    if found.get(COULOMB) is not None:
        factors[COULOMB_VALUES] = -0.25
        rest = fit.combined(factors / load_torque(robot))
        reason += f'; both together are {rest.value:.3f} ± {rest.sigma:.1g} of the load'
    found.refused[AXLE] = reason


def _add_feed_forward(found: MotorFit, model: MotorModel, fit: Fit) -> None:
    ground, gain = model.ground, _mean(fit, SPEED_GAIN)
    found.duty = ground.speed.mean(axis=1), ground.duty.mean(axis=1)
    if found.attempt(FEED_FORWARD, lambda: require(
            FEED_FORWARD, gain, 'requires driving at several speeds')) is not None:
        found.add(FEED_FORWARD, gain, 's/rad', 'duty per wheel speed of a motor without torque',
                  'pid.feed_forward')


def _add_scales(found: MotorFit, fit: Fit) -> None:
    """Report motors whose measured torque differs from that of the others."""
    kappas = fit.values[KAPPA]
    median = float(np.median(kappas))
    for i, (wheel, kappa) in enumerate(zip(WHEELS, kappas)):
        sigma = _mean(fit, KAPPA, 4.0 * np.eye(4)[i] - 1.0).sigma / median
        if abs(kappa / median - 1.0) > SIGNIFICANT_SIGMAS * sigma:
            # a motor with a larger constant measures less torque
            found.notes.append(
                f'{wheel}: torque constant {median / kappa:.2f} ± {sigma:.1g} times that of the '
                'others; one constant is written for all motors')
