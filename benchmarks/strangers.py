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
What recordings of other robots have that is wrong or unusual, and what each door says of it.

``python -m benchmarks.strangers [BAG]`` makes the variants of ``wrong_data`` and of this file from
a bag, by default from a simulated drive, and prints a row per variant. ``doctor``: right if the
warnings and errors that the bag itself does not have name the cause and nothing else. ``analyze``:
the exit status, and the distance of its end from that of the bag itself in standard deviations; it
is right if an error is named, or the distance is less than three. ``live``: whether the checks of
a running ``slip_estimator`` name the errors of ``doctor``, as its diagnostics do.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
import itertools
import math
from pathlib import Path
import tempfile
from typing import Any

from benchmarks.wrong_data import (
    CHANGED, DEGREES, Events, judged, RIGHT, RPM, Variant, VARIANTS, written)
import numpy as np

from smart_tire.analysis.offline import analyze
from smart_tire.analysis.pipeline import bag_params, BagParams, EstimatorParams, FILES
from smart_tire.arrays import Array
from smart_tire.bags import Bag, SampleDecoder
from smart_tire.checks import findings
from smart_tire.checks.live import errors_of
from smart_tire.checks.recording import read
from smart_tire.findings import Finding, Level
from smart_tire.host_load import HostLoad
from smart_tire.nodes.live_checks import LiveChecks, PERIOD
from smart_tire.parameters import FrictionEstimatorParams, RobotParams, SlipEstimatorParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.parameters.simulation import SimulatorParams, SurfaceParams
from smart_tire.recording import Faults
from smart_tire.samples import ImuSample, NS_PER_S, WHEELS, WheelSample
from smart_tire.simulation.offline import simulate

DRIVE = ((2.0, 90.0, 90.0), (5.0, 100.0, 60.0), (9.0, 40.0, 80.0), (12.0, 0.0, 0.0),
         (15.0, -60.0, -80.0), (19.0, 90.0, 90.0), (22.0, 0.0, 0.0))  # start time [s], rpm
DURATION = 24.0  # s
MAX_SIGMAS = 3.0
NONE = '-'
NO_LOAD = HostLoad(0.0, 0.0, 0.0, 1)
BEGIN, END = '<!-- begin variants -->', '<!-- end variants -->'  # of the table in a page
HEAD = ('| variant | doctor | live | analyze | standard deviations |\n'
        '| --- | --- | --- | --- | --- |')
Change = Callable[[Events, RobotParams], Events]


# --- changes of samples ----------------------------------------------------------------------


def each(topic: str, change: Callable[[Any, float], Any], begin: float = 0.0,
         end: float = math.inf) -> Change:
    """Return the change of the samples of ``topic`` in shares of the time, which it gets [s]."""
    def changed(events: Events, robot: RobotParams) -> Events:
        first, last = events[0][0], events[-1][0]
        return [(at, name, change(sample, (at - first) / NS_PER_S)
                 if name == topic and begin <= (at - first) / (last - first) < end else sample)
                for at, name, sample in events]
    return changed


def clock(step: float, topics: tuple[str, ...] = CHANGED, share: float = 0.45, *,
          received: bool = True) -> Change:
    """Return the change of timestamps, and of receptions, by ``step`` [s] from a time on."""
    def changed(events: Events, robot: RobotParams) -> Events:
        first, last = events[0][0], events[-1][0]
        step_ns, since = round(step * NS_PER_S), first + share * (last - first)
        return [(at + step_ns * received * (at > since), name, replace(
            sample, stamp_ns=sample.stamp_ns + step_ns * (at > since))
            if name in topics else sample) for at, name, sample in events]
    return changed


def before_clock(shift: float, share: float = 0.15) -> Change:
    """Return timestamps and receptions shifted by ``shift`` [s]; the first are received at 0."""
    def changed(events: Events, robot: RobotParams) -> Events:
        first, last, shift_ns = events[0][0], events[-1][0], round(shift * NS_PER_S)
        since = first + share * (last - first)
        return [((at + shift_ns) * (at > since), name, replace(
            sample, stamp_ns=sample.stamp_ns + shift_ns)) for at, name, sample in events]
    return changed


