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

"""Scores of constructed runs with known errors."""

from __future__ import annotations

import math

from benchmarks.slip.scoring import estimated_at, moving_mean, score_run, steady_sides
from benchmarks.slip.series import as_truth, EstimateSeries, IcrSeries, Statistic, Truth
import numpy as np
import pytest
from smart_tire.analysis.series import PoseSeries, SlipSeries
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S, Odometry, WheelSlip

RADIUS = 0.087
PERIOD_NS = NS_PER_S // 100
NO_COVARIANCE = (0.0,) * 36


def poses(stamps, pose, twist, sigma=math.nan, speed_sigma=math.nan):
    """Return a series of poses and twists, each (n, 3), with constant sigmas."""
    n = len(stamps)
    return PoseSeries(stamps, pose, twist, np.tile(sigma ** 2 * np.eye(3), (n, 1, 1)),
                      np.full((n, 3), speed_sigma ** 2))


def straight_run(seconds=10.0, speed=0.5, slip=0.1):
    """Return a straight run: stationary for 2 s, then a step to full speed."""
    n = round(100 * seconds)
    stamps = 5 * NS_PER_S + PERIOD_NS * np.arange(n)
    time = np.arange(n) / 100
    v = np.where(time >= 2.0, speed, 0.0)
    twist = np.column_stack([v, np.zeros((n, 2))])
    pose = np.column_stack([np.cumsum(v) / 100, np.zeros((n, 2))])
    rolling = np.tile(v[:, np.newaxis] / (1.0 - slip), (1, 4))
    ratio = np.where(rolling > 0.0, slip, math.nan)
    return Truth(stamps, poses(stamps, pose, twist, 0.0, 0.0), ratio, rolling, RADIUS)


def estimate_with(truth, slip_error=0.0, slip_sigma=0.1, shift=(0.0, 0.0, 0.0), speed_error=0.0):
    """Return an estimate with constant errors; those of the pose begin after the start."""
    off = np.outer(np.arange(len(truth.stamp_ns)) > 0, shift)
    twist = truth.poses.twist + [speed_error, 0.0, 0.0]
    return EstimateSeries(
        poses(truth.stamp_ns, truth.poses.pose + off, twist, 0.1, 0.02),
        SlipSeries(truth.stamp_ns, truth.ratio + slip_error,
                   np.full_like(truth.ratio, slip_sigma)))


def test_constant_errors_give_the_expected_rms_and_nees():
    truth = straight_run()
    estimate = estimate_with(truth, slip_error=0.03, slip_sigma=0.02, speed_error=0.01)
    result = score_run(estimate, truth)
    for side in (result.left, result.right):
        assert side.selected.rms == pytest.approx(0.03)
        assert side.all_times.mean == pytest.approx(0.03)
        assert side.selected.normalized_rms ** 2 == pytest.approx(2.25)
        assert side.selected.within_two == 1.0
    assert result.speed.selected.rms == pytest.approx(0.01)
    assert result.speed.selected.normalized_rms == pytest.approx(0.5)


def test_a_nan_where_the_truth_is_defined_counts_as_an_error_of_one():
    truth = straight_run()
    ratio = truth.ratio.copy()
    late = np.flatnonzero(np.isfinite(ratio[:, 0]))[-200:]
    ratio[late[:50], 0] = math.nan  # of one wheel: then its side is undefined, too
    slips = SlipSeries(truth.stamp_ns, ratio, np.full_like(ratio, 0.1))
    estimate = EstimateSeries(truth.poses, slips)
    result = score_run(estimate, truth)
    count = result.left.selected.count
    assert result.left.selected.rms == pytest.approx(math.sqrt(50 / count))
    assert result.left.selected.normalized_rms == pytest.approx(math.sqrt(50 / count))
    assert result.right.selected.rms == 0.0


def test_a_missing_estimate_has_an_error_of_one_everywhere():
    truth = straight_run()
    empty = SlipSeries(np.empty(0, np.int64), np.empty((0, 4)), np.empty((0, 4)))
    result = score_run(EstimateSeries(truth.poses, empty), truth)
    assert result.left.selected.rms == result.left.all_times.rms == 1.0


def test_estimates_while_the_truth_is_undefined_do_not_count():
    truth = straight_run()
    ratio = np.where(np.isnan(truth.ratio), 0.9, truth.ratio)
    slips = SlipSeries(truth.stamp_ns, ratio, np.full_like(ratio, 0.1))
    estimate = EstimateSeries(truth.poses, slips)
    assert score_run(estimate, truth).left.all_times.rms == 0.0


def test_steady_sides_roll_after_settling_and_without_fast_changes():
    truth = straight_run()
    truth.rolling[700, 3] += 1.0  # a jerk of one wheel at 7 s
    steady = steady_sides(truth)
    time = np.arange(len(truth.stamp_ns)) / 100
    assert not steady[time <= 3.0].any()
    assert steady[(time > 3.0) & (time < 6.5)].all()
    assert not steady[(time > 6.6) & (time < 7.4)].any()
    assert steady[time > 7.5].all()


