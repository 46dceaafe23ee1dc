# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Errors of constructed runs with known errors."""

import math

from benchmarks.motion import (
    as_truth, Estimate, estimated_at, score_motion, steady_sides, Truth)
import numpy as np
import pytest
from smart_tire.estimates import PoseEstimate, SlipEstimate
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S, WheelSlip
from support.ideal_robot import odometry

RADIUS = 0.087
PERIOD_NS = NS_PER_S // 100


def poses(stamps, pose, twist, sigma=math.nan, speed_sigma=math.nan):
    """Return a series of poses and twists, each (n, 3), with constant sigmas."""
    n = len(stamps)
    return PoseEstimate(stamps, pose, twist, np.tile(sigma ** 2 * np.eye(3), (n, 1, 1)),
                        np.full((n, 3), speed_sigma))


def straight_run(seconds=10.0, speed=0.5, slip=0.1):
    """Return a straight run: stationary for 2 s, then a step to full speed."""
    n = round(100 * seconds)
    stamps = 5 * NS_PER_S + PERIOD_NS * np.arange(n)
    v = np.where(np.arange(n) >= 200, speed, 0.0)
    twist = np.column_stack([v, np.zeros((n, 2))])
    pose = np.column_stack([np.cumsum(v) / 100, np.zeros((n, 2))])
    rolling = np.tile(v[:, np.newaxis] / (1.0 - slip), (1, 4))
    ratio = np.where(rolling > 0.0, slip, math.nan)
    return Truth(stamps, poses(stamps, pose, twist, 0.0, 0.0), ratio, rolling, RADIUS)


@pytest.fixture
def truth():
    return straight_run()


def estimate_with(truth, slip_error=0.0, slip_sigma=0.1, shift=(0.0, 0.0, 0.0), speed_error=0.0,
                  ratio=None, **values):
    """Return an estimate with constant errors; those of the pose begin after the start."""
    off = np.outer(np.arange(len(truth.stamp_ns)) > 0, shift)
    twist = truth.poses.twist + [speed_error, 0.0, 0.0]
    ratio = truth.ratio + slip_error if ratio is None else ratio
    return Estimate(poses(truth.stamp_ns, truth.poses.pose + off, twist, 0.1, 0.02),
                    SlipEstimate(truth.stamp_ns, ratio, np.full_like(ratio, slip_sigma),
                                 np.full_like(ratio, math.nan)), **values)


def figures(estimate, truth, **options):
    """Return the figures of each quantity, and the values."""
    found = score_motion('row', 1, estimate, truth, **options)
    return {**found.figures, **found.values}


def test_constant_errors_give_the_expected_rms_and_nees_where_the_truth_is_defined(truth):
    estimate = estimate_with(truth, slip_error=0.03, slip_sigma=0.02, speed_error=0.01)
    found = figures(estimate, truth)
    for side in ('left', 'right'):
        assert found[f'slip_{side}']['rms'] == pytest.approx(0.03)
        assert found[f'slip_{side}_all']['mean'] == pytest.approx(0.03)
        assert found[f'slip_{side}']['nees'] == pytest.approx(2.25)
    assert found['v']['rms'] == pytest.approx(0.01) and found['v']['nees'] == pytest.approx(0.25)
    ratio = np.where(np.isnan(truth.ratio), 0.9, truth.ratio)
    assert figures(estimate_with(truth, ratio=ratio), truth)['slip_left_all']['rms'] == 0.0


@pytest.mark.parametrize('missing', [50, 550])
def test_a_nan_where_the_truth_is_defined_counts_as_an_error_of_one(missing):
    truth = straight_run(seconds=5.5)  # 2 s of it steady
    ratio = truth.ratio.copy()
    ratio[-missing:, 0] = math.nan  # of one wheel: then its side is undefined, too
    found = figures(estimate_with(truth, ratio=ratio), truth)
    count = int(steady_sides(truth)[:, 0].sum())
    assert found['slip_left']['rms'] == pytest.approx(
        math.sqrt(min(missing, count) / count), rel=1e-6)
    assert found['slip_right']['rms'] == 0.0


