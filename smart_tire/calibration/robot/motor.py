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
Torque constant, friction and inertia of the wheel drives, and feed-forward of their control.

The torque constant follows from starts and stops on firm ground, where the known mass of the robot
is the reference. Friction and inertia require a recording with lifted wheels: on the ground their
effect is that of rolling resistance and mass. How axle friction and rolling resistance share the
rest cannot be observed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import Recording
from smart_tire.calibration.robot.geometry import Quantity
from smart_tire.calibration.robot.motor_balance import GroundFit, INERTIA_SIGMA
from smart_tire.calibration.robot.motor_drive import fit_drive, fit_speed_gains, mean_gain
from smart_tire.calibration.robot.motor_solution import (
    alternatives, Inputs, prepare, Solution, solve, total_kappa)
from smart_tire.errors import EstimatorError
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.samples import WHEELS
from smart_tire.uncertain import Uncertain, weighted_mean

CONSTANT, INERTIA, COULOMB = 'torque constant', 'inertia', 'Coulomb friction'
VISCOUS, AXLE, FEED_FORWARD = 'viscous friction', 'axle friction', 'feed-forward'
RESISTANCE, STALL = 'resistance', 'stall torque'
IN_STEP = 'readings in step with the motor commands miss the torque in between'
SEVERAL_SPEEDS = 'requires lifted wheels at several speeds in both directions'
FRICTION_SIGMA = 0.1       # relative, of the configured friction: a worse result is refused
MAX_VISCOUS_SHARE = 0.2    # of Coulomb friction: standard error of viscous friction at top speed
MAX_FEED_FORWARD_SIGMA = 0.05  # relative
TIRE_SHARE_SIGMA = 0.03    # relative, of the force of one tire among four; assumed
WHEEL_INERTIA_SIGMA = 0.02   # relative, of one wheel among four; assumed
SIGNIFICANT_SIGMAS = 3.0   # of the scale of a motor, above which it is reported
MIN_SPEED_CHANGES = 0.3    # m/s2, rms of the specific force: smaller ones calibrate nothing


@dataclass
class MotorFit:
    """Identified quantities, reasons of those not observable, and data for figures."""

    quantities: list[Quantity] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)  # name -> reason
    notes: list[str] = field(default_factory=list)
    ground: GroundFit | None = None
    duty: tuple[Array, Array] | None = None  # (n,) rad/s and duty, of all wheels in motion

    def get(self, name: str) -> Uncertain | None:
        """Return the estimate of the quantity ``name``, None if it is not observable."""
        return next((item.estimate for item in self.quantities if item.name == name), None)

    def add(self, name: str, estimate: Uncertain, unit: str, note: str = '',
            parameter: str = '') -> None:
        """Append a quantity."""
        self.quantities.append(Quantity(name, estimate, unit, note, parameter))

    def parameters(self) -> list[Identified]:
        """Return the entries of a parameter file."""
        items = [Identified(item.parameter, max(item.estimate.value, 0.0), item.estimate.sigma,
                            item.note) for item in self.quantities if item.parameter]
        constant = self.get(CONSTANT)
        if constant is not None:
            items.append(Identified('motor.torque_constant_sigma',
                                    constant.sigma / constant.value))
        return items


def identify_motor(grounds: Sequence[Recording], lifted: Sequence[Recording],
                   robot: RobotParams) -> MotorFit:
    """
    Return the constants of the drives from recordings on the ground and with lifted wheels.

    Raises EstimatorError with the reason if a recording cannot be used at all.
    """
    for recording in (*grounds, *lifted):
        _check_torque(recording)
    inputs, found = prepare(grounds, lifted, robot), MotorFit()
    _add_feed_forward(found, inputs)
    between = _reason_against_duty(inputs)
    best, others = solve(inputs, not between), alternatives(inputs, not between)
    found.ground = best.ground
    kappa = total_kappa(best, others, inputs)
    _add_constant(found, best, kappa, inputs, between)
    if found.get(CONSTANT) is None:  # friction and inertia rest on what is known already
        kappa = Uncertain(1.0, robot.motor.torque_constant_sigma)
    _add_lifted(found, best, others, kappa)
    _add_resistance(found, best, kappa, robot)
    if best.drive is not None:
        stall = float(best.drive.stall_torque.mean())
        found.add(STALL, _over(Uncertain(stall, best.drive.relative_sigma * stall), kappa), 'N m',
                  'of one motor', 'pid.stall_torque')
    _add_scales(found, best)
    return found


