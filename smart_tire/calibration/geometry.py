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
Geometry of the robot from a recording: latency, radius, track, and noise and mounting of the IMU.

A value is written if it differs from the configured one by several standard errors. The standard
error is at least half the difference of the values from both halves of the recording (interleaved
blocks, so that both contain all phases): a value that only fits a part of it is not written.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
import math
from operator import attrgetter
from typing import TypeVar

import numpy as np

from smart_tire.calibration.latency import (
    fit_speed_changes, fit_yaw_rate, SpeedChangeFit, YawRateFit)
from smart_tire.calibration.priors import PRIORS, require
from smart_tire.calibration.recording import CalibrationRecording
from smart_tire.calibration.reference import (
    fit_gyro_scale, fit_radius, RadiusFit, usable_reference)
from smart_tire.calibration.results import Found, ReportedQuantity, SIGNIFICANT_SIGMAS
from smart_tire.calibration.sensor_noise import (
    fit_jitter, fit_rest, MAX_REPEATED_SHARE, motion_noise, RestFit)
from smart_tire.errors import EstimatorError
from smart_tire.estimation.slip.state import MAX_SAMPLE_GAP
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.rotation import angles, matrix
from smart_tire.uncertain import Uncertain, weighted_mean

LatencyFit = TypeVar('LatencyFit', YawRateFit, SpeedChangeFit)

LATENCY, JITTER, TRACK = 'wheel latency', 'timestamp jitter', 'effective track'
RADIUS, GYRO_SCALE, STATIC_IMU = 'rolling radius', 'gyro scale', 'IMU at standstill'
ROLL, PITCH, ROTATION = 'mounting roll', 'mounting pitch', 'imu.rotation'
MAX_NOISE_RATIO = 1.2      # of the noise in motion over that at rest
BLOCKS = 12  # of which every other one is in the same half
NO_POSITIONS = ('wheel_states have no positions: the interval of their mean velocities is '
                'uncertain by half a period, unless speed changes confirm the latency')


@dataclass
class Geometry(Found):
    """Identified geometry, why parameters are not written, and the fits (None if failed)."""

    factor: float = 1.0  # of the largest standard errors
    yaw_rate_fit: YawRateFit | None = None
    radius_fit: RadiusFit | None = None
    speed_change_fit: SpeedChangeFit | None = None

    def parameters(self, robot: RobotParams) -> list[Identified]:
        """Return the entries of a parameter file."""
        items = [Identified(item.parameter, *item.written, item.note)
                 for item in self.quantities
                 if item.parameter not in ('', ROTATION, *self.kept)]
        items += [Identified(f'{item.parameter}_sigma', item.written.sigma / item.written.value)
                  for item in self.quantities
                  if item.name in (RADIUS, GYRO_SCALE) and item.parameter not in self.kept]
        roll, pitch = self.get(ROLL), self.get(PITCH)
        if roll is not None and pitch is not None and ROTATION not in self.kept:
            turned = matrix(roll.value, pitch.value, 0.0) @ matrix(*robot.imu.rotation)
            items.append(Identified(ROTATION, angles(turned), (roll.sigma, pitch.sigma, 0.0),
                                    'yaw unchanged; assumes level ground'))
        return items


def identify_geometry(recording: CalibrationRecording, robot: RobotParams) -> Geometry:
    """Return all quantities that ``recording`` makes observable, and the reasons of the others."""
    found = _geometry(recording, robot)
    try:
        parts = [_geometry(half, robot, math.inf) for half in halves(recording)]
    except EstimatorError as error:
        found.kept.update({item.parameter: str(error) for item in found.quantities
                           if item.parameter})
        return found
    _compare(found, parts, robot)
    return found


def halves(recording: CalibrationRecording) -> tuple[CalibrationRecording, CalibrationRecording]:
    """
    Return wheels and reference of both halves; each has all IMU samples.

    Raises EstimatorError if the recording is too short.
    """
    wheels, poses = recording.wheels, recording.reference
    shortest = 2.0 * MAX_SAMPLE_GAP  # shorter gaps are bridged by the positions
    blocks = min(BLOCKS, int(np.ptp(wheels.time) / shortest))
    if blocks < 4:
        raise EstimatorError(f'the recording lasts {np.ptp(wheels.time):.0f} s, expected at least '
                             f'{4.0 * shortest:.0f} s to compare its halves')
    ends = np.linspace(wheels.time[0], wheels.time[-1], blocks + 1)[1:-1]

    def half(parity: int) -> CalibrationRecording:
        own = np.searchsorted(ends, wheels.time) % 2 == parity
        seen = None if poses is None else poses.where(
            np.searchsorted(ends, poses.time) % 2 == parity)
        return replace(recording, wheels=wheels.where(own), reference=seen)
    return half(0), half(1)


