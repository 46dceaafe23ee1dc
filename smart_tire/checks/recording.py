# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the checks read: samples as received, and what is wrong with the messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from smart_tire.bags import Bag, contents
from smart_tire.calibration.latency import fit_yaw_rate, YawRateFit
from smart_tire.calibration.recording import CalibrationRecording, ImuRecord, WheelRecord
from smart_tire.checks import limits
from smart_tire.checks.stalls import Stalls
from smart_tire.errors import EstimatorError
from smart_tire.estimation.streams import INPUTS
from smart_tire.findings import Finding, Level
from smart_tire.host_load import HostLoad
from smart_tire.messages import NANOSEC, NodeStatus, TOPICS
from smart_tire.parameters import RobotParams
from smart_tire.recording import Faults, SampleArrays, Stream
from smart_tire.samples import ImuSample, WheelSample
from smart_tire.yaml_text import load_own

STEP_SHARE = 0.7  # of the steps of timestamps that are not larger than the one that counts
READ = ('imu/data', 'wheel_states', 'tire_samples', 'tire_battery', 'motor_commands',
        'cmd_vel')
TEXTS: dict[str, dict[str, str]] = load_own(
    Path(__file__).with_name('findings.yaml').read_text(encoding='utf-8'))


def finding(name: str, where: str, level: Level | None = None, **values: object) -> Finding:
    """Return the finding ``name`` of ``findings.yaml`` with ``values`` inserted."""
    text = TEXTS[name]
    return Finding(level or Level[text['level']], where, *(
        text.get(part, '').format(**values) for part in ('found', 'expected', 'action')))


@dataclass(frozen=True, eq=False)
class CheckedRecording:
    """Input of the checks."""

    robot: RobotParams
    samples: SampleArrays
    faults: Faults = field(default_factory=Faults)
    problems: tuple[str, ...] = ()  # damage of the bag, other message types
    statuses: tuple[tuple[int, NodeStatus], ...] = ()  # timestamps [ns], diagnostics of nodes
    live: bool = False              # a few seconds of a running robot
    host: HostLoad | None = None    # of a running robot; reported elsewhere if it is late
    mended: CalibrationRecording | None = None  # IMU and wheels without the errors that were found
    radius_given: bool = True       # wheel_radius is not just the default
    other_robot: bool = False       # wheel_radius is contradicted, so others are as well
    contents: tuple[str, str] = '', 'start its driver'  # of the bag, and the way on without inputs

    def of(self, topic: str) -> list[Stream]:
        """Return the streams of ``topic``, by wheel; films without other numbers of them."""
        streams = self.samples.of(TOPICS[topic].sample)
        return [one.complete for one in streams] if topic == 'tire_samples' else streams

    @cached_property
    def imu(self) -> Stream:
        """Return the stream of the IMU."""
        return self.samples.stream(ImuSample)

    @cached_property
    def wheels(self) -> Stream:
        """Return the stream of the wheels."""
        return self.samples.stream(WheelSample)

    @cached_property
    def regular(self) -> list[Stream]:
        """Return the inputs with enough samples for a statistic."""
        return [stream for topic in INPUTS for stream in self.of(topic)
                if stream.name not in self.invalid_stamps
                and len(stream.ordered) >= limits.MIN_READINGS]

    @cached_property
    def invalid_stamps(self) -> dict[str, float]:
        """
        Return streams whose timestamps do not advance as the messages are received.

        The value is the mean time between receptions over the median step of the stamps.
        """
        found = {}
        for stream in (one for topic in INPUTS for one in self.of(topic)):
            if len(stream) < limits.MIN_READINGS or not (stream.stamp_ns > 0).all():
                continue
            if NANOSEC in self.faults.reasons.get(stream.topic, ''):
                found[stream.name] = math.nan
                continue
            received = float(np.median(np.diff(stream.receive_ns)))
            # repeated messages of a second publisher are less than half
            step = float(np.quantile(np.abs(np.diff(stream.stamp_ns)), STEP_SHARE))
            if step < limits.MIN_STAMP_STEP * received:
                found[stream.name] = received / max(step, 1.0)
        return found

    @cached_property
    def stamped(self) -> list[Stream]:
        """Return those of ``regular`` whose timestamps are set."""
        return [stream for stream in self.regular if (stream.stamp_ns > 0).all()]

    @cached_property
    def stalls(self) -> Stalls:
        """Return the stalls of the devices and of the host."""
        return Stalls(self.stamped, self.statuses, self.host, self.faults.pauses)

    @cached_property
    def origin_ns(self) -> int:
        """Return the first timestamp that is not zero."""
        return min((int(stream.stamp_ns[stream.stamp_ns > 0].min())
                    for topic in READ for stream in self.of(topic)
                    if (stream.stamp_ns > 0).any()), default=0)

    @cached_property
    def motion(self) -> CalibrationRecording | None:
        """Return IMU, in axes of ``base_link``, and wheels; None without enough of both."""
        if self.mended is not None:
            return self.mended
        imu, wheels = self.imu.ordered, self.wheels.ordered
        if self.invalid_stamps or min(len(imu), len(wheels)) < limits.MIN_READINGS:
            return None
        return CalibrationRecording(ImuRecord.of(imu, self.origin_ns, self.robot),
                                    WheelRecord.of(wheels, self.origin_ns))

    @cached_property
    def yaw_rate_fit(self) -> YawRateFit | None:
        """Return wheel latency and effective track; None if not observable."""
        try:
            fit = None if self.motion is None else fit_yaw_rate(self.motion, self.robot)
        except EstimatorError:
            return None
        # a longer delay is another turn that happens to look like this one
        return fit if fit and abs(fit.latency.value) < limits.MAX_DELAY else None

    @cached_property
    def stationary(self) -> NDArray[np.bool_]:
        """Return a mask of the IMU samples, sorted, at standstill; all False without wheels."""
        if self.motion is None:
            return np.zeros(len(self.imu.ordered), bool)
        wheels, limit = self.motion.wheels, self.robot.slip.standstill_speed
        moving = wheels.time[np.abs(wheels.velocity).max(axis=1) * self.robot.wheel_radius > limit]
        if not len(moving):
            return np.ones(len(self.motion.imu.time), bool)
        nearest = np.searchsorted(moving, self.motion.imu.time)
        after = moving[np.minimum(nearest, len(moving) - 1)]
        before = moving[np.maximum(nearest - 1, 0)]
        time = self.motion.imu.time
        inside = (time >= wheels.time[0]) & (time <= wheels.time[-1])
        following = np.clip(np.searchsorted(wheels.time, time), 1, len(wheels.time) - 1)
        inside &= wheels.time[following] - wheels.time[following - 1] < limits.REST_MARGIN
        return np.asarray(inside & (np.minimum(
            np.abs(time - before), np.abs(after - time)) > limits.REST_MARGIN))


def read(bag: Bag, robot: RobotParams, progress: Callable[[float], None] = lambda share: None,
         *, radius_given: bool = True) -> CheckedRecording:
    """Return what the checks need of ``bag``, which is read once."""
    samples = bag.recording(READ, progress, restamp=False)
    return CheckedRecording(robot, samples, bag.faults, problems_of(bag), tuple(bag.statuses()),
                            radius_given=radius_given, contents=contents(bag))


def problems_of(bag: Bag) -> tuple[str, ...]:
    """Return damage of a bag that was read, and topics of other types."""
    return (*(f'{text}: not read' for text in bag.type_mismatches()), *bag.warnings,
            *bag.losses.lines())
