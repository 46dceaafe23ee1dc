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
A recording as arrays: one stream per type of sample, and per wheel where wheels share a topic.

Whatever the samples are from (a bag, live topics, the simulator, an estimator), they are added one
by one in the order of their reception. Ground truth is a recording of its own, because its samples
are of the same types as the estimates.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
import math
import mmap
from operator import itemgetter
import os
from tempfile import gettempdir, TemporaryFile
from typing import Any, cast, IO, NamedTuple
import weakref

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array, Instants
from smart_tire.errors import BagError
from smart_tire.estimates import (
    FrictionEstimate, GroundEstimate, PoseEstimate, Quantity, RotationCenter, SlipEstimate)
from smart_tire.rotation import yaw_of
from smart_tire.samples import (
    BatterySample, Friction, FRICTION_QUANTITIES, GROUND_ESTIMATES, GroundState, Icr, ImuSample,
    MotorCommand, NS_PER_S, Odometry, PLANAR, PLANAR_COVARIANCE, Sample, TireSample,
    VelocityCommand, WheelSample, WheelSlip)

UNKNOWN_FOUR = (math.nan,) * 4
PLANAR_COVARIANCES = itemgetter(*PLANAR_COVARIANCE)  # of the 36 numbers of ROS
PLANAR_VARIANCES = itemgetter(*(7 * row for row in PLANAR))
MAX_IN_MEMORY = 1 << 20  # bytes of an array: recordings of minutes need no files

Row = Sequence[float]


def _odometry_row(sample: Odometry) -> Row:
    pose, twist = sample.pose_covariance, sample.twist_covariance
    known = twist[0] != -1.0
    return (*sample.position[:2], yaw_of(sample.orientation),
            *((*sample.linear[:2], sample.angular[2]) if known else (math.nan,) * 3),
            *PLANAR_COVARIANCES(pose), *(PLANAR_VARIANCES(twist) if known else (math.nan,) * 3))


def _ground_row(sample: GroundState) -> Row:
    estimates = [getattr(sample, name) for name in GROUND_ESTIMATES]
    return (*(one.value for one in estimates), *(one.sigma for one in estimates),
            sample.friction_common_sigma, sample.change_age_left, sample.change_age_right)


class Layout(NamedTuple):
    """Numbers of a sample; NaN is what is not measured."""

    topic: str
    columns: Mapping[str, int]  # name -> width
    row: Callable[[Any], Row]


LAYOUTS: dict[type, Layout] = {
    ImuSample: Layout(
        'imu/data', {'acceleration': 3, 'rate': 3, 'orientation': 4}, lambda sample: (
            *sample.acceleration, *sample.rate, *(sample.orientation or UNKNOWN_FOUR))),
    WheelSample: Layout(
        'wheel_states', {'velocity': 4, 'position': 4, 'effort': 4}, lambda sample: (
            *sample.velocity, *(sample.position or UNKNOWN_FOUR),
            *(sample.effort or UNKNOWN_FOUR))),
    TireSample: Layout('tire_samples', {}, lambda sample: sample.volts),  # a column per film
    BatterySample: Layout('tire_battery', {'volts': 1}, lambda sample: (sample.volts,)),
    VelocityCommand: Layout(
        'cmd_vel', {'v_x': 1, 'yaw_rate': 1}, lambda sample: (sample.v_x, sample.yaw_rate)),
    MotorCommand: Layout('motor_commands', {'duty': 4}, lambda sample: sample.duty),
    Odometry: Layout(
        'odom', {'pose': 3, 'twist': 3, 'covariance': 9, 'variance': 3}, _odometry_row),
    WheelSlip: Layout(
        'wheel_slip', {'ratio': 4, 'sigma': 4, 'velocity': 4},
        lambda sample: sample.ratio + sample.sigma + sample.slip_velocity),
    Icr: Layout('icr', {'position': 2}, lambda sample: (sample.x, sample.y)),
    GroundState: Layout(
        'ground_state', {**dict.fromkeys(('value', 'sigma'), len(GROUND_ESTIMATES)),
                         'friction_common_sigma': 1, 'change_age': 2}, _ground_row),
}


