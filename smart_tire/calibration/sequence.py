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
The identifications in their order: each one uses the results of the former ones.

Rest gives noise and mounting of the IMU; turns give a first latency, from which the straight part
determines latency and C_x together; then the torque constant; at last track and S from turns. A
recording that contains several of these parts can be given for each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
import math
from typing import Any, TypeVar

import numpy as np

from smart_tire.calibration.geometry import (
    add_rest, combine as combine_geometry, Geometry, identify_geometry,
    LATENCY as WHEEL_LATENCY, NO_POSITIONS, RADIUS, STATIC_IMU)
from smart_tire.calibration.latency import fit_yaw_rate
from smart_tire.calibration.motor import CONSTANT, identify_motor, INERTIA, MotorFit
from smart_tire.calibration.priors import LIMITS, PRIORS, require
from smart_tire.calibration.recording import Recording
from smart_tire.calibration.results import CONTRADICTION_SIGMAS
from smart_tire.calibration.sensor_noise import fit_jitter, stationary_intervals
from smart_tire.calibration.stiffness import identify_stiffness, StiffnessFit
from smart_tire.calibration.turning import (
    combine as combine_icr, effective_track, IcrFit, identify_icr)
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams, specs
from smart_tire.parameters.calibration_file import Identified
from smart_tire.samples import GRAVITY
from smart_tire.uncertain import Uncertain, weighted_mean

Fit = TypeVar('Fit')

MIN_PART = 6.0          # s, of a recording that is compared with its other part
WRITTEN_SHARE = 0.5     # of the limit of a latency that is not compared with the configured one
MAX_SLIDING_SHARE = 0.3    # of the time in motion, beyond the critical slip

REST, STRAIGHT, TURNS, LIFTED = 'rest', 'straight', 'turns', 'lifted'
STEPS = (REST, STRAIGHT, TURNS, LIFTED)
LATENCY, JITTER, TRACK = 'encoder.latency', 'encoder.stamp_jitter', 'effective_track'
STIFFNESS, STIFFNESS_SIGMA = 'tire.longitudinal_stiffness', 'tire.longitudinal_stiffness_sigma'
Gains = Callable[[RobotParams], Sequence[Identified]]


@dataclass(frozen=True)
class Finding(Identified):
    """An identified parameter, and the step of the sequence whose recordings it comes from."""

    step: str = ''


@dataclass
class Calibration:
    """Identified values in the order of identification; reasons of the values that are kept."""

    robot: RobotParams
    found: dict[str, Finding] = field(default_factory=dict)
    kept: dict[str, str] = field(default_factory=dict)  # parameter -> reason
    notes: list[str] = field(default_factory=list)
    stiffness: StiffnessFit | None = None  # the fits, for figures
    motor: MotorFit | None = None
    icr: IcrFit | None = None

    def attempt(self, names: Sequence[str], fit: Callable[[], Fit]) -> Fit | None:
        """Return what ``fit`` returns; if it fails, keep the parameters ``names``."""
        try:
            return fit()
        except EstimatorError as error:
            for name in names:
                self.keep(name, str(error))
            return None

    def keep(self, name: str, reason: str) -> None:
        """Keep the value of a parameter, unless it has been identified."""
        if name not in self.found:
            self.kept.setdefault(name, reason)

    def accept(self, step: str, *items: Identified) -> None:
        """Take values, in place of earlier ones; all later identifications use them."""
        for item in items:
            self.found.pop(item.name, None)  # the order is that of the identifications
            self.found[item.name] = Finding(**vars(item), step=step)
            self.kept.pop(item.name, None)
            if item.name in specs(RobotParams):
                group, _, own = item.name.rpartition('.')
                value: Any = {own: item.value}
                if group:
                    value = {group: replace(getattr(self.robot, group), **value)}
                self.robot = replace(self.robot, **value)


def check_one_ground(recordings: Sequence[Recording], robot: RobotParams,
                     latency_sigma: float) -> None:
    """
    Raise EstimatorError if C_x or drag of the parts of ``recordings`` differ significantly.

    The parts of a recording are its halves, divided at a standstill.
    """
    fits = []
    for part in (part for recording in recordings for part in parts_of(recording, robot)):
        try:
            fits.append(identify_stiffness([part], robot, latency_sigma))
        except EstimatorError:
            continue  # too little for a value of its own, which the whole may have
    for name, unit in (('stiffness', 'C_x'), ('drag', 'drag')):
        values = [getattr(fit, name) for fit in fits]
        if any(differ(first, second) for i, first in enumerate(values) for second in values[:i]):
            text = ', '.join(f'{value.value:.3g} ± {value.sigma:.2g}' for value in values)
            raise EstimatorError(f'the parts of the recordings give {unit} {text} N: several '
                                 'grounds in one recording, give the part on one ground')


