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
Variants of a recording with wrong units, axes, signs and clocks, and what ``doctor`` says.

``python -m benchmarks.wrong_data BAG ...`` prints a row per variant: right if the warnings and
errors that the bag itself does not have name the cause and nothing else, silent if there are none,
wrong if one of them names something else.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from pathlib import Path
from typing import Any

import numpy as np

from smart_tire.analysis.pipeline import bag_params
from smart_tire.arrays import Array
from smart_tire.bags import Bag, BagWriter, channel_of, PARAMETERS_KEY, SampleDecoder
from smart_tire.bags.cdr import empty, Encoder
from smart_tire.checks import findings
from smart_tire.checks.recording import CheckedRecording, READ
from smart_tire.findings import Finding, Level
from smart_tire.messages import TOPICS
from smart_tire.parameters import RobotParams
from smart_tire.parameters.files import snapshot_text
from smart_tire.parameters.spec import values_of
from smart_tire.recording import Faults, SampleArrays
from smart_tire.rotation import matrix
from smart_tire.samples import GRAVITY, ImuSample, NS_PER_S, WheelSample
from smart_tire.simulation.offline import Event

Events = Sequence[Event]
Change = Callable[[Events, RobotParams], Events]
Setting = Callable[[RobotParams], RobotParams]
RIGHT, SILENT, WRONG = 'right', 'silent', 'wrong'
CHANGED = 'imu/data', 'wheel_states'  # topics of the variants
DEGREES, RPM = 180.0 / math.pi, 60.0 / math.tau


@dataclass(frozen=True)
class Variant:
    """A change of a recording or of the parameters, and what has to be said about it."""

    change: Change = lambda events, robot: events
    cause: tuple[str, ...] = ()  # parts of the texts; all must be found
    setting: Setting = lambda robot: robot
    also: tuple[str, ...] = ()   # parts of texts that are true as well
    message: Callable[[str, Any], None] | None = None  # changes a message of a topic in place
    same_end: bool = True        # the drive ends where the unchanged one does


def _each(topic: str, change: Callable[[Any, RobotParams], Any]) -> Change:
    """Return the change of each sample of ``topic``; None removes it."""
    return lambda events, robot: [
        (at, name, new) for at, name, sample in events
        if (new := change(sample, robot) if name == topic else sample) is not None]


def _imu(*, force: Array | float = 1.0, rate: Array | float = 1.0, lost: Array | float = 0.0
         ) -> Change:
    """Return the change of an IMU: factors or rotations of force and rate, force without lost."""
    def changed(vector: Any, factor: Array | float, less: Array | float = 0.0) -> Any:
        return tuple((np.asarray(factor) @ vector if np.ndim(factor) else
                      np.asarray(factor) * (np.asarray(vector) - less)).tolist())

    return _each('imu/data', lambda one, robot: replace(
        one, acceleration=changed(one.acceleration, force, lost),
        rate=changed(one.rate, rate)))


def _turned(roll: float, pitch: float, yaw: float) -> Change:
    """Return the change of an IMU that is mounted with these angles [degrees] of its axes."""
    own = matrix(*np.radians((roll, pitch, yaw))).T
    return _imu(force=own, rate=own)


def _wheels(order: Sequence[int] = (0, 1, 2, 3), factors: Sequence[float] | float = 1.0,
            positions: bool = True) -> Change:
    """Return the change of the wheels: their order, factors, also of the positions."""
    scale = np.broadcast_to(np.asarray(factors, float), 4)

    def new(values: Any) -> Any:
        return values and tuple((scale * np.asarray(values)[list(order)]).tolist())

    return _each('wheel_states', lambda one, robot: replace(
        one, velocity=new(one.velocity), position=new(one.position) if positions
        else one.position, effort=one.effort and tuple(
            (np.sign(scale) * np.asarray(one.effort)[list(order)]).tolist())))


def _metres(events: Events, robot: RobotParams) -> Events:
    return _wheels(factors=robot.wheel_radius)(events, robot)


def _stamped(topic: str, late: float) -> Change:
    """Return the change of the timestamps of ``topic`` by ``late`` [s]; NaN: zero."""
    return _each(topic, lambda one, robot: replace(
        one, stamp_ns=0 if math.isnan(late) else one.stamp_ns + round(late * NS_PER_S)))


def _imu_at(axis: int, value: float) -> Setting:
    """Return the setting of x or y of the position of the IMU [m]."""
    def setting(robot: RobotParams) -> RobotParams:
        position = np.array(robot.imu.position)
        position[axis] = value
        return replace(robot, imu=replace(robot.imu, position=tuple(position.tolist())))
    return setting


def _both(*changes: Change) -> Change:
    def change(events: Events, robot: RobotParams) -> Events:
        for one in changes:
            events = one(events, robot)
        return events
    return change


def _part(begin: float, end: float) -> Change:
    """Return the cut to the shares of the time from ``begin`` to ``end``."""
    def change(events: Events, robot: RobotParams) -> Events:
        first, last = events[0][0], events[-1][0]
        return [event for event in events
                if begin <= (event[0] - first) / (last - first) <= end]
    return change


