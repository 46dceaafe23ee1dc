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
The identifications in their order: each one uses the results of the former ones.

Rest gives noise and mounting of the IMU; turns give a first latency, from which the straight part
determines latency and C_x together; then the torque constant; at last track and S from turns. A
recording that contains several of these parts can be given for each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
import math

from smart_tire.calibration.procedure.ground import check_one_ground, check_rolling
from smart_tire.calibration.procedure.results import Calibration, Finding
from smart_tire.calibration.recording import Recording
from smart_tire.calibration.results import CONTRADICTION_SIGMAS
from smart_tire.calibration.robot.geometry import (
    add_rest, combine as combine_geometry, Geometry, identify_geometry, NO_POSITIONS, RADIUS,
    STATIC_IMU)
from smart_tire.calibration.robot.jitter import fit_jitter
from smart_tire.calibration.robot.latency import fit_yaw_rate
from smart_tire.calibration.robot.motor import CONSTANT, identify_motor, INERTIA
from smart_tire.calibration.robot.turning import (
    combine as combine_icr, fit_turn_track, identify_icr)
from smart_tire.calibration.tire.stiffness import identify_stiffness
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.uncertain import Uncertain, weighted_mean

REST, STRAIGHT, TURNS, LIFTED = 'rest', 'straight', 'turns', 'lifted'
STEPS = (REST, STRAIGHT, TURNS, LIFTED)

LATENCY, JITTER, TRACK = 'encoder.latency', 'encoder.stamp_jitter', 'effective_track'
STIFFNESS, STIFFNESS_SIGMA = 'tire.longitudinal_stiffness', 'tire.longitudinal_stiffness_sigma'
MAX_LATENCY_SIGMA = 0.015     # s: a quarter of the period of the wheel encoders
UNKNOWN_LATENCY_SIGMA = 0.03  # s, of the configured latency if turns do not show it
IMU_DELAY_SIGMA = 0.001       # s, of the timestamps of the IMU: its filter and sampling; assumed

Gains = Callable[[RobotParams], Sequence[Identified]]


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
    bias = add_rest(imu, inputs.rest, [*inputs.straight, *inputs.turns], robot)
    _add(found, imu.parameters(robot), REST)
    for name in ('imu.gyro_noise', 'imu.accel_noise', 'imu.rotation'):
        found.keep(name, imu.kept.get(name) or imu.refused.get(STATIC_IMU, ''))
    _add_jitter(found, inputs)
    latency = _add_turn_latency(found, inputs)
    track = found.attempt([TRACK], lambda: fit_turn_track(
        _needed(inputs.turns, 'with turns'), found.robot, bias))
    if track is not None:
        found.add(Finding(TRACK, *track.track, TURNS, f'for wheel_radius '
                          f'{robot.wheel_radius:g} m; {track.spread:.2g} m between turns'))
    found.attempt([STIFFNESS, STIFFNESS_SIGMA], lambda: _add_stiffness(found, inputs, latency))
    found.attempt(['motor.torque_constant'], lambda: _add_motor(found, inputs))
    found.icr = found.attempt(['icr_x'], lambda: combine_icr(
        [identify_icr(one, found.robot) for one in _needed(inputs.turns, 'with turns')]))
    if found.icr is not None:
        _add(found, found.icr.parameters(found.robot), TURNS)
    if gains is not None:
        _add(found, found.attempt(['film.stretch_gain'], lambda: gains(found.robot)) or (), TURNS)
    found.attempt(['wheel_radius'], lambda: _add_radius(found, inputs))
    found.keep('imu.position', 'only its distance from the centers of rotation is observable')
    return found


def _add(found: Calibration, items: Iterable[Identified], step: str) -> None:
    for item in items:
        found.add(Finding(item.name, item.value, item.sigma, step, item.note))


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
    found.add(Finding('wheel_radius', *radius, STRAIGHT, 'against the reference poses'))
    found.add(Finding('wheel_radius_sigma', radius.sigma / radius.value, None, STRAIGHT))


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
            found.add(Finding(JITTER, *weighted_mean(values), step))
            return
    found.keep(JITTER, '; '.join(dict.fromkeys(reasons)) or 'no recording in motion')


def _add_turn_latency(found: Calibration, inputs: Inputs) -> Uncertain | None:
    """Return the latency that turns show, and add it if its standard error is small enough."""
    latency = found.attempt([LATENCY], lambda: weighted_mean(
        [fit_yaw_rate(one, found.robot).latency for one in _needed(inputs.turns, 'with turns')]))
    if latency is None:
        return None
    if not inputs.positions:
        found.keep(LATENCY, NO_POSITIONS)
    elif latency.sigma > MAX_LATENCY_SIGMA:
        found.keep(LATENCY, f'standard error of {latency.sigma:.2g} s, expected at most '
                            f'{MAX_LATENCY_SIGMA:g} s')
    else:
        found.add(Finding(LATENCY, *latency, TURNS, 'wheel speed difference against gyro'))
    return latency


def _add_stiffness(found: Calibration, inputs: Inputs, latency: Uncertain | None) -> None:
    """
    Add C_x, and the latency that the same fit determines.

    Raises EstimatorError if the ground changes, or if turns contradict the latency.
    """
    recordings = _needed(inputs.straight, 'of straight starts and stops')
    known = found.get(LATENCY)
    sigma = known.sigma if known is not None else UNKNOWN_LATENCY_SIGMA
    assert isinstance(sigma, float)
    if 'several grounds' in found.kept.get(TRACK, ''):
        raise EstimatorError(f'{found.kept[TRACK]}: C_x is that of a tire on one ground')
    check_one_ground(recordings, found.robot, sigma)
    result = identify_stiffness(recordings, found.robot, sigma)
    check_rolling(result, found.robot)
    late = Uncertain(found.robot.encoder.latency + result.latency_error.value,
                     math.hypot(result.latency_error.sigma, IMU_DELAY_SIGMA))
    if latency is not None and abs(late.value - latency.value) > CONTRADICTION_SIGMAS * math.hypot(
            late.sigma, latency.sigma):
        raise EstimatorError(
            f'starts and stops give a latency of {late.value:.3f} ± {late.sigma:.2g} s, turns '
            f'{latency.value:.3f} ± {latency.sigma:.2g} s: the wheels slip in one of them')
    if inputs.positions and late.sigma <= MAX_LATENCY_SIGMA:
        found.add(Finding(LATENCY, *late, STRAIGHT, 'fitted together with C_x'))
    C_x, found.stiffness = result.stiffness, result
    found.add(Finding(STIFFNESS, *C_x, STRAIGHT,
                      f'for a mass of {found.robot.mass:g} kg, on the recorded ground'))
    found.add(Finding(STIFFNESS_SIGMA, C_x.sigma / C_x.value, None, STRAIGHT,
                      'relative standard error of C_x on that ground'))


def _add_motor(found: Calibration, inputs: Inputs) -> None:
    found.motor = fit = identify_motor(
        _needed(inputs.straight, 'of straight starts and stops'), inputs.lifted, found.robot)
    for item in fit.parameters():
        step = LIFTED if item.name.startswith('motor.') and 'torque' not in item.name else STRAIGHT
        _add(found, [item], step)
    for name, parameter in ((CONSTANT, 'motor.torque_constant'), (INERTIA, 'motor.inertia')):
        if name in fit.refused:
            found.keep(parameter, fit.refused[name])
    found.notes += fit.notes
