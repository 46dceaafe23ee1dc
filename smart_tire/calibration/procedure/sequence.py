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

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math

from smart_tire.calibration.procedure.ground import check_one_ground, check_rolling
from smart_tire.calibration.procedure.results import Calibration, Finding
from smart_tire.calibration.recording import Recording
from smart_tire.calibration.robot.geometry import (
    combine as combine_geometry, identify_geometry, RADIUS as ROLLING_RADIUS,
    SIGNIFICANT_TILT_SIGMAS)
from smart_tire.calibration.robot.icr import combine as combine_icr, identify_icr
from smart_tire.calibration.robot.motion_noise import motion_noise
from smart_tire.calibration.robot.motor import CONSTANT, identify_motor, INERTIA
from smart_tire.calibration.robot.static_imu import fit_static_imu, StaticImuFit
from smart_tire.calibration.robot.timestamp_jitter import fit_jitter
from smart_tire.calibration.robot.turn_track import fit_turn_track
from smart_tire.calibration.robot.wheel_latency import fit_yaw_rate
from smart_tire.calibration.tire.stiffness import identify_stiffness
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.rotation import angles, matrix
from smart_tire.uncertain import Uncertain, weighted_mean

REST, STRAIGHT, TURNS, LIFTED = 'rest', 'straight', 'turns', 'lifted'
STEPS = (REST, STRAIGHT, TURNS, LIFTED)

LATENCY, JITTER = 'encoder.latency', 'encoder.stamp_jitter'
GYRO_NOISE, ACCEL_NOISE, ROTATION = 'imu.gyro_noise', 'imu.accel_noise', 'imu.rotation'
STIFFNESS, STIFFNESS_SIGMA = ('tire.longitudinal_stiffness', 'tire.longitudinal_stiffness_sigma')
TRACK, ICR, TORQUE = 'effective_track', 'icr_x', 'motor.torque_constant'
POSITION, RADIUS, RADIUS_SIGMA = 'imu.position', 'wheel_radius', 'wheel_radius_sigma'
MAX_LATENCY_SIGMA = 0.015    # s: a quarter of the period of the wheel encoders
UNKNOWN_LATENCY_SIGMA = 0.03  # s, of the configured latency if turns do not show it
IMU_DELAY_SIGMA = 0.001      # s, of the timestamps of the IMU: its filter and sampling; assumed
MAX_NOISE_RATIO = 1.5        # of the noise in motion over that at rest
SEPARATE_SIGMAS = 4.0        # standard errors by which two latencies contradict

Gains = Callable[[RobotParams], Sequence[Identified]]


@dataclass(frozen=True)
class Inputs:
    """Recordings of the steps; the same recording may be part of several steps."""

    rest: Sequence[Recording] = ()
    straight: Sequence[Recording] = ()
    turns: Sequence[Recording] = ()
    lifted: Sequence[Recording] = ()


def calibrate(inputs: Inputs, robot: RobotParams, gains: Gains | None = None) -> Calibration:
    """
    Return what ``inputs`` show of a robot with the known parameters ``robot``.

    ``gains`` identifies the films of the robot it is called with; None if there are no films in
    the recordings. Nothing is raised: a value that cannot be identified is kept, with the reason.
    """
    found = Calibration(robot)
    bias = _add_rest(found, inputs)
    _add_jitter(found, inputs)
    latency = _add_turn_latency(found, inputs)
    _add_track(found, inputs, bias)
    _add_stiffness(found, inputs, latency)
    _add_motor(found, inputs)
    _add_icr(found, inputs)
    if gains is not None:
        for item in found.attempt(['film.stretch_gain'], lambda: gains(found.robot)) or ():
            found.add(Finding(item.name, item.value, item.sigma, TURNS, item.note))
    _add_radius(found, inputs)
    found.keep(POSITION, 'only its distance from the centers of rotation is observable')
    return found