@dataclass(frozen=True, eq=False)
class Stream:
    """Samples of one type (and wheel) in the order of their reception."""

    kind: type
    wheel: str            # '' unless wheels share the topic
    stamp_ns: Instants    # (n,)
    receive_ns: Instants  # (n,)
    values: Array         # (n, width), see ``LAYOUTS``

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def __getitem__(self, name: str) -> Array:
        """Return the columns ``name`` of the values, shape (n, width)."""
        columns, first = LAYOUTS[self.kind].columns, 0
        for other, width in columns.items():
            if other == name:
                return self.values[:, first:first + width]
            first += width
        raise KeyError(name)

    @property
    def topic(self) -> str:
        """Return the standard topic of the samples."""
        return LAYOUTS[self.kind].topic

    @property
    def name(self) -> str:
        """Return topic and wheel."""
        return f'{self.topic} of {self.wheel}' if self.wheel else self.topic

    def where(self, rows: Any) -> Stream:
        """Return the samples of ``rows``, an index or a mask."""
        return Stream(self.kind, self.wheel, self.stamp_ns[rows], self.receive_ns[rows],
                      self.values[rows])

    @property
    def ordered(self) -> Stream:
        """Return the samples in the order of their timestamps, of equal ones the last."""
        return self if (np.diff(self.stamp_ns) > 0).all() else self._sorted

    @cached_property
    def _sorted(self) -> Stream:
        order = np.argsort(self.stamp_ns, kind='stable')
        stamps = self.stamp_ns[order]
        return self.where(order[np.append(np.diff(stamps) > 0, True)[:len(stamps)]])

    @cached_property
    def complete(self) -> Stream:
        """Return the samples with as many numbers as most have, and no columns for more."""
        counts = np.sum(~np.isnan(self.values), axis=1)
        if not len(self) or counts.min() == self.values.shape[1]:
            return self
        count = int(np.bincount(counts).argmax())
        found = self.where(counts == count)
        return Stream(self.kind, self.wheel, found.stamp_ns, found.receive_ns,
                      found.values[:, :count])

    @cached_property
    def period(self) -> float:
        """Return the median period [s] of the timestamps; NaN for fewer than two."""
        stamps = self.ordered.stamp_ns
        return float(np.median(np.diff(stamps))) / NS_PER_S if len(stamps) > 1 else math.nan


class Column:
    """Growing array, in a temporary file if it is large: memory does not grow with a recording."""

    def __init__(self, rows: NDArray[Any]) -> None:
        self.rows = rows[:0]
        self._file: IO[bytes] | None = None
        self.extend(rows)

    def __getstate__(self) -> dict[str, Any]:
        return {'rows': self.rows, '_file': None}

    def extend(self, rows: NDArray[Any]) -> None:
        """Append ``rows`` (n, ...) of the same dtype; raise BagError if the disk is full."""
        before, size = self.rows, self.rows.nbytes + rows.nbytes
        if size <= MAX_IN_MEMORY:
            self.rows = np.concatenate([before, rows]) if len(before) else rows
            return
        try:
            if self._file is None:
                self._file = TemporaryFile(buffering=0)  # noqa: SIM115 (as long as the column)
                weakref.finalize(self, self._file.close)
                self._file.write(before.tobytes())
            os.posix_fallocate(self._file.fileno(), 0, size)  # or raises OSError
            self._file.write(rows.tobytes())
            memory = mmap.mmap(self._file.fileno(), size, access=mmap.ACCESS_COPY)
        except OSError as error:
            raise BagError(f'{gettempdir()}: {size / 1e6:.0f} MB of a recording cannot be kept '
                           f'there ({error.strerror})') from error
        self.rows = np.frombuffer(memory, before.dtype).reshape(-1, *before.shape[1:])


