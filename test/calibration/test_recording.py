# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Intervals of recordings: no overlap, and no data invented in gaps."""

from __future__ import annotations

import numpy as np
import pytest
from smart_tire.calibration.recording import PoseRecord, Signal, wheel_intervals, WheelRecord


def wheels(time, speed=2.0, positions=True):
    time = np.asarray(time)
    angle = speed * (time - time[0])[:, None] * np.ones(4)
    return WheelRecord(time, np.full((len(time), 4), speed), angle if positions else None)


@pytest.mark.parametrize('rate, min_duration', [(200.0, 0.05), (16.0, 0.05), (4.0, 0.05)])
@pytest.mark.parametrize('positions', [True, False])
def test_intervals_are_contiguous_and_long_enough(rate, min_duration, positions):
    time = np.arange(0.0, 10.0, 1.0 / rate)
    intervals = wheel_intervals(wheels(time, positions=positions), min_duration)
    assert np.all(intervals.duration > 0.99 * min_duration)
    assert np.all(intervals.duration < min_duration + 1.01 / rate)
    assert intervals.end[:-1] == pytest.approx(intervals.begin[1:])
    assert intervals.sides == pytest.approx(np.full((len(intervals.end), 2), 2.0))


def test_positions_bridge_a_lost_message_but_velocities_do_not():
    time = np.delete(np.arange(0.0, 5.0, 0.1), 20)
    bridged = wheel_intervals(wheels(time), 0.05)
    assert bridged.duration.max() == pytest.approx(0.2)
    assert wheel_intervals(wheels(time, positions=False), 0.05).duration.max() < 0.11


def test_motion_is_selected_with_a_margin():
    time = np.arange(0.0, 10.0, 0.1)
    speed = np.where((time > 4.95) & (time < 6.0), 1.0, 0.0)[:, None] * np.ones(4)
    intervals = wheel_intervals(WheelRecord(time, speed, None), 0.05)
    near = intervals.end[intervals.near_motion(0.5)]
    assert near.min() == pytest.approx(4.5) and near.max() == pytest.approx(6.4)
    assert not intervals.near_motion(2.0).any()


def test_means_of_a_signal_are_those_of_its_linear_interpolation():
    time = np.array([0.0, 1.0, 3.0])
    signal = Signal(time, np.array([0.0, 2.0, 2.0]))
    assert signal.mean(np.array([0.0, 0.0, 1.5]), np.array([1.0, 3.0, 2.0])) == pytest.approx(
        [1.0, 5.0 / 3.0, 2.0])
    assert signal.centered_mean(np.array([0.5]), 0.5) == pytest.approx([1.0])


def test_intervals_of_poses_restart_after_a_gap():
    time = np.concatenate([np.arange(0.0, 3.05, 0.1), np.arange(5.0, 8.05, 0.1)])
    record = PoseRecord(time, np.zeros((len(time), 2)), np.zeros(len(time)))
    ends = [(time[a], time[b]) for a, b in zip(*record.intervals(1.45))]
    assert np.array(ends) == pytest.approx(np.array(
        [(0.0, 1.5), (1.5, 3.0), (5.0, 6.5), (6.5, 8.0)]))
