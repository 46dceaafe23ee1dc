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

Rest gives noise and mounting of the IMU; turns give a first latency and the track. One fit of all
motion (``ground_fit``) determines C_x, latency, scale of the forward acceleration and, where it
was not measured, position of the IMU together; then follow the torque constant, again this fit
with the torques, and S from turns. A recording that contains several of these parts can be given
for each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
import math
from typing import Any, TypeVar

from smart_tire.calibration.geometry import (
    add_rest, combine as combine_geometry, Geometry, identify_geometry,
    LATENCY as WHEEL_LATENCY, NO_POSITIONS, RADIUS, STATIC_IMU)
from smart_tire.calibration.ground_fit import fit_ground, GroundFit, SCALE
from smart_tire.calibration.latency import fit_yaw_rate
from smart_tire.calibration.motor import (
    ACCEL_SCALE, CONSTANT as TORQUE_CONSTANT, identify_motor, INERTIA, MotorFit)
from smart_tire.calibration.priors import LIMITS, PRIORS, require
from smart_tire.calibration.recording import CalibrationRecording
from smart_tire.calibration.results import differ
from smart_tire.calibration.sensor_noise import mean_jitter
from smart_tire.calibration.stiffness import stiffness_of, StiffnessFit
from smart_tire.calibration.turning import (
    combine as combine_icr, effective_track, IcrFit, identify_icr)
from smart_tire.errors import EstimatorError
from smart_tire.estimation.ground.unknowns import Unknown
from smart_tire.parameters import RobotParams, specs
from smart_tire.parameters.calibration_file import Identified
from smart_tire.uncertain import Uncertain, weighted_mean

Fit = TypeVar('Fit')

WRITTEN_SHARE = 0.5     # of the limit of a value that is not compared with the configured one

REST, STRAIGHT, TURNS, LIFTED = 'rest', 'straight', 'turns', 'lifted'
STEPS = (REST, STRAIGHT, TURNS, LIFTED)
LATENCY, JITTER, TRACK = 'encoder.latency', 'encoder.stamp_jitter', 'effective_track'
STIFFNESS, STIFFNESS_SIGMA = 'tire.longitudinal_stiffness', 'tire.longitudinal_stiffness_sigma'
POSITION, POSITION_SIGMA = 'imu.position', 'imu.position_sigma'
CONSTANT = 'motor.torque_constant'
Gains = Callable[[RobotParams], Sequence[Identified]]


@dataclass(frozen=True)
class StepFinding(Identified):
    """An identified parameter, and the step of the sequence whose recordings it comes from."""

    step: str = ''


@dataclass
class Calibration:
    """Identified values in the order of identification; reasons of the values that are kept."""

    robot: RobotParams
    found: dict[str, StepFinding] = field(default_factory=dict)
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

    def refuse(self, name: str, reason: str) -> None:
        """Keep the value of a parameter although it has been identified."""
        if self.found.pop(name, None) is not None:
            self.kept[name] = reason

    def accept(self, step: str, *items: Identified) -> None:
        """Take values, in place of earlier ones; all later identifications use them."""
        for item in items:
            self.found.pop(item.name, None)  # the order is that of the identifications
            self.found[item.name] = StepFinding(**vars(item), step=step)
            self.kept.pop(item.name, None)
            if item.name in specs(RobotParams):
                group, _, own = item.name.rpartition('.')
                value: Any = {own: item.value}
                if group:
                    value = {group: replace(getattr(self.robot, group), **value)}
                self.robot = replace(self.robot, **value)


@dataclass(frozen=True)
class Inputs:
    """Recordings of the steps; the same recording may be part of several steps."""

    rest: Sequence[CalibrationRecording] = ()
    straight: Sequence[CalibrationRecording] = ()
    turns: Sequence[CalibrationRecording] = ()
    lifted: Sequence[CalibrationRecording] = ()

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
    known = found.robot
    if known.imu.position_sigma == 0.0:
        found.keep(POSITION, 'given: imu.position_sigma is 0')
    ground = found.attempt([STIFFNESS, STIFFNESS_SIGMA, POSITION],
                           lambda: _add_ground(found, inputs, known, latency, torques=False))
    motor = found.attempt([CONSTANT], lambda: _add_motor(found, inputs, ground))
    if ground is not None and motor is not None and motor.torques_used:
        try:  # again from what was known before: no recording counts twice
            _add_ground(found, inputs, known, latency, torques=True)
        except EstimatorError as error:
            found.notes.append(f'C_x is estimated without the motor torques: {error}')
    found.icr = found.attempt(['icr_x'], lambda: combine_icr(
        [identify_icr(one, _placed(found)) for one in _needed(inputs.turns, 'with turns')]))
    if found.icr is not None:
        found.accept(TURNS, *found.icr.parameters(found.robot))
    if gains is not None:
        found.accept(TURNS, *(found.attempt(
            ['film.stretch_gain'], lambda: gains(found.robot)) or ()))
    found.attempt(['wheel_radius'], lambda: _add_radius(found, inputs))
    found.keep(POSITION, 'requires starts and stops, and turns')
    return found


