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
Straight segments of a recording: specific force and rolled distances on one time grid.

A segment is a contiguous interval without turns, with standstill before, within and after it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import (
    CalibrationRecording, covered, Indices, Mask, MAX_IMU_GAP, period, Signal, wheel_intervals,
    WheelIntervals)
from smart_tire.calibration.sensor_noise import stationary_intervals
from smart_tire.numerics.robust import noise_level
from smart_tire.parameters import RobotParams

MIN_INTERVAL = 0.05    # s; shorter intervals between wheel samples are merged
MIN_SPEED = 0.2        # m/s; at lower speeds the brush model does not apply: static friction
MAX_TURN_SHARE = 0.05  # of the speed: lateral speed, or half the difference of the sides
MAX_TURN_SPEED = 0.02  # m/s, of the same at low speed, where noise dominates
STANDSTILL_SPEED = 0.002    # m/s, of stationary wheels
SETTLING_TIME = 0.4         # s after the wheels have stopped, until the body is stationary
MAX_STANDSTILL = 2.0        # s, before and after the motion of a segment
MIN_SEGMENT_INTERVALS = 6   # in motion
MAX_SEGMENT_INTERVALS = 2000
GRID_MARGIN = 0.06          # s of IMU samples before and after the wheel intervals


@dataclass(frozen=True)
class StraightSegment:
    """
    One segment: m samples of the IMU, n intervals of the wheels.

    The intervals are contiguous: interval i is between the timestamps i and i + 1.
    """

    time: Array        # (m,) s
    force: Array       # (m,) m/s2, forward specific force
    noise: float       # m/s2, standard deviation of ``force``
    stamps: Array      # (n + 1,) s, of the wheels, without the configured latency
    distance: Array    # (n,) m, rolled by the mean of the four wheels
    stationary: Mask   # (m,) whether the robot is stationary for certain

    @property
    def speed(self) -> Array:
        """Return the mean wheel speed [m/s] of each interval, shape (n,)."""
        return self.distance / np.diff(self.stamps)

    @property
    def resting(self) -> Indices:
        """Return samples at rest, one for each wheel interval."""
        still = np.flatnonzero(self.stationary)
        return still[::max(1, round(len(self.time) / len(self.distance)))]


def straight_segments(recording: CalibrationRecording,
                      robot: RobotParams) -> list[StraightSegment]:
    """Return the straight segments of a recording."""
    intervals = wheel_intervals(recording.wheels, MIN_INTERVAL)
    speed = robot.wheel_radius * intervals.sides.mean(axis=1)
    straight = _is_straight(intervals, speed, recording, robot)
    return [_segment(intervals.where(rows), speed[rows], recording, robot)
            for rows in _contiguous(straight, intervals, speed)]


def _is_straight(intervals: WheelIntervals, speed: Array, recording: CalibrationRecording,
                 robot: RobotParams) -> Mask:
    """Return a mask of intervals that are covered by IMU samples and straight."""
    sides = robot.wheel_radius * intervals.sides
    half_difference = 0.5 * np.abs(sides[:, 1] - sides[:, 0])
    imu = recording.imu
    rate = Signal(imu.time, imu.rate[:, 2] - float(np.median(imu.rate[:, 2])))
    begin, end = (time - robot.encoder.latency for time in (intervals.begin, intervals.end))
    lever = 0.5 * math.hypot(robot.wheelbase, robot.track_width)
    lateral_speed = lever * np.abs(rate.mean(begin, end))
    limit = np.maximum(MAX_TURN_SHARE * np.abs(speed), MAX_TURN_SPEED)
    margin = MAX_IMU_GAP + GRID_MARGIN
    return covered(imu.time, begin - margin, end + margin, MAX_IMU_GAP) & (
        half_difference < limit) & (lateral_speed < limit)


def _contiguous(straight: Mask, intervals: WheelIntervals, speed: Array) -> Iterator[Indices]:
    """Yield the indices of contiguous straight intervals, with little standstill at their ends."""
    breaks = np.flatnonzero(~(straight[1:] & straight[:-1] & (
        intervals.begin[1:] == intervals.end[:-1]))) + 1
    for part in np.split(np.arange(len(straight)), breaks):
        moving = part[np.abs(speed[part]) > MIN_SPEED]
        if straight[part[0]] and len(moving) >= MIN_SEGMENT_INTERVALS:
            near = (intervals.end[part] > intervals.begin[moving[0]] - MAX_STANDSTILL) & (
                intervals.begin[part] < intervals.end[moving[-1]] + MAX_STANDSTILL)
            for first in range(0, int(near.sum()), MAX_SEGMENT_INTERVALS):
                rows = part[near][first:first + MAX_SEGMENT_INTERVALS]
                if (np.abs(speed[rows]) > MIN_SPEED).sum() >= MIN_SEGMENT_INTERVALS:
                    yield rows


def _segment(intervals: WheelIntervals, speed: Array, recording: CalibrationRecording,
             robot: RobotParams) -> StraightSegment:
    stamps = np.append(intervals.begin, intervals.end[-1]) - robot.encoder.latency
    imu, force = recording.imu, recording.forward_force(robot.imu.position[0])
    inside = (imu.time > stamps[0] - GRID_MARGIN) & (imu.time < stamps[-1] + GRID_MARGIN)
    time, force = imu.time[inside], force[inside]
    noise = max(robot.imu.accel_noise, noise_level(force, 3))
    return StraightSegment(time, force, noise, stamps, speed * intervals.duration,
                           _stationary(time, recording, robot))


def _stationary(time: Array, recording: CalibrationRecording, robot: RobotParams) -> Mask:
    """Return a mask of the times at which the robot is stationary."""
    wheels, stationary = recording.wheels, np.zeros(len(time), bool)
    for begin, end in stationary_intervals(wheels, robot, STANDSTILL_SPEED):
        begin += SETTLING_TIME if begin > wheels.time[0] else 0.0
        # without the last period: the robot may start to move in it
        stationary |= (time > begin - robot.encoder.latency) & (
            time <= end - period(wheels.time) - robot.encoder.latency)
    return stationary
