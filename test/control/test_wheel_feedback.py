# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Readings of the wheel speeds: their periods, means, ages and delays."""

from __future__ import annotations

import math

import pytest
from smart_tire.control.constants import LINE_DELAY
from smart_tire.control.wheel_feedback import WheelFeedback
from smart_tire.samples import NS_PER_S

MS = 1_000_000
LINE_NS = round(LINE_DELAY * NS_PER_S)


def read(times, window=0.0, speeds=None, stamps=None):
    """Return feedback with readings at ``times`` [ms] of the front left wheel."""
    feedback = WheelFeedback(window)
    for index, time in enumerate(times):
        speed = speeds[index] if speeds else float(index)
        feedback.add_reading((speed, 0.0, 0.0, 7.0), time * MS,
                             round((stamps[index] if stamps else 0) * MS))
    return feedback


def test_a_reading_is_the_mean_of_the_period_that_ends_with_it():
    mean = read([100, 350]).mean(0)
    assert mean == (1.0, 100 * MS - LINE_NS, 350 * MS - LINE_NS)
    assert read([100, 350]).mean(3)[0] == 7.0


def test_the_duration_of_a_single_reading_is_unknown():
    assert WheelFeedback(0.0).mean(0) is None
    feedback = read([100])
    assert feedback.mean(0) is None and feedback.period is None
    assert feedback.delay(0.1) == math.inf
    assert not feedback.is_current(100 * MS)


def test_readings_are_averaged_over_the_window_with_their_durations():
    feedback = read([0, 10, 22, 30, 40], window=0.03, speeds=[9.0, 8.0, 1.0, 2.0, 4.0])
    speed, begin_ns, end_ns = feedback.mean(0)
    assert (begin_ns, end_ns) == (10 * MS - LINE_NS, 40 * MS - LINE_NS)
    assert speed == pytest.approx((1.0 * 12 + 2.0 * 8 + 4.0 * 10) / 30)


def test_a_reading_longer_than_the_window_stands_alone():
    speed, begin_ns, end_ns = read([0, 50, 100], window=0.03).mean(0)
    assert (speed, end_ns - begin_ns) == (pytest.approx(2.0), 50 * MS)


def test_errors_of_timestamps_within_the_window_cancel():
    """A wheel at 10 rad/s, read every 10 ms, with timestamps up to 3 ms off."""
    stamps = [0, 13, 18, 32, 40]
    speeds = [10.0] + [10.0 * 10 / (late - early) for early, late in zip(stamps, stamps[1:])]
    feedback = read([0, 10, 20, 30, 40], 0.04, speeds, stamps=[1000 + one for one in stamps])
    assert feedback.mean(0)[0] == pytest.approx(10.0)
    unstamped = read([0, 10, 20, 30, 40], 0.04, speeds)
    assert unstamped.mean(0)[0] > 10.5


def feed(arrivals, stamps, positions, window=0.03):
    """Return feedback with readings whose wheels are at ``positions`` [rad], times in ms."""
    feedback = WheelFeedback(window)
    for arrival, stamp, position in zip(arrivals, stamps, positions, strict=True):
        # the speeds contradict the positions: they must not be used
        feedback.add_reading((1.0,) * 4, arrival * MS, stamp * MS, (position, 0.0, 0.0, -position))
    return feedback


def test_a_late_arrival_does_not_move_the_period_of_its_mean_speed():
    stamps = [1000 + 10 * index for index in range(9)]
    late = [3, 15, 5, 0, 14, 4, 11, 1, 15]
    feedback = feed([10 * i + one for i, one in enumerate(late)], stamps,
                    [0.002 * i * i for i in range(9)])
    assert feedback.mean(0) == (
        pytest.approx((0.002 * 64 - 0.002 * 25) / 0.03), 50 * MS - LINE_NS, 80 * MS - LINE_NS)
    assert feedback.delay(0.01) == pytest.approx(
        0.5 * (0.03 + 0.01 + 0.01) + LINE_DELAY + sum(late) / 9e3)


def test_a_clock_of_the_timestamps_that_runs_slowly_moves_the_period_by_a_tenth_of_a_second():
    feedback = feed(range(0, 4000, 50), range(1000, 3000, 25), [0.0] * 80)
    assert 3850 * MS - LINE_NS <= feedback.mean(0)[2] <= 3950 * MS - LINE_NS