def _mean_of_sides(one: WheelSample, robot: RobotParams) -> WheelSample:
    def mean(values: Any) -> Any:
        return values and tuple(0.5 * (values[i] + values[i ^ 1]) for i in range(4))
    return replace(one, velocity=mean(one.velocity), position=mean(one.position))


YAW = 'turned by {} degrees about z'
GYRO_SIGN = 'imu/data: the yaw rate has the opposite sign'
DOWN = 'imu/data: gravity is on -z'
SWAPPED = 'left and right are swapped'
VARIANTS: Mapping[str, Variant] = {
    'none': Variant(),
    # units
    'gyro in deg/s': Variant(_imu(rate=DEGREES), ('imu/data: yaw rate is', 'in deg/s')),
    'accelerometer in g': Variant(_imu(force=1.0 / GRAVITY), ('imu/data', 'in g')),
    'accelerometer in mg': Variant(_imu(force=1e3 / GRAVITY), ('imu/data', 'or mg')),
    'accelerometer in cm/s2': Variant(_imu(force=100.0), ('imu/data', 'in cm/s2')),
    'gravity removed': Variant(_imu(lost=np.array([0.0, 0.0, GRAVITY])),
                               ('gravity was removed',)),
    'gyro in deg/s, accelerometer in g': Variant(
        _imu(rate=DEGREES, force=1.0 / GRAVITY), ('in deg/s', 'in g')),
    'wheel speeds in m/s': Variant(_metres, ('wheel_states', 'm/s')),
    'wheel speeds in rpm': Variant(_wheels(factors=RPM), ('wheel_states', 'rpm')),
    'wheel speeds in deg/s': Variant(_wheels(factors=DEGREES), ('wheel_states', 'deg/s')),
    'wheel speeds in revolutions/s': Variant(
        _wheels(factors=1.0 / math.tau), ('wheel_states', 'revolutions/s')),
    'velocities in rpm, positions in rad': Variant(
        _wheels(factors=RPM, positions=False), ('wheel_states: velocity', 'rpm')),
    'velocities in m/s, positions in rad': Variant(
        _each('wheel_states', lambda one, robot: replace(one, velocity=tuple(
            robot.wheel_radius * speed for speed in one.velocity))),
        ('wheel_states: velocity', 'm/s')),
    # axes of the IMU
    'IMU turned by 90 degrees': Variant(_turned(0, 0, 90), (YAW.format(90),)),
    'IMU turned by -90 degrees': Variant(_turned(0, 0, -90), (YAW.format(-90),)),
    'IMU turned by 180 degrees': Variant(_turned(0, 0, 180), ('180 degrees about z',)),
    'IMU turned by 45 degrees': Variant(_turned(0, 0, 45), ('degrees about z',)),
    'y right, z down': Variant(_turned(180, 0, 0), (DOWN,)),
    'y right, z down, backwards': Variant(_turned(180, 0, 180), (DOWN,)),
    'z down, turned by 90 degrees': Variant(_turned(180, 0, 90), (DOWN,)),
    'IMU on its side': Variant(_turned(90, 0, 0), ('gravity is on +y',)),
    'IMU on its other side': Variant(_turned(-90, 0, 0), ('gravity is on -y',)),
    'IMU on its front': Variant(_turned(0, 90, 0), ('gravity is on -x',)),
    'gyro z reversed': Variant(_imu(rate=np.diag([1.0, 1.0, -1.0])), (GYRO_SIGN,)),
    'turned by 90 degrees, in g': Variant(
        _both(_turned(0, 0, 90), _imu(force=1.0 / GRAVITY)), (YAW.format(90), 'in g')),
    # wheels
    'sides swapped': Variant(_wheels((1, 0, 3, 2)), (SWAPPED,)),
    'right wheels reversed': Variant(
        _wheels(factors=(1, -1, 1, -1)), ('wheel_states: the right wheels are reversed',)),
    'left wheels reversed': Variant(
        _wheels(factors=(-1, 1, -1, 1)), ('wheel_states: the left wheels are reversed',)),
    'all wheels reversed': Variant(_wheels(factors=-1.0), ('wheel_states: all wheels are',)),
    'reversed and swapped': Variant(
        _wheels((1, 0, 3, 2), -1.0), ('180 degrees about z', 'swap both sides')),
    'right wheels reversed, rpm': Variant(
        _wheels(factors=(RPM, -RPM, RPM, -RPM)), ('the right wheels are reversed', 'rpm')),
    'one wheel reversed': Variant(
        _wheels(factors=(1, 1, 1, -1)), ('rear_right: turns in the opposite',)),
    'one wheel stuck': Variant(_wheels(factors=(1, 1, 0, 1)), ('rear_left: stands still',)),
    'mean of the sides': Variant(_each('wheel_states', _mean_of_sides), ('same speed',)),
    'torques reversed': Variant(_each('wheel_states', lambda one, robot: replace(
        one, effort=one.effort and tuple(-value for value in one.effort))), ('absorb',)),
    # parameters
    'radius in mm': Variant(cause=('wheel_radius',), setting=lambda robot: replace(
        robot, wheel_radius=min(2.0, 1e3 * robot.wheel_radius))),
    'diameter as radius': Variant(cause=('wheel_radius',), setting=lambda robot: replace(
        robot, wheel_radius=2.0 * robot.wheel_radius)),
    'half of the radius': Variant(cause=('wheel_radius',), setting=lambda robot: replace(
        robot, wheel_radius=0.5 * robot.wheel_radius)),
    'IMU 0.8 m to the left': Variant(cause=('imu.position: y',), setting=_imu_at(1, 0.8)),
    'IMU 0.5 m to the right': Variant(cause=('imu.position: y',), setting=_imu_at(1, -0.5)),
    'IMU 1 m ahead': Variant(cause=('imu.position: x',), setting=_imu_at(0, 1.0)),
    'IMU 1 m behind': Variant(cause=('imu.position: x',), setting=_imu_at(0, -1.0)),
    # clocks
    'wheels late by 0.2 s': Variant(_stamped('wheel_states', 0.2), ('late',),
                                    also=('wheel_states: timestamps are',)),
    'IMU late by 0.2 s': Variant(_stamped('imu/data', 0.2), ('imu/data: timestamps are',),
                                 also=('encoder.latency',)),
    'wheels early by 2 s': Variant(
        _stamped('wheel_states', -2.0), ('timestamps are 2 s behind',), also=('2 s before',)),
    'no stamps of the IMU': Variant(_stamped('imu/data', math.nan), ('timestamps are zero',)),
    # nothing is wrong
    'first half': Variant(_part(0.0, 0.5), same_end=False),
    'second half': Variant(_part(0.5, 1.0), same_end=False),
    'first quarter': Variant(_part(0.0, 0.25), same_end=False),
    'second quarter': Variant(_part(0.25, 0.5), same_end=False),
    'third quarter': Variant(_part(0.5, 0.75), same_end=False),
    'last quarter': Variant(_part(0.75, 1.0), same_end=False),
    'no torques': Variant(_each('wheel_states', lambda one, robot: replace(one, effort=None))),
    'no positions': Variant(_each('wheel_states', lambda one, robot: replace(
        one, position=None))),
}