def test_steady_sides_roll_after_settling_and_without_fast_changes(truth):
    truth.rolling[700, 3] += 1.0  # a jerk of one wheel at 7 s
    steady = steady_sides(truth)
    time = np.arange(len(truth.stamp_ns)) / 100
    assert not steady[time <= 3.0].any()
    assert steady[(time > 3.0) & (time < 6.5)].all()
    assert not steady[(time > 6.6) & (time < 7.4)].any()
    assert steady[time > 7.5].all()
    truth.rolling[:, [0, 2]] *= 0.09 / truth.rolling[-1, 0]  # too slow
    steady = steady_sides(truth)
    assert not steady[:, 0].any() and steady[-1, 1]
    for rate, calm in ((1.4, True), (1.6, False)):  # rad/s2
        truth.rolling[:] = (0.3 + RADIUS * rate * time)[:, np.newaxis]
        assert np.all(steady_sides(truth)[time > 3.5] == calm)


def test_path_errors_from_a_common_start_are_shares_of_the_distance(truth):
    found = figures(estimate_with(truth, shift=(0.0, 0.1, 0.02)), truth, prefix='own.')
    assert found['own.distance'] == pytest.approx(4.0, rel=0.02)
    assert found['own.position_end_share'] == pytest.approx(0.1 / found['own.distance'])
    assert found['own.position']['rms'] == pytest.approx(0.1, rel=0.01)
    assert found['own.position']['nees'] == pytest.approx(0.5, rel=0.01)  # one of two directions
    assert found['own.heading_end'] == pytest.approx(0.02)
    assert found['own.heading']['nees'] == pytest.approx(0.04, rel=0.01)


def test_the_icr_is_scored_while_the_robot_turns(truth):
    truth.poses.twist[:, 1:] = -0.02 * 0.5, 0.5  # v_y = -S W with S = 0.02 m
    centers = truth.stamp_ns, np.tile([0.05, 1.0], (len(truth.stamp_ns), 1))
    estimate = estimate_with(truth, icr=centers, nis=1.5, step_us=80.0)
    found = figures(estimate, truth)
    assert found['icr']['rms'] == pytest.approx(0.03)
    assert (found['nis'], found['step_us']) == (1.5, 80.0)
    truth.poses.twist[:, 2] = 0.0
    assert math.isnan(figures(estimate, truth)['icr']['rms'])


def test_next_to_a_nan_the_nearest_value_is_used_and_none_in_gaps():
    stamps = np.array([0, 8, 16, 1000, 1008]) * NS_PER_S // 1000
    values = np.array([[1.0], [2.0], [math.nan], [4.0], [5.0]])
    wanted = np.array([-1, 4, 11, 13, 500, 1004]) * NS_PER_S // 1000
    found = estimated_at(wanted, stamps, values)[:, 0]
    assert found == pytest.approx([math.nan, 1.5, 2.0, math.nan, math.nan, 4.5], nan_ok=True)


def test_the_truth_needs_odometry_and_slip_with_equal_timestamps():
    stamps = [n * PERIOD_NS for n in range(200)]
    poses = [odometry(stamp, v_x=0.3, yaw_rate=0.5) for stamp in stamps]
    slips = [WheelSlip(stamp, (0.1,) * 4, (0.05,) * 4, (0.0,) * 4) for stamp in stamps]
    truth = as_truth([*poses, *slips], RobotParams())
    assert truth.stamp_ns[-1] == stamps[-1] - NS_PER_S // 2  # the excluded end
    assert truth.rolling[0] == pytest.approx(0.05 + 0.3 + 0.19 * 0.5 * np.array([-1, 1, -1, 1]))
    for records in (poses + slips[1:], []):
        with pytest.raises(ValueError, match='with odometry and slip'):
            as_truth(records, RobotParams())
