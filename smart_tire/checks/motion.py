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
Checks of wheels against IMU: unit, rolling radius, effective track, latency, lever arm.

The radius has two independent references. Changes of the speed integrate the forward specific
force (``calibration/latency.py``). In a turn, the lateral specific force is
``a_y = W r u (1 - slip) - y W^2 + x dW/dt``: W the yaw rate, u the mean wheel speed, (x, y) the
IMU. Both have a systematic error, because the body tilts when it accelerates.
"""

from __future__ import annotations

import cmath
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.latency import (
    fit_speed_changes, moving_intervals, yaw_motion)
from smart_tire.calibration.priors import PRIORS
from smart_tire.calibration.recording import CalibrationRecording, Mask, side_slip, Signal
from smart_tire.checks import limits
from smart_tire.checks.recording import CheckedRecording, finding
from smart_tire.checks.sensors import speed_units
from smart_tire.errors import EstimatorError
from smart_tire.findings import Finding, Level
from smart_tire.numerics.least_squares import Errors, Prior, regression, Rows
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain, weighted_mean

INTERVAL = 0.4  # s, of the force: longer than most latencies, shorter than a start
RADIUS, SLIP, LEVER_X, LEVER_Y, BIAS = range(5)  # columns of the lateral fit


@dataclass(frozen=True)
class LateralFit:
    """Rolling radius and position of the IMU from the lateral specific force."""

    radius: Uncertain   # m
    lever_x: Uncertain  # m, of the IMU ahead of the center of rotation
    lever_y: Uncertain  # m, of the IMU to the left of ``base_link``
    signal: float       # m/s2, spread of the centripetal acceleration
    both_ways: bool     # whether there are turns to the left and to the right


@dataclass(frozen=True)
class PlanarFit:
    """Horizontal specific force over the acceleration of the wheels."""

    factor: complex
    sigma: float    # standard error of the factor
    residual: float  # share of the specific force that is not explained
    lever: tuple[Uncertain, Uncertain]  # m, x and y of the IMU

    @property
    def determined(self) -> bool:
        """Return whether the factor is known."""
        return self.sigma < limits.MAX_SIGMA * abs(self.factor)

    @property
    def angle(self) -> float:
        """Return the angle [rad] of the factor."""
        return cmath.phase(self.factor)


def check_sides(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield that the robot does not drive, or a yaw rate without wheel difference."""
    intervals = _driving(recording)
    if recording.motion is None:
        return
    if intervals is None:
        yield finding('not_driving', 'wheel_states', action='' if recording.live else
                      'record a drive with turns, starts and stops')
    elif intervals.turns and float(np.abs(intervals.difference).max()) < 1e-6:
        yield finding('sides_equal', 'wheel_states')


