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

"""What the checks read: samples as received, with receive times, frames and rejected messages."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smart_tire.analysis.series import Floats, seconds, Stamps
from smart_tire.bags import Bag
from smart_tire.bags.cdr import Decoder
from smart_tire.calibration.recording import ImuRecord, Recording, WheelRecord
from smart_tire.calibration.robot.wheel_latency import fit_yaw_rate, YawRateFit
from smart_tire.errors import EstimatorError, MessageError
from smart_tire.messages import TOPICS
from smart_tire.parameters import RobotParams
from smart_tire.rotation import matrix
from smart_tire.samples import (
    BatterySample, ImuSample, MotorCommand, NS_PER_S, Sample, TireSample, WheelSample)

READ = ('imu/data', 'wheel_states', 'tire_samples', 'tire_battery', 'motor_commands', 'cmd_vel')
REST_MARGIN = 1.0  # s before and after motion in which the body may settle
PROGRESS_MESSAGES = 1000  # between two reports of progress
MIN_READINGS = 20  # of IMU and wheels, for the checks of the motion
NOT_MEASURED = (math.nan,) * 4
VALUES: dict[type, Callable[[Any], tuple[float, ...]]] = {
    ImuSample: lambda sample: (*sample.rate, *sample.acceleration),
    WheelSample: lambda sample: (*sample.velocity, *(sample.position or NOT_MEASURED),
                                 *(sample.effort or NOT_MEASURED)),
    TireSample: lambda sample: sample.volts,
    BatterySample: lambda sample: (sample.volts,),
    MotorCommand: lambda sample: sample.duty,
}


@dataclass(frozen=True)
class Stream:
    """Messages of one topic (and wheel) in the order of their reception."""

    topic: str
    wheel: str          # '' unless several wheels share the topic
    stamp_ns: Stamps    # (n,)
    receive_ns: Stamps  # (n,)
    values: Floats      # (n, width), see ``VALUES``

    @property
    def name(self) -> str:
        """Return topic and wheel."""
        return f'{self.topic} of {self.wheel}' if self.wheel else self.topic

    @cached_property
    def ordered(self) -> tuple[Stamps, Floats]:
        """Return timestamps and values in the order of the timestamps, of equal ones the last."""
        order = np.argsort(self.stamp_ns, kind='stable')
        stamps, values = self.stamp_ns[order], self.values[order]
        last = np.append(np.diff(stamps) > 0, True)[:len(stamps)]
        return stamps[last], values[last]

    @cached_property
    def period(self) -> float:
        """Return the median period [s] of the timestamps; NaN for fewer than two."""
        stamps, _ = self.ordered
        return float(np.median(np.diff(stamps))) / NS_PER_S if len(stamps) > 1 else math.nan


@dataclass(frozen=True, eq=False)
class CheckedRecording:
    """Input of the checks."""

    robot: RobotParams
    streams: dict[tuple[str, str], Stream]         # (topic, wheel) -> messages
    names: dict[str, str]                          # standard name -> name in the recording
    frames: dict[str, Counter[str]] = field(default_factory=dict)  # topic -> header.frame_id
    rejected: Counter[str] = field(default_factory=Counter)        # topic -> invalid messages
    reasons: dict[str, str] = field(default_factory=dict)          # topic -> first reason
    problems: tuple[str, ...] = ()                 # damage of the bag, other message types
    live: bool = False                             # a few seconds of a running robot

    def of(self, topic: str) -> list[Stream]:
        """Return the streams of ``topic``, by wheel."""
        return [stream for key, stream in sorted(self.streams.items()) if key[0] == topic]

    @property
    def imu(self) -> Stream | None:
        """Return the stream of the IMU."""
        return self.streams.get(('imu/data', ''))

    @property
    def wheels(self) -> Stream | None:
        """Return the stream of the wheels."""
        return self.streams.get(('wheel_states', ''))

    @cached_property
    def origin_ns(self) -> int:
        """Return the first timestamp that is not zero."""
        return min((int(stream.stamp_ns[stream.stamp_ns > 0].min())
                    for stream in self.streams.values() if (stream.stamp_ns > 0).any()), default=0)

    @cached_property
    def motion(self) -> Recording | None:
        """Return IMU, in axes of ``base_link``, and wheels; None without enough of both."""
        imu, wheels = self.imu, self.wheels
        if imu is None or wheels is None or min(len(imu.ordered[0]),
                                                len(wheels.ordered[0])) < MIN_READINGS:
            return None
        turn = matrix(*self.robot.imu.rotation)
        stamps, values = imu.ordered
        record = ImuRecord(seconds(stamps, self.origin_ns), values[:, :3] @ turn.T,
                           values[:, 3:] @ turn.T)
        stamps, values = wheels.ordered
        angles, torques = values[:, 4:8], values[:, 8:]
        return Recording(record, WheelRecord(
            seconds(stamps, self.origin_ns), values[:, :4],
            None if np.isnan(angles).any() else angles,
            None if np.isnan(torques).all() else torques))

    @cached_property
    def yaw_rate_fit(self) -> YawRateFit | None:
        """Return wheel latency and effective track; None if not observable."""
        try:
            return None if self.motion is None else fit_yaw_rate(self.motion, self.robot)
        except EstimatorError:
            return None

    @cached_property
    def stationary(self) -> NDArray[np.bool_]:
        """Return a mask of the IMU samples, sorted, at standstill; all False without wheels."""
        if self.motion is None:
            return np.zeros(0 if self.imu is None else len(self.imu.ordered[0]), bool)
        wheels, limit = self.motion.wheels, self.robot.slip.standstill_speed
        moving = wheels.time[np.abs(wheels.velocity).max(axis=1) * self.robot.wheel_radius > limit]
        if not len(moving):
            return np.ones(len(self.motion.imu.time), bool)
        nearest = np.searchsorted(moving, self.motion.imu.time)
        after = moving[np.minimum(nearest, len(moving) - 1)]
        before = moving[np.maximum(nearest - 1, 0)]
        time = self.motion.imu.time
        inside = (time >= wheels.time[0]) & (time <= wheels.time[-1])
        return np.asarray(inside & (np.minimum(
            np.abs(time - before), np.abs(after - time)) > REST_MARGIN))


class Collector:
    """Collects messages for ``CheckedRecording``."""

    def __init__(self) -> None:
        self.frames: dict[str, Counter[str]] = {}
        self.rejected: Counter[str] = Counter()
        self.reasons: dict[str, str] = {}
        self.names: dict[str, str] = {}
        self._decoders = {name: Decoder(TOPICS[name].type) for name in READ}
        self._tables: dict[tuple[str, str, int], tuple[array[int], array[int], array[float]]] = {}

    def add_message(self, topic: str, receive_ns: int, data: bytes) -> None:
        """Add a serialized message of the standard name ``topic``, one of ``READ``."""
        try:
            msg = self._decoders[topic](data)
            self.frames.setdefault(topic, Counter())[msg.header.frame_id] += 1
            sample = TOPICS[topic].from_msg(msg)
        except MessageError as error:
            self.rejected[topic] += 1
            self.reasons.setdefault(topic, str(error))
        else:
            self.add(topic, receive_ns, sample)

    def add(self, topic: str, receive_ns: int, sample: Sample) -> None:
        """Add a sample."""
        values = VALUES[type(sample)](sample) if type(sample) in VALUES else ()
        wheel = sample.wheel if isinstance(sample, (TireSample, BatterySample)) else ''
        key = topic, wheel, len(values)
        if key not in self._tables:
            self._tables[key] = array('q'), array('q'), array('d')
        stamps, received, rows = self._tables[key]
        stamps.append(sample.stamp_ns)
        received.append(receive_ns)
        rows.extend(values)

    def streams(self) -> dict[tuple[str, str], Stream]:
        """Return (topic, wheel) -> messages; of several film counts the most frequent one."""
        found: dict[tuple[str, str], Stream] = {}
        for (topic, wheel, width), (stamps, received, rows) in sorted(
                self._tables.items(), key=lambda item: len(item[1][0])):
            found[topic, wheel] = Stream(
                topic, wheel, np.array(stamps, np.int64), np.array(received, np.int64),
                np.array(rows, np.float64).reshape(len(stamps), width))
        return found

    def recording(self, robot: RobotParams, problems: tuple[str, ...] = (), *,
                  live: bool = False) -> CheckedRecording:
        """Return what was collected."""
        return CheckedRecording(robot, self.streams(), self.names, self.frames, self.rejected,
                                self.reasons, problems, live)


def read(bag: Bag, robot: RobotParams, progress: Callable[[float], None] = lambda share: None
         ) -> CheckedRecording:
    """Return what the checks need of ``bag``, which is read once."""
    collector = Collector()
    collector.names = bag.match(TOPICS)
    wanted = {collector.names[name]: name for name in READ if name in collector.names}
    start, end = bag.span_ns
    for count, (receive_ns, channel, data) in enumerate(bag.replayable(list(wanted))):
        collector.add_message(wanted[channel.topic], receive_ns, data)
        if count % PROGRESS_MESSAGES == 0:
            progress((receive_ns - start) / max(1, end - start))
    problems = (*(f'{text}: not read' for text in bag.type_mismatches()), *bag.warnings)
    return collector.recording(robot, problems)
