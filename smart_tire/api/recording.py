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
Recordings as arrays: measurements of IMU, wheels and films, and ground truth where known; bags.

The rows of a stream are in order of reception, which is nearly that of the timestamps. Axes are
those of REP-103, wheels are in the order of ``WHEELS``: front left, front right, rear left, rear
right.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
import heapq
import math
from operator import itemgetter
from pathlib import Path
from typing import Any, cast, NamedTuple

import numpy as np

from smart_tire.analysis.pipeline import bag_params, INPUTS, TRUTHS
from smart_tire.api.params import Params
from smart_tire.arrays import Array, Instants
from smart_tire.bags import Bag, BagWriter, PARAMETERS_KEY, TopicNames
from smart_tire.errors import ParameterError
from smart_tire.estimates import (
    by_wheel, check_wheel, FrictionEstimate, PoseEstimate, SlipEstimate, Tables, Tabular, Truth)
from smart_tire.paths import find_bag
from smart_tire.recording import SampleArrays
from smart_tire.rotation import quaternion
from smart_tire.samples import (
    Four, Friction, FRICTION_QUANTITIES, ImuSample, NS_PER_S, Odometry, PLANAR, Sample, TireSample,
    Vector3, WHEELS, WheelSample, WheelSlip)
from smart_tire.uncertain import Uncertain

ABSENT: Any = None  # default of an array that __post_init__ then makes
TRUTH = 'ground_truth/'  # prefix of its topics
ZERO = (0.0, 0.0, 0.0)


class Received(NamedTuple):
    """A sample with its topic and the time of its reception."""

    receive_ns: int
    topic: str
    sample: Sample


