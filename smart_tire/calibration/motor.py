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
    Assumptions, fit_drive, GroundFit, mean_gain, Runs, Solution, solve,
    speed_gains, steady_motion)
from smart_tire.calibration.motor_rows import motor_rows
from smart_tire.calibration.recording import Recording
from smart_tire.calibration.results import (
    CONFIGURED_SIGMA, Found, MAX_STANDARD_ERROR, SIGNIFICANT_SIGMAS)
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.samples import GRAVITY, WHEELS
from smart_tire.uncertain import Uncertain

CONSTANT, INERTIA, COULOMB = 'torque constant', 'inertia', 'Coulomb friction'
VISCOUS, AXLE, FEED_FORWARD = 'viscous friction', 'axle friction', 'feed-forward'
RESISTANCE, STALL = 'resistance', 'stall torque'
IN_STEP = 'readings in step with the motor commands miss the torque in between'
SEVERAL_SPEEDS = 'requires lifted wheels at several speeds in both directions'
MAX_VISCOUS_SHARE = 0.2    # of Coulomb friction: standard error of viscous friction at top speed
MAX_SAMPLING_ERROR = 0.03  # relative; above it, readings are in step with the commands
EQUAL_SIGMA = 0.03         # relative, of the force or inertia of one wheel among four; assumed


@dataclass
class MotorFit(Found):
    """Identified quantities, reasons of those not observable, and data for figures."""

    ground: GroundFit | None = None
    duty: tuple[Array, Array] | None = None  # (n,) rad/s and duty, of all wheels in motion

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
    runs, off_ground = ([motor_rows(one, robot) for one in some] for some in (grounds, lifted))
    found, between = MotorFit(), ''
    _add_feed_forward(found, runs)
    try:
        fit_drive(runs, Assumptions())
    except EstimatorError as error:
        between = str(error)
    best = solve(runs, off_ground, robot, with_duty=not between)
    found.ground, in_step = best.ground, best.sampling_error > MAX_SAMPLING_ERROR
    _add_constant(found, best, robot, runs, f'{IN_STEP}: {between}' if in_step else '')
    # without a constant, friction and inertia rest on what is known already
    kappa = best.kappa if found.get(CONSTANT) is not None else Uncertain(
        1.0, robot.motor.torque_constant_sigma)
    if best.lifted is None:
        found.refused[INERTIA] = 'acts like mass on the ground: requires lifted wheels'
        found.refused[COULOMB] = found.refused[VISCOUS] = (
            'acts like rolling resistance on the ground: requires lifted wheels')
    elif in_step:
        found.refused.update(dict.fromkeys((INERTIA, COULOMB, VISCOUS), IN_STEP))
    else:
        _add_lifted(found, best, kappa)
    _add_resistance(found, best, kappa, robot)
    if best.drive is not None:
        stall = float(best.drive.stall_torque.mean())
        found.add(STALL, _over(Uncertain(stall, best.drive.relative_sigma * stall), kappa), 'N m',
                  'of one motor', 'pid.stall_torque')
    _add_scales(found, best)
    return found


def _check_torque(recording: Recording) -> None:
    torque = recording.wheels.torque
    if torque is None or not np.isfinite(torque).any():
        raise EstimatorError('wheel_states without motor torque: effort is empty, or was the duty '
                             'in an old recording')
    missing = ', '.join(wheel for wheel, column in zip(WHEELS, torque.T)
                        if np.isnan(column).all())
    if missing:
        raise EstimatorError(f'the motor torque of {missing} was not measured')


def _add_constant(found: MotorFit, best: Solution, robot: RobotParams, runs: Runs,
                  in_step: str) -> None:
    kappa, known = best.kappa, robot.motor.torque_constant_sigma
    relative = kappa.sigma / abs(kappa.value)
    if kappa.value > 0.0 and relative < known and not in_step:
        constant = robot.motor.torque_constant / kappa.value
        assumed = f'; inertia as configured, {CONFIGURED_SIGMA:.0%} sigma'
        found.add(CONSTANT, Uncertain(constant, constant * relative), 'N m/A',
                  f'proportional to the given mass of {robot.mass:g} kg'
                  + (assumed if best.lifted is None else ''), 'motor.torque_constant')
        return
    if steady := steady_motion(runs):
        cause = steady
    elif in_step:
        cause = in_step
    elif best.lifted is None and abs(best.inertia_shift) > 0.5 * kappa.sigma:
        cause = 'mostly from the inertia of the wheels: requires a recording with lifted wheels'
    else:
        cause = 'requires more starts and stops'
    found.refused[CONSTANT] = (f'standard error of {relative:.1%}, already known to {known:.1%}; '
                               + cause)