def differ(first: Uncertain, second: Uncertain) -> bool:
    """Return whether two values differ significantly."""
    return abs(first.value - second.value) > CONTRADICTION_SIGMAS * math.hypot(
        first.sigma, second.sigma)


def parts_of(recording: Recording, robot: RobotParams) -> list[Recording]:
    """Return the halves of a recording, divided at the standstill next to its middle."""
    time = recording.wheels.time
    middle = 0.5 * float(time[0] + time[-1])
    cuts = [min(max(middle, begin), end) for begin, end in stationary_intervals(
        recording.wheels, robot)]
    cut = min(cuts, key=lambda one: abs(one - middle), default=time[0])
    if min(cut - time[0], time[-1] - cut) < MIN_PART:
        return []
    return [_between(recording, -math.inf, cut), _between(recording, cut, math.inf)]


def _between(recording: Recording, begin: float, end: float) -> Recording:
    imu, wheels = recording.imu, recording.wheels
    return replace(recording, imu=imu.where((imu.time >= begin) & (imu.time <= end)),
                   wheels=wheels.where((wheels.time >= begin) & (wheels.time <= end)))


def check_rolling(fit: StiffnessFit, robot: RobotParams) -> None:
    """Raise EstimatorError if the wheels slide in much of the straight motion."""
    load = 0.25 * robot.mass * GRAVITY
    critical = 3.0 * fit.friction.value * load / fit.stiffness.value
    moving = np.abs(fit.force) > 0.0
    share = float(np.mean(np.abs(fit.slip[moving]) > critical)) if moving.any() else 0.0
    if share > MAX_SLIDING_SHARE:
        raise EstimatorError(f'the wheels slide in {share:.0%} of the motion, expected at most '
                             f'{MAX_SLIDING_SHARE:.0%}: accelerate less')


@dataclass(frozen=True)
class Inputs:
    """Recordings of the steps; the same recording may be part of several steps."""

    rest: Sequence[Recording] = ()
    straight: Sequence[Recording] = ()
    turns: Sequence[Recording] = ()
    lifted: Sequence[Recording] = ()

    @property
    def positions(self) -> bool:
        """Return whether all wheel samples have positions."""
        return all(one.wheels.position is not None for one in (*self.straight, *self.turns))


def calibrate(inputs: Inputs, robot: RobotParams, gains: Gains | None = None) -> Calibration:
    """
    Return what ``inputs`` show of a robot with the known parameters ``robot``.

    ``gains`` identifies the films of the robot it is called with; None if there are no films in
    the recordings. Nothing is raised: a value that cannot be identified is kept, with the reason.
    """
    found, imu = Calibration(robot), Geometry()
    add_rest(imu, inputs.rest, [*inputs.straight, *inputs.turns], robot)
    found.accept(REST, *imu.parameters(robot))
    for name in ('imu.gyro_noise', 'imu.accel_noise', 'imu.rotation'):
        found.keep(name, imu.kept.get(name) or imu.refused.get(STATIC_IMU, ''))
    _add_jitter(found, inputs)
    latency = _add_turns(found, inputs)
    found.attempt([STIFFNESS, STIFFNESS_SIGMA], lambda: _add_stiffness(found, inputs, latency))
    found.attempt(['motor.torque_constant'], lambda: _add_motor(found, inputs))
    found.icr = found.attempt(['icr_x'], lambda: combine_icr(
        [identify_icr(one, found.robot) for one in _needed(inputs.turns, 'with turns')]))
    if found.icr is not None:
        found.accept(TURNS, *found.icr.parameters(found.robot))
    if gains is not None:
        found.accept(TURNS, *(found.attempt(
            ['film.stretch_gain'], lambda: gains(found.robot)) or ()))
    found.attempt(['wheel_radius'], lambda: _add_radius(found, inputs))
    found.keep('imu.position', 'only its distance from the centers of rotation is observable')
    return found


def _needed(recordings: Sequence[Recording], what: str) -> Sequence[Recording]:
    if not recordings:
        raise EstimatorError(f'no recording {what}')
    return recordings


