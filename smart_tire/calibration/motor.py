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

The torque tau of a motor accelerates a wheel of inertia J against friction, and on the ground it
drives a quarter of the body, whose mass calibrates the torque constant. Boards report kappa tau:

    ``kappa tau = kappa J dw/dt + kappa b w + kappa c sign(w) + kappa r m f / 4``

with the specific force f, which contains the slope; lifted wheels have no last term. This is
linear in kappa J, kappa b, kappa c and kappa, which are fitted to the means of the four motors in
all recordings. On the ground alone J acts like mass, and friction like rolling resistance; how
axle friction and rolling resistance share the rest cannot be observed.

The torque of a brushed motor is ``tau = k (duty - w / w_0)``, with stall torque k and free speed
w_0. Between two commands it falls while the wheel accelerates, so that readings at the rate of the
commands see it always at the same phase (their mean is wrong by up to 20 % for the paper's robot
at 16 Hz). With recorded duties, kappa k and w_0 follow from torque, duty and speed at the same
instants, and means of the torque from those of duty and speed. Without duties, means of the
readings must do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.motor_rows import DELAY_SIGMA, motor_rows, MotorRows
from smart_tire.calibration.priors import LIMITS, PRIORS, require
from smart_tire.calibration.recording import CalibrationRecording, Indices, MAX_TURN_SHARE
from smart_tire.calibration.results import (
    differ, Found, MIN_ROBUST, MIN_ROWS, SIGNIFICANT_SIGMAS)
from smart_tire.errors import EstimatorError
from smart_tire.estimation.ground.unknowns import SLOPE_SIGMA
from smart_tire.models.tire.brush_tire import LN_STIFFNESS
from smart_tire.numerics.least_squares import Errors, Fit, HAC_TIME, Prior, regression, Rows
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.samples import GRAVITY, LEFT, RIGHT, WHEELS
from smart_tire.uncertain import Uncertain

CONSTANT, INERTIA, COULOMB = 'torque constant', 'inertia', 'Coulomb friction'
VISCOUS, AXLE, FEED_FORWARD = 'viscous friction', 'axle friction', 'feed-forward'
RESISTANCE, STALL = 'resistance', 'stall torque'
IN_STEP = 'readings in step with the motor commands miss the torque in between'
SEVERAL_SPEEDS = 'requires lifted wheels at several speeds in both directions'
ACCEL_SCALE = Uncertain(*PRIORS['scale of the accelerometer'].prior)
MAX_SAMPLING_ERROR = 0.03  # relative; above it, readings are in step with the commands
SAMPLING_FACTOR = 2.0    # error of the torque over the ripple of the force, which tires smooth
BRAKING_FACTOR = 2.0  # times the configured friction: motors must brake, too

# coefficients: kappa J, kappa b, delay of commands [s], kappa; then of each recording, those on
# the ground first, kappa c and an offset [N m], by sensors and slope
J, B, _, KAPPA = range(4)


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


def load_torque(robot: RobotParams) -> float:
    """Return the torque [N m] of one wheel that drives with its share of the weight."""
    return 0.25 * robot.mass * GRAVITY * robot.wheel_radius


def _moved(robot: RobotParams) -> float:
    """Return the inertia [kg m2] of a wheel and its share of the body about the wheel axis."""
    return robot.motor.inertia + 0.25 * robot.mass * robot.wheel_radius ** 2


class MotorLaw(NamedTuple):
    """Measured torque by duty and speed."""

    torque: Uncertain      # N m, at full duty and standstill
    speed_gain: Uncertain  # s/rad, duty per speed without torque


