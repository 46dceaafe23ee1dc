# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Checks of IMU and wheels on their own, and of the stiffness of the tire for its load."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import itertools
import math
from typing import Any

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import WheelRecord
from smart_tire.checks import limits
from smart_tire.checks.recording import CheckedRecording, finding
from smart_tire.checks.stalls import Mask, runs
from smart_tire.findings import Finding, Level
from smart_tire.models.tire.brush_tire import critical_slip
from smart_tire.parameters import RobotParams
from smart_tire.rotation import matrix
from smart_tire.samples import GRAVITY, LEFT, NS_PER_S, RIGHT

# Scale errors of accelerometers hide the 2 % between mg and cm/s2.
FORCE_UNITS = {'g': 1.0 / GRAVITY, 'cm/s2 or mg': 101.0, 'ft/s2': 1.0 / 0.3048}
SPEED_UNITS = {'rpm': 60.0 / math.tau, 'deg/s': 180.0 / math.pi, 'revolutions/s': 1.0 / math.tau}
ANGLE_UNITS = {'degrees': 180.0 / math.pi, 'revolutions': 1.0 / math.tau}
PARTNERS = ((0, 2), (1, 3))  # front and rear wheel of a side
# Wheels that agree if two are exchanged: one of these pairs
EXCHANGES = {((0, 3), (1, 2)): ((0, 1), (2, 3)), ((0, 1), (2, 3)): ((1, 2), (0, 3))}
MIN_TICKS = 30.0  # per revolution, of positions that are not in rad


@dataclass(frozen=True)
class Gravity:
    """Mean specific force, at standstill if there is any."""

    up: Array     # (3,) direction in axes of ``base_link``
    size: float   # in the unit of the recording
    unit: str     # '' if it is m/s2
    when: str

    @property
    def factor(self) -> float:
        """Return the unit of the recording per m/s2; also of one without a name."""
        if self.unit or self.size < limits.REMOVED_GRAVITY * GRAVITY or abs(
                self.size / GRAVITY - 1.0) < limits.TOLERANCE:
            return FORCE_UNITS.get(self.unit, 1.0)
        return self.size / GRAVITY

    @property
    def removed(self) -> bool:
        """Return whether this is a specific force without gravity."""
        return self.size / self.factor < limits.REMOVED_GRAVITY * GRAVITY

    @property
    def axis(self) -> str:
        """Return the axis that points up, such as '+z'; '' without gravity."""
        axis = int(np.argmax(np.abs(self.up)))
        return '' if self.removed else ('-' if self.up[axis] < 0.0 else '+') + 'xyz'[axis]

    def findings(self, name: str, rotation: Sequence[float]) -> Iterator[Finding]:
        """Yield a wrong unit, size or direction; the right one is ``rotation`` of the IMU."""
        values: dict[str, Any] = {'size': self.size, 'when': self.when, 'gravity': GRAVITY}
        if self.removed:
            yield finding('gravity_removed', name, **values)
            return
        if self.unit:
            yield finding('gravity_unit', name, unit=self.unit, **values)
        elif abs(self.size / GRAVITY - 1.0) > limits.GRAVITY_TOLERANCE:
            yield finding('gravity_size', name,
                          Level.ERROR if self.factor != 1.0 else None, **values)
        tilt = math.degrees(math.acos(min(1.0, max(-1.0, float(self.up[2])))))
        limit = math.degrees(limits.MAX_TILT)
        kind = ('upside_down' if self.axis == '-z' else 'gravity_axis' if self.axis != '+z'
                else 'tilt' if tilt > limit else 'gravity')
        if kind != 'gravity' or not self.unit:
            yield finding(kind, name, axis=self.axis, tilt=tilt, limit=limit,
                          rotation=list(rotation), **values)


def frozen(recording: CheckedRecording, field: str) -> tuple[Mask, list[tuple[float, float]]]:
    """
    Return a mask of the samples of the IMU in which it is stuck; begins and durations [s] of that.

    ``field`` is that of the samples. A simulator without noise also repeats its values, but not
    while the wheels change their speeds.
    """
    imu, wheels, robot = recording.imu.ordered, recording.wheels.ordered, recording.robot
    mask, found = np.zeros(len(imu), bool), list[tuple[float, float]]()
    if recording.invalid_stamps or min(len(imu), len(wheels)) < limits.MIN_READINGS:
        return mask, found
    speeds = robot.wheel_radius * np.nan_to_num(wheels['velocity'])
    left, right = speeds[:, LEFT].mean(axis=1), speeds[:, RIGHT].mean(axis=1)
    motion, limit = ((right - left) / robot.track_width, limits.FROZEN_YAW_RATE) if (
        field == 'rate') else (0.5 * (left + right), limits.FROZEN_SPEED)
    for begin, end in zip(*runs((np.diff(imu[field], axis=0) == 0.0).all(axis=1))):
        first, last = imu.stamp_ns[begin], imu.stamp_ns[end]
        rows = (wheels.stamp_ns >= first) & (wheels.stamp_ns <= last)
        inside, time = motion[rows], (wheels.stamp_ns[rows] - first) / NS_PER_S
        if field == 'acceleration' and len(inside) > 2:  # a constant one is a ramp of the speed
            inside = inside - np.polyval(np.polyfit(time, inside, 1), time)
        if last - first > limits.MIN_FROZEN_TIME * NS_PER_S and len(inside) > 1 and (
                np.ptp(inside) > limit):
            mask[begin:end + 1] = True
            found.append(((first - recording.origin_ns) / NS_PER_S, (last - first) / NS_PER_S))
    return mask, found


