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
Wrong units, axes and signs of IMU and wheels, and the recording without them.

An error has consequences all over a recording. So each one that is found is mended before the next
one is looked for: the checks after these see what the recording would be without it, and report no
consequences. Two comparisons over intervals near motion distinguish them:

- the yaw rate of the gyro with difference and mean of the sides: signs of the sides, unit;
- the horizontal specific force with the acceleration ``r du/dt + i W r u`` of the wheels, as
  complex numbers: the magnitude of the factor is the unit, its angle the direction of the IMU.
  With the opposite yaw rate W it fits as well only if there are no turns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
import itertools
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import (
    CalibrationRecording, ImuRecord, Indices, WheelRecord)
from smart_tire.checks import limits
from smart_tire.checks.messages import clock_differences
from smart_tire.checks.motion import correlation, force_intervals, planar_fit
from smart_tire.checks.recording import CheckedRecording, finding
from smart_tire.checks.sensors import (
    exchanges, gravity_of, opposite_pairs, PARTNERS, stuck_wheels, velocity_ratio, wheel_units)
from smart_tire.findings import Finding
from smart_tire.numerics.least_squares import Errors, Prior, regression, Rows
from smart_tire.parameters import RobotParams
from smart_tire.rotation import angles, matrix
from smart_tire.samples import LEFT, RIGHT, WHEELS

GYRO_UNITS = {'rad/s': 1.0, 'rpm': 30.0 / math.pi, 'deg/s': 180.0 / math.pi}  # per rad/s
UPRIGHT = {'+x': (0.0, -90.0, 0.0), '-x': (0.0, 90.0, 0.0), '+y': (90.0, 0.0, 0.0),
           '-y': (-90.0, 0.0, 0.0), '-z': (180.0, 0.0, 0.0)}  # degrees that turn an axis to +z


@dataclass(frozen=True)
class Sides:
    """Yaw rate of the gyro against the speeds of the sides."""

    ratio: float         # magnitude over the yaw rate of the wheels without slip
    difference: float    # correlation with right minus left; NaN if one of both is constant
    mean: float          # correlation with the mean of both sides
    turning: float       # rad/s, rms of the yaw rate
    opposite: bool       # the sides turn in opposite directions, but the robot does not