def identify_motor(grounds: Sequence[CalibrationRecording], lifted: Sequence[CalibrationRecording],
                   robot: RobotParams, scale: Uncertain = ACCEL_SCALE) -> MotorFit:
    """
    Return the constants of the drives from recordings on the ground and with lifted wheels.

    ``scale`` is the measured over the true forward acceleration. Raises EstimatorError with the
    reason if a recording cannot be used at all.
    """
    for recording in (*grounds, *lifted):
        _check_torque(recording)
    runs = [_straight(motor_rows(one.scaled(1.0 / scale.value), robot)) for one in grounds]
    free = [motor_rows(one, robot) for one in lifted]
    for kind in filter(None, (runs, free)):
        if (count := sum(len(rows.time) for rows in kind)) < MIN_ROWS:
            raise EstimatorError(
                f'{count} readings in straight motion, expected at least {MIN_ROWS}: each needs '
                'half a second in one direction')
    _check_motion(runs, free, robot)
    ground = MotorRows.joined(runs)
    found = MotorFit(sampling_error=_sampling_error(ground))
    drive = found.attempt(FEED_FORWARD, lambda: _drive(ground))
    between = found.refused.pop(FEED_FORWARD, '')
    found.attempt(FEED_FORWARD, lambda: _add_feed_forward(found, drive, ground, robot))
    in_step = drive is None and found.sampling_error > MAX_SAMPLING_ERROR
    error = found.sampling_error if drive is None else drive.torque.sigma / drive.torque.value
    if drive is None and lifted:
        error = math.hypot(error, PRIORS['inertia without motor_commands'].sigma
                           * robot.motor.inertia / _moved(robot))
    _add_scales(found, ground)
    runs, free = ([_by_duty(rows, drive) for rows in kind] for kind in (runs, free))
    fit = _fit(runs, free, robot)
    kappa = fit.estimate(KAPPA)
    found.kappa, by_mass = kappa.value, math.hypot(
        kappa.sigma / kappa.value, scale.sigma, robot.wheel_radius_sigma, _attenuation(ground))
    relative = math.hypot(by_mass, error)
    # of two reasons the one with the larger part of the standard error, if that is too large
    only_in_step = in_step and relative <= max(
        robot.motor.torque_constant_sigma, math.sqrt(2.0) * error)
    _add_constant(found, fit, relative, robot, lifted=bool(lifted),
                  in_step=f'{IN_STEP}: {between}' if only_in_step else '')
    kappa = Uncertain(kappa.value, kappa.value * relative) if found.get(CONSTANT) else Uncertain(
        1.0, robot.motor.torque_constant_sigma)
    if not lifted:
        found.refused[INERTIA] = 'acts like mass on the ground: requires lifted wheels'
        found.refused[COULOMB] = found.refused[VISCOUS] = (
            'acts like rolling resistance on the ground: requires lifted wheels')
    elif in_step:
        found.refused.update(dict.fromkeys((INERTIA, COULOMB, VISCOUS), IN_STEP))
    else:
        _add_lifted(found, fit, kappa, drive, free)
    _add_resistance(found, fit, kappa, len(runs), robot)
    if drive is not None:
        stall = drive.torque.value / found.kappa
        found.add(STALL, Uncertain(stall, stall * by_mass), 'N m', 'of one motor',
                  'pid.stall_torque')
    inertia = float(fit.values[J]) / found.kappa if lifted else robot.motor.inertia
    push = (robot.wheel_radius * robot.mass * ground.force
            + inertia * ground.acceleration.sum(axis=1))
    found.balance = push, found.kappa * push + 4.0 * fit.residuals[:len(push)]
    return found


def _drive(rows: MotorRows) -> MotorLaw:
    """Return torque by duty and speed; raise EstimatorError with the reason if not observable."""
    _check_duties(rows)
    torque, duty, *speeds = (getattr(rows, f'center_{name}').ravel() for name in (
        'torque', 'duty', 'speed', 'slip'))
    matrix = np.column_stack([np.ones(len(torque)), duty, *speeds, rows.acceleration.ravel()])
    known, instant = np.isfinite(torque + duty), np.repeat(np.arange(len(rows.time)), 4)
    if known.sum() < 4 * MIN_ROWS:
        raise EstimatorError(
            'all torques are measured within a few milliseconds of a change of the duty')
    loss = 0.0  # N m s/rad, torque over speed, by which errors of the speed count
    for _ in range(2):
        fit = regression(
            Rows(rows.time[instant], matrix, torque, np.zeros(len(torque))).where(known),
            Prior.of(None, None, None, *((0.0, sigma * loss + 1e-9) for sigma in (
                LN_STIFFNESS.sigma, DELAY_SIGMA))), _errors(rows, instant[known]))
        loss = abs(float(fit.values[2]))
    gain = fit.estimate(1)
    if not gain.determined:
        raise EstimatorError('the torque does not follow the duty, or the duty hardly changes')
    if gain.value < 0.0:
        raise EstimatorError('the torque falls with the duty: a sign is wrong')
    ratio = -float(fit.values[2] / gain.value)
    return MotorLaw(gain, Uncertain(
        ratio, fit.combined(np.array([0.0, ratio, 1.0, 0.0, 0.0])).sigma / gain.value))