def _compare(found: Geometry, parts: Sequence[Geometry], robot: RobotParams) -> None:
    """
    Set the spread of the values to half the difference of the halves ``parts``.

    What equals the configured value, or is not observable in one half, is not written.
    """
    equal, different = {}, set()
    for number, item in enumerate(found.quantities):
        values = [one for part in parts if (one := part.get(item.name)) is not None]
        if item.parameter and len(values) < len(parts):
            half = next(part for part in parts if part.get(item.name) is None)
            found.kept.setdefault(item.parameter, 'not observable in one half: ' + (
                half.refused.get(item.name) or half.refused.get(STATIC_IMU, '')))
        elif item.parameter:
            found.quantities[number] = item = replace(
                item, spread=0.5 * abs(values[0].value - values[1].value))
            (value, sigma), configured = item.written, _configured(item, robot)
            if abs(value - configured) > SIGNIFICANT_SIGMAS * sigma:
                different.add(item.parameter)
            pair = ' and '.join(f'{one.value:.4g}' for one in values)
            equal[item.parameter] = (
                f'no significant difference from {configured:.4g} {item.unit}, as configured: '
                f'{value:.4g} ± {sigma:.2g} {item.unit}, the halves give {pair}')
    for parameter, reason in equal.items():
        if parameter not in different:
            found.kept.setdefault(parameter, reason)


def _configured(item: ReportedQuantity, robot: RobotParams) -> float:
    if item.parameter == ROTATION:
        return 0.0
    return float(attrgetter(item.parameter if item.parameter != 'effective_track'
                            else 'track_width')(robot))


def _geometry(recording: CalibrationRecording, robot: RobotParams,
              factor: float = 1.0) -> Geometry:
    """Return all observable quantities, with ``factor`` times larger standard errors at most."""
    found = Geometry(factor=factor)
    gyro = found.attempt(GYRO_SCALE, lambda: fit_gyro_scale(recording))
    _add_latency(found, recording, robot)
    jitter = found.attempt(JITTER, lambda: fit_jitter(recording.wheels, robot))
    if jitter is not None:
        found.add(JITTER, jitter, 's', 'standard deviation of a timestamp', 'encoder.stamp_jitter')
    _add_radius(found, recording, robot, 0.0 if gyro is None else gyro[1])
    _add_track(found, robot)
    if gyro is not None:
        known = robot.imu.gyro_scale  # by which the rates are corrected
        found.add(GYRO_SCALE, Uncertain(known * gyro[0].value, known * gyro[0].sigma), '-',
                  'against the reference', 'imu.gyro_scale')
    add_rest(found, [recording], [recording], robot)
    return found


def _add_latency(found: Geometry, recording: CalibrationRecording, robot: RobotParams) -> None:
    def by(fit: LatencyFit) -> LatencyFit:
        require(LATENCY, fit.latency, 'yaw rate or speed hardly change with the wheels',
                factor=found.factor)
        return fit

    found.yaw_rate_fit = turns = found.attempt(
        LATENCY, lambda: by(fit_yaw_rate(recording, robot)))
    found.speed_change_fit = speeds = found.attempt(
        'speed', lambda: by(fit_speed_changes(recording, robot)))
    reason = found.refused.pop('speed', '')
    # turns have priority: under acceleration the body pitches and lags more behind its wheels
    if turns is not None:
        found.add(LATENCY, turns.latency, 's', '' if speeds is None else (
            f'speed changes give {speeds.latency.value:.3f} ± {speeds.latency.sigma:.3f} s'),
            'encoder.latency')
    elif speeds is not None:
        found.add(LATENCY, speeds.latency, 's',
                  f'from speed changes; from turns: {found.refused.pop(LATENCY)}',
                  'encoder.latency')
    else:
        found.refused[LATENCY] += f'; from speed changes: {reason}'
    confirmed = turns is not None and speeds is not None and abs(
        turns.latency.value - speeds.latency.value) < SIGNIFICANT_SIGMAS * math.hypot(
            turns.latency.sigma, speeds.latency.sigma)
    if recording.wheels.position is None and not confirmed:
        found.kept['encoder.latency'] = NO_POSITIONS


def _add_radius(found: Geometry, recording: CalibrationRecording, robot: RobotParams,
                reference_latency: float) -> None:
    def fit() -> RadiusFit:
        poses = usable_reference(recording)
        latency = found.get(LATENCY) or Uncertain(robot.encoder.latency, math.inf)
        turn_slip = PRIORS['share of side slip lost in turns'].value
        if found.yaw_rate_fit is not None:
            track = found.yaw_rate_fit.slope.value * robot.wheel_radius
            turn_slip = min(max(1.0 - robot.track_width / track, 0.0), 1.0)
        made = fit_radius(recording.wheels, poses, latency.value - reference_latency, robot,
                          turn_slip)
        require(RADIUS, made.radius, factor=found.factor)
        return made

    found.radius_fit = found.attempt(RADIUS, fit)
    if found.radius_fit is None:
        if found.speed_change_fit is not None:
            rough = found.speed_change_fit.radius
            found.refused[RADIUS] += (
                f'; the accelerometer gives {rough.value:.3f} ± {rough.sigma:.3f} m')
        return
    radius = found.radius_fit.radius
    found.add(RADIUS, radius, 'm', 'mean, including the slip of straight free rolling',
              'wheel_radius')
    if found.yaw_rate_fit is not None:
        difference = found.yaw_rate_fit.radius_difference
        sigma = math.hypot(radius.sigma, 0.5 * radius.value * difference.sigma)
        for side, sign in (('left', -1.0), ('right', 1.0)):
            value = radius.value * (1.0 + 0.5 * sign * difference.value)
            found.add(f'{RADIUS}, {side}', Uncertain(value, sigma), 'm')


