# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recordings for the calibrations, read from bags."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Instants
from smart_tire.bags import Bag, STANDARD_NAMES, TopicNames
from smart_tire.calibration.priors import LIMITS, PRIORS
from smart_tire.calibration.recording import (
    CalibrationRecording, DutyRecord, ImuRecord, PoseRecord, WheelRecord)
from smart_tire.errors import BagError, EstimatorError
from smart_tire.estimates import PoseEstimate
from smart_tire.estimation.streams import SLIP
from smart_tire.parameters import RobotParams
from smart_tire.recording import seconds, Stream
from smart_tire.samples import ImuSample, MotorCommand, WheelSample

REFERENCES = ('ground_truth/odom', 'overhead/odom')  # in order of preference
NO_REFERENCE, ANY_REFERENCE = 'none', 'any'
MIN_READINGS = 20  # of each input


@dataclass(frozen=True)
class TimeRange:
    """Part of a bag [s], counted from the first input message."""

    since: float = 0.0
    until: float = math.inf


def read_recording(path: Path, robot: RobotParams, time_range: TimeRange,
                   reference: str = NO_REFERENCE, *, duties: bool = False,
                   names: TopicNames = STANDARD_NAMES) -> CalibrationRecording:
    """
    Return the inputs of a bag, in axes of ``base_link``, and the reference poses.

    ``reference`` is the topic of reference poses; by default none is used, and ``ANY_REFERENCE``
    is the first of ``REFERENCES`` that is recorded. ``names`` are topics with other names in the
    bag. Raises BagError if the bag cannot be read, EstimatorError if it lacks the inputs.
    With ``duties`` also those in ``motor_commands``, if they are recorded.
    """
    with Bag(path, names, robot.joints) as bag:
        topic = reference_topic(bag, reference)
        wanted = (*SLIP.inputs.values(), *([topic] if topic else []),
                  *(['motor_commands'] if duties else []))
        recording = bag.recording(wanted)
    imu, wheels = (recording.stream(kind).ordered for kind in (ImuSample, WheelSample))
    for name, stream in (('imu/data', imu), ('wheel_states', wheels)):
        if len(stream) < MIN_READINGS:
            raise EstimatorError(
                f'{path}: {len(stream)} messages on {name}, expected at least {MIN_READINGS}')
    origin = int(min(imu.stamp_ns[0], wheels.stamp_ns[0]))
    imu, wheels = (stream.where(_in_range(stream.stamp_ns, origin, time_range))
                   for stream in (imu, wheels))
    return CalibrationRecording(
        ImuRecord.of(imu, origin, robot), WheelRecord.of(wheels, origin),
        _pose_record(recording.poses(), origin, time_range) if topic else None,
        _duty_record(recording.stream(MotorCommand).ordered, origin))


def known(robot: RobotParams, given: Collection[str]) -> RobotParams:
    """
    Return the robot with what is known of it if only the parameters ``given`` are.

    Its defaults are those of another robot: the IMU may be anywhere, the center of mass as far
    from ``base_link`` as the center of rotation, and the yaw inertia is in proportion to mass and
    squared dimensions.
    """
    if 'imu.position' not in given and 'imu.position_sigma' not in given:
        robot = replace(robot, imu=replace(
            robot.imu, position_sigma=PRIORS['position of the IMU'].sigma))
    if not {'center_of_mass', 'center_of_mass_sigma'} & set(given):
        robot = replace(robot, center_of_mass_sigma=tuple(
            LIMITS['S'].sigma * size for size in (robot.wheelbase, robot.track_width)))
    if 'yaw_inertia' not in given:
        default = RobotParams()
        robot = replace(robot, yaw_inertia=default.yaw_inertia * _inertia_scale(
            robot) / _inertia_scale(default))
    return robot


def _inertia_scale(robot: RobotParams) -> float:
    return robot.mass * (robot.track_width ** 2 + robot.wheelbase ** 2)


def check_all_measured(robot: RobotParams, quantity: str) -> None:
    """Raise EstimatorError if a wheel is not measured: its force is unknown."""
    if not all(robot.joints.measured):
        raise EstimatorError(f'{quantity}: the forces of all wheels are needed, but a wheel is '
                             'not measured (empty joints.*)')


def reference_topic(bag: Bag, requested: str) -> str | None:
    """Return the topic of the reference poses, or None."""
    if requested == NO_REFERENCE:
        return None
    names = REFERENCES if requested == ANY_REFERENCE else (requested.strip('/'),)
    available = bag.match(names)
    if not available:
        raise BagError(f'{bag.path}: has no {" or ".join(names)}, expected one of '
                       f'{", ".join(REFERENCES)}')
    return next((name for name in names if name in available), None)


def _in_range(stamps: Instants, origin: int, time_range: TimeRange) -> NDArray[np.bool_]:
    time = seconds(stamps, origin)
    return (time >= time_range.since) & (time <= time_range.until)


def _duty_record(commands: Stream, origin: int) -> DutyRecord | None:
    """Return the duties of the whole bag: the one before a time range is still in force."""
    if not len(commands):
        return None
    return DutyRecord(seconds(commands.stamp_ns, origin), commands['duty'])


def _pose_record(poses: PoseEstimate, origin: int, time_range: TimeRange) -> PoseRecord | None:
    chosen = _in_range(poses.stamp_ns, origin, time_range)
    if chosen.sum() < MIN_READINGS:
        return None
    return PoseRecord(seconds(poses.stamp_ns[chosen], origin), poses.pose[chosen, :2],
                      poses.pose[chosen, 2])