def _check_duties(rows: MotorRows) -> None:
    """Raise EstimatorError if the duties are not known, or are not those of the motors."""
    if np.isnan(rows.duty).any():
        raise EstimatorError('requires motor_commands during straight motion')
    if not np.median(np.abs(rows.duty), axis=0).all():
        raise EstimatorError('the duty is zero while the wheels turn')


def _by_duty(rows: MotorRows, drive: MotorLaw | None) -> MotorRows:
    """Return rows with torques by duty and speed, if both are known."""
    if drive is None or np.isnan(rows.duty).any():
        return replace(rows, duty_rate=np.zeros_like(rows.torque))
    gain = drive.torque.value
    return replace(rows, duty_rate=gain * rows.duty_rate, torque=gain * (
        rows.duty - drive.speed_gain.value * rows.speed))


def _errors(rows: MotorRows, instant: Indices | None = None,
            group: Indices | None = None) -> Errors:
    """Return how errors are related: neighbors, and wheels, count as one."""
    lags = max(math.ceil(HAC_TIME / float(np.median(np.diff(rows.time)))), rows.lags)
    return Errors(lags, group=group, instant=instant, repeats=2.0 * rows.lags + 1.0)


def _fit(grounds: Sequence[MotorRows], lifted: Sequence[MotorRows], robot: RobotParams) -> Fit:
    """Return the fit of the mean torques."""
    runs, motor = [*grounds, *lifted], robot.motor
    rows = MotorRows.joined(runs)
    acceleration, speed, by_delay, torque, direction = (
        getattr(rows, name).mean(axis=1)
        for name in ('acceleration', 'speed', 'duty_rate', 'torque', 'direction'))
    number = np.repeat(np.arange(len(runs)), [len(one.time) for one in runs])
    on_ground, lever = number < len(grounds), 0.25 * robot.mass * robot.wheel_radius
    push, inertia = lever * rows.force * on_ground, None
    if not lifted:  # what is known moves like the body
        push, inertia = push + motor.inertia * acceleration, (
            0.0, PRIORS['motor parameters'].sigma * motor.inertia)
    own = (number[:, None] == np.arange(len(runs))).astype(float)
    matrix = np.column_stack([acceleration, speed, by_delay, push, *(
        column for one in own.T for column in (one * direction, one))])
    offset = PRIORS['friction and offset of a torque'].sigma * load_torque(robot)
    priors = [inertia, _viscous(rows, robot), (0.0, DELAY_SIGMA), None]
    for one in grounds:  # the force at rest may be that of a slope, or a bias
        priors += [None, (0.0, math.hypot(offset, lever * one.rest_sigma))]
    priors += [None, (0.0, offset)] * len(lifted)
    known = np.isfinite(torque)
    return regression(Rows(rows.time, matrix, torque, np.zeros(len(torque))).where(known),
                      Prior.of(*priors), _errors(rows, group=1 * on_ground[known]))


def _viscous(rows: MotorRows, robot: RobotParams) -> tuple[float, float]:
    return robot.motor.viscous_friction, PRIORS['friction and offset of a torque'].sigma * (
        load_torque(robot) / float(np.abs(rows.speed).max()))


def _attenuation(rows: MotorRows) -> float:
    """Return the relative bias of kappa from noise and vibration of the IMU."""
    return float(np.sum(rows.force_noise ** 2) / max(
        float(np.sum((rows.force - rows.force.mean()) ** 2)), 1e-9))