class _Table:
    """Growing table of numbers with timestamps; a row may be longer than those before."""

    def __init__(self, kind: type, wheel: str, width: int, index: int) -> None:
        self._kind, self._wheel, self._width, self.index = kind, wheel, width, index
        self._columns = [Column(np.empty(0, np.int64)), Column(np.empty(0, np.int64)),
                         Column(np.empty((0, width)))]
        self._begin()

    def _begin(self) -> None:
        """Begin to collect rows, those after the columns."""
        self._stamps, self._received, self._values = array('q'), array('q'), array('d')
        self._stream = Stream(self._kind, self._wheel, *(one.rows for one in self._columns))

    def append(self, stamp_ns: int, receive_ns: int, row: Row) -> None:
        """Append one row; missing numbers at its end are NaN."""
        if len(row) != self._width:
            if len(row) > self._width:
                self._widen(len(row))
            row = (*row, *[math.nan] * (self._width - len(row)))
        self._stamps.append(stamp_ns)
        self._received.append(receive_ns)
        self._values.extend(row)
        if len(self._values) * self._values.itemsize > MAX_IN_MEMORY:
            self._collect()

    def _collect(self) -> None:
        for column, rows in zip(self._columns, (
                np.asarray(self._stamps), np.asarray(self._received),
                np.frombuffer(self._values).reshape(-1, self._width))):
            column.extend(rows)
        self._begin()

    def stream(self) -> Stream:
        """Return the rows as a stream, the same one until there are more."""
        if self._stamps:
            self._collect()
        return self._stream

    def _widen(self, width: int) -> None:
        before = self.stream().values
        values = np.full((len(before), width), math.nan)
        values[:, :self._width] = before
        self._width, self._columns[2] = width, Column(values)
        self._begin()


@dataclass
class Faults:
    """What is wrong with the messages of standard topics, by topic."""

    rejected: Counter[str] = field(default_factory=Counter)  # invalid messages
    reasons: dict[str, str] = field(default_factory=dict)    # why the first one is invalid
    frames: dict[str, Counter[str]] = field(default_factory=dict)  # header.frame_id
    completed: Counter[str] = field(default_factory=Counter)  # of wheel_states: ``WheelReader``
    contradictions: Counter[str] = field(default_factory=Counter)  # of imu/data: ``imu_from_msg``
    clock_steps: Sequence[str] = ()  # clocks that were set, as text
    # begin and end [ns] of times without any reception, and whether the wheels turned on
    pauses: Sequence[tuple[int, int, bool]] = ()

    def reject(self, topic: str, reason: Exception) -> None:
        """Count an invalid message."""
        self.rejected[topic] += 1
        self.reasons.setdefault(topic, str(reason))

    def lines(self) -> list[str]:
        """Return the rejected messages as text."""
        return [f'{count} messages of {topic}: rejected, first reason: {self.reasons[topic]}'
                for topic, count in self.rejected.items()]