def test_the_mean_over_a_lost_reading_follows_from_the_positions():
    feedback = feed([0, 50, 100, 200], [0, 50, 100, 200], [0.0, 0.1, 0.2, 0.9])
    assert feedback.mean(0) == (pytest.approx(7.0), 100 * MS - LINE_NS, 200 * MS - LINE_NS)
    assert feedback.mean(3)[0] == pytest.approx(-7.0)


@pytest.mark.parametrize('restarted', [-400.0, 400.0, math.nan])
def test_speeds_replace_positions_that_jump(restarted):
    feedback = feed([0, 50, 100], [0, 50, 100], [0.0, 0.5, restarted])
    assert feedback.mean(0)[0] == pytest.approx(1.0)


@pytest.mark.parametrize(('stamps', 'period'), [
    ([5, 5, 5], 0.06), ([50, 30, 10], 0.06), ([0, 9000, 18000], 0.06), ([1.0, 1.05, 1.1], 0.06),
    ([1, 2, 3], 0.001), ([1, 1901, 3801], 1.9)])
def test_timestamps_that_are_not_plausible_are_replaced_by_the_arrival(stamps, period):
    assert read([0, 60, 120], stamps=stamps).period == pytest.approx(period)


def test_a_new_rate_of_the_readings_is_known_after_three_of_them():
    times = [*range(0, 500, 10), 590, 690, 790]
    assert read(times).period == pytest.approx(0.1)
    assert read(times[:-1]).period == pytest.approx(0.01)


def test_after_a_lost_reading_only_the_latest_counts_with_its_own_period():
    feedback = read([0, 10, 20, 30, 40, 70], window=0.03, speeds=[1.0] * 5 + [4.0])
    assert feedback.mean(0) == (4.0, 60 * MS - LINE_NS, 70 * MS - LINE_NS)
    assert feedback.period == pytest.approx(0.01)


def test_another_reading_of_the_same_time_is_ignored():
    feedback = read([0, 50, 50], speeds=[1.0, 2.0, 3.0])
    assert feedback.mean(0) == (pytest.approx(2.0), 0 - LINE_NS, 50 * MS - LINE_NS)


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf, 100.1, -100.1])
@pytest.mark.parametrize('wheel', range(4))
def test_speeds_that_are_not_possible_are_ignored(bad, wheel):
    feedback = read([0, 50])
    feedback.add_reading(tuple(bad if index == wheel else 1.0 for index in range(4)), 100 * MS)
    assert feedback.latest.arrived_ns == 50 * MS
    feedback.add_reading((100.0, -100.0, 0.0, 0.0), 100 * MS)
    assert feedback.latest.arrived_ns == 100 * MS


def test_a_reading_is_current_for_two_periods():
    feedback = read([0, 50])
    assert feedback.is_current(150 * MS)
    assert not feedback.is_current(150 * MS + 1)


def test_discarded_readings_leave_their_period():
    feedback = read([0, 50])
    feedback.discard()
    assert feedback.latest is None and feedback.mean(0) is None
    assert not feedback.is_current(50 * MS)
    assert feedback.slope(0) == 0.0
    feedback.add_reading((3.0,) * 4, 500 * MS)
    assert feedback.mean(0) == (
        pytest.approx(3.0), 450 * MS - LINE_NS, 500 * MS - LINE_NS)


def test_the_slope_is_that_over_the_window():
    assert read([0, 50]).slope(0) == pytest.approx(20.0)
    assert read([0, 50, 150], window=0.1, speeds=[0.0, 1.0, 4.0]).slope(0) == pytest.approx(30.0)
    assert read([0, 50, 150], window=1.0, speeds=[0.0, 1.0, 4.0]).slope(0) == pytest.approx(
        4.0 / 0.15)
    assert read([0]).slope(0) == 0.0


def test_the_delay_is_half_of_reading_period_and_control_period():
    """Half the averaged time, half a period of readings, half a period of duties, and the line."""
    slow = read([0, 250, 500], window=0.06)
    assert slow.delay(0.0625) == pytest.approx(0.5 * (0.25 + 0.25 + 0.0625) + LINE_DELAY)
    fast = read(range(0, 200, 10), window=0.06)
    assert fast.delay(0.01) == pytest.approx(0.5 * (0.06 + 0.01 + 0.01) + LINE_DELAY)