def _over(value: Uncertain, kappa: Uncertain) -> Uncertain:
    """Return a value over kappa; their errors are independent."""
    return Uncertain(value.value / kappa.value, math.hypot(
        value.sigma, value.value * kappa.sigma / kappa.value) / abs(kappa.value))


def _check_torque(recording: CalibrationRecording) -> None:
    torque = recording.wheels.torque
    if torque is None or not np.isfinite(torque).any():
        raise EstimatorError('wheel_states without motor torque: effort is empty, or was the duty '
                             'in an old recording')
    missing = ', '.join(wheel for wheel, column in zip(WHEELS, torque.T)
                        if np.isnan(column).all())
    if missing:
        raise EstimatorError(f'the motor torque of {missing} was not measured')


def _add_feed_forward(found: MotorFit, drive: MotorLaw | None, rows: MotorRows,
                      robot: RobotParams) -> None:
    """Add the duty per speed, if need be from means alone; raise EstimatorError with a reason."""
    _check_duties(rows)
    found.duty = rows.speed.mean(axis=1), rows.duty.mean(axis=1)
    if drive is not None:
        gain = drive.speed_gain
    else:
        matrix = np.stack([rows.speed, rows.acceleration, rows.direction]).mean(axis=2).T
        fit = regression(Rows(rows.time, matrix, rows.duty.mean(axis=1), np.zeros(len(matrix))),
                         Prior.of(None, None, None), _errors(rows))
        gain = fit.estimate(0)
        gain = Uncertain(gain.value, math.hypot(
            gain.sigma, _viscous(rows, robot)[1] * float(fit.values[1]) / _moved(robot)))
    found.add(FEED_FORWARD, require(FEED_FORWARD, gain, 'requires driving at several speeds'),
              's/rad', 'duty per wheel speed of a motor without torque', 'pid.feed_forward')


def _add_constant(found: MotorFit, fit: Fit, relative: float, robot: RobotParams, *,
                  lifted: bool, in_step: str) -> None:
    kappa, known = fit.estimate(KAPPA), robot.motor.torque_constant_sigma
    if kappa.value > 0.0 and relative < known and not in_step:
        constant, inertia = robot.motor.torque_constant / kappa.value, PRIORS['motor parameters']
        found.add(CONSTANT, Uncertain(constant, constant * relative), 'N m/A',
                  f'proportional to the given mass of {robot.mass:g} kg' + (
                      '' if lifted else f'; inertia as configured, {inertia.sigma:.0%} sigma'),
                  'motor.torque_constant')
        return
    common = float(fit.covariance[KAPPA, J])
    inertial = common ** 2 > 0.25 * (kappa.value * relative * fit.estimate(J).sigma) ** 2
    found.refused[CONSTANT] = (
        f'standard error of {abs(relative):.1%}, already known to {known:.1%}; ' + (in_step or (
            'mostly from the inertia of the wheels: requires a recording with lifted wheels'
            if inertial and not lifted else 'requires starts and stops')))


def _add_lifted(found: MotorFit, fit: Fit, kappa: Uncertain, drive: MotorLaw | None,
                lifted: Sequence[MotorRows]) -> None:
    known = PRIORS['motor parameters'].sigma
    max_speed = max(float(np.abs(rows.speed).max()) for rows in lifted)
    inertia, viscous, coulomb = (_over(value, kappa) for value in (
        fit.estimate(J), fit.estimate(B), _friction(fit, len(fit.values) - 2 * len(lifted))))
    if drive is None:
        inertia = Uncertain(inertia.value, math.hypot(
            inertia.sigma, PRIORS['inertia without motor_commands'].sigma * inertia.value))
    else:
        viscous = Uncertain(viscous.value, math.hypot(
            viscous.sigma, drive.torque.value * drive.speed_gain.sigma))
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


def _friction(fit: Fit, first: int, last: int | None = None) -> Uncertain:
    """Return the mean kappa c of recordings, whose values are those from ``first`` on."""
    factors = np.zeros(len(fit.values))
    factors[first:last:2] = 1.0
    return fit.combined(factors / factors.sum())