def _placed(found: Calibration) -> RobotParams:
    """Return the robot with the standard error of its IMU along x, where it is identified."""
    position = found.found.get(POSITION)
    if position is None or not isinstance(position.sigma, tuple):
        return found.robot
    return replace(found.robot, imu=replace(
        found.robot.imu, position_sigma=position.sigma[0]))


def _needed(recordings: Sequence[CalibrationRecording],
            what: str) -> Sequence[CalibrationRecording]:
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
    try:
        found.accept(TURNS, Identified(JITTER, *mean_jitter(inputs.turns, found.robot)))
    except EstimatorError:
        # turns add nothing but their reasons
        jitter = found.attempt([JITTER], lambda: mean_jitter(
            [*inputs.turns, *inputs.straight], found.robot))
        if jitter is not None:
            found.accept(STRAIGHT, Identified(JITTER, *jitter))


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


def _add_ground(found: Calibration, inputs: Inputs, robot: RobotParams,
                latency: Uncertain | None, *, torques: bool) -> GroundFit:
    """
    Add C_x, latency of the wheels, and position of the IMU if it was not given; return the fit.

    Raises EstimatorError if the ground changes, or if turns contradict the latency.
    """
    straight = _needed(inputs.straight, 'of straight starts and stops')
    if 'several grounds' in found.kept.get(TRACK, ''):
        raise EstimatorError(f'{found.kept[TRACK]}: C_x is that of a tire on one ground')
    recordings = list({id(one): one for one in (*straight, *inputs.turns)}.values())
    fit = fit_ground(recordings, robot, torques=torques)
    result, imu = stiffness_of(fit), robot.imu
    late = Uncertain(fit.latency.value, math.hypot(
        fit.latency.sigma, PRIORS['IMU latency'].sigma))
    if latency is not None and differ(late, latency):
        raise EstimatorError(
            f'starts and stops give a latency of {late.value:.3f} ± {late.sigma:.2g} s, turns '
            f'{latency.value:.3f} ± {latency.sigma:.2g} s: the wheels slip in one of them')
    if inputs.positions and late.sigma <= WRITTEN_SHARE * LIMITS[WHEEL_LATENCY].sigma:
        found.accept(STRAIGHT, Identified(LATENCY, *late, 'fitted together with C_x'))
    found.stiffness = result
    found.accept(STRAIGHT, *result.parameters())
    x, y = fit.estimate(Unknown.IMU_X), fit.estimate(Unknown.IMU_Y)
    sigma = max(x.sigma, y.sigma)
    if sigma < WRITTEN_SHARE * imu.position_sigma:
        # of the wheels' center; if nothing is given, base_link may be off it
        off = LIMITS['S'].sigma * robot.wheelbase * (
            imu.position_sigma >= PRIORS['position of the IMU'].sigma)
        position = imu.position[0] + x.value, imu.position[1] + y.value, imu.position[2]
        found.accept(TURNS, Identified(POSITION, position, (
            math.hypot(x.sigma, off), y.sigma, 0.0), 'z unchanged'),
            Identified(POSITION_SIGMA, sigma))
    return fit


def _add_motor(found: Calibration, inputs: Inputs, ground: GroundFit | None) -> MotorFit:
    scale = ACCEL_SCALE
    if ground is not None:
        value, sigma = ground.estimate(SCALE)
        scale = Uncertain(1.0 + value, math.hypot(sigma, scale.sigma))
    found.motor = fit = identify_motor(
        _needed(inputs.straight, 'of straight starts and stops'), inputs.lifted, found.robot,
        scale)
    for item in fit.parameters():
        step = LIFTED if item.name.startswith('motor.') and 'torque' not in item.name else STRAIGHT
        found.accept(step, item)
    for name, parameter in ((TORQUE_CONSTANT, CONSTANT), (INERTIA, 'motor.inertia')):
        if name in fit.refused:
            found.keep(parameter, fit.refused[name])
    found.notes += fit.notes
    return fit