def check_causes(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield wrong units, axes and signs."""
    yield from mended(recording)[0]


def mended(recording: CheckedRecording) -> tuple[list[Finding], CheckedRecording]:
    """Return the wrong units, axes and signs, and ``recording`` without them."""
    found, motion = list[Finding](), recording.motion
    gravity, axes, unit = gravity_of(recording), np.eye(3), 1.0
    if gravity is not None:
        axes = matrix(*np.radians(UPRIGHT.get(gravity.axis, (0.0, 0.0, 0.0))))
        unit = gravity.factor
    if motion is not None:
        robot = recording.robot
        late = clock_differences(recording)
        imu = ImuRecord(motion.imu.time + late.get('imu/data', 0.0), motion.imu.rate @ axes.T,
                        motion.imu.force @ axes.T / unit)
        wheels = replace(motion.wheels, time=motion.wheels.time + late.get('wheel_states', 0.0))
        motion = replace(motion, imu=imu, wheels=wheels)
        found, motion, yaw = _explained(motion, robot)
        axes = matrix(0.0, 0.0, yaw) @ axes
    rotation = [round(float(angle), 3) + 0.0 for angle in angles(
        axes @ matrix(*recording.robot.imu.rotation))]
    if gravity is not None:
        found[:0] = gravity.findings(recording.imu.name, rotation)
    if not np.allclose(axes, np.eye(3)) and (gravity is None or gravity.axis not in UPRIGHT):
        angle = math.degrees(math.atan2(axes[1, 0], axes[0, 0]))
        found.append(finding(
            'turned', recording.imu.name, angle=round(angle), rotation=rotation,
            other=', or swap both sides and their signs' if abs(angle) > 135.0 else ''))
    return found, replace(recording, mended=motion)


Mended = tuple[list[Finding], CalibrationRecording]


def _scaled(motion: CalibrationRecording, factors: Array | float,
            order: Indices | None = None) -> CalibrationRecording:
    """Return the recording with wheel speeds and positions times ``factors``."""
    wheels, rows = motion.wheels, np.arange(len(WHEELS)) if order is None else order
    position = None if wheels.position is None else wheels.position[:, rows] * factors
    return replace(motion, wheels=WheelRecord(
        wheels.time, wheels.velocity[:, rows] * factors, position, wheels.torque))


def _explained(motion: CalibrationRecording, robot: RobotParams
               ) -> tuple[list[Finding], CalibrationRecording, float]:
    """
    Return the findings, the recording without them, and the yaw [rad] by which the IMU is turned.

    Which wheels are of one side, and which one of two turns backwards, is decided by what leaves
    the least to explain.
    """
    stuck, motion = _stuck(motion, robot)
    best: tuple[int, list[Finding], CalibrationRecording, float] | None = None
    for wheels, changed in _wheel_hypotheses(motion, robot):
        found, mended = [*stuck, *wheels], changed
        for step in (_wheel_scale, _velocity_unit, _side_scale, _reversed_side, _gyro_unit,
                     _yaw_sign):
            one, mended = step(mended, robot)
            found += one
        yaw, mended = _mounting(mended, robot)
        count = len(found) + (yaw != 0.0)
        if best is None or count < best[0]:
            best = count, found, mended, yaw
    assert best is not None  # there is at least the recording as it is
    return best[1:]


def _stuck(motion: CalibrationRecording, robot: RobotParams) -> Mended:
    """Mend wheels that stand still while their partner turns."""
    order, found = np.arange(len(WHEELS)), []
    for wheel, other in stuck_wheels(motion.wheels.velocity):
        order[wheel] = other
        found.append(finding('wheel_stuck', f'wheel_states of {WHEELS[wheel]}',
                             other=WHEELS[other]))
    return found, _scaled(motion, 1.0, order) if found else motion


def _wheel_hypotheses(motion: CalibrationRecording, robot: RobotParams) -> Iterator[Mended]:
    """Yield exchanged and reversed wheels, and the recording without them; the likeliest first."""
    for exchanged in exchanges(motion.wheels.velocity):
        order, found = np.arange(len(WHEELS)), []
        if exchanged is not None:
            one, other = exchanged
            order[[one, other]] = other, one
            found = [finding('wheels_exchanged', 'wheel_states', one=WHEELS[one],
                             other=WHEELS[other])]
        moved = _scaled(motion, 1.0, order) if found else motion
        pairs = list(opposite_pairs(moved.wheels.velocity))
        for reversed_wheels in itertools.product(*pairs):
            factors = np.ones(len(WHEELS))
            factors[list(reversed_wheels)] = -1.0
            yield [*found, *(finding(
                'wheel_reversed', f'wheel_states of {WHEELS[wheel]}', other=WHEELS[
                    pair[pair[0] == wheel]]) for wheel, pair in zip(reversed_wheels, pairs))], (
                _scaled(moved, factors) if pairs else moved)


def _velocity_unit(motion: CalibrationRecording, robot: RobotParams) -> Mended:
    """Mend velocities that are not the rate of change of the positions."""
    wheels, ratio = motion.wheels, velocity_ratio(motion.wheels)
    if ratio == 1.0 or wheels.position is None:
        return [], motion
    fit = planar_fit(motion, robot)  # with the speeds by the positions
    units = wheel_units(ratio, robot, 1.0 / math.copysign(abs(fit.factor), fit.factor.real)
                        if fit is not None and fit.determined else None)
    return [finding('velocity_unit', 'wheel_states', ratio=ratio, unit=units.text)], replace(
        motion, wheels=replace(wheels, velocity=wheels.velocity / units.velocity,
                               position=wheels.position / units.position))


def _wheel_scale(motion: CalibrationRecording, robot: RobotParams) -> Mended:
    """Mend a wheel that always turns a factor faster or slower than the other one of its side."""
    speed = np.abs(motion.wheels.velocity)
    moving = speed.min(axis=1) > limits.MIN_SPEED
    if moving.sum() < limits.MIN_READINGS:
        return [], motion
    found, factors = [], np.ones(len(WHEELS))
    for pair in PARTNERS:
        ratios = np.log(speed[moving][:, pair[0]] / speed[moving][:, pair[1]])
        low, middle, high = np.quantile(ratios, (0.25, 0.5, 0.75))
        if abs(middle) < math.log(limits.SCALE_RATIO) or high - low > limits.TOLERANCE:
            continue
        others = float(np.median(speed[moving][:, [k for k in range(4) if k not in pair]]))
        own = np.median(speed[moving][:, list(pair)], axis=0)
        wrong = int(np.abs(np.log(own / others)).argmax())
        wheel, other = pair[wrong], pair[1 - wrong]
        factors[wheel] = own[1 - wrong] / own[wrong]
        found.append(finding('wheel_scale', f'wheel_states of {WHEELS[wheel]}',
                             ratio=1.0 / factors[wheel], other=WHEELS[other]))
    return (found, _scaled(motion, factors)) if len(found) == 1 else ([], motion)


def _side_scale(motion: CalibrationRecording, robot: RobotParams) -> Mended:
    """Mend a side that counts a factor more than the other one: straight ahead, too."""
    found = force_intervals(motion, robot)
    if found is None:
        return [], motion
    time, sides, yaw_rate, _, _ = found
    rows = Rows(time, np.column_stack([sides, np.ones(len(time))]), yaw_rate, np.zeros(len(time)))
    fit = regression(rows, Prior.of(None, None, (0.0, robot.imu.gyro_bias)), Errors(
        rows.lags(limits.CORRELATION_TIME)))
    left, right = fit.estimate(0), fit.estimate(1)
    if (left.value * right.value >= 0.0
            or max(abs(one.sigma / one.value) for one in (left, right)) > limits.TOLERANCE
            or correlation(yaw_rate, yaw_rate - fit.residuals) < limits.MIN_FOLLOWING):
        return [], motion
    ratio = abs(left.value / right.value)  # right speeds over those of the left side
    if abs(math.log(ratio)) < math.log(limits.SCALE_RATIO):
        return [], motion
    options = [('right', _signs('right', 1.0 / ratio)), ('left', _signs('left', ratio))]

    def unit_error(option: tuple[str, Array]) -> float:
        one = planar_fit(_scaled(motion, option[1]), robot)
        return math.inf if one is None else abs(math.log(abs(one.factor)))
    side, factors = min(options, key=unit_error)
    return [finding('side_scale', 'wheel_states', side=side,
                    ratio=ratio if side == 'right' else 1.0 / ratio)], _scaled(motion, factors)


def _reversed_side(motion: CalibrationRecording, robot: RobotParams) -> Mended:
    """Mend one side that is reversed: the yaw rate follows the sum of the sides."""
    sides = sides_of(motion, robot)
    if sides is None or not (sides.opposite or sides.turning > limits.MIN_YAW_RATE
                             and abs(sides.mean) > limits.CLEAR_CORRELATION
                             and abs(sides.difference) < limits.MIN_CORRELATION):
        return [], motion
    right = sides.mean < 0.0
    if sides.opposite:  # no turns: the side that makes the forward force follow
        factors = _signs('right')
        fit = planar_fit(_scaled(motion, factors), robot)
        if fit is None or not fit.determined:
            return [], motion
        right = abs(fit.angle) < 0.5 * math.pi
    side = 'right' if right else 'left'
    return [finding('side_reversed', 'wheel_states', side=side)], _scaled(motion, _signs(side))


def _signs(side: str, factor: float = -1.0) -> Array:
    signs = np.ones(len(WHEELS))
    signs[list(RIGHT if side == 'right' else LEFT)] = factor
    return signs


def _gyro_unit(motion: CalibrationRecording, robot: RobotParams) -> Mended:
    """
    Mend a gyro in deg/s or rpm.

    It multiplies the yaw rate over that of the wheels, and divides the lateral force over that of
    gyro and wheels: a wrong unit of the wheels multiplies both.
    """
    sides, fit = sides_of(motion, robot), planar_fit(motion, robot)
    if sides is None or not abs(sides.difference) > limits.MIN_CORRELATION:
        return [], motion
    ratio = sides.ratio
    factor = math.sqrt(ratio / abs(fit.factor)) if fit is not None and fit.determined else ratio
    unit = min(GYRO_UNITS, key=lambda one: abs(math.log(max(factor, 1e-9) / GYRO_UNITS[one])))
    if unit == 'rad/s':
        return [], motion
    imu = replace(motion.imu, rate=motion.imu.rate / GYRO_UNITS[unit])
    return [finding('gyro_unit', 'imu/data', ratio=ratio, unit=unit, factor=GYRO_UNITS[unit])
            ], replace(motion, imu=imu)


def _yaw_sign(motion: CalibrationRecording, robot: RobotParams) -> Mended:
    """Mend a yaw rate of the opposite sign: swapped sides, reversed wheels, reversed gyro."""
    sides = sides_of(motion, robot)
    if sides is None or not sides.difference < -limits.MIN_CORRELATION:
        return [], motion
    reversed_gyro = replace(motion, imu=replace(
        motion.imu, rate=motion.imu.rate * np.array([1.0, 1.0, -1.0])))
    swapped = _scaled(motion, 1.0, np.array([1, 0, 3, 2]))
    fit, other = planar_fit(motion, robot), planar_fit(reversed_gyro, robot)
    if fit is None or other is None:
        return [finding('yaw_sign', 'imu/data')], swapped
    if other.residual < limits.CLEAR_RESIDUAL * fit.residual:
        return [finding('gyro_sign', 'imu/data')], reversed_gyro
    if fit.determined and abs(fit.angle) > 0.75 * math.pi:
        return [finding('all_reversed', 'wheel_states')], _scaled(motion, -1.0)
    if fit.residual < limits.CLEAR_RESIDUAL * other.residual:
        return [finding('sides_swapped', 'wheel_states')], swapped
    return [finding('yaw_sign', 'imu/data')], swapped


def _mounting(motion: CalibrationRecording,
              robot: RobotParams) -> tuple[float, CalibrationRecording]:
    """Return the yaw [rad] by which the IMU is turned, 0 unless it is clear, and mend it."""
    sides, fit = sides_of(motion, robot), planar_fit(motion, robot)
    if sides is None or fit is None or not fit.determined or abs(fit.angle) < max(
            limits.MAX_YAW, limits.SIGMAS * fit.sigma / abs(fit.factor)):
        return 0.0, motion
    if not (sides.difference > limits.MIN_FOLLOWING or sides.turning < limits.MIN_YAW_RATE):
        return 0.0, motion  # on slippery ground the body moves sideways
    quarter = 0.5 * math.pi * round(fit.angle / (0.5 * math.pi))
    yaw = -(quarter if abs(fit.angle - quarter) < limits.MAX_TILT else fit.angle)
    turn = matrix(0.0, 0.0, yaw)
    return yaw, replace(motion, imu=replace(
        motion.imu, rate=motion.imu.rate @ turn.T, force=motion.imu.force @ turn.T))


def sides_of(motion: CalibrationRecording, robot: RobotParams) -> Sides | None:
    """Return how the yaw rate follows the wheels; None if nothing moves."""
    found = force_intervals(motion, robot)
    if found is None:
        return None
    _, sides, yaw_rate, _, _ = found
    difference = (sides[:, 1] - sides[:, 0]) * robot.wheel_radius / robot.track_width
    turning, wheels = (float(np.sqrt(np.mean(one ** 2))) for one in (yaw_rate, difference))
    follows = correlation(yaw_rate, difference)
    return Sides(abs(follows) * float(np.std(yaw_rate)) / max(float(np.std(difference)), 1e-9),
                 follows, correlation(yaw_rate, sides.sum(axis=1)), turning,
                 correlation(*sides.T) < -limits.MIN_CORRELATION
                 and turning < limits.NO_TURN * wheels)
