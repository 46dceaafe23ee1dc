# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Straight segments of a recording: samples of the IMU around the wheel intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from smart_tire.calibration.recording import ImuRecord, WheelRecord
from smart_tire.calibration.straight_segments import MAX_SEGMENT_INTERVALS, straight_segments
from smart_tire.numerics.robust import noise_level
from smart_tire.parameters import RobotParams
from support.driving import STEP
from support.identifying import recorded, turning_run
from support.straight import CONCRETE, motion, oscillation, straight_run

ROBOT = RobotParams()


def without(recording, begin, end):
    """Return a recording without IMU samples between two times [s]."""
    imu = recording.imu
    received = (imu.time < begin) | (imu.time > end)
    return replace(recording, imu=ImuRecord(
        imu.time[received], imu.rate[received], imu.force[received]))


def stop_and_go(time):
    """Return the oscillating speed with a standstill from 8 to 11 s."""
    return 0.0 if 8.0 < time < 11.0 else oscillation(time)


def test_a_start_and_the_drive_after_it_are_one_segment_with_the_standstill_before():
    segment, = straight_segments(straight_run(CONCRETE, 1), ROBOT)
    assert segment.stamps[0] < 0.5 and segment.stamps[-1] > 19.5
    rolling, _ = motion(CONCRETE)
    middle = 0.5 * (segment.stamps[1:] + segment.stamps[:-1])
    assert segment.speed == pytest.approx(rolling[(middle / STEP).astype(int)], abs=0.1)
    assert segment.stationary[12:50].all() and not segment.stationary[200:].any()


def test_the_samples_cover_all_intervals():
    segment, = straight_segments(straight_run(CONCRETE, 1), ROBOT)
    assert segment.time[0] < segment.stamps[0] and segment.time[-1] > segment.stamps[-1]
    assert segment.noise == pytest.approx(ROBOT.imu.accel_noise, rel=0.1)
    speed = motion(CONCRETE)[1][(segment.time / STEP).astype(int)]
    fitted = np.polyfit(segment.time, cumulative_trapezoid(
        segment.force, segment.time, initial=0.0) - speed, 1)
    assert abs(fitted[0]) < 0.1  # m/s2, bias
    assert 0 < len(segment.resting) < 0.1 * len(segment.distance)
    assert segment.stationary[segment.resting].all()


def test_a_body_settles_after_a_stop():
    recording = straight_run(CONCRETE, 6, pace=stop_and_go)
    segment, = straight_segments(recording, ROBOT)
    still = segment.time[segment.stationary]
    assert not ((still > 7.0) & (still < 8.3)).any()
    assert ((still > 9.0) & (still < 10.5)).any()


def test_turns_and_standstill_have_no_straight_segment():
    assert straight_segments(straight_run(CONCRETE, 1, pace=lambda time: 0.0), ROBOT) == []
    turning = straight_segments(recorded(turning_run(1, 20.0, turn=0.6)), ROBOT)
    assert sum((np.abs(segment.speed) > 0.2).sum() for segment in turning) < 40


def test_an_imu_gap_ends_a_segment():
    segments = straight_segments(without(straight_run(CONCRETE, 2), 10.0, 10.3), ROBOT)
    assert len(segments) == 2
    assert segments[0].stamps[-1] < 10.0 and segments[1].stamps[0] > 10.3


def test_a_missing_wheel_sample_ends_a_segment():
    recording = straight_run(CONCRETE, 2, positions=False)
    wheels = recording.wheels
    received = np.arange(len(wheels.time)) != 200
    segments = straight_segments(replace(recording, wheels=WheelRecord(
        wheels.time[received], wheels.velocity[received], None)), ROBOT)
    assert len(segments) == 2


def test_long_segments_are_split():
    segments = straight_segments(
        straight_run(CONCRETE, 4, seconds=140.0), ROBOT)
    assert len(segments) == 2
    assert max(len(segment.distance) for segment in segments) == MAX_SEGMENT_INTERVALS


def test_a_high_wheel_rate_gives_merged_intervals():
    segment = straight_segments(straight_run(CONCRETE, 5, wheel_rate=200.0), ROBOT)[0]
    assert np.median(np.diff(segment.stamps)) == pytest.approx(0.05, abs=0.006)


def test_white_noise_is_separated_from_slow_changes():
    rng = np.random.default_rng(1)
    slow = 5.0 * np.sin(np.arange(5000) / 100.0)
    assert noise_level(slow + rng.normal(0.0, 0.3, 5000), 2) == pytest.approx(0.3, rel=0.05)
    assert noise_level(np.array([1.0, 2.0]), 2) == 0.0