def paused(begin: float, end: float) -> Change:
    """Return a recording without shares of the time."""
    def changed(events: Events, robot: RobotParams) -> Events:
        first, last = events[0][0], events[-1][0]
        return [event for event in events
                if not begin <= (event[0] - first) / (last - first) < end]
    return changed


def again(topic: str, change: Callable[[Any], Any] = lambda sample: sample, every: int = 1
          ) -> Change:
    """Return the addition of a second publisher of ``topic``."""
    def changed(events: Events, robot: RobotParams) -> Events:
        found, count = [], itertools.count()
        for at, name, sample in events:
            found.append((at, name, sample))
            if name == topic and next(count) % every == 0:
                found.append((at, name, change(sample)))
        return found
    return changed


def frozen(begin: float, end: float) -> Change:
    """Return an IMU that repeats its values in shares of the time."""
    def changed(events: Events, robot: RobotParams) -> Events:
        held: list[Any] = []

        def hold(sample: Any, time: float) -> Any:
            held.append(sample)
            return replace(held[0], stamp_ns=sample.stamp_ns)
        return each('imu/data', hold, begin, end)(events, robot)
    return changed


def angles(wrap: Callable[[Array], Array]) -> Change:
    """Return the change of the angles of the wheels."""
    return each('wheel_states', lambda one, time: replace(
        one, position=one.position and tuple(wrap(np.array(one.position)).tolist())))


def faster(rate: float) -> Change:
    """Return wheel_states at ``rate`` [Hz], interpolated as a simulator has them."""
    def changed(events: Events, robot: RobotParams) -> Events:
        wheels = [sample for _, name, sample in events if name == 'wheel_states']
        stamps = np.array([one.stamp_ns for one in wheels])
        dense = np.arange(stamps[0], stamps[-1], round(NS_PER_S / rate))
        columns = [np.array([np.interp(dense, stamps, column) for column in np.array(
            [getattr(one, name) for one in wheels]).T]).T for name in ('velocity', 'position')]
        late = events[0][0] - events[0][2].stamp_ns
        new = [(int(stamp) + late, 'wheel_states', WheelSample(int(stamp), *(
            tuple(row) for row in rows))) for stamp, *rows in zip(dense, *columns)]
        return sorted([*(one for one in events if one[1] != 'wheel_states'), *new],
                      key=lambda event: event[0])
    return changed


def thinned(topic: str, every: int) -> Change:
    """Return one of ``every`` messages of ``topic``."""
    def changed(events: Events, robot: RobotParams) -> Events:
        count = itertools.count()
        return [event for event in events if event[1] != topic or next(count) % every == 0]
    return changed


def restarted(events: Events, robot: RobotParams) -> Events:
    """Return angles that are zero at each start of the wheels."""
    origin, still = np.zeros(4), True

    def change(one: Any, time: float) -> Any:
        nonlocal origin, still
        moves = any(one.velocity)
        if moves and still:
            origin = np.array(one.position)
        still = not moves
        return replace(one, position=tuple((np.array(one.position) - origin).tolist()))
    return each('wheel_states', change)(events, robot)


def order(*wheels: int) -> Change:
    """Return the change of which wheel has which values."""
    def four(values: Any) -> Any:
        return values and tuple(values[i] for i in wheels)
    return each('wheel_states', lambda one, time: replace(
        one, velocity=four(one.velocity), position=four(one.position), effort=four(one.effort)))


def signs(*factors: float) -> Change:
    """Return the change of the signs of the wheels, 0 for one that stands still."""
    def four(values: Any) -> Any:
        return values and tuple(a * b for a, b in zip(values, factors))
    return each('wheel_states', lambda one, time: replace(
        one, velocity=four(one.velocity), position=four(one.position), effort=four(one.effort)))


def turned(axes: Array) -> Change:
    """Return the change of an IMU whose axes are the rows of ``axes`` in ``base_link``."""
    return each('imu/data', lambda one, time: replace(
        one, rate=tuple((axes @ one.rate).tolist()),
        acceleration=tuple((axes @ one.acceleration).tolist())))


def rotations() -> Iterator[Array]:
    """Yield the 24 rotations that map axes to axes, the identity first."""
    for places in itertools.permutations(range(3)):
        for factors in itertools.product((1.0, -1.0), repeat=3):
            axes = np.eye(3)[list(places)] * np.array(factors)[:, np.newaxis]
            if np.linalg.det(axes) > 0.0:
                yield axes