def _add_radius(found: Calibration, inputs: Inputs) -> None:
    """Add the rolling radius by the pose references, if there are any."""
    recordings = {id(one): one for one in (*inputs.straight, *inputs.turns)
                  if one.reference is not None}.values()
    if not recordings:
        found.keep(RADIUS, 'requires a pose reference (--truth)')
        return
    parts = combine_geometry([identify_geometry(one, found.robot) for one in recordings])
    radius = parts.get(ROLLING_RADIUS)
    if radius is None:
        found.keep(RADIUS, parts.refused[ROLLING_RADIUS])
        return
    found.add(Finding(RADIUS, radius.value, radius.sigma, STRAIGHT, 'against the reference poses'))
    found.add(Finding(RADIUS_SIGMA, radius.sigma / radius.value, None, STRAIGHT))


def _add_rest(found: Calibration, inputs: Inputs) -> Uncertain:
    """Add noise and mounting of the IMU; return the gyro bias about z."""
    names = (GYRO_NOISE, ACCEL_NOISE, ROTATION)
    fit = found.attempt(names, lambda: _longest_rest(inputs.rest, found.robot))
    if fit is None:
        return Uncertain(0.0, found.robot.imu.gyro_bias)
    moving = [*inputs.straight, *inputs.turns]
    _add_noise(found, GYRO_NOISE, fit.gyro_noise, motion_noise(moving, 'rate', (2,)), 'rad/s')
    _add_noise(found, ACCEL_NOISE, fit.accel_noise, motion_noise(moving, 'force', (0, 1)), 'm/s2')
    if any(abs(tilt.value) > SIGNIFICANT_TILT_SIGMAS * tilt.sigma
           for tilt in (fit.roll, fit.pitch)):
        turned = matrix(fit.roll.value, fit.pitch.value, 0.0) @ matrix(*found.robot.imu.rotation)
        found.add(Finding(ROTATION, angles(turned), (fit.roll.sigma, fit.pitch.sigma, 0.0), REST,
                          'yaw unchanged; assumes level ground'))
    else:
        found.keep(ROTATION, f'roll {fit.roll.value:.4f} and pitch {fit.pitch.value:.4f} rad are '
                             f'below {SIGNIFICANT_TILT_SIGMAS:g} standard errors of '
                             f'{fit.roll.sigma:.2g} rad: bias and slope of the ground')
    return fit.gyro_bias[2]


def _longest_rest(recordings: Sequence[Recording], robot: RobotParams) -> StaticImuFit:
    """Return the fit of the recording with the longest standstill."""
    if not recordings:
        raise EstimatorError('no recording at rest')
    fits, reasons = [], []
    for recording in recordings:
        try:
            fits.append(fit_static_imu(recording, robot))
        except EstimatorError as error:
            reasons.append(str(error))
    if not fits:
        raise EstimatorError('; '.join(dict.fromkeys(reasons)))
    best = max(fits, key=lambda fit: fit.seconds)
    return best


def _add_noise(found: Calibration, name: str, noise: Uncertain, moving: float,
               unit: str) -> None:
    if moving > MAX_NOISE_RATIO * noise.value:
        found.keep(name, f'{moving:.2g} {unit} in motion and {noise.value:.2g} {unit} at rest: '
                         'the estimators need that of the motion, which the vibration level '
                         'of the slip estimator follows')
        return
    found.add(Finding(name, noise.value, noise.sigma, REST, 'of one sample'))


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
            jitter = weighted_mean(values)
            found.add(Finding(JITTER, jitter.value, jitter.sigma, step))
            return
    found.keep(JITTER, '; '.join(dict.fromkeys(reasons)) or 'no recording in motion')


def _add_turn_latency(found: Calibration, inputs: Inputs) -> Uncertain | None:
    """Return the latency that turns show, and add it if its standard error is small enough."""
    def fit() -> Uncertain:
        if not inputs.turns:
            raise EstimatorError('no recording with turns')
        return weighted_mean([fit_yaw_rate(one, found.robot).latency for one in inputs.turns])
    latency = found.attempt([LATENCY], fit)
    if latency is not None and latency.sigma <= MAX_LATENCY_SIGMA and _positions(inputs):
        found.add(Finding(LATENCY, latency.value, latency.sigma, TURNS,
                          'wheel speed difference against gyro'))
    elif latency is not None:
        found.keep(LATENCY, f'standard error of {latency.sigma:.2g} s, expected at most '
                            f'{MAX_LATENCY_SIGMA:g} s' if _positions(inputs) else
                            'wheel_states have no positions: the interval of a mean velocity is '
                            'uncertain by half a period')
    return latency