def _add_resistance(found: MotorFit, fit: Fit, kappa: Uncertain, grounds: int,
                    robot: RobotParams) -> None:
    """Add what friction and rolling resistance are together, and their share of the load."""
    first = KAPPA + 1
    resistance = _over(_friction(fit, first, first + 2 * grounds), kappa)
    found.add(RESISTANCE, resistance, 'N m', 'of one wheel on the ground at low speed: '
              'friction of drive and axle, and rolling resistance; not written')
    reason = 'not separable from the rolling resistance of the ground'
    if (coulomb := found.get(COULOMB)) is not None:
        load = load_torque(robot)
        reason += (f'; both together are {(resistance.value - coulomb.value) / load:.3f} ± '
                   f'{math.hypot(resistance.sigma, coulomb.sigma) / load:.1g} of the load')
    found.refused[AXLE] = reason


def _add_scales(found: MotorFit, rows: MotorRows) -> None:
    """Report motors whose measured torque differs from that of the others."""
    mean = rows.torque.mean(axis=1)
    matrix = np.column_stack([mean, rows.direction[:, 0], np.ones(len(mean))])
    for wheel, torque in zip(WHEELS, rows.torque.T):
        fit = regression(Rows(rows.time, matrix, torque, np.zeros(len(mean))).where(
            np.isfinite(mean)), Prior.of(None, None, None), _errors(rows))
        share = fit.estimate(0)
        sigma = math.hypot(share.sigma, SLOPE_SIGMA)
        if abs(share.value - 1.0) > SIGNIFICANT_SIGMAS * sigma:
            # a motor with a larger constant measures less torque
            found.notes.append(
                f'{wheel}: torque constant {1.0 / share.value:.2f} ± {sigma:.1g} times that of '
                'the mean; one constant is written for all motors')


def _straight(rows: MotorRows) -> MotorRows:
    """Return the rows in which all wheels rotate in one direction at similar speeds."""
    left, right = (rows.speed[:, side].mean(axis=1) for side in (LEFT, RIGHT))
    return rows.where((np.abs(rows.direction.sum(axis=1)) == 4) & (
        np.abs(right - left) < MAX_TURN_SHARE * np.abs(left + right)))


def _check_motion(grounds: Sequence[MotorRows], lifted: Sequence[MotorRows],
                  robot: RobotParams) -> None:
    """Raise EstimatorError if wheels slide, are lifted or not, or drive while the body brakes."""
    for share, runs, reason in (
            (0.0, lifted, 'accelerates with its wheels: they are not lifted'),
            (1.0, grounds, 'does not accelerate with its wheels: they slide, or are lifted')):
        for rows in filter(lambda rows: len(rows.time) > 1, runs):
            # acceleration of the body over that of its wheels
            fit = regression(Rows(rows.time, np.column_stack([
                robot.wheel_radius * rows.acceleration.mean(axis=1), np.ones(len(rows.time))]),
                rows.force, np.zeros(len(rows.time))), Prior.of(None, None), _errors(rows))
            found = fit.estimate(0)
            if abs(found.value - share) > 0.5 and differ(found, Uncertain(share, 0.0)):
                raise EstimatorError(f'the body {reason}')
    for rows in grounds:
        _check_braking(rows, robot)


def _check_braking(rows: MotorRows, robot: RobotParams) -> None:
    """Raise EstimatorError if the torque drives while the body brakes harder than friction."""
    motor, direction = robot.motor, rows.direction[:, 0]
    balance = direction * (robot.mass * robot.wheel_radius * rows.force
                           + motor.inertia * rows.acceleration.sum(axis=1))
    friction = 4.0 * (motor.coulomb_friction + motor.axle_friction * load_torque(robot))
    braking = balance < -BRAKING_FACTOR * friction
    if braking.sum() >= MIN_ROBUST and float(np.median(
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
    errors = _errors(rows)
    shares = [regression(Rows(rows.time, force, ripple, np.zeros(len(force))), Prior.of(None),
                         errors).estimate(0) for ripple in rows.ripple.T]
    excess = sum(share.value ** 2 - share.sigma ** 2 for share in shares)  # over that of noise
    return SAMPLING_FACTOR * math.sqrt(max(excess, 0.0))