def _reason_against_duty(inputs: Inputs) -> str:
    """Return why the duty does not give the torque between its readings, '' if it does."""
    try:
        fit_drive(inputs.ground)
    except EstimatorError as error:
        return str(error)
    return ''


def _check_torque(recording: Recording) -> None:
    torque = recording.wheels.torque
    if torque is None or not np.isfinite(torque).any():
        raise EstimatorError('wheel_states without motor torque: effort is empty, or was the duty '
                             'in an old recording')
    missing = ', '.join(wheel for wheel, column in zip(WHEELS, torque.T)
                        if np.isnan(column).all())
    if missing:
        raise EstimatorError(f'the motor torque of {missing} was not measured')


def _add_constant(found: MotorFit, best: Solution, kappa: Uncertain, inputs: Inputs,
                  between: str) -> None:
    robot, relative = inputs.robot, kappa.sigma / abs(kappa.value)
    known = robot.motor.torque_constant_sigma
    if kappa.value > 0.0 and relative < known and not best.in_step:
        constant = robot.motor.torque_constant / kappa.value
        assumed = f'; inertia as configured, {INERTIA_SIGMA:.0%} sigma'
        found.add(CONSTANT, Uncertain(constant, constant * relative), 'N m/A',
                  f'proportional to the given mass of {robot.mass:g} kg'
                  + (assumed if best.lifted is None else ''), 'motor.torque_constant')
        return
    accelerations = np.concatenate([rows.force - rows.force.mean() for rows in inputs.ground])
    changes = math.sqrt(float(np.mean(accelerations ** 2)))
    if changes < MIN_SPEED_CHANGES:
        cause = f'acceleration of {changes:.2g} m/s2 rms: requires starts and stops'
    elif best.in_step:
        cause = f'{IN_STEP}: {between}'
    elif best.lifted is None and abs(best.ground.inertia_shift) > 0.5 * kappa.sigma:
        cause = 'mostly from the inertia of the wheels: requires a recording with lifted wheels'
    else:
        cause = 'requires more starts and stops'
    found.refused[CONSTANT] = (f'standard error of {relative:.1%}, already known to {known:.1%}; '
                               + cause)


def _add_lifted(found: MotorFit, best: Solution, others: Sequence[Solution],
                kappa: Uncertain) -> None:
    """Add inertia and friction, in true torque."""
    lifted = best.lifted
    if lifted is None:
        found.refused[INERTIA] = 'acts like mass on the ground: requires lifted wheels'
        found.refused[COULOMB] = found.refused[VISCOUS] = (
            'acts like rolling resistance on the ground: requires lifted wheels')
        return
    if best.in_step:
        found.refused.update(dict.fromkeys((INERTIA, COULOMB, VISCOUS), IN_STEP))
        return
    measured = {name: _with_shifts(best, others, name)
                for name in ('inertia', 'coulomb', 'viscous')}
    # a larger inertia reduces kappa: both errors add
    shift = best.ground.inertia_shift / best.ground.kappa.value
    measured['inertia'] = Uncertain(measured['inertia'].value, measured['inertia'].sigma
                                    + abs(shift) * measured['inertia'].value)
    inertia, coulomb, viscous = (_over(value, kappa) for value in measured.values())
    _add_if_known(found, INERTIA, inertia, INERTIA_SIGMA, 'kg m2', 'motor.inertia')
    _add_if_known(found, COULOMB, coulomb, FRICTION_SIGMA, 'N m', 'motor.coulomb_friction')
    if viscous.sigma * lifted.max_speed < MAX_VISCOUS_SHARE * coulomb.value and COULOMB not in (
            found.refused):
        found.add(VISCOUS, viscous, 'N m s/rad', 'mean of four', 'motor.viscous_friction')
    else:
        found.refused[VISCOUS] = SEVERAL_SPEEDS