def _positions(inputs: Inputs) -> bool:
    return all(one.wheels.position is not None for one in (*inputs.straight, *inputs.turns))


def _add_track(found: Calibration, inputs: Inputs, bias: Uncertain) -> None:
    if not inputs.turns:
        found.keep(TRACK, 'no recording with turns')
        return
    fit = found.attempt([TRACK], lambda: fit_turn_track(inputs.turns, found.robot, bias))
    if fit is not None:
        found.add(Finding(TRACK, fit.track.value, fit.track.sigma, TURNS,
                          f'for wheel_radius {found.robot.wheel_radius:g} m; {fit.spread:.2g} m '
                          'between turns'))


def _add_stiffness(found: Calibration, inputs: Inputs, latency: Uncertain | None) -> None:
    """Add C_x, and the latency that the same fit determines."""
    names = (STIFFNESS, STIFFNESS_SIGMA)
    if not inputs.straight:
        for name in names:
            found.keep(name, 'no recording of straight starts and stops')
        return
    known = found.get(LATENCY)
    sigma = known.sigma if known is not None else UNKNOWN_LATENCY_SIGMA
    assert isinstance(sigma, float)

    def fit() -> None:
        if 'several grounds' in found.kept.get(TRACK, ''):
            raise EstimatorError(f'{found.kept[TRACK]}: C_x is that of a tire on one ground')
        check_one_ground(inputs.straight, found.robot, sigma)
        result = identify_stiffness(inputs.straight, found.robot, sigma)
        check_rolling(result, found.robot)
        _add_late(found, inputs, result.latency_error, latency)
        C_x, found.stiffness = result.stiffness, result
        found.add(Finding(STIFFNESS, C_x.value, C_x.sigma, STRAIGHT,
                          f'for a mass of {found.robot.mass:g} kg, on the recorded ground'))
        found.add(Finding(STIFFNESS_SIGMA, C_x.sigma / C_x.value, None, STRAIGHT,
                          'relative standard error of C_x on that ground'))
    found.attempt(names, fit)


def _add_late(found: Calibration, inputs: Inputs, error: Uncertain,
              turns: Uncertain | None) -> None:
    """Add the latency by starts and stops; EstimatorError if turns contradict it."""
    late = Uncertain(found.robot.encoder.latency + error.value,
                     math.hypot(error.sigma, IMU_DELAY_SIGMA))
    if turns is not None and abs(late.value - turns.value) > SEPARATE_SIGMAS * math.hypot(
            late.sigma, turns.sigma):
        raise EstimatorError(
            f'starts and stops give a latency of {late.value:.3f} ± {late.sigma:.2g} s, turns '
            f'{turns.value:.3f} ± {turns.sigma:.2g} s: the wheels slip in one of them')
    if not _positions(inputs) or late.sigma > MAX_LATENCY_SIGMA:
        return
    found.add(Finding(LATENCY, late.value, late.sigma, STRAIGHT, 'fitted together with C_x'))


def _add_motor(found: Calibration, inputs: Inputs) -> None:
    if not inputs.straight:
        found.keep(TORQUE, 'no recording of straight starts and stops')
        return
    fit = found.attempt([TORQUE], lambda: identify_motor(
        inputs.straight, inputs.lifted, found.robot))
    if fit is None:
        return
    found.motor = fit
    for item in fit.parameters():
        step = LIFTED if item.name.startswith('motor.') and 'torque' not in item.name else STRAIGHT
        found.add(Finding(item.name, item.value, item.sigma, step, item.note))
    for name, parameter in ((CONSTANT, TORQUE), (INERTIA, 'motor.inertia')):
        if name in fit.refused:
            found.keep(parameter, fit.refused[name])
    found.notes += fit.notes


def _add_icr(found: Calibration, inputs: Inputs) -> None:
    if not inputs.turns:
        found.keep(ICR, 'no recording with turns')
        return
    fit = found.attempt([ICR], lambda: combine_icr(
        [identify_icr(one, found.robot) for one in inputs.turns]))
    if fit is not None:
        found.icr = fit
        for item in fit.parameters(found.robot):
            found.add(Finding(item.name, item.value, item.sigma, TURNS, item.note))