def found_in(events: Iterable[Event], robot: RobotParams, variant: Variant = Variant()
             ) -> list[Finding]:
    """Return the warnings and errors on ``events``, sent and received as messages."""
    samples, faults = SampleArrays(), Faults()
    read = {topic: SampleDecoder(topic, faults) for topic in CHANGED}
    for receive_ns, topic, sample in events:
        received = read[topic](encoded(topic, sample, variant)) if topic in read else (sample,)
        for one in received:
            samples.add_sample(one, receive_ns)
    return [one for one in findings(CheckedRecording(robot, samples, faults))
            if one.level >= Level.WARNING]


def encoded(topic: str, sample: Any, variant: Variant) -> bytes:
    """Return the message of a sample, as ``variant`` changes it."""
    form = TOPICS[topic]
    msg = form.to_msg(empty(form.type), sample)
    if variant.message is not None:
        variant.message(topic, msg)
    return Encoder(form.type)(msg)


def written(path: Path, events: Iterable[Event], variant: Variant, robot: RobotParams) -> Path:
    """Write ``events``, in their order, and the parameters of the robot into a bag."""
    with BagWriter(path, custom_data={
            PARAMETERS_KEY: snapshot_text({'slip_estimator': values_of(robot)})}) as writer:
        for receive_ns, topic, sample in events:
            writer.add_topic(channel_of(f'/{topic}', TOPICS[topic].type))
            writer.write(f'/{topic}', receive_ns, encoded(topic, sample, variant))
    return path


def judged(variant: Variant, found: Sequence[Finding], before: Sequence[Finding] = ()) -> str:
    """Return whether ``found`` is right, silent or wrong; ``before`` is not due to the variant."""
    known = {(one.where, one.found.split()[0]) for one in before}
    new = [one for one in found if (one.where, one.found.split()[0]) not in known]
    named = (*variant.cause, *variant.also)
    if any(not any(part in one.text for part in named) for one in new):
        return WRONG
    text = '\n'.join(one.text for one in new)
    return RIGHT if all(part in text for part in variant.cause) else SILENT


def main() -> None:
    """Print the table of the bags."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[1])
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG')
    parser.add_argument('--params', action='append', type=Path, default=[], metavar='FILE')
    args = parser.parse_args()
    for path in args.bags:
        with Bag(path) as bag:
            robot = bag_params(bag, args.params).params.robot
            bag.joints = robot.joints
            events = [event for event in bag.samples(READ, restamp=False)
                      if isinstance(event[2], (ImuSample, WheelSample))]
        before = found_in(events, robot)
        for name, variant in VARIANTS.items():
            changed = variant.setting(robot)
            found = found_in(variant.change(events, robot), changed, variant)
            print(f'{path.name:24} {judged(variant, found, before):7} {name}')
            for one in found:
                print(f'{"":33}{one.level.name.lower()} {one.text}')


if __name__ == '__main__':
    main()