def check_yaw_rate(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield an effective track that no robot has."""
    fit, robot, intervals = recording.yaw_rate_fit, recording.robot, _driving(recording)
    if fit is None or intervals is None or not intervals.turns or (
            fit.slope.sigma > limits.MAX_SIGMA * fit.slope.value
            or not correlation(fit.yaw_rate, fit.wheel_difference) > limits.MIN_FOLLOWING):
        return
    geometric = robot.track_width / robot.wheel_radius
    ratio = geometric / fit.slope.value  # yaw rate over that of the wheels without slip
    share, error = 1.0 / ratio, limits.SIGMAS * fit.slope.sigma / geometric
    outside = share + error < limits.MIN_TRACK_RATIO or share - error > limits.MAX_TRACK_RATIO
    yield finding('track_outside' if outside else 'track', 'track_width',
                  track=share * robot.track_width, sigma=robot.wheel_radius * fit.slope.sigma,
                  radius=robot.wheel_radius, share=share, width=robot.track_width,
                  least=limits.MIN_TRACK_RATIO, most=limits.MAX_TRACK_RATIO)


def check_radius(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield whether the wheel radius fits the accelerometer."""
    yield from mended_radius(recording)[0]


def mended_radius(recording: CheckedRecording) -> tuple[list[Finding], CheckedRecording]:
    """
    Return a unit or radius that contradicts the accelerometer, and the recording without.

    Also a radius that nobody has given, unless the accelerometer confirms it.
    """
    found, mended = _contradicted_radius(recording)
    known = recording.radius_given or any(
        one.level in (Level.OK, Level.ERROR) for one in found)
    if not known and _driving(recording) is not None:
        found = [finding('radius_assumed', 'wheel_radius',
                         radius=recording.robot.wheel_radius), *found]
    return found, mended


def _contradicted_radius(recording: CheckedRecording) -> tuple[list[Finding], CheckedRecording]:
    data, robot, motion = _driving(recording), recording.robot, recording.motion
    if data is None or motion is None or np.mean(data.mean ** 2) < 0.25 * np.mean(
            data.difference ** 2):
        return [], recording  # mostly turns in place: the wheels' mean is small, slip is not
    found = _radii(recording)
    if not found:
        return [], recording
    value, sigma = weighted_mean(found)  # the scatter includes what neither of them models
    error = value - robot.wheel_radius
    slip = limits.MAX_SLIP * robot.wheel_radius if error < 0.0 else 0.0
    shown: dict[str, Any] = {'value': value, 'sigma': sigma, 'radius': robot.wheel_radius}
    if abs(error) <= max(limits.SIGMAS * sigma, limits.TOLERANCE * robot.wheel_radius) + slip:
        fits = abs(error) - slip < sigma < 0.5 * limits.MAX_SIGMA * abs(value)
        return [finding('radius_fits', 'wheel_radius', **shown)] if fits else [], recording
    if not _radii(recording, one_way=False):
        return [], recording
    if value < 0.0 or not all(abs(weighted_mean(half)[0] - value) < 0.5 * abs(error)
                              for half in map(_radii, _halves(recording)) if half):
        return [], recording  # no radius: the forces have another cause
    units = _units_of(robot.wheel_radius / value, speed_units(robot))
    if units:
        one = finding('speed_unit', 'wheel_states', unit=' or '.join(units), **shown)
    elif error < 0.0 and not data.following > limits.MIN_FOLLOWING:
        return [finding('slips', 'wheel_states', Level.INFO if data.turns else None,
                        share=1.0 - value / robot.wheel_radius, **shown)], recording
    else:
        one = finding('radius', 'wheel_radius', **shown)
    wheels, factor = motion.wheels, value / robot.wheel_radius
    return [one], replace(recording, other_robot=True, mended=replace(motion, wheels=replace(
        wheels, velocity=factor * wheels.velocity,
        position=None if wheels.position is None else factor * wheels.position)))


def _units_of(ratio: float, units: Mapping[str, float]) -> list[str]:
    """Return the units whose factor ``ratio`` is, in spite of slip; the nearest one first."""
    def distance(unit: str) -> float:
        return abs(math.log(ratio / units[unit]))

    near = sorted((unit for unit in units if abs(math.log(units[unit])) > math.log(2.0)
                   and distance(unit) < math.log(1.0 + limits.UNIT_TOLERANCE)), key=distance)
    if not near and ratio > limits.MIN_TICKS_PER_RAD:
        return ['ticks/s']
    return [unit for unit in near if distance(unit) - distance(near[0]) < limits.TOLERANCE]


def check_latency(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield timestamps of the wheels that are later or earlier than configured."""
    fit, robot = recording.yaw_rate_fit, recording.robot
    if fit is None:
        return
    error = fit.latency.value - robot.encoder.latency
    least = limits.MIN_FIRM_FOLLOWING if error < 0.0 else limits.MIN_FOLLOWING
    if not correlation(fit.yaw_rate, fit.wheel_difference) > least:
        return  # on ice the body follows its wheels late
    lag = _turning_lag(recording) if error < 0.0 else 0.0
    tolerance = max(limits.SIGMAS * fit.latency.sigma, limits.MIN_LATENCY_ERROR) + lag
    if abs(error) > tolerance and all(
            half.yaw_rate_fit is not None
            and abs(half.yaw_rate_fit.latency.value - fit.latency.value) < 2.0 * tolerance
            for half in _halves(recording)):
        yield finding('latency', 'encoder.latency', value=fit.latency.value,
                      sigma=fit.latency.sigma, configured=robot.encoder.latency)


def _halves(recording: CheckedRecording) -> Iterator[CheckedRecording]:
    """Yield the recording until and from half of its turns: what is in both is no accident."""
    motion, data = recording.motion, _driving(recording)
    if motion is None or data is None:
        return
    total = np.cumsum(np.abs(data.yaw_rate))
    middle = float(data.time[np.searchsorted(total, 0.5 * total[-1])])
    for first in (True, False):
        yield replace(recording, mended=CalibrationRecording(
            motion.imu.where((motion.imu.time < middle) == first),
            motion.wheels.where((motion.wheels.time < middle) == first)))


def _turning_lag(recording: CheckedRecording) -> float:
    """
    Return by how much [s] the yaw rate follows the wheel difference of a slipping robot.

    The wheels yield a moment C_x W^2 / v per yaw rate that they are ahead of the body, so that it
    follows with the time constant I_z v / (C_x W^2). To the fit this looks like early timestamps.
    """
    robot, intervals = recording.robot, _driving(recording)
    if intervals is None:
        return 0.0
    speed = robot.wheel_radius * float(np.sqrt(np.mean(intervals.mean ** 2)))
    return robot.yaw_inertia * speed / (
        robot.tire.longitudinal_stiffness * robot.track_width ** 2)


def check_imu_position(recording: CheckedRecording) -> Iterator[Finding]:
    """
    Yield a position of the IMU that contradicts the lateral force in turns.

    It is an error if the forward force, in which the yaw acceleration shows y and the squared yaw
    rate x, confirms it, and the other parameters are those of this robot.
    """
    robot, fit, motion = recording.robot, lateral_fit(recording), recording.motion
    if fit is None or motion is None:
        return
    both = planar_fit(motion, robot, 'position of the IMU')
    halves: list[LateralFit | None] | None = None
    known = max(limits.MAX_LEVER_ERROR, limits.SIGMAS * robot.imu.position_sigma)
    for axis, lever, tolerance in ((0, fit.lever_x, max(known, 0.5 * robot.wheelbase)),
                                   (1, fit.lever_y, known)):  # x: of the center of rotation
        if axis == 1 and not fit.both_ways:
            continue  # its force is that of another radius
        configured = robot.imu.position[axis]
        error = abs(lever.value - configured) - tolerance
        if lever.sigma < limits.MAX_LEVER_ERROR and error > limits.SIGMAS * lever.sigma:
            halves = halves or [lateral_fit(half) for half in _halves(recording)]
            able = [half for half in halves if axis == 0 or half and half.both_ways] or halves
            if not all(half and abs((half.lever_x, half.lever_y)[axis].value - lever.value) < error
                       for half in able):
                continue
            other = both and both.lever[axis]
            side = math.copysign(1.0, lever.value - configured)
            confirmed = other and not recording.other_robot and side * (
                other.value - configured) > tolerance + limits.SIGMAS * other.sigma
            yield finding('lever_arm', 'imu.position', Level.ERROR if confirmed else None,
                          axis='xy'[axis], value=lever.value, sigma=lever.sigma,
                          configured=configured)


def lateral_fit(recording: CheckedRecording) -> LateralFit | None:
    """Return radius and lever arms from the lateral force; None without turns."""
    robot, late = recording.robot, recording.yaw_rate_fit
    data = _driving(recording, robot.encoder.latency if late is None else late.latency.value)
    if data is None or not data.turns:
        return None
    W, slip = data.yaw_rate, side_slip(data.mean, 0.5 * np.abs(data.difference))
    matrix = np.column_stack([W * data.mean, -W * slip * robot.wheel_radius, data.yaw_acceleration,
                              -W ** 2, np.ones(len(W))])
    rows = Rows(data.time, matrix, data.lateral, np.zeros(len(W)))
    lost = PRIORS['share of side slip lost in turns']
    fit = regression(rows, Prior.of(None, lost.prior, None, None, None),
                     Errors(rows.lags(limits.CORRELATION_TIME)))
    radius = fit.estimate(RADIUS)
    return LateralFit(
        Uncertain(radius.value, math.hypot(
            radius.sigma, PRIORS['acceleration on straight lines'].sigma * radius.value)),
        fit.estimate(LEVER_X), fit.estimate(LEVER_Y),
        float(np.std(matrix[:, RADIUS] * radius.value)),
        min(_share(W > 0.0, W), _share(W < 0.0, W)) > limits.MIN_TURN_SHARE)


def planar_fit(motion: CalibrationRecording, robot: RobotParams,
               position: str = 'lateral effects of the squared yaw rate') -> PlanarFit | None:
    """
    Return the regression of the horizontal force; None if nothing moves.

    ``position`` is the name of the prior of the position of the IMU in ``PRIORS``.
    """
    found = force_intervals(motion, robot)
    if found is None:
        return None
    time, sides, W, change, force = found
    speed = robot.wheel_radius * sides.mean(axis=1)
    forward, lateral = np.gradient(speed, time), W * speed
    one, none = np.ones(len(time)), np.zeros(len(time))
    rows = np.vstack([  # factor, lever arm of the IMU, bias
        np.column_stack([forward, -lateral, -W ** 2, -change, one, none]),
        np.column_stack([lateral, forward, change, -W ** 2, none, one])])
    both = Rows(np.concatenate([time, time]), rows, force.T.ravel(), np.zeros(2 * len(time)))
    lever = PRIORS[position].prior
    fit = regression(both, Prior.of(None, None, lever, lever, None, None), Errors(
        max(1, round(limits.CORRELATION_TIME / float(np.median(np.diff(time))))),
        instant=np.tile(np.arange(len(time)), 2)))
    (p, sigma_p), (q, sigma_q) = fit.estimate(0), fit.estimate(1)
    signal = both.target - rows[:, 4:] @ fit.values[4:]
    return PlanarFit(complex(p, q), math.hypot(sigma_p, sigma_q),
                     float(np.sum(fit.residuals ** 2) / max(np.sum(signal ** 2), 1e-12)),
                     (fit.estimate(2), fit.estimate(3)))


def force_intervals(motion: CalibrationRecording, robot: RobotParams
                    ) -> tuple[Array, Array, Array, Array, Array] | None:
    """Return time (n,), wheel speeds (n, 2), yaw rate, its change, force (n, 2); None if few."""
    try:
        found = moving_intervals(motion, robot, margin=INTERVAL, least=INTERVAL)
    except EstimatorError:
        return None
    if len(found.end) < limits.MIN_READINGS:
        return None
    imu = motion.imu
    rate, change = yaw_motion(Signal(imu.time, imu.rate[:, 2]), found.begin, found.end)
    force = np.stack([Signal(imu.time, imu.force[:, i]).mean(found.begin, found.end)
                      for i in range(2)], axis=1)
    return found.center, found.sides, rate, change, force


def _share(selected: Mask, values: Array) -> float:
    """Return the share of ``selected`` values in the sum of squares."""
    return float(np.sum(values[selected] ** 2) / np.sum(values ** 2))


def correlation(first: Array, second: Array) -> float:
    """Return the correlation coefficient; NaN if one of both is constant."""
    with np.errstate(invalid='ignore', divide='ignore'):
        return float(np.corrcoef(first, second)[0, 1])


def _radii(recording: CheckedRecording, *, one_way: bool = True) -> list[Uncertain]:
    """
    Return the rolling radii [m] that turns and changes of the speed determine.

    In turns in one direction the force may be that of a bias or of another place of the IMU.
    """
    found, turns = [], lateral_fit(recording)
    if turns is not None and (one_way or turns.both_ways):
        found.append((turns.radius, turns.signal))
    try:
        assert recording.motion is not None  # the robot drives
        changes = fit_speed_changes(recording.motion, recording.robot)
        found.append((changes.radius, float(np.std(changes.rolled))))
    except EstimatorError:
        pass  # no changes of speed
    return [radius for radius, signal in found
            if radius.sigma < limits.MAX_SIGMA * abs(radius.value) and signal > limits.MIN_SIGNAL]


@dataclass(frozen=True)
class _Intervals:
    """Means over intervals near motion."""

    time: Array              # (n,) s
    mean: Array              # (n,) rad/s, of all wheels
    difference: Array        # (n,) rad/s, right minus left
    yaw_rate: Array          # (n,) rad/s
    yaw_acceleration: Array  # (n,) rad/s2
    lateral: Array           # (n,) m/s2

    @property
    def turns(self) -> bool:
        """Return whether the robot turns."""
        return float(np.sqrt(np.mean(self.yaw_rate ** 2))) >= limits.MIN_YAW_RATE

    @property
    def following(self) -> float:
        """Return the correlation of yaw rate and wheel difference."""
        return correlation(self.yaw_rate, self.difference)


def _driving(recording: CheckedRecording, latency: float = 0.0) -> _Intervals | None:
    """Return the intervals in which the robot drives, None if it does not."""
    if recording.motion is None:
        return None
    imu = recording.motion.imu
    try:
        found = moving_intervals(recording.motion, recording.robot)
    except EstimatorError:
        return None
    begin, end, sides = found.begin - latency, found.end - latency, found.sides
    rate, acceleration = yaw_motion(Signal(imu.time, imu.rate[:, 2]), begin, end)
    force = Signal(imu.time, imu.force[:, 1])
    return _Intervals(0.5 * (begin + end), sides.mean(axis=1), sides[:, 1] - sides[:, 0],
                      rate, acceleration, force.mean(begin, end))
