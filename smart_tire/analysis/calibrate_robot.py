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

"""Calibration of a robot from bags: geometry, IMU, encoder latency and ICR."""

from __future__ import annotations

from dataclasses import dataclass
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from smart_tire.analysis.series import PoseSeries, seconds, Series, Stamps, Table
from smart_tire.bags import Bag, STANDARD_NAMES, TopicNames
from smart_tire.calibration.recording import (
    DutyRecord, ImuRecord, PoseRecord, Recording, WheelRecord)
from smart_tire.calibration.robot import geometry, icr
from smart_tire.calibration.robot.geometry import Geometry
from smart_tire.calibration.robot.icr import IcrFit
from smart_tire.errors import BagError, EstimatorError
from smart_tire.estimation.streams import SLIP
from smart_tire.parameters import RobotParams
from smart_tire.rotation import matrix
from smart_tire.samples import Four, ImuSample, MotorCommand, Odometry, WheelSample

REFERENCES = ('ground_truth/odom', 'overhead/odom')  # in order of preference
NO_REFERENCE, ANY_REFERENCE = 'none', 'any'
MIN_READINGS = 20  # of each input
NOT_MEASURED = (math.nan,) * 4


@dataclass(frozen=True)
class TimeRange:
    """Part of a bag [s], counted from the first input message."""

    since: float = 0.0
    until: float = math.inf


def identify_geometry(path: Path, robot: RobotParams, *, since: float = 0.0,
                      until: float = math.inf, reference: str = NO_REFERENCE,
                      names: TopicNames = STANDARD_NAMES) -> Geometry:
    """
    Return the geometry identified from the bag at ``path`` between ``since`` and ``until`` [s].

    ``reference`` is the topic of reference poses; by default none is used, and ``ANY_REFERENCE``
    is the first of ``REFERENCES`` that is recorded. ``names`` are topics with other names in the
    bag. Raises BagError if the bag cannot be read, EstimatorError if it lacks the inputs.
    """
    recording = read_recording(path, robot, TimeRange(since, until), reference, names=names)
    return geometry.identify_geometry(recording, robot)


def identify_icr(path: Path, robot: RobotParams, *, since: float = 0.0, until: float = math.inf,
                 reference: str = NO_REFERENCE, names: TopicNames = STANDARD_NAMES) -> IcrFit:
    """Return S from the bag at ``path``; EstimatorError if S is not observable."""
    recording = read_recording(path, robot, TimeRange(since, until), reference, names=names)
    return icr.identify_icr(recording, robot)


def read_recording(path: Path, robot: RobotParams, time_range: TimeRange,
                   reference: str = NO_REFERENCE, *, duties: bool = False,
                   names: TopicNames = STANDARD_NAMES) -> Recording:
    """
    Return the inputs of a bag, in axes of ``base_link``, and the reference poses.

    With ``duties`` also those in ``motor_commands``, if they are recorded.
    """
    with Bag(path, names, robot.joints) as bag:
        topic = _reference(bag, reference)
        wanted = (*SLIP.inputs.values(), *([topic] if topic else []),
                  *(['motor_commands'] if duties else []))
        imu, wheels, poses, commands = Table(6), _Wheels(), Series(), Table(4)
        for _, _, sample in bag.samples(wanted):
            if isinstance(sample, ImuSample):
                imu.add(sample.stamp_ns, (*sample.rate, *sample.acceleration))
            elif isinstance(sample, WheelSample):
                wheels.add(sample)
            elif isinstance(sample, Odometry):
                poses.add(sample)
            elif isinstance(sample, MotorCommand):
                commands.add(sample.stamp_ns, sample.duty)
    stamps, values = imu.arrays()
    for name, count in (('imu/data', len(stamps)), ('wheel_states', len(wheels))):
        if count < MIN_READINGS:
            raise EstimatorError(
                f'{path}: {count} messages on {name}, expected at least {MIN_READINGS}')
    origin = min(int(stamps[0]), wheels.first_ns)
    chosen = _in_range(stamps, origin, time_range)
    turn = matrix(*robot.imu.rotation)
    record = ImuRecord(seconds(stamps[chosen], origin), values[chosen, :3] @ turn.T,
                       values[chosen, 3:] @ turn.T)
    return Recording(record, wheels.record(origin, time_range),
                     _pose_record(poses.poses(), origin, time_range) if topic else None,
                     _duty_record(commands, origin))


def check_all_measured(robot: RobotParams, quantity: str) -> None:
    """Raise EstimatorError if a wheel is not measured: its force is unknown."""
    if not all(robot.joints.measured):
        raise EstimatorError(f'{quantity}: the forces of all wheels are needed, but a wheel is '
                             'not measured (empty joints.*)')


def _reference(bag: Bag, requested: str) -> str | None:
    """Return the topic of the reference poses, or None."""
    if requested == NO_REFERENCE:
        return None
    names = REFERENCES if requested == ANY_REFERENCE else (requested.strip('/'),)
    available = bag.match(names)
    if not available:
        raise BagError(f'{bag.path}: has no {" or ".join(names)}, expected one of '
                       f'{", ".join(REFERENCES)}')
    return next((name for name in names if name in available), None)


def _in_range(stamps: Stamps, origin: int, time_range: TimeRange) -> NDArray[np.bool_]:
    time = seconds(stamps, origin)
    return (time >= time_range.since) & (time <= time_range.until)


class _Wheels:
    """Table of wheel samples."""

    def __init__(self) -> None:
        self._speeds, self._angles, self._torques = Table(4), Table(4), Table(4)

    def __len__(self) -> int:
        return len(self._speeds)

    def add(self, sample: WheelSample) -> None:
        self._speeds.add(sample.stamp_ns, _filled(sample.velocity))
        self._angles.add(sample.stamp_ns, _filled(sample.position or NOT_MEASURED))
        self._torques.add(sample.stamp_ns, sample.effort or NOT_MEASURED)

    @property
    def first_ns(self) -> int:
        return int(self._speeds.arrays()[0][0])

    def record(self, origin: int, time_range: TimeRange) -> WheelRecord:
        stamps, speeds = self._speeds.arrays()
        angles = self._angles.arrays()[1]
        chosen = _in_range(stamps, origin, time_range)
        angles = angles[chosen]
        torques = self._torques.arrays()[1][chosen]
        return WheelRecord(seconds(stamps[chosen], origin), speeds[chosen],
                           None if np.isnan(angles).any() else angles,
                           None if np.isnan(torques).all() else torques)


def _filled(values: Four) -> Four:
    """Return ``values``, with those of the other wheel of its side for a wheel not measured."""
    a, b, c, d = (values[i - 2] if math.isnan(value) else value  # i - 2: the same side
                  for i, value in enumerate(values))
    return a, b, c, d


def _duty_record(commands: Table, origin: int) -> DutyRecord | None:
    """Return the duties of the whole bag: the one before a time range is still in force."""
    if not len(commands):
        return None
    stamps, duties = commands.arrays()
    return DutyRecord(seconds(stamps, origin), duties)


def _pose_record(poses: PoseSeries, origin: int, time_range: TimeRange) -> PoseRecord | None:
    chosen = _in_range(poses.stamp_ns, origin, time_range)
    if chosen.sum() < MIN_READINGS:
        return None
    return PoseRecord(seconds(poses.stamp_ns[chosen], origin), poses.pose[chosen, :2],
                      poses.pose[chosen, 2])