def _add_lifted(found: MotorFit, best: Solution, kappa: Uncertain) -> None:
    """Add inertia and friction, in true torque."""
    assert best.lifted is not None
    extra = (0.0, 0.0, 0.0 if best.drive is None else best.drive.viscous_sigma)
    inertia, coulomb, viscous = (
        Uncertain(value, math.hypot(sigma, shift, more))
        for (value, sigma), shift, more in zip(best.lifted.means, best.shifts, extra))
    # a larger inertia reduces kappa: both errors add
    inertia = Uncertain(inertia.value, inertia.sigma + abs(
        best.inertia_shift / best.kappa.value) * inertia.value)
    inertia, coulomb, viscous = (_over(value, kappa) for value in (inertia, coulomb, viscous))
    for name, value, known, unit, parameter in (
            (INERTIA, inertia, CONFIGURED_SIGMA, 'kg m2', 'motor.inertia'),
            (COULOMB, coulomb, CONFIGURED_SIGMA, 'N m', 'motor.coulomb_friction')):
        if 0.0 < value.sigma < known * value.value:
            found.add(name, value, unit, 'of one wheel with its drive, mean of four', parameter)
        else:
            found.refused[name] = (f'{value.value:.2g} ± {value.sigma:.1g} {unit}, expected a '
                                   f'standard error below {known:.0%}: {SEVERAL_SPEEDS}')
    if COULOMB not in found.refused and (
            viscous.sigma * best.lifted.max_speed < MAX_VISCOUS_SHARE * coulomb.value):
        found.add(VISCOUS, viscous, 'N m s/rad', 'mean of four', 'motor.viscous_friction')
    else:
        found.refused[VISCOUS] = SEVERAL_SPEEDS


def _over(value: Uncertain, kappa: Uncertain) -> Uncertain:
    """Return ``value`` / ``kappa``."""
    return Uncertain(value.value / kappa.value, math.hypot(
        value.sigma, value.value * kappa.sigma / kappa.value) / kappa.value)


def _add_resistance(found: MotorFit, best: Solution, kappa: Uncertain,
                    robot: RobotParams) -> None:
    """Add what friction and rolling resistance are together, and their share of the load."""
    total = _over(best.ground.resistance, kappa)
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


def _add_feed_forward(found: MotorFit, runs: Runs) -> None:
    gains = found.attempt(FEED_FORWARD, lambda: speed_gains(runs))
    if gains is None:
        return
    gain = mean_gain(gains)
    speed, duty = (np.concatenate([getattr(rows, name).mean(axis=1) for rows in runs])
                   for name in ('speed', 'duty'))
    found.duty = speed, duty
    if gain.value > 0.0 and gain.sigma < MAX_STANDARD_ERROR * gain.value:
        found.add(FEED_FORWARD, gain, 's/rad', 'duty per wheel speed of a motor without torque',
                  'pid.feed_forward')
    else:
        found.refused[FEED_FORWARD] = (
            f'{gain.value:.2g} ± {gain.sigma:.1g} s/rad: requires driving at several speeds')


def _add_scales(found: MotorFit, best: Solution) -> None:
    """Report motors whose measured torque differs from that of the others."""
    parts = [best.ground.scales, *([] if best.lifted is None else [best.lifted.inertias])]
    medians = [float(np.median([item.value for item in part])) for part in parts]
    for wheel, values in zip(WHEELS, zip(*parts)):
        scaled = [(item.value / median, math.hypot(item.sigma / median, EQUAL_SIGMA) ** -2)
                  for item, median in zip(values, medians)]
        weight = sum(own for _, own in scaled)
        scale, sigma = sum(value * own for value, own in scaled) / weight, weight ** -0.5
        if abs(scale - 1.0) > SIGNIFICANT_SIGMAS * sigma:
            # a motor with a larger constant measures less torque
            found.notes.append(f'{wheel}: torque constant {1.0 / scale:.2f} ± {sigma:.1g} times '
                               'that of the others; one constant is written for all motors')