def _add_radius(found: Calibration, inputs: Inputs) -> None:
    """Add the rolling radius by the pose references, if there are any."""
    recordings = {id(one): one for one in (*inputs.straight, *inputs.turns)
                  if one.reference is not None}.values()
    if not recordings:
        raise EstimatorError('requires a pose reference (--truth)')
    parts = combine_geometry([identify_geometry(one, found.robot) for one in recordings])
    radius = parts.get(RADIUS)
    if radius is None:
        raise EstimatorError(parts.refused[RADIUS])
    found.accept(STRAIGHT, Identified('wheel_radius', *radius, 'against the reference poses'),
                 Identified('wheel_radius_sigma', radius.sigma / radius.value))


def _add_jitter(found: Calibration, inputs: Inputs) -> None:
    """Add the timestamp jitter, of turns if possible: there the sides differ in speed."""
    reasons = []
    for step, recordings in ((TURNS, inputs.turns), (STRAIGHT, inputs.straight)):
        values = []
        for recording in recordings:
            try:
                values.append(fit_jitter(recording.wheels, found.robot))
            except EstimatorError as error:
                reasons.append(str(error))
        if values:
            found.accept(step, Identified(JITTER, *weighted_mean(values)))
            return
    found.keep(JITTER, '; '.join(dict.fromkeys(reasons)) or 'no recording in motion')


def _add_turns(found: Calibration, inputs: Inputs) -> Uncertain | None:
    """Add track and latency, if its standard error is small enough; return the latency."""
    fits = found.attempt([LATENCY, TRACK], lambda: [
        fit_yaw_rate(one, found.robot) for one in _needed(inputs.turns, 'with turns')])
    if fits is None:
        return None
    latency, radius = weighted_mean([fit.latency for fit in fits]), found.robot.wheel_radius
    if not inputs.positions:
        found.keep(LATENCY, NO_POSITIONS)
    elif found.attempt([LATENCY], lambda: require(
            WHEEL_LATENCY, latency, factor=WRITTEN_SHARE)) is not None:
        found.accept(TURNS, Identified(LATENCY, *latency, 'wheel speed difference against gyro'))
    track = found.attempt([TRACK], lambda: effective_track(fits, Uncertain(radius, 0.0)))
    if track is not None:
        found.accept(TURNS, Identified(TRACK, *track, f'for wheel_radius {radius:g} m'))
    return latency


def _add_stiffness(found: Calibration, inputs: Inputs, latency: Uncertain | None) -> None:
    """
    Add C_x, and the latency that the same fit determines.

    Raises EstimatorError if the ground changes, or if turns contradict the latency.
    """
    recordings = _needed(inputs.straight, 'of straight starts and stops')
    sigma = PRIORS[WHEEL_LATENCY].sigma
    if LATENCY in found.found and latency is not None:
        sigma = latency.sigma
    if 'several grounds' in found.kept.get(TRACK, ''):
        raise EstimatorError(f'{found.kept[TRACK]}: C_x is that of a tire on one ground')
    check_one_ground(recordings, found.robot, sigma)
    result = identify_stiffness(recordings, found.robot, sigma)
    check_rolling(result, found.robot)
    late = Uncertain(found.robot.encoder.latency + result.latency_error.value,
                     math.hypot(result.latency_error.sigma, PRIORS['IMU latency'].sigma))
    if latency is not None and abs(late.value - latency.value) > CONTRADICTION_SIGMAS * math.hypot(
            late.sigma, latency.sigma):
        raise EstimatorError(
            f'starts and stops give a latency of {late.value:.3f} ± {late.sigma:.2g} s, turns '
            f'{latency.value:.3f} ± {latency.sigma:.2g} s: the wheels slip in one of them')
    if inputs.positions and late.sigma <= WRITTEN_SHARE * LIMITS[WHEEL_LATENCY].sigma:
        found.accept(STRAIGHT, Identified(LATENCY, *late, 'fitted together with C_x'))
    C_x, found.stiffness = result.stiffness, result
    found.accept(
        STRAIGHT, Identified(STIFFNESS, *C_x, f'for a mass of {found.robot.mass:g} kg, on the '
                             'recorded ground'),
        Identified(STIFFNESS_SIGMA, C_x.sigma / C_x.value,
                   note='relative standard error of C_x on that ground'))


def _add_motor(found: Calibration, inputs: Inputs) -> None:
    found.motor = fit = identify_motor(
        _needed(inputs.straight, 'of straight starts and stops'), inputs.lifted, found.robot)
    for item in fit.parameters():
        step = LIFTED if item.name.startswith('motor.') and 'torque' not in item.name else STRAIGHT
        found.accept(step, item)
    for name, parameter in ((CONSTANT, 'motor.torque_constant'), (INERTIA, 'motor.inertia')):
        if name in fit.refused:
            found.keep(parameter, fit.refused[name])
    found.notes += fit.notes