# --- changes of messages ---------------------------------------------------------------------


def shuffled(topic: str, msg: Any) -> None:
    """Change the order of the joints in a message, another one in each."""
    if topic == 'wheel_states':
        turn = msg.header.stamp.nanosec // 1000 % 4
        for field in ('name', 'position', 'velocity', 'effort'):
            values = list(getattr(msg, field))
            setattr(msg, field, values[turn:] + values[:turn])


def others(topic: str, msg: Any) -> None:
    """Add two wheels and the joints of a steering, which is turned, between those of the robot."""
    if topic == 'wheel_states':
        for field, values in (('name', ['middle_left', 'steering', 'middle_right', 'arm']),
                              ('position', [1.0, 0.4, -3.0, 1.5]), ('velocity', [0.0, 0.1] * 2),
                              ('effort', [0.0, 5.0] * 2)):
            own = list(getattr(msg, field))
            setattr(msg, field, [one for pair in zip(values, own) for one in pair] if own else own)


def imu(*fields: str, value: float | None = 0.0, covariance: float = -1.0
        ) -> Callable[[str, Any], None]:
    """Return the change of vectors of ``imu/data`` and their covariances; None: of these."""
    def change(topic: str, msg: Any) -> None:
        if topic != 'imu/data':
            return
        for field in fields:
            vector = getattr(msg, field)
            if value is not None:
                vector.x = vector.y = vector.z = value
            setattr(msg, f'{field}_covariance', [covariance, *[0.0] * 8])
    return change


def wheels(**fields: Any) -> Callable[[str, Any], None]:
    """Return the change of fields of ``wheel_states``: values, or functions of them."""
    def change(topic: str, msg: Any) -> None:
        if topic == 'wheel_states':
            for name, value in fields.items():
                setattr(msg, name, value(list(getattr(msg, name))) if callable(value) else value)
    return change


def stamped(convert: Callable[[int, int], tuple[int, int]], topics: tuple[str, ...] = CHANGED
            ) -> Callable[[str, Any], None]:
    """Return the change of seconds and nanoseconds of the timestamps."""
    def change(topic: str, msg: Any) -> None:
        stamp = msg.header.stamp
        if topic in topics:
            stamp.sec, stamp.nanosec = convert(stamp.sec, stamp.nanosec)
    return change


def units(position: float, velocity: float) -> Change:
    """Return positions and velocities in units per rad and rad/s; NaN: per wheel radius."""
    def changed(events: Events, robot: RobotParams) -> Events:
        angle, speed = (np.nan_to_num(one, nan=robot.wheel_radius) for one in (position, velocity))
        return each('wheel_states', lambda one, time: replace(
            one, position=tuple(angle * value for value in one.position),
            velocity=tuple(speed * value for value in one.velocity)))(events, robot)
    return changed


def wrapped(full: float, low: float) -> Callable[[Array], Array]:
    """Return the wrap of angles to the range from ``low`` on."""
    return lambda angle: (angle - low) % full + low


def _rotation_name(axes: Array) -> str:
    return 'IMU axes ' + ' '.join(
        f"{'-' if row.sum() < 0.0 else '+'}{'xyz'[int(np.abs(row).argmax())]}" for row in axes)


def _rotation(axes: Array) -> Variant:
    """Return the variant of an IMU with these axes."""
    up = axes[:, 2]  # of base_link, in axes of the IMU
    axis = int(np.abs(up).argmax())
    if axis == 2 and up[2] > 0.0:
        return Variant(turned(axes), ('degrees about z',))
    return Variant(turned(axes), (f"gravity is on {'-' if up[axis] < 0.0 else '+'}{'xyz'[axis]}",))