def _with_shifts(best: Solution, others: Sequence[Solution], name: str) -> Uncertain:
    """Return a quantity of the lifted wheels, as measured, with the errors of assumptions."""
    value, sigma = getattr(best.lifted, name)
    shifts = [getattr(other.lifted, name).value - value for other in others]
    if name == 'viscous' and best.drive is not None:
        shifts.append(best.drive.viscous_sigma)
    return Uncertain(value, math.hypot(sigma, *shifts))


def _add_if_known(found: MotorFit, name: str, value: Uncertain, known: float, unit: str,
                  parameter: str) -> None:
    """Add a quantity if its relative standard error is below ``known``, else the reason."""
    if value.value > 0.0 and value.sigma < known * value.value:
        found.add(name, value, unit, 'of one wheel with its drive, mean of four', parameter)
    else:
        found.refused[name] = (f'{value.value:.2g} ± {value.sigma:.1g} {unit}, expected a '
                               f'standard error below {known:.0%}: {SEVERAL_SPEEDS}')


def _over(value: Uncertain, kappa: Uncertain) -> Uncertain:
    """Return ``value`` / ``kappa``."""
    return Uncertain(value.value / kappa.value, math.hypot(
        value.sigma, value.value * kappa.sigma / kappa.value) / kappa.value)


def _add_resistance(found: MotorFit, best: Solution, kappa: Uncertain,
                    robot: RobotParams) -> None:
    """Add what friction and rolling resistance are together, and their share of the load."""
    total = _over(weighted_mean(best.ground.resistance), kappa)
    found.add(RESISTANCE, total, 'N m', 'of one wheel on the ground at low speed: friction of '
              'drive and axle, and rolling resistance; not written')
    load_torque = 0.25 * robot.mass * GRAVITY * robot.wheel_radius
    reason = 'not separable from the rolling resistance of the ground'
    coulomb = found.get(COULOMB)
    if coulomb is not None:
        rest = Uncertain((total.value - coulomb.value) / load_torque,
                         math.hypot(total.sigma, coulomb.sigma) / load_torque)
        reason += f'; both together are {rest.value:.3f} ± {rest.sigma:.1g} of the load'
    found.refused[AXLE] = reason


def _add_feed_forward(found: MotorFit, inputs: Inputs) -> None:
    try:
        gain = mean_gain(fit_speed_gains(inputs.ground))
    except EstimatorError as error:
        found.refused[FEED_FORWARD] = str(error)
        return
    found.duty = (np.concatenate([rows.speed.mean(axis=1) for rows in inputs.ground]),
                  np.concatenate([rows.duty.mean(axis=1) for rows in inputs.ground]))
    if gain.value > 0.0 and gain.sigma < MAX_FEED_FORWARD_SIGMA * gain.value:
        found.add(FEED_FORWARD, gain, 's/rad', 'duty per wheel speed of a motor without torque',
                  'pid.feed_forward')
    else:
        found.refused[FEED_FORWARD] = (
            f'{gain.value:.2g} ± {gain.sigma:.1g} s/rad: requires driving at several speeds')


def _add_scales(found: MotorFit, best: Solution) -> None:
    """Report motors whose measured torque differs from that of the others."""
    parts = [_relative(best.ground.scales, TIRE_SHARE_SIGMA)]
    if best.lifted is not None:
        parts.append(_relative(best.lifted.inertias, WHEEL_INERTIA_SIGMA))
    for wheel, estimates in zip(WHEELS, zip(*parts)):
        weights = [item.sigma ** -2 for item in estimates]
        scale = sum(weight * item.value for weight, item in zip(weights, estimates)) / sum(weights)
        sigma = sum(weights) ** -0.5
        if abs(scale - 1.0) > SIGNIFICANT_SIGMAS * sigma:
            # a motor with a larger constant measures less torque
            found.notes.append(f'{wheel}: torque constant {1.0 / scale:.2f} ± {sigma:.1g} times '
                               'that of the others; one constant is written for all motors')


def _relative(values: Sequence[Uncertain], share: float) -> list[Uncertain]:
    """Return ``values`` over their median; ``share`` is the relative sigma of equal motors."""
    median = float(np.median([item.value for item in values]))
    return [Uncertain(item.value / median, math.hypot(item.sigma / median, share))
            for item in values]