@dataclass(frozen=True, eq=False, repr=False)
class DeviceData(Tabular):
    """
    Measurements of one device in order of reception.

    * ``stamp_ns``: (n,) ns, instants of the measurements
    """

    stamp_ns: Instants

    def __post_init__(self) -> None:
        stamps = np.asarray(self.stamp_ns)
        if stamps.ndim != 1 or stamps.dtype.kind != 'i':
            raise ParameterError(f'stamp_ns has shape {stamps.shape} and type {stamps.dtype}, '
                                 'expected integers (n,)')
        object.__setattr__(self, 'stamp_ns', stamps.astype(np.int64))
        if getattr(self, 'receive_ns', ABSENT) is ABSENT and (np.diff(self.stamp_ns) < 0).any():
            row = int(np.argmax(np.diff(self.stamp_ns) < 0)) + 1
            raise ParameterError(f'stamp_ns decreases in row {row}: sort the rows, or give '
                                 'receive_ns if they are in order of reception')
        self._fill('receive_ns', (), self.stamp_ns, np.int64)

    def _fill(self, name: str, shape: tuple[int, ...], default: Any = math.nan,
              kind: type = float) -> None:
        """Convert the field ``name`` to (n, *shape); None becomes ``default``."""
        given, expected = getattr(self, name), (len(self.stamp_ns), *shape)
        values = np.broadcast_to(default, expected) if given is None else np.asarray(given)
        if values.shape != expected:
            raise ParameterError(f'{name} has shape {values.shape}, expected {expected}')
        object.__setattr__(self, name, values.astype(kind))

    def _check_measured(self, *names: str) -> None:
        """Raise ParameterError if all of these fields are NaN in every row."""
        if len(self) and all(np.isnan(getattr(self, name)).all() for name in names):
            raise ParameterError(f'{" and ".join(names)}: NaN in all {len(self)} rows')

    def received(self) -> Iterator[Received]:
        """Yield the samples in order of reception."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False, repr=False)
class ImuData(DeviceData):
    """
    Readings of the IMU in ``imu_link``.

    * ``stamp_ns``: (n,) ns, instants of the measurements
    * ``acceleration``: (n, 3) m/s2, specific force: +g on z when stationary
    * ``rate``: (n, 3) rad/s
    * ``orientation``: (n, 4) quaternion x, y, z, w; NaN if unknown
    * ``receive_ns``: (n,) ns; default: the timestamps
    """

    acceleration: Array
    rate: Array
    orientation: Array = ABSENT
    receive_ns: Instants = ABSENT

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, shape in ('acceleration', 3), ('rate', 3), ('orientation', 4):
            self._fill(name, (shape,))
        self._check_measured('acceleration')
        self._check_measured('rate')

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        return {f'{name}_{axis}': column
                for name, rows in (('acceleration', self.acceleration), ('rate', self.rate))
                for axis, column in zip('xyz', rows.T)}

    def received(self) -> Iterator[Received]:
        """Yield the samples in order of reception."""
        for receive_ns, stamp_ns, force, rate, turn in zip(*(values.tolist() for values in (
                self.receive_ns, self.stamp_ns, self.acceleration, self.rate,
                self.orientation))):
            yield Received(receive_ns, 'imu/data', ImuSample(
                stamp_ns, cast(Vector3, tuple(force)), cast(Vector3, tuple(rate)),
                None if math.isnan(turn[0]) else cast(Four, tuple(turn))))


@dataclass(frozen=True, eq=False, repr=False)
class WheelData(DeviceData):
    """
    Readings of the four wheels, positive rolling forward on both sides.

    * ``stamp_ns``: (n,) ns, instants of the measurements
    * ``velocity``: (n, 4) rad/s, mean over the period that ends at the timestamp
    * ``position``: (n, 4) rad, unwrapped angle; NaN if not measured
    * ``effort``: (n, 4) N m, motor torque at the wheel; NaN if not
    * ``receive_ns``: (n,) ns; default: the timestamps
    """

    velocity: Array
    position: Array = ABSENT
    effort: Array = ABSENT
    receive_ns: Instants = ABSENT

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in 'velocity', 'position', 'effort':
            self._fill(name, (len(WHEELS),))
        self._check_measured('velocity', 'position')

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        return {**by_wheel('velocity', self.velocity, WHEELS),
                **by_wheel('position', self.position, WHEELS),
                **by_wheel('effort', self.effort, WHEELS)}

    def received(self) -> Iterator[Received]:
        """Yield the samples in order of reception."""
        for receive_ns, stamp_ns, velocity, position, effort in zip(*(
                values.tolist() for values in (self.receive_ns, self.stamp_ns, self.velocity,
                                               self.position, self.effort))):
            yield Received(receive_ns, 'wheel_states', WheelSample(
                stamp_ns, cast(Four, tuple(velocity)),
                cast(Four, tuple(position)) if _measured(position, velocity) else None,
                None if all(map(math.isnan, effort)) else cast(Four, tuple(effort))))


def _measured(position: list[float], velocity: list[float]) -> bool:
    """Return whether the angles of all wheels that have a speed are measured."""
    return not any(math.isnan(angle) and not math.isnan(speed)
                   for angle, speed in zip(position, velocity))


@dataclass(frozen=True, eq=False, repr=False)
class FilmData(DeviceData):
    """
    A/D conversions of the films of one wheel.

    * ``stamp_ns``: (n,) ns, instants of the measurements
    * ``wheel``: name of the wheel
    * ``volts``: (n, films) V; rolling forward, film 1 enters the patch first
    * ``receive_ns``: (n,) ns; default: the timestamps
    """

    wheel: str
    volts: Array
    receive_ns: Instants = ABSENT

    def __post_init__(self) -> None:
        super().__post_init__()
        check_wheel(self.wheel)
        if np.ndim(self.volts) != 2:
            raise ParameterError(f'volts has shape {np.shape(self.volts)}, expected (n, films)')
        self._fill('volts', (np.shape(self.volts)[1],))
        self._check_measured('volts')

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        return {f'film_{i + 1}': column for i, column in enumerate(self.volts.T)}

    def received(self) -> Iterator[Received]:
        """Yield the samples in order of reception; films that are NaN at the end are absent."""
        for receive_ns, stamp_ns, volts in zip(self.receive_ns.tolist(), self.stamp_ns.tolist(),
                                               self.volts.tolist()):
            while volts and math.isnan(volts[-1]):
                volts.pop()
            yield Received(receive_ns, 'tire_samples',
                           TireSample(stamp_ns, self.wheel, tuple(volts)))


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Tables):
    """
    Measurements of one drive.

    ``order`` (N,) gives the device of each sample in order of reception: 0 the IMU, 1 the wheels,
    2 and more the ``films`` in their order. By default it follows from ``receive_ns``. Raises
    ParameterError if it does not fit the streams, or if films have another wheel than their key.

    * ``films``: wheel -> its films
    * ``warnings``: what could not be read
    * ``params``: with which it was recorded or simulated, if known
    """

    imu: ImuData
    wheels: WheelData
    films: Mapping[str, FilmData] = field(default_factory=dict)
    truth: Truth = field(default_factory=lambda: _truth(SampleArrays()))
    warnings: tuple[str, ...] = ()
    order: Instants = ABSENT
    params: Params | None = None

    def __post_init__(self) -> None:
        for wheel, films in self.films.items():
            if films.wheel != wheel:
                raise ParameterError(f'films[{wheel!r}] are those of {films.wheel}')
        lengths = [len(stream) for stream in self.streams]
        devices = np.repeat(np.arange(len(lengths)), lengths)
        if self.order is None:
            received = np.concatenate([stream.receive_ns for stream in self.streams])
            object.__setattr__(self, 'order', devices[np.argsort(received, kind='stable')])
        if not np.array_equal(np.sort(self.order), devices):
            raise ParameterError('order does not have one entry for each sample of the streams')

    @property
    def streams(self) -> tuple[ImuData | WheelData | FilmData, ...]:
        """IMU, wheels and films."""
        return (self.imu, self.wheels, *self.films.values())

    def tables(self) -> dict[str, Tabular]:
        """Return ``imu``, ``wheels`` and the films by name of their wheel."""
        return {'imu': self.imu, 'wheels': self.wheels, **self.films}

    @property
    def duration(self) -> float:
        """Time from the first to the last measurement [s]; 0 without measurements."""
        stamps = np.concatenate([stream.stamp_ns for stream in self.streams])
        return float(np.ptp(stamps)) / NS_PER_S if len(stamps) else 0.0

    def received(self) -> Iterator[Received]:
        """Yield the samples of all devices in order of reception."""
        streams = [stream.received() for stream in self.streams]
        for device in self.order.tolist():
            yield next(streams[device])


def _truth(samples: SampleArrays) -> Truth:
    return Truth(samples.poses(), samples.slips(), samples.frictions())


def as_recording(received: Iterable[tuple[int, str, Sample]], params: Params | None = None
                 ) -> Recording:
    """Return samples, with receive time [ns] and topic, in order of their reception."""
    samples, truth = SampleArrays(), SampleArrays()
    for receive_ns, topic, sample in received:
        (truth if topic.startswith(TRUTH) else samples).add_sample(sample, receive_ns)
    imu, wheels = samples.stream(ImuSample), samples.stream(WheelSample)
    films = samples.of(TireSample)
    return Recording(
        ImuData(imu.stamp_ns, imu['acceleration'], imu['rate'], imu['orientation'],
                imu.receive_ns),
        WheelData(wheels.stamp_ns, wheels['velocity'], wheels['position'], wheels['effort'],
                  wheels.receive_ns),
        {one.wheel: FilmData(one.stamp_ns, one.wheel, one.values, one.receive_ns)
         for one in films},
        _truth(truth), (), samples.order((imu, wheels, *films)), params)


def read_bag(path: str | Path, *, params: Params | None = None,
             remap: Mapping[str, str] | None = None) -> Recording:
    """
    Return the measurements and the ground truth in a rosbag2 bag.

    ``path`` is a rosbag2 directory, a folder that contains one, or a single file, MCAP or
    sqlite3. Topics may have a namespace or, with ``remap``, other names: ``{'imu/data':
    '/mti30/imu'}``. Recorded estimates are not read. ``Recording.params`` are ``params``, whose
    ``joints`` name the wheels, by default the parameters in the bag. A damaged bag is read up to
    the damage: ``Recording.warnings`` lists what could not be read. Raises BagError if the bag
    cannot be read at all, ParameterError if ``remap`` or a parameter in the bag is invalid.
    """
    with Bag(find_bag(Path(path)), TopicNames(remap or {})) as bag:
        if params is None and bag.parameters:
            params = Params(bag_params(bag).params)
        if params is not None:
            bag.joints = params.robot.joints
        recording = as_recording(bag.samples((*INPUTS, *TRUTHS)), params)
        return replace(recording, warnings=(
            *bag.losses.lines(), *bag.warnings, *bag.type_mismatches(), *bag.faults.lines()))


def write_bag(path: str | Path, recording: Recording) -> None:
    """
    Write the measurements and the ground truth of ``recording`` to the new bag ``path``.

    ``smart_tire analyze``, ``ros2 bag`` and ``read_bag`` read it, the latter as the same arrays to
    rounding, with the parameters of its estimators. The true pose is written as planar motion.
    Raises BagError if the folder ``path`` exists or cannot be written.
    """
    truth = recording.truth
    truths = heapq.merge(_odometry(truth.pose), _slips(truth.slip), _crossings(truth.friction),
                         key=itemgetter(0))
    params = recording.params
    with BagWriter(path, custom_data={} if params is None else {
            PARAMETERS_KEY: params.estimators.text}) as writer:
        for item in heapq.merge(recording.received(), truths, key=itemgetter(0)):
            writer.write_sample(item.topic, item.receive_ns, item.sample)


def _odometry(pose: PoseEstimate) -> Iterator[Received]:
    for stamp_ns, (x, y, yaw), (v_x, v_y, rate), covariance, sigma in zip(
            pose.stamp_ns.tolist(), pose.pose.tolist(), pose.twist.tolist(), pose.covariance,
            pose.twist_sigma):
        known = not math.isnan(rate)
        linear, angular = ((v_x, v_y, 0.0), (0.0, 0.0, rate)) if known else (ZERO, ZERO)
        yield Received(stamp_ns, 'ground_truth/odom', Odometry(
            stamp_ns, (x, y, 0.0), quaternion(0.0, 0.0, yaw), linear, angular,
            _six_by_six({(i, j): covariance[i, j] for i in range(3) for j in range(3)}),
            _six_by_six({(i, i): sigma[i]**2 for i in range(3)} if known else {(0, 0): -1.0})))


def _six_by_six(entries: dict[tuple[int, int], float]) -> tuple[float, ...]:
    """Return the covariance of ROS with ``entries`` (row, column) of x, y and yaw."""
    numbers = [0.0] * 36
    for (row, column), value in entries.items():
        numbers[6 * PLANAR[row] + PLANAR[column]] = float(value)
    return tuple(numbers)


def _slips(slip: SlipEstimate) -> Iterator[Received]:
    def fours(values: Array) -> list[Four]:
        return [cast(Four, tuple(row)) for row in values.tolist()]

    for stamp_ns, ratio, velocity, sigma in zip(
            slip.stamp_ns.tolist(), fours(slip.ratio), fours(slip.velocity), fours(slip.sigma)):
        yield Received(stamp_ns, 'ground_truth/wheel_slip',
                       WheelSlip(stamp_ns, ratio, velocity, sigma))


def _crossings(friction: FrictionEstimate) -> Iterator[Received]:
    quantities = {name: getattr(friction, name) for name in FRICTION_QUANTITIES}
    for i, (stamp_ns, wheel) in enumerate(zip(friction.stamp_ns.tolist(),
                                              friction.wheel.tolist())):
        yield Received(stamp_ns, 'ground_truth/tire_friction', Friction(stamp_ns, wheel, **{
            name: Uncertain(float(one.value[i]), float(one.sigma[i]))
            for name, one in quantities.items()}))