def test_a_slow_side_is_not_steady_but_the_other_one_is():
    truth = straight_run()
    truth.rolling[:, [0, 2]] *= 0.09 / truth.rolling[-1, 0]
    steady = steady_sides(truth)
    assert not steady[:, 0].any() and steady[-1, 1]


def test_a_slow_ramp_is_steady_and_a_fast_one_is_not():
    truth = straight_run()
    time = np.arange(len(truth.stamp_ns)) / 100
    for rate, calm in ((1.4, True), (1.6, False)):  # rad/s2
        truth.rolling[:] = (0.3 + RADIUS * rate * time)[:, np.newaxis]
        assert steady_sides(truth)[time > 3.5].all() == calm
        assert steady_sides(truth)[time > 3.5].any() == calm


def test_averaging_ignores_and_keeps_undefined_values():
    stamps = PERIOD_NS * np.arange(100)
    values = np.ones((100, 1))
    values[50] = 14.0
    values[:20] = math.nan
    means = moving_mean(values, stamps, 0.125)
    assert np.isnan(means[:20]).all()
    assert means[20, 0] == 1.0
    assert means[[43, 57], 0] == pytest.approx(1.0)
    assert means[44:57, 0] == pytest.approx(2.0)  # 13 stamps lie within 0.125 s


def test_the_averaged_score_covers_all_times():
    truth = straight_run()
    truth.ratio[500] += 1.3
    estimate = estimate_with(straight_run())
    averaged = score_run(estimate, truth, averaged=True)
    assert averaged.left.selected.count == averaged.left.all_times.count
    assert averaged.left.selected.rms == pytest.approx(
        math.sqrt(13 * 0.1 ** 2 / averaged.left.selected.count))
    assert averaged.left.all_times.rms == pytest.approx(
        math.sqrt(1.3 ** 2 / averaged.left.all_times.count))


def test_path_errors_from_a_common_start_are_in_percent_of_the_distance():
    truth = straight_run()
    path = score_run(estimate_with(truth, shift=(0.0, 0.1, 0.02)), truth).path
    assert path.distance_m == pytest.approx(4.0, rel=0.02)
    assert path.end_m == pytest.approx(0.1)
    assert path.end_percent == pytest.approx(100 * 0.1 / path.distance_m)
    assert path.rms_m == pytest.approx(0.1, rel=0.01)
    assert path.nees == pytest.approx(0.5, rel=0.01)  # 1 sigma in one of two directions
    assert path.heading_end == pytest.approx(0.02)
    assert path.heading.normalized_rms == pytest.approx(0.2, rel=0.01)
    assert path.inside == 1.0


def test_the_icr_is_scored_while_the_robot_turns():
    truth = straight_run()
    truth.poses.twist[:, 1:] = -0.02 * 0.5, 0.5  # v_y = -S W with S = 0.02 m
    centers = IcrSeries(truth.stamp_ns, np.tile([0.05, 1.0], (len(truth.stamp_ns), 1)))
    estimate = EstimateSeries(truth.poses, estimate_with(truth).slips, centers,
                              Statistic(truth.stamp_ns, np.full(len(truth.stamp_ns), 1.5)), 80.0)
    result = score_run(estimate, truth)
    assert result.icr_x == pytest.approx(0.03)
    assert (result.nis, result.step_us) == (1.5, 80.0)
    truth.poses.twist[:, 2] = 0.0
    assert math.isnan(score_run(estimate, truth).icr_x)


def test_next_to_a_nan_the_nearest_value_is_used_and_none_in_gaps():
    stamps = np.array([0, 8, 16, 1000, 1008]) * NS_PER_S // 1000
    values = np.array([[1.0], [2.0], [math.nan], [4.0], [5.0]])
    wanted = np.array([-1, 4, 11, 13, 500, 1004]) * NS_PER_S // 1000
    found = estimated_at(wanted, stamps, values)[:, 0]
    assert found == pytest.approx([math.nan, 1.5, 2.0, math.nan, math.nan, 4.5], nan_ok=True)


def test_the_truth_needs_odometry_and_slip_with_equal_timestamps():
    stamps = [n * PERIOD_NS for n in range(200)]
    odometry = [Odometry(stamp, (0.0,) * 3, (0.0, 0.0, 0.0, 1.0), (0.3, 0.0, 0.0),
                         (0.0, 0.0, 0.5), NO_COVARIANCE, NO_COVARIANCE) for stamp in stamps]
    slips = [WheelSlip(stamp, (0.1,) * 4, (0.05,) * 4, (0.0,) * 4) for stamp in stamps]
    truth = as_truth([*odometry, *slips], RobotParams())
    assert truth.stamp_ns[-1] == stamps[-1] - NS_PER_S // 2  # the excluded end
    assert truth.rolling[0] == pytest.approx(0.05 + 0.3 + 0.19 * 0.5 * np.array([-1, 1, -1, 1]))
    with pytest.raises(ValueError, match='with odometry and slip'):
        as_truth(odometry + slips[1:], RobotParams())
    with pytest.raises(ValueError, match='with odometry and slip'):
        as_truth([], RobotParams())