class SampleArrays:
    """Samples as arrays; samples of other types than ``LAYOUTS`` and ``Friction`` are ignored."""

    def __init__(self, samples: Iterable[Sample] = ()) -> None:
        self.crossings: list[Friction] = []
        self._tables: dict[tuple[type, str], _Table] = {}
        self._order = array('H')  # index of its table for each sample
        for sample in samples:
            self.add_sample(sample)

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self._order) + len(self.crossings)

    def add_sample(self, sample: Sample, receive_ns: int | None = None) -> None:
        """Add a sample, by default received at its timestamp."""
        kind = type(sample)
        if kind is Friction:
            self.crossings.append(cast(Friction, sample))
        layout = LAYOUTS.get(kind)
        if layout is None:
            return
        key, row = (kind, getattr(sample, 'wheel', '')), layout.row(sample)
        table = self._tables.get(key)
        if table is None:
            table = self._tables[key] = _Table(*key, len(row), len(self._tables))
        table.append(sample.stamp_ns, sample.stamp_ns if receive_ns is None else receive_ns, row)
        self._order.append(table.index)

    def stream(self, kind: type, wheel: str = '') -> Stream:
        """Return the samples of a type (and wheel), an empty stream if there are none."""
        table = self._tables.get((kind, wheel)) or _Table(
            kind, wheel, sum(LAYOUTS[kind].columns.values()), -1)
        return table.stream()

    def order(self, streams: Sequence[Stream]) -> Instants:
        """Return the index of its stream for each sample of ``streams``, as they were received."""
        known = np.full(len(self._tables), -1)
        for index, stream in enumerate(streams):
            if (table := self._tables.get((stream.kind, stream.wheel))) is not None:
                known[table.index] = index
        found = known[np.array(self._order, np.int64)]
        return np.asarray(found[found >= 0], np.int64)

    def of(self, kind: type) -> list[Stream]:
        """Return the streams of a type that have samples, by wheel."""
        return [self.stream(kind, wheel) for wheel in self.wheels(kind)]

    def wheels(self, kind: type) -> list[str]:
        """Return the wheels with samples of a type, '' for one that is not of a wheel."""
        return sorted(wheel for other, wheel in self._tables if other is kind)

    def poses(self) -> PoseEstimate:
        """Return poses and twists."""
        found = self.stream(Odometry).ordered
        pose = found['pose'].copy()
        pose[:, 2] = np.unwrap(pose[:, 2])
        return PoseEstimate(found.stamp_ns, pose, found['twist'],
                            found['covariance'].reshape(-1, 3, 3), np.sqrt(found['variance']))

    def slips(self) -> SlipEstimate:
        """Return the slips of the four wheels."""
        found = self.stream(WheelSlip).ordered
        return SlipEstimate(found.stamp_ns, found['ratio'], found['sigma'], found['velocity'])

    def centers(self) -> RotationCenter:
        """Return the instantaneous centers of rotation."""
        found = self.stream(Icr).ordered
        return RotationCenter(found.stamp_ns, found['position'])

    def grounds(self) -> GroundEstimate:
        """Return the states of the ground."""
        found = self.stream(GroundState).ordered
        quantities = map(Quantity, found['value'].T, found['sigma'].T)
        return GroundEstimate(
            found.stamp_ns, friction_common_sigma=found['friction_common_sigma'][:, 0],
            change_age=found['change_age'], **dict(zip(GROUND_ESTIMATES, quantities)))

    def frictions(self) -> FrictionEstimate:
        """Return the patch crossings of all wheels, in order of time."""
        ordered = sorted(self.crossings, key=lambda crossing: crossing.stamp_ns)
        pairs = np.array([[one.quantity(name) for name in FRICTION_QUANTITIES]
                          for one in ordered], float).reshape(-1, len(FRICTION_QUANTITIES), 2)
        return FrictionEstimate(
            np.array([one.stamp_ns for one in ordered], np.int64),
            np.array([one.wheel for one in ordered], np.str_),
            *(Quantity(*pairs[:, i].T) for i in range(len(FRICTION_QUANTITIES))))

    def speeds(self) -> tuple[Instants, Array]:
        """Return timestamps and the four wheel speeds [rad/s]."""
        found = self.stream(WheelSample).ordered
        return found.stamp_ns, found['velocity']

    def film_wheels(self) -> list[str]:
        """Return the wheels with film samples."""
        return self.wheels(TireSample)

    def films(self, wheel: str) -> tuple[Instants, Array]:
        """Return timestamps and voltages (n, films) of ``wheel`` with the usual film count."""
        found = self.stream(TireSample, wheel).complete.ordered
        return found.stamp_ns, found.values


def seconds(stamp_ns: Instants, origin_ns: int) -> Array:
    """Return timestamps as seconds after ``origin_ns``, without loss of precision."""
    return (stamp_ns - origin_ns) / NS_PER_S