NOT_MEASURED, EXCHANGED = 'is not measured', '{} and {} are exchanged'
OF_STAMPS = '{}: the clock of its stamps was set {}'
CLOCK = 'clock was set'
DIFFER = ('one clock for all inputs',)  # while it goes on
EMPTY: Mapping[str, Any] = {'velocity': ()}
TICKS, FEW_TICKS = 2048 / math.tau, 96 / math.tau
METRES = math.nan
UNITS: Mapping[tuple[str, str], tuple[Any, ...]] = {  # per rad and rad/s, causes
    ('angles in degrees', 'rad/s'): (DEGREES, 1.0, 'positions in degrees?'),
    ('angles in revolutions', 'rad/s'): (1.0 / math.tau, 1.0, 'positions in revolutions?'),
    ('angles in ticks', 'rad/s'): (TICKS, 1.0, 'positions in ticks, 2048'),
    ('angles in m', 'rad/s'): (METRES, 1.0, 'positions in m?'),
    ('angles in rad', 'deg/s'): (1.0, DEGREES, 'velocities in deg/s?'),
    ('angles in rad', 'revolutions/s'): (1.0, 1.0 / math.tau, 'velocities in revolutions/s?'),
    ('angles in rad', 'ticks/s'): (1.0, FEW_TICKS, 'velocities in ticks/s, 96'),
    ('angles in revolutions', 'rpm'): (
        1.0 / math.tau, RPM, 'velocities in rpm, positions in revolutions?'),
    ('angles in revolutions', 'deg/s'): (
        1.0 / math.tau, DEGREES, 'velocities in deg/s, positions in revolutions?'),
    ('angles in revolutions', 'm/s'): (
        1.0 / math.tau, METRES, 'velocities in m/s, positions in revolutions?'),
    ('angles in degrees', 'rpm'): (DEGREES, RPM, 'velocities in rpm, positions in degrees?'),
    ('angles in degrees', 'm/s'): (DEGREES, METRES, 'velocities in m/s, positions in degrees?'),
    ('angles in m', 'rpm'): (METRES, RPM, 'velocities in rpm, positions in m?'),
    ('angles in degrees', 'deg/s'): (DEGREES, DEGREES, 'wheel speeds', 'in deg/s'),
    ('angles in revolutions', 'revolutions/s'): (
        1.0 / math.tau, 1.0 / math.tau, 'wheel speeds', 'in revolutions/s'),
    ('angles in m', 'm/s'): (METRES, METRES, 'wheel speeds', 'm/s'),
    ('angles in ticks', 'ticks/s'): (TICKS / 3, TICKS / 3, 'wheel speeds', 'ticks/s'),
    ('angles in many ticks', 'ticks/s'): (TICKS, TICKS, 'magnitudes of at most 1000'),
    ('angles in rad', 'rad/s of the opposite sign'): (1.0, -1.0, 'velocities of the opposite'),
    ('angles of the opposite sign', 'rad/s'): (-1.0, 1.0, 'positions of the opposite')}
WRAPS = {'pi': wrapped(math.tau, -math.pi), '2 pi': wrapped(math.tau, 0.0),
         '+-2 pi': lambda angle: np.fmod(angle, math.tau)}