def _add_track(found: Geometry, robot: RobotParams) -> None:
    if found.yaw_rate_fit is None:
        found.refused[TRACK] = f'requires the latency from turns (see {LATENCY})'
        return
    slope, radius = found.yaw_rate_fit.slope, found.get(RADIUS)
    value, sigma = radius or (robot.wheel_radius, 0.0)
    track = Uncertain(slope.value * value, math.hypot(slope.sigma * value, slope.value * sigma))
    if found.attempt(TRACK, lambda: require(TRACK, track, factor=found.factor)) is not None:
        found.add(TRACK, track, 'm', 'for the configured wheel_radius' if radius is None
                  else 'for the rolling radius above', 'effective_track')


def add_rest(found: Geometry, rests: Sequence[CalibrationRecording],
             moving: Sequence[CalibrationRecording], robot: RobotParams) -> None:
    """
    Add noise and mounting of the IMU from the longest rest.

    The estimators need the noise of the motion: that at rest is not written if vibration, in
    recordings ``moving``, exceeds it.
    """
    fits: list[RestFit] = []
    for recording in rests:
        fit = found.attempt(STATIC_IMU, lambda one=recording: fit_rest(  # type: ignore[misc]
            one, robot))
        fits += [fit] if fit is not None else []
    if not fits:
        found.refused.setdefault(STATIC_IMU, 'no recording at rest')
        return
    found.refused.pop(STATIC_IMU, None)
    fit = max(fits, key=lambda one: one.seconds)
    for axis, bias in zip('xyz', fit.gyro_bias):
        found.add(f'gyro bias {axis}', bias, 'rad/s', 'of this recording')
    repeats = f'; {fit.repeated_share:.0%} of the samples repeat the previous one, ignored' if (
        fit.repeated_share > MAX_REPEATED_SHARE) else ''
    for name, noise, level, unit, parameter in zip(
            ('gyro noise', 'accelerometer noise'), (fit.gyro_noise, fit.accel_noise),
            motion_noise(moving), ('rad/s', 'm/s2'), ('imu.gyro_noise', 'imu.accel_noise')):
        found.add(name, noise, unit, f'of a sample at standstill{repeats}', parameter)
        if level.value > max(MAX_NOISE_RATIO * noise.value, noise.value + SIGNIFICANT_SIGMAS
                             * math.hypot(level.sigma, noise.sigma)):
            found.kept[parameter] = (
                f'{level.value:.2g} {unit} in motion and {noise.value:.2g} {unit} at rest: the '
                'estimators need that of the motion, which the vibration level of the slip '
                'estimator follows')
    intervals = f'{fit.intervals} intervals' if fit.intervals > 1 else 'one interval'
    for name, tilt in ((ROLL, fit.roll), (PITCH, fit.pitch)):
        found.add(name, tilt, 'rad', f'in addition to imu.rotation, from {intervals} at '
                  'standstill; sigma includes bias and slope of the ground', ROTATION)
    if all(abs(tilt.value) <= SIGNIFICANT_SIGMAS * tilt.sigma for tilt in (fit.roll, fit.pitch)):
        found.kept[ROTATION] = (
            f'roll {fit.roll.value:.4f} and pitch {fit.pitch.value:.4f} rad are below '
            f'{SIGNIFICANT_SIGMAS:g} standard errors of {fit.roll.sigma:.2g} rad: bias and slope '
            'of the ground')


def combine(parts: Iterable[Geometry]) -> Geometry:
    """
    Return the combined result of several recordings: means weighted by the standard errors.

    If the values scatter more than their standard errors, those are scaled up accordingly. A
    parameter that one recording does not confirm is not written.
    """
    parts = list(parts)
    merged = Geometry()
    for kind in ('yaw_rate_fit', 'speed_change_fit', 'radius_fit'):
        setattr(merged, kind, next(filter(None, (getattr(part, kind) for part in parts)), None))
    for name in dict.fromkeys(item.name for part in parts for item in part.quantities):
        same = [item for part in parts for item in part.quantities if item.name == name]
        merged.quantities.append(replace(
            same[0], estimate=weighted_mean([item.estimate for item in same]),
            spread=max(item.spread for item in same)))
    for part in parts:
        merged.kept.update(part.kept)
        merged.refused.update((name, why) for name, why in part.refused.items()
                              if merged.get(name) is None)
    return merged