def check_constant(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield an IMU that repeats its values while the wheels change their speeds."""
    seen = []
    for field, name in (('rate', 'angular_velocity'), ('acceleration', 'linear_acceleration')):
        if found := frozen(recording, field)[1]:
            first, duration = found[0]
            seen.append((name, first, duration))
    if seen:
        yield finding('constant', recording.imu.name, field=' and '.join(
            name for name, *_ in seen), first=seen[0][1], duration=max(one[2] for one in seen))


def check_saturated(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield a gyro at the end of its range: it follows the wheels only below that."""
    motion, robot = recording.motion, recording.robot
    if motion is None or frozen(recording, 'rate')[1]:
        return
    rate, wheels = motion.imu.rate[:, 2], motion.wheels
    largest = float(np.abs(rate).max())
    begin, end = runs(np.abs(rate) == largest)
    long = end - begin >= limits.MIN_PINNED
    pinned = np.zeros(len(rate), bool)
    for first, last in zip(begin[long], end[long]):
        pinned[first:last] = True
    turning = robot.wheel_radius / robot.track_width * np.abs(np.interp(
        motion.imu.time, wheels.time, wheels.velocity[:, RIGHT].mean(axis=1)
        - wheels.velocity[:, LEFT].mean(axis=1)))
    free = ~pinned & (turning > limits.MIN_YAW_RATE) & (np.abs(rate) < 0.9 * largest)
    if min(pinned.sum(), free.sum()) < limits.MIN_READINGS:
        return
    below, at = (float(np.median(np.abs(rate[one]) / np.maximum(turning[one], 1e-9)))
                 for one in (free, pinned))
    if at < limits.SATURATED_SHARE * below:
        yield finding('saturated', recording.imu.name, value=largest,
                      share=float(pinned.mean()))


def gravity_of(recording: CheckedRecording) -> Gravity | None:
    """Return size and direction of the mean specific force; None for few samples."""
    imu = recording.imu
    if len(imu.ordered) < limits.MIN_READINGS or not imu['acceleration'].any():
        return None
    force = imu.ordered['acceleration'] @ matrix(*recording.robot.imu.rotation).T
    still = recording.stationary
    rests = still.sum() >= limits.MIN_READINGS
    mean = np.median(force[still] if rests else force, axis=0)
    size = float(np.linalg.norm(mean))
    return Gravity(mean / max(size, 1e-9), size,
                   unit_of(size / GRAVITY, FORCE_UNITS, limits.TOLERANCE),
                   'at rest' if rests else 'in the median')


def check_gyro_bias(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield a gyro that turns while the wheels stand still."""
    still, configured = recording.stationary, recording.robot.imu.gyro_bias
    if recording.motion is None:
        return
    still = still & ~frozen(recording, 'rate')[0]
    if still.sum() < limits.MIN_READINGS:
        return
    largest = float(np.abs(np.median(recording.motion.imu.rate[still], axis=0)).max())
    if largest > limits.BIAS_SIGMAS * configured:
        yield finding('gyro_bias', recording.imu.name, largest=largest, configured=configured)


def stuck_wheels(velocity: Array) -> Iterator[tuple[int, int]]:
    """Yield the wheels that stand still while the other one of their side turns, and this."""
    for wheel, other in (*PARTNERS, *(pair[::-1] for pair in PARTNERS)):
        moving = np.abs(velocity[:, other]) > limits.MIN_SPEED
        if moving.sum() >= limits.MIN_READINGS and (
                np.abs(velocity[moving, wheel])
                < limits.STUCK_SHARE * np.abs(velocity[moving, other])).mean() > 0.5:
            yield wheel, other


def exchanges(velocity: Array) -> Sequence[tuple[int, int] | None]:
    """
    Return which two wheels may be exchanged, None if the wheels of each side agree.

    Two wheels agree if their speeds differ little, whatever their signs.
    """
    moving = velocity[np.abs(velocity).max(axis=1) > limits.MIN_SPEED]
    if len(moving) < limits.MIN_READINGS:
        return [None]

    def spread(pairs: Sequence[tuple[int, int]]) -> float:
        return sum(min(float(np.mean((moving[:, i] - sign * moving[:, k]) ** 2))
                       for sign in (1.0, -1.0)) for i, k in pairs)

    own, other = spread(PARTNERS), {
        EXCHANGES[pairs]: spread(pairs) for pairs in EXCHANGES}
    best = min(other, key=other.__getitem__)
    if max(other[best], limits.STUCK_SHARE * float(np.mean(moving ** 2))) > (
            limits.EXCHANGED_SHARE ** 2 * own):
        return [None]
    return best


def opposite_pairs(velocity: Array) -> Iterator[tuple[int, int]]:
    """Yield rear and front wheel of a side that turn in opposite directions."""
    for front, rear in PARTNERS:
        moving = np.abs(velocity[:, [front, rear]]).min(axis=1) > limits.MIN_SPEED
        if moving.sum() >= limits.MIN_READINGS and np.median(
                np.sign(velocity[moving, front] * velocity[moving, rear])) < 0.0:
            yield rear, front


def check_motion(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield an IMU that moves while the wheels never turn, or does not while they do."""
    motion, still = recording.motion, recording.stationary
    if motion is None:
        return
    rate, force = motion.imu.rate[:, 2], motion.imu.force
    speed = motion.wheels.velocity
    recorded = recording.wheels.ordered['velocity']  # another unit or radius scales them
    if max(np.abs(speed).max(), np.abs(recorded).max()) < limits.MIN_SPEED:
        if (turning := float(np.std(rate))) > limits.MIN_CARRIED_RATE:
            yield finding('wheels_still', 'wheel_states', turning=turning)
        return
    if min(still.sum(), (~still).sum()) < limits.MIN_READINGS:
        return
    measured = np.column_stack([rate, force])
    rest, moved = (np.std(measured[mask], axis=0) for mask in (still, ~still))
    expected = float(np.std(speed[:, RIGHT].mean(axis=1) - speed[:, LEFT].mean(axis=1))
                     ) * recording.robot.wheel_radius / recording.robot.track_width
    if (rest > 0.0).any() and (moved <= limits.MAX_STILL_FACTOR * rest).all() and (
            expected > max(limits.MIN_CARRIED_RATE, 10.0 * moved[0])):
        yield finding('imu_still', recording.imu.name, expected=expected, turning=moved[0])


def velocity_ratio(wheels: WheelRecord) -> float:
    """Return velocity over the rate of change of the positions, 1 if they agree or are unknown."""
    if wheels.position is None or len(wheels.time) < limits.MIN_READINGS:
        return 1.0
    steps = np.diff(wheels.time)
    usable = steps < 1.5 * float(np.median(steps))
    rate = (np.diff(wheels.position, axis=0) / steps[:, None])[usable]
    velocity = wheels.velocity[1:][usable]
    moving = np.abs(rate) > 0.1 * np.quantile(np.abs(rate), 0.95) if len(rate) else rate > 0.0
    if moving.sum() < limits.MIN_READINGS:
        return 1.0
    ratio = float(np.median(velocity[moving] / rate[moving]))
    return 1.0 if abs(ratio - 1.0) <= limits.TOLERANCE else ratio


@dataclass(frozen=True)
class WheelUnits:
    """Units of velocities and positions, per rad/s and per rad; text is '' if none is known."""

    velocity: float
    position: float
    text: str = ''


def wheel_units(ratio: float, robot: RobotParams, angle: float | None) -> WheelUnits:
    """
    Return the units of wheels whose velocity is ``ratio`` times the rate of their positions.

    ``angle`` is the unit of the positions per rad by the IMU, negative if they are reversed, None
    if it is unknown.

    >>> wheel_units(60.0, RobotParams(), None).text
    ': velocities in rpm, positions in revolutions?'
    >>> wheel_units(math.tau / 2048, RobotParams(), 1.0).text
    ': positions in ticks, 2048 per revolution?'
    """
    size = abs(ratio)
    best = min(_unit_pairs(size, robot, angle is not None), key=lambda one: (
        angle is not None and abs(math.log(abs(angle) / one[1].position)) > math.log(2.0),
        *one[0]), default=(0, WheelUnits(1.0, 1.0 / size)))[1]
    if ratio > 0.0:
        return best
    wrong = 'positions' if angle is None or angle < 0.0 else 'velocities'
    text = f'{best.text[:-1] if best.text else ":"} {wrong} of the opposite sign?'
    return (replace(best, velocity=-best.velocity, text=text) if wrong == 'velocities' else
            replace(best, position=-best.position, text=text))


def _unit_pairs(ratio: float, robot: RobotParams, verified: bool
                ) -> Iterator[tuple[tuple[int, bool, float], WheelUnits]]:
    """Yield pairs of units with this ratio, before each what the best one has the least of."""
    if abs(ratio - 1.0) <= limits.TOLERANCE:
        yield (0, False, 0.0), WheelUnits(1.0, 1.0)
    for (speed, velocity), (angle, position) in itertools.product(
            {'': 1.0, **speed_units(robot)}.items(),
            {'': 1.0, **ANGLE_UNITS, 'm': robot.wheel_radius}.items()):
        error = abs(math.log(ratio * position / velocity))
        one = not speed or not angle or (speed, angle) == ('rpm', 'revolutions')
        exact = error > limits.RATIO_TOLERANCE
        if error < limits.TOLERANCE and (speed or angle) and (
                not exact or not speed or not angle or angle == 'm' or speed == 'm/s'):
            names = [f'{what} in {unit}' for what, unit in (
                ('velocities', speed), ('positions', angle)) if unit]
            yield (0 if one else 1 if verified else 3, exact, error), WheelUnits(
                velocity, position, f': {", ".join(names)}?')
    for ticks, units, text in (
            (math.tau / ratio, (1.0, 1.0 / ratio), 'positions in ticks'),
            (math.tau * ratio, (ratio, 1.0), 'velocities in ticks/s')):
        if ticks > MIN_TICKS:
            yield (2, False, 0.0), WheelUnits(*units, f': {text}, {ticks:.0f} per revolution?')


def speed_units(robot: RobotParams) -> Mapping[str, float]:
    """Return units of wheel speeds per rad/s."""
    return {**SPEED_UNITS, 'm/s': robot.wheel_radius}


def unit_of(ratio: float, units: Mapping[str, float], tolerance: float) -> str:
    """Return the unit whose factor ``ratio`` is, '' if there is none."""
    return next((unit for unit, factor in units.items()
                 if abs(ratio / factor - 1.0) < tolerance), '')


def check_torques(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield motor torques that brake in the mean, or that exceed what the ground can hold."""
    wheels, robot = recording.wheels, recording.robot
    speed, torque = wheels.ordered['velocity'], wheels.ordered['effort']
    if len(speed) and velocity_ratio(WheelRecord.of(wheels.ordered, recording.origin_ns)) < 0.0:
        return  # velocities or positions have the opposite sign
    moving = (np.abs(speed) > limits.MIN_SPEED).all(axis=1) & ~np.isnan(torque).any(axis=1)
    if moving.sum() < limits.MIN_READINGS:
        return
    power = np.sum(speed[moving] * torque[moving], axis=1)
    sigma = float(np.std(power)) / math.sqrt(
        len(power) * wheels.period / limits.CORRELATION_TIME)
    if power.mean() < -limits.SIGMAS * sigma:
        # a robot that drives downhill absorbs power, but its torques still accelerate it
        gain = np.gradient(speed.mean(axis=1), wheels.ordered.stamp_ns / NS_PER_S)[moving]
        with np.errstate(invalid='ignore', divide='ignore'):  # constant: NaN
            follows = float(np.corrcoef(gain, torque[moving].sum(axis=1))[0, 1])
        yield finding('absorbed_power', wheels.name,
                      Level.ERROR if follows < -limits.MIN_TORQUE_CORRELATION else None,
                      power=-power.mean())
    force = float(np.quantile(np.abs(torque[moving]).sum(axis=1), 0.9)) / robot.wheel_radius
    limit = limits.MAX_FORCE_WEIGHTS * robot.mass * GRAVITY
    if force > limit:
        yield finding('torque_size', wheels.name, force=force, limit=limit,
                      weights=limits.MAX_FORCE_WEIGHTS)


def check_stiffness(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield a longitudinal stiffness that is implausible for the load."""
    robot = recording.robot
    load, stiffness = 0.25 * robot.mass * GRAVITY, robot.tire.longitudinal_stiffness
    ratio = stiffness / load
    critical = float(critical_slip(limits.ASSUMED_FRICTION, load, stiffness))
    if critical > 1.0 or ratio > limits.MAX_STIFFNESS_RATIO:
        yield finding('stiffness_small' if critical > 1.0 else 'stiffness_large',
                      'tire.longitudinal_stiffness', stiffness=stiffness, load=load,
                      critical=critical, ratio=ratio, mu=limits.ASSUMED_FRICTION,
                      least=3.0 * limits.ASSUMED_FRICTION, most=limits.MAX_STIFFNESS_RATIO)