STRANGE: Mapping[str, Variant] = {
    **{_rotation_name(axes): _rotation(axes) for axes in itertools.islice(rotations(), 1, None)},
    # wheels
    **{f'{wheel} reversed': Variant(signs(*(-1.0 if i == k else 1.0 for i in range(4))),
                                    (f'{wheel}: turns in the opposite',))
       for k, wheel in enumerate(WHEELS)},
    **{f'{wheel} dead': Variant(signs(*(0.0 if i == k else 1.0 for i in range(4))),
                                (f'{wheel}: stands still',)) for k, wheel in enumerate(WHEELS)},
    'front wheels swapped': Variant(
        order(1, 0, 2, 3), (EXCHANGED.format('front_left', 'front_right'),)),
    'rear wheels swapped': Variant(
        order(0, 1, 3, 2), (EXCHANGED.format('rear_left', 'rear_right'),)),
    'front and rear exchanged': Variant(order(2, 3, 0, 1)),
    'diagonal wheels exchanged': Variant(
        order(3, 1, 2, 0), (EXCHANGED.format('front_left', 'rear_right'),)),
    'order left, left, right, right': Variant(
        order(0, 2, 1, 3), (EXCHANGED.format('front_right', 'rear_left'),)),
    'left wheels reversed and swapped': Variant(
        lambda events, robot: order(1, 0, 3, 2)(signs(-1, 1, -1, 1)(events, robot), robot),
        ('left wheels are reversed', 'swap both sides')),
    # IMU
    'gyro not measured': Variant(message=imu('angular_velocity'), cause=(NOT_MEASURED,)),
    'accelerometer not measured': Variant(
        message=imu('linear_acceleration'), cause=(NOT_MEASURED,)),
    'orientation only': Variant(message=imu('angular_velocity', 'linear_acceleration'),
                                cause=(NOT_MEASURED,)),
    'gyro always zero': Variant(message=imu('angular_velocity', covariance=0.0),
                                cause=('angular_velocity is constant',)),
    'accelerometer always zero': Variant(message=imu('linear_acceleration', covariance=0.0),
                                         cause=('linear_acceleration is constant',)),
    **{f'{name} with covariance -1': Variant(
        message=imu(*fields, value=None), cause=('covariance -1, not measured', *fields))
       for name, fields in {'gyro': ('angular_velocity',), 'accelerometer': (
           'linear_acceleration',), 'both': ('angular_velocity', 'linear_acceleration')}.items()},
    'gyro NaN': Variant(message=imu('angular_velocity', value=math.nan),
                        cause=('expected finite',)),
    'gyro bias of 5 deg/s': Variant(each('imu/data', lambda one, time: replace(
        one, rate=(*one.rate[:2], one.rate[2] + math.radians(5.0)))), ('at rest is',)),
    'gyro saturated': Variant(each('imu/data', lambda one, time: replace(
        one, rate=tuple(min(0.3, max(-0.3, rate)) for rate in one.rate))), ('saturated',)),
    'IMU stuck for 3 s': Variant(frozen(0.32, 0.45), ('is constant',)),
    'IMU stuck in the second half': Variant(frozen(0.5, math.inf), ('is constant',)),
    'the IMU twice': Variant(again('imu/data'), ('imu/data', 'second publisher')),
    'two IMUs': Variant(again('imu/data', lambda one: replace(
        one, stamp_ns=one.stamp_ns + 1_300_000, rate=(one.rate[1], -one.rate[0], one.rate[2]),
        acceleration=(one.acceleration[1], -one.acceleration[0], one.acceleration[2]))),
        ('imu/data', 'two publishers')),
    'a slower second IMU, z down': Variant(again('imu/data', lambda one: replace(
        one, stamp_ns=one.stamp_ns + 700_000,
        rate=(one.rate[0], -one.rate[1], -one.rate[2]), acceleration=(
            one.acceleration[0], -one.acceleration[1], -one.acceleration[2])), every=4),
        ('imu/data', 'two publishers')),
    # factors, other orders and rates
    **{f'{name} of {factor:g} times the speed': Variant(
        signs(*(factor if k in wheels else 1.0 for k in range(4))), (cause,))
       for name, wheels, factor, cause in (
           ('rear_right', (3,), 2.0, 'rear_right: always turns 2 times'),
           ('front_left', (0,), 0.5, 'front_left: always turns 0.5 times'),
           ('right wheels', (1, 3), 2.0, 'the right wheels turn 2 times'),
           ('left wheels', (0, 2), 0.5, 'the left wheels turn 0.5 times'))},
    'gyro in rpm': Variant(each('imu/data', lambda one, time: replace(
        one, rate=tuple(RPM * rate for rate in one.rate))), ('yaw rate is', 'in rpm')),
    'acceleration doubled': Variant(each('imu/data', lambda one, time: replace(
        one, acceleration=tuple(2.0 * force for force in one.acceleration))),
        ('specific force is 19',)),
    'IMU on its side, in deg/s and g': Variant(each('imu/data', lambda one, time: replace(
        one, rate=tuple(DEGREES * one.rate[k] * (-1.0) ** (k == 1) for k in (0, 2, 1)),
        acceleration=tuple(one.acceleration[k] / 9.81 * (-1.0) ** (k == 1)
                           for k in (0, 2, 1)))), ('gravity is on +y', 'in deg/s', 'in g')),
    'joints in another order in each message': Variant(message=shuffled),
    'other wheels and joints between them': Variant(message=others),
    'angles that begin at zero at each start': Variant(restarted),
    'angles that begin at zero at each start, no velocities': Variant(
        restarted, message=wheels(**EMPTY)),
    'each message twice': Variant(
        lambda events, robot: [event for event in events for _ in range(2)],
        ('imu/data', 'wheel_states', 'second publisher')),
    'velocities cut to integers': Variant(each('wheel_states', lambda one, time: replace(
        one, velocity=tuple(map(math.trunc, one.velocity))))),
    'IMU at 25 Hz': Variant(thinned('imu/data', 4)),
    'wheel_states at 4 Hz': Variant(thinned('wheel_states', 4)),
    'mass of 100 times': Variant(cause=('check mass',), setting=lambda robot: replace(
        robot, mass=100.0 * robot.mass)),
    'torques of 1000 times': Variant(each('wheel_states', lambda one, time: replace(
        one, effort=one.effort and tuple(1e3 * torque for torque in one.effort))),
        ('motor torques give',)),
    # clocks
    'clock set forward by 0.3 s': Variant(clock(0.3), (CLOCK,)),
    'clock set forward by 2 s': Variant(clock(2.0), (CLOCK,)),
    'clock set forward by an hour': Variant(clock(3600.0), (CLOCK,)),
    'clock set forward by 13 years': Variant(clock(4e8), (CLOCK,)),
    'clock set back by 0.3 s': Variant(clock(-0.3), (CLOCK,)),
    'clock set back by 2 s': Variant(clock(-2.0), (CLOCK,)),
    'clock set back by an hour': Variant(clock(-3600.0), (CLOCK,)),
    'clock of the IMU set forward by 2 s': Variant(
        clock(2.0, ('imu/data',), received=False),
        (OF_STAMPS.format('imu/data', 'forward by 2 s'),), also=DIFFER),
    'clock of the wheels set back by 1 s': Variant(
        clock(-1.0, ('wheel_states',), received=False),
        (OF_STAMPS.format('wheel_states', 'back by 1 s'),), also=DIFFER),
    'clock set forward by 2 s at rest': Variant(
        clock(2.0, share=0.05), ('or the clock was set forward',)),
    'recording paused at rest': Variant(
        paused(0.02, 0.06), ('recording was interrupted, or',)),
    'recording paused in motion': Variant(
        paused(0.4, 0.48), ('recording was interrupted; ',)),
    'simulated time': Variant(clock(20.0 - 1.7e9, share=-1.0, received=False)),
    'received in simulated time': Variant(lambda events, robot: [
        (at - round((1.7e9 - 20.0) * NS_PER_S), name, sample) for at, name, sample in events],
        ('times of reception are those of a simulation',)),
    'simulated time, received before /clock': Variant(
        before_clock(20.0 - 1.7e9), ('before it received /clock',)),
    'milliseconds in nanosec': Variant(
        message=stamped(lambda sec, nanosec: (sec, nanosec // 1_000_000), ('imu/data',)),
        cause=('imu/data', 'header.stamp.nanosec')),
    'microseconds in nanosec': Variant(
        message=stamped(lambda sec, nanosec: (sec, nanosec // 1000)),
        cause=('header.stamp.nanosec',)),
    'nanosec cut to 32 bits': Variant(message=stamped(lambda sec, nanosec: (
        sec, (sec * NS_PER_S + nanosec) & 0xFFFFFFFF), ('imu/data',)),
        cause=('imu/data', 'nanosec')),
    'whole seconds': Variant(message=stamped(lambda sec, nanosec: (sec, 0), ('imu/data',)),
                             cause=('imu/data', 'header.stamp.nanosec')),
    # wheel_states
    **{f'angles wrapped at {name}': Variant(angles(wrap)) for name, wrap in WRAPS.items()},
    **{f'angles wrapped at {name}, no velocities': Variant(angles(wrap), message=wheels(**EMPTY))
       for name, wrap in WRAPS.items()},
    'angles in degrees, wrapped': Variant(
        angles(lambda angle: np.degrees(angle) % 360.0), ('positions in degrees',)),
    'angles in degrees, wrapped, no velocities': Variant(
        angles(lambda angle: np.degrees(angle) % 360.0), ('in deg/s',), message=wheels(**EMPTY)),
    'wheels that never turn': Variant(each('wheel_states', lambda one, time: replace(
        one, position=(0.0,) * 4, velocity=(0.0,) * 4)), ('the wheels never turn',),
        also=('motor torques',)),
    **{f'{name[0]}, {name[1]}': Variant(
        units(position, velocity), tuple(cause), also=('magnitudes of at most 1000',))
       for name, (position, velocity, *cause) in UNITS.items()},
    '16-bit counters': Variant(angles(wrapped(65536 * math.tau / 2000, 0.0))),
    '16-bit counters, no velocities': Variant(
        angles(wrapped(16384 * math.tau / 2000, 0.0)), message=wheels(**EMPTY)),
    'reset of the angles': Variant(each('wheel_states', lambda one, time: replace(
        one, position=tuple(angle - 37.0 for angle in one.position)), 0.3)),
    'reset of the angles, no velocities': Variant(each('wheel_states', lambda one, time: replace(
        one, position=tuple(angle - 37.0 for angle in one.position)), 0.3),
        message=wheels(**EMPTY)),
    'no velocities': Variant(message=wheels(**EMPTY)),
    'velocities always zero': Variant(message=wheels(velocity=(0.0,) * 4),
                                      cause=('velocity is 0 in',)),
    'velocities NaN': Variant(message=wheels(velocity=(math.nan,) * 4)),
    'one velocity NaN': Variant(message=wheels(velocity=lambda old: [*old[:2], math.nan, old[3]])),
    'one effort only': Variant(message=wheels(effort=lambda old: old[:1]), cause=('left out',)),
    'wheel_states at 50 Hz': Variant(faster(50.0)),
    'wheel_states at 1 kHz': Variant(faster(1000.0)),
    'wheel_states at 1 kHz, no velocities': Variant(faster(1000.0), message=wheels(**EMPTY)),
}
ALL: Mapping[str, Variant] = {**VARIANTS, **STRANGE}


def combined(one: Variant, other: Variant) -> Variant:
    """Return the variant with both changes."""
    def message(topic: str, msg: Any) -> None:
        for each_message in filter(None, (one.message, other.message)):
            each_message(topic, msg)
    return Variant(
        lambda events, robot: other.change(one.change(events, robot), robot),
        (*one.cause, *other.cause), lambda robot: other.setting(one.setting(robot)),
        (*one.also, *other.also), message, one.same_end and other.same_end)


PAIRS = tuple(itertools.combinations((
    'gyro in deg/s', 'accelerometer in g', 'IMU axes -x -y +z', 'rear wheels swapped',
    'front_right reversed', 'clock set forward by 2 s', 'angles wrapped at pi, no velocities',
    'velocities always zero', 'rear_left dead'), 2))
EQUIVALENT = {  # they are also those of two others, or of none
    ('IMU axes -x -y +z', 'rear wheels swapped'), ('rear wheels swapped', 'rear_left dead')}


# --- doors -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Result:
    """What ``doctor`` and ``analyze`` say of a recording."""

    doctor: str                # RIGHT, SILENT or WRONG
    live: str                  # as for the errors of doctor; NONE if it has none
    found: list[Finding]
    error: bool                # ``analyze`` names an error
    end: Array | None = None   # x, y [m] and yaw [rad] at the end; None if nothing is estimated
    sigma: Array | None = None
    same_end: bool = True      # as the unchanged drive

    def distance(self, other: Result) -> float:
        """Return the distance of the ends in standard deviations; infinite if it is unknown."""
        if self.end is None or self.sigma is None or other.end is None:
            return math.inf
        return float(np.abs((self.end - other.end) / self.sigma).max())

    def right(self, reference: Result) -> bool:
        """Return whether a wrong estimate is named."""
        return self.error or not self.same_end or self.distance(reference) < MAX_SIGMAS


def result(events: Events, robot: RobotParams, variant: Variant, before: list[Finding],
           doors: bool = True) -> Result:
    """Return what is said about a variant of ``events``; ``analyze`` only with ``doors``."""
    changed, setting = variant.change(events, robot), variant.setting(robot)
    params = EstimatorParams(SlipEstimatorParams(robot=setting),
                             FrictionEstimatorParams(robot=setting))
    with tempfile.TemporaryDirectory() as folder:
        path = written(Path(folder) / 'bag', changed, variant, setting)
        with Bag(path) as bag:
            found = [one for one in findings(read(bag, setting)) if one.level >= Level.WARNING]
        said = judged(variant, found, before)
        heard = live_errors(path, setting)
        errors = '\n'.join(one.text for one in found if one.level is Level.ERROR)
        cause = tuple(part for part in variant.cause if part in errors)
        live = judged(replace(variant, cause=cause), heard, before) if cause or heard else NONE
        if not doors:
            return Result(said, live, found, False)
        done = analyze(path, None, params, source=BagParams(params, FILES), checks=True)
    error = bool(done.contents.errors) or done.summary is None or bool(done.summary['diverged'])
    odom = done.summary and done.summary['estimates'].get('odom')
    if not odom:
        return Result(said, live, found, error)
    end, sigma = (np.array(list(odom[name].values()), float) for name in ('end', 'end_sigma'))
    return Result(said, live, found, error, end, sigma, variant.same_end)


def live_errors(path: Path, robot: RobotParams) -> list[Finding]:
    """Return what the diagnostics of ``slip_estimator`` say after the messages of a bag."""
    faults, checks = Faults(), LiveChecks(
        robot, lambda work: work(), lambda *job: (errors_of(*job), 0.0))
    read = {name: SampleDecoder(name, faults) for name in CHANGED}
    with Bag(path) as bag:
        for receive_ns, channel, data in bag.raw(as_written=True):
            for sample in read[channel.topic.lstrip('/')](data):
                assert isinstance(sample, ImuSample | WheelSample)
                checks.add(receive_ns, sample)
            checks.poll(receive_ns, NO_LOAD, faults.completed)
        errors = [*checks.poll(receive_ns + round(PERIOD * NS_PER_S), NO_LOAD, faults.completed)]
    return errors + [Finding(Level.ERROR, topic, reason)
                     for topic, reason in faults.reasons.items()]


def simulated() -> tuple[list[Any], RobotParams]:
    """Return the events of a drive without films, and its robot."""
    robot = RobotParams(film=TreadFilmParams(wheels=()))
    events = simulate(SimulatorParams(seed=1, ground=SurfaceParams(
        base='concrete', patches=()), robot=robot), DRIVE, DURATION)
    return [event for event in events if event[1] in CHANGED], robot


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[1])
    parser.add_argument('bag', nargs='?', type=Path, metavar='BAG')
    parser.add_argument('--params', action='append', type=Path, default=[], metavar='FILE')
    parser.add_argument('--only', default='', help='a part of the names of the variants')
    parser.add_argument('--doctor', action='store_true', help='without analyze')
    parser.add_argument('--page', type=Path, metavar='FILE', help='write the table into a page')
    args = parser.parse_args()
    if args.bag is None:
        events, robot = simulated()
    else:
        with Bag(args.bag) as bag:
            robot = bag_params(bag, args.params).params.robot
            bag.joints = robot.joints
            events = [event for event in bag.samples(CHANGED, restamp=False)
                      if isinstance(event[2], (ImuSample, WheelSample))]
    before = result(events, robot, Variant(), [], False).found
    reference = result(events, robot, Variant(), before, not args.doctor)
    rows = [HEAD]
    for name, variant in ALL.items():
        if args.only not in name:
            continue
        one = result(events, robot, variant, before, not args.doctor)
        analyzed = ('-' if args.doctor else 'error' if one.error else
                    'ok' if one.right(reference) else 'WRONG')
        distance = one.distance(reference) if one.same_end else math.inf
        rows.append(f'| {name} | {one.doctor} | {one.live} | {analyzed} | '
                    f'{"-" if math.isinf(distance) else f"{distance:.1f}"} |')
        print(rows[-1], flush=True)
        if one.doctor != RIGHT or one.live not in (RIGHT, NONE):
            for finding in one.found:
                print(f'    {finding.level.name.lower()} {finding.text}', flush=True)
    if args.page is not None:
        before_it, _, rest = args.page.read_text(encoding='utf-8').partition(BEGIN)
        args.page.write_text('\n'.join((before_it + BEGIN, *rows, END + rest.partition(END)[2])),
                             encoding='utf-8')


if __name__ == '__main__':
    main()
