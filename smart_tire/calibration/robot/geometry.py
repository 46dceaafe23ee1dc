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

"""Calibration of wheels and IMU from a recording: parameters, and which are not observable."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
import math
from typing import TypeVar

import numpy as np

from smart_tire.calibration.recording import Recording
from smart_tire.calibration.robot.accelerometer_fit import (
    fit_speed_changes, speed_change_problem, SpeedChangeFit)
from smart_tire.calibration.robot.cross_validation import (
    both_ways, delay_prediction, halves, noise_verdict, Prediction, value_verdict, Verdict,
    verdict)
from smart_tire.calibration.robot.gyro_scale import fit_gyro_scale, GyroScaleFit, usable_reference
from smart_tire.calibration.robot.rolling_radius import fit_radius, RadiusFit, TURN_SLIP
from smart_tire.calibration.robot.static_imu import (
    fit_static_imu, MAX_REPEATED_SHARE, StaticImuFit)
from smart_tire.calibration.robot.timestamp_jitter import fit_jitter
from smart_tire.calibration.robot.wheel_latency import (
    fit_yaw_rate, yaw_rate_problem, YawRateFit)
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay_regression import DelayProblem
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.rotation import angles, matrix
from smart_tire.uncertain import Uncertain, weighted_mean

LATENCY, JITTER, TRACK = 'wheel latency', 'timestamp jitter', 'effective track'
RADIUS, GYRO_SCALE, STATIC_IMU = 'rolling radius', 'gyro scale', 'IMU at standstill'
ROLL, PITCH = 'mounting roll', 'mounting pitch'
MAX_TRACK_SIGMA = 0.1          # relative standard error above which a track is not reported
SIGNIFICANT_TILT_SIGMAS = 3.0  # standard errors above which a tilt is attributed to the mounting

Fit = TypeVar('Fit')
Halves = tuple[Recording, Recording]


@dataclass(frozen=True)
class Quantity:
    """A calibrated quantity: one line of the report."""

    name: str
    estimate: Uncertain
    unit: str
    note: str = ''
    parameter: str = ''  # name of the parameter, '' if there is none


@dataclass
class Geometry:
    """Calibrated quantities, reasons of those not observable, and the fits (None if failed)."""

    quantities: list[Quantity] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)  # name -> reason
    verdicts: dict[str, Verdict] = field(default_factory=dict)  # parameter -> cross-validation
    yaw_rate_fit: YawRateFit | None = None
    speed_change_fit: SpeedChangeFit | None = None
    radius_fit: RadiusFit | None = None

    def get(self, name: str) -> Uncertain | None:
        """Return the estimate of the quantity ``name``, None if it is not observable."""
        return next((item.estimate for item in self.quantities if item.name == name), None)

    def accepted(self, parameter: str) -> bool:
        """Return whether a parameter passed the cross-validation."""
        return parameter in self.verdicts and self.verdicts[parameter].accepted

    def sigma(self, item: Quantity) -> float:
        """Return the standard error, at least the one that the difference of the halves shows."""
        return max(item.estimate.sigma, self.verdicts[item.parameter].spread)

    def add(self, name: str, estimate: Uncertain, unit: str, note: str = '',
            parameter: str = '') -> None:
        """Append a quantity."""
        self.quantities.append(Quantity(name, estimate, unit, note, parameter))

    def attempt(self, name: str, fit: Callable[[], Fit]) -> Fit | None:
        """Return what ``fit`` returns; if it fails, store the reason under ``name``."""
        try:
            return fit()
        except EstimatorError as error:
            self.refused[name] = str(error)
            return None


def identify_geometry(recording: Recording, robot: RobotParams) -> Geometry:
    """Return all quantities that ``recording`` makes observable, and the reasons of the others."""
    found = Geometry()
    static_imu = found.attempt(STATIC_IMU, lambda: fit_static_imu(recording, robot))
    gyro = found.attempt(GYRO_SCALE, lambda: fit_gyro_scale(recording))
    _add_latency(found, recording, robot)
    jitter = found.attempt(JITTER, lambda: fit_jitter(recording.wheels, robot))
    if jitter is not None:
        found.add(JITTER, jitter, 's', 'standard deviation of a timestamp', 'encoder.stamp_jitter')
    _add_radius(found, recording, robot, gyro)
    _add_track(found, robot)
    if gyro is not None:
        found.add(GYRO_SCALE, gyro.scale, '-', 'against the reference; no parameter takes it')
    if static_imu is not None:
        _add_static_imu(found, static_imu)
    _cross_validate(found, recording, robot)
    return found


def _cross_validate(found: Geometry, recording: Recording, robot: RobotParams) -> None:
    """Test each parameter: identified from one half of the recording, tested on the other."""
    tests: dict[str, Callable[[Halves], Verdict]] = {
        'encoder.latency': lambda parts: _test_latency(found, parts, robot),
        'effective_track': lambda parts: _test_track(parts, robot),
        'wheel_radius': lambda parts: _test_radius(parts, robot),
        'encoder.stamp_jitter': lambda parts: _test_jitter(parts, robot),
        'imu.gyro_noise': lambda parts: noise_verdict(
            parts, lambda part: part.imu.rate[:, 2:], robot.imu.gyro_noise, 'rad/s'),
        'imu.accel_noise': lambda parts: noise_verdict(
            parts, lambda part: part.imu.force[:, :2], robot.imu.accel_noise, 'm/s2'),
        'imu.rotation': lambda parts: _test_tilt(parts, robot)}
    identified = {item.parameter for item in found.quantities} | {
        'imu.rotation' for item in found.quantities if item.name == PITCH}
    for name in (name for name in tests if name in identified):
        try:
            found.verdicts[name] = tests[name](halves(recording))
        except EstimatorError as error:
            found.verdicts[name] = Verdict(False, f'not observable in one half: {error}')


def _test_latency(found: Geometry, parts: Halves, robot: RobotParams) -> Verdict:
    """
    Return whether the latency of one half predicts the motion in the other one better.

    In turns by the gyro; speed changes by the accelerometer must not contradict, and have to
    confirm it if the meaning of the wheel velocities is not certain.
    """
    turns = found.yaw_rate_fit is not None

    def latency(part: Recording) -> float:
        fit = fit_yaw_rate(part, robot) if turns else fit_speed_changes(part, robot)
        return fit.latency.value

    values = {id(part): latency(part) for part in parts}

    def predictions(problem: Callable[[Recording, RobotParams], DelayProblem]) -> list[Prediction]:
        return both_ways(parts, lambda fitted, tested: delay_prediction(
            problem(fitted, robot), problem(tested, robot), robot.encoder.latency,
            values[id(fitted)]))

    first, second = values.values()
    spread = 0.5 * abs(first - second)
    by_speed = verdict(predictions(speed_change_problem), 'm/s in speed changes')
    if not turns:
        return replace(by_speed, spread=spread)
    if by_speed.contradicted:
        return by_speed
    if parts[0].wheels.position is None and not by_speed.accepted:
        return Verdict(False, 'wheel_states have no positions, so the interval of their mean '
                              'velocities is uncertain by half a period, and speed changes do not '
                              f'confirm the latency: {by_speed.reason}')
    return replace(verdict(predictions(yaw_rate_problem), 'rad/s in turns'), spread=spread)


def _test_track(parts: Halves, robot: RobotParams) -> Verdict:
    """Return whether the track of one half predicts the gyro in the other one better."""
    fits = {id(part): fit_yaw_rate(part, robot) for part in parts}

    def predict(fitted: Recording, tested: Recording) -> Prediction:
        slope, fit = fits[id(fitted)].slope.value, fits[id(tested)]
        configured = robot.track_width / robot.wheel_radius
        return Prediction(fit.time, fit.yaw_rate - fit.wheel_difference / configured,
                          fit.yaw_rate - fit.wheel_difference / slope)
    slopes = [fit.slope.value for fit in fits.values()]
    return replace(verdict(both_ways(parts, predict), 'rad/s against the geometric track'),
                   spread=0.5 * robot.wheel_radius * abs(slopes[0] - slopes[1]))


def _test_radius(parts: Halves, robot: RobotParams) -> Verdict:
    """Return whether the radius of one half predicts the distances in the other one better."""
    def fit(part: Recording) -> RadiusFit:
        half = Geometry()
        gyro = half.attempt(GYRO_SCALE, lambda: fit_gyro_scale(part))
        _add_latency(half, part, robot)
        return _fit_radius(half, part, robot, gyro)

    fits = {id(part): fit(part) for part in parts}

    def predict(fitted: Recording, tested: Recording) -> Prediction:
        own, other = fits[id(fitted)].radius.value, fits[id(tested)]
        rolled = other.wheel_distance / other.radius.value
        return Prediction(other.time, other.reference_distance - rolled * robot.wheel_radius,
                          other.reference_distance - rolled * own)
    radii = [fit.radius.value for fit in fits.values()]
    return replace(verdict(both_ways(parts, predict), 'm'), spread=0.5 * abs(radii[0] - radii[1]))


def _test_jitter(parts: Halves, robot: RobotParams) -> Verdict:
    found = [fit_jitter(part.wheels, robot) for part in parts]
    return value_verdict([item.value for item in found], robot.encoder.stamp_jitter,
                         [item.sigma for item in found], 's')


def _test_tilt(parts: Halves, robot: RobotParams) -> Verdict:
    """Return whether a tilt was the same at different places."""
    fits = [fit_static_imu(part, robot) for part in parts]
    first, second = (np.array([fit.roll.value, fit.pitch.value]) for fit in fits)
    text = f'{first.round(4).tolist()} and {second.round(4).tolist()} rad'
    better = np.linalg.norm(first - second) < min(np.linalg.norm(first), np.linalg.norm(second))
    if min(fit.intervals for fit in fits) < 2:
        return Verdict(False, 'one half has fewer than two standstills: the slope of the ground '
                              'may be the same')
    return Verdict(bool(better), text if better else f'no improvement on the other half: {text}')


def _add_latency(found: Geometry, recording: Recording, robot: RobotParams) -> None:
    turns = found.yaw_rate_fit = found.attempt(LATENCY, lambda: fit_yaw_rate(recording, robot))
    speeds = found.speed_change_fit = found.attempt(
        'latency by speed', lambda: fit_speed_changes(recording, robot))
    speed_reason = found.refused.pop('latency by speed', '')
    if turns is None and speeds is None:
        found.refused[LATENCY] += f'; from speed changes: {speed_reason}'
    # turns have priority: under acceleration the body pitches and lags more behind its wheels
    other = '' if speeds is None else (f'speed changes give {speeds.latency.value:.3f} '
                                       f'± {speeds.latency.sigma:.3f} s')
    if turns is not None:
        found.add(LATENCY, turns.latency, 's', other, 'encoder.latency')
    elif speeds is not None:
        reason = found.refused.pop(LATENCY)
        found.add(LATENCY, speeds.latency, 's', f'from speed changes; from turns: {reason}',
                  'encoder.latency')


def _add_radius(found: Geometry, recording: Recording, robot: RobotParams,
                gyro: GyroScaleFit | None) -> None:
    found.radius_fit = found.attempt(RADIUS, lambda: _fit_radius(found, recording, robot, gyro))
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


def _fit_radius(found: Geometry, recording: Recording, robot: RobotParams,
                gyro: GyroScaleFit | None) -> RadiusFit:
    poses = usable_reference(recording)
    latency = found.get(LATENCY) or Uncertain(robot.encoder.latency, math.inf)
    reference_latency = gyro.latency.value if gyro is not None else 0.0
    turn_slip = TURN_SLIP
    if found.yaw_rate_fit is not None:
        track = found.yaw_rate_fit.slope.value * robot.wheel_radius
        turn_slip = min(max(1.0 - robot.track_width / track, 0.0), 1.0)
    return fit_radius(recording.wheels, poses, latency.value - reference_latency, robot,
                      turn_slip)


def _add_track(found: Geometry, robot: RobotParams) -> None:
    if found.yaw_rate_fit is None:
        found.refused[TRACK] = f'requires the latency from turns (see {LATENCY})'
        return
    slope = found.yaw_rate_fit.slope
    radius = found.get(RADIUS) or Uncertain(robot.wheel_radius, 0.0)
    track = Uncertain(slope.value * radius.value, math.hypot(
        slope.sigma * radius.value, slope.value * radius.sigma))
    if track.sigma > MAX_TRACK_SIGMA * track.value:
        found.refused[TRACK] = (f'standard error of {track.sigma / track.value:.0%}, expected at '
                                f'most {MAX_TRACK_SIGMA:.0%}')
    else:
        found.add(TRACK, track, 'm', 'for the rolling radius above' if found.radius_fit is not None
                  else 'for the configured wheel_radius', 'effective_track')


def _add_static_imu(found: Geometry, fit: StaticImuFit) -> None:
    for axis, bias in zip('xyz', fit.gyro_bias):
        found.add(f'gyro bias {axis}', bias, 'rad/s', 'of this recording')
    repeats = f'; {fit.repeated_share:.0%} of the samples repeat the previous one, ignored' if (
        fit.repeated_share > MAX_REPEATED_SHARE) else ''
    found.add('gyro noise', fit.gyro_noise, 'rad/s', f'of a sample at standstill{repeats}',
              'imu.gyro_noise')
    found.add('accelerometer noise', fit.accel_noise, 'm/s2',
              f'of a sample at standstill{repeats}', 'imu.accel_noise')
    intervals = f'{fit.intervals} intervals' if fit.intervals > 1 else 'one interval'
    for name, tilt in ((ROLL, fit.roll), (PITCH, fit.pitch)):
        found.add(name, tilt, 'rad', f'in addition to imu.rotation, from {intervals} at '
                                     'standstill; sigma includes bias and slope of the ground')


def parameters(found: Geometry, robot: RobotParams) -> list[Identified]:
    """
    Return the entries of a parameter file.

    Only values that passed the cross-validation are included, and the mounting only if its tilt is
    significant against bias and slope of the ground.
    """
    items = [Identified(item.parameter, item.estimate.value, found.sigma(item), item.note)
             for item in found.quantities if found.accepted(item.parameter)]
    radius = found.get(RADIUS)
    if radius is not None and found.accepted('wheel_radius'):
        items.append(Identified('wheel_radius_sigma', max(
            radius.sigma, found.verdicts['wheel_radius'].spread) / radius.value))
    roll, pitch = found.get(ROLL), found.get(PITCH)
    if roll is not None and pitch is not None and found.accepted('imu.rotation') and any(
            abs(tilt.value) > SIGNIFICANT_TILT_SIGMAS * tilt.sigma for tilt in (roll, pitch)):
        rotation = matrix(roll.value, pitch.value, 0.0) @ matrix(*robot.imu.rotation)
        items.append(Identified('imu.rotation', angles(rotation), (roll.sigma, pitch.sigma, 0.0),
                                'yaw unchanged'))
    return items


def combine(parts: Iterable[Geometry]) -> Geometry:
    """
    Return the combined result of several recordings: means weighted by the standard errors.

    If the values scatter more than their standard errors, those are scaled up accordingly.
    """
    parts = list(parts)
    merged = Geometry()
    for kind in ('yaw_rate_fit', 'speed_change_fit', 'radius_fit'):
        setattr(merged, kind, next(filter(None, (getattr(part, kind) for part in parts)), None))
    names = dict.fromkeys(item.name for part in parts for item in part.quantities)
    for name in names:
        same = [item for part in parts for item in part.quantities if item.name == name]
        merged.quantities.append(replace(
            same[0], estimate=weighted_mean([item.estimate for item in same])))
        # one recording that contradicts is enough
        for parameter in {item.parameter for item in same} | {'imu.rotation'}:
            tested = [part.verdicts[parameter] for part in parts if parameter in part.verdicts]
            if tested:
                merged.verdicts[parameter] = min(tested, key=lambda item: item.accepted)
    for part in parts:
        merged.refused.update((name, why) for name, why in part.refused.items()
                              if name not in names)
    return merged
