# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Scores of constructed errors."""

from dataclasses import replace
import math

from hypothesis import given, settings, strategies as st
import numpy as np
import pytest

from smart_tire.analysis.metrics import (
    compared_poses, compared_slips, compared_twist, distance, pose_score, score, slip_scores,
    stamp_score)
from smart_tire.estimates import PoseEstimate, SlipEstimate

EPOCH = 1_700_000_000_000_000_000


def ticks(count, rate=100.0):
    return EPOCH + np.round(np.arange(count) * 1e9 / rate).astype(np.int64)


def poses(pose, twist=None, sigma=0.1, rate=100.0):
    count = len(pose)
    return PoseEstimate(
        ticks(count, rate), np.asarray(pose, float),
        np.full((count, 3), math.nan) if twist is None else np.asarray(twist, float),
        np.broadcast_to(np.eye(3) * sigma ** 2, (count, 3, 3)), np.full((count, 3), sigma))


def exact(truth):
    """Return the poses with covariances of zero, as those of ground truth."""
    return replace(truth, covariance=0.0 * truth.covariance,
                   twist_sigma=0.0 * truth.twist_sigma)


def posed(estimate, truth):
    truth = exact(truth)
    return pose_score(compared_poses(estimate, truth), compared_twist(estimate, truth))


def circle(count=1000, radius=2.0, turn=3.0):
    yaw = np.linspace(0.0, turn, count)
    return np.column_stack([radius * np.sin(yaw), radius * (1.0 - np.cos(yaw)), yaw])


def straight(length=10.0, count=1001):
    return np.column_stack([np.linspace(0.0, length, count), np.zeros(count), np.zeros(count)])


def moved(pose, x, y, angle):
    cos, sin = math.cos(angle), math.sin(angle)
    return np.column_stack([x + cos * pose[:, 0] - sin * pose[:, 1],
                            y + sin * pose[:, 0] + cos * pose[:, 1], pose[:, 2] + angle])


@pytest.mark.parametrize(('error', 'sigma', 'count', 'rms', 'within_one', 'within_two'), [
    ([1.0, math.nan, -1.0], [1.0, 1.0, 1.0], 2, 1.0, 1.0, 1.0),
    ([1.5], [1.0], 1, 1.5, 0.0, 1.0), ([1.0], [0.0], 1, 1.0, 0.0, 0.0),
    ([0.0], [0.0], 1, 0.0, 1.0, 1.0), ([], [], 0, math.nan, math.nan, math.nan)])
def test_finite_errors_are_compared_with_their_sigma(error, sigma, count, rms, within_one,
                                                     within_two):
    found = score(np.array(error), np.array(sigma))
    assert found.count == count
    assert (found.rms, found.within_one, found.within_two) == pytest.approx(
        (rms, within_one, within_two), nan_ok=True)


@settings(max_examples=30, deadline=None)
@given(x=st.floats(-1e3, 1e3), y=st.floats(-1e3, 1e3), angle=st.floats(-7.0, 7.0))
def test_the_frame_of_the_truth_and_the_rate_of_the_estimate_do_not_matter(x, y, angle):
    found = posed(poses(circle(10_000), rate=1000.0),
                  poses(moved(circle(10_000)[::10], x, y, angle)))
    assert found.position_rms_m == pytest.approx(0.0, abs=1e-6)
    assert found.yaw.rms == pytest.approx(0.0, abs=1e-6)
    assert found.distance_m == pytest.approx(6.0, abs=0.06)


def test_a_radius_one_percent_too_large_is_one_percent_of_the_distance():
    found = posed(poses(1.01 * straight()), poses(straight()))
    assert found.position_end_m == found.position_max_m == pytest.approx(0.1)
    assert found.end_percent_of_distance == pytest.approx(1.0, rel=1e-2)
    assert found.position_rms_m == pytest.approx(0.1 / math.sqrt(3.0), rel=1e-2)
    assert found.relative_position_rms_m == pytest.approx(0.01, rel=1e-6)  # at 1 m/s
    assert found.duration_s == pytest.approx(10.0)


def test_heading_drift_gives_absolute_and_relative_yaw_errors():
    truth = straight()
    drifting = truth + np.column_stack([np.zeros((1001, 2)), np.linspace(0.0, 0.5, 1001)])
    found = posed(poses(drifting), poses(truth))
    assert found.yaw_end_rad == pytest.approx(0.5)
    assert found.relative_yaw_rms_rad == pytest.approx(0.05)
    assert found.position_end_m == 0.0


def test_relative_errors_do_not_contain_old_heading_errors():
    """A heading error from a turn in place does not affect later relative errors."""
    truth = np.vstack([np.zeros((100, 3)), straight()])
    wrong = np.vstack([np.zeros((100, 3)), moved(straight(), 0.0, 0.0, 0.3)])
    found = posed(poses(wrong), poses(truth))
    assert found.position_end_m == pytest.approx(2.0 * 10.0 * math.sin(0.15), rel=1e-3)
    after = posed(poses(wrong[200:]), poses(truth[200:]))
    assert after.relative_position_rms_m == pytest.approx(0.0, abs=1e-9)


def test_gaussian_errors_have_gaussian_coverage_and_normalized_errors_of_one():
    truth = circle(5000)
    noisy = truth + np.random.default_rng(3).normal(0.0, 0.1, truth.shape)
    noisy[0] = truth[0]  # the paths are aligned there
    found = posed(poses(noisy, sigma=0.1), poses(truth))
    assert found.position_normalized_rms == pytest.approx(1.0, abs=0.03)
    assert found.yaw.normalized_rms == pytest.approx(1.0, abs=0.03)
    assert found.yaw.within_one == pytest.approx(0.683, abs=0.02)
    assert found.yaw.within_two == pytest.approx(0.954, abs=0.01)


def test_noise_of_a_stationary_robot_is_not_a_distance():
    noise = np.random.default_rng(4).normal(0.0, 0.005, (5000, 2))
    assert distance(noise) == 0.0
    assert distance(straight()[:, :2] + noise[:1001]) == pytest.approx(10.0, rel=0.03)


def test_errors_of_the_twist_are_found_in_each_component():
    count = 1000
    truth = poses(circle(), twist=np.tile([0.6, 0.0, 0.3], (count, 1)))
    estimate = poses(circle(), twist=np.tile([0.7, -0.1, 0.5], (count, 1)), sigma=0.1)
    twist = posed(estimate, truth).twist
    assert [twist[name].mean for name in ('v_x', 'v_y', 'yaw_rate')] == pytest.approx(
        [0.1, -0.1, 0.2])
    assert twist['yaw_rate'].normalized_rms == pytest.approx(2.0)
    assert posed(poses(circle()), poses(circle())).twist is None


def test_poses_that_never_overlap_have_no_score():
    late = poses(circle())
    late = PoseEstimate(late.stamp_ns + 60_000_000_000, late.pose, late.twist,
                        late.covariance, late.twist_sigma)
    assert posed(late, poses(circle())) is None
    assert posed(poses(circle()[:0]), poses(circle())) is None


def slips(ratio, sigma=0.1):
    ratio = np.asarray(ratio, float)
    return SlipEstimate(ticks(len(ratio)), ratio, np.full(ratio.shape, sigma), ratio)


def slid(estimate, truth, *intervals):
    truth = replace(truth, sigma=0.0 * truth.sigma)
    return slip_scores(compared_slips(estimate, truth), *intervals)


def test_slip_is_scored_where_both_slips_are_defined():
    ratio = np.full((100, 4), 0.1)
    truth, estimate = ratio.copy(), ratio + 0.1
    truth[:20] = math.nan
    estimate[90:] = math.nan
    found = slid(slips(estimate), slips(truth))['left'].error
    assert found.count == 70 and found.mean == pytest.approx(0.1)
    never = slips(np.full((10, 4), math.nan))
    assert slid(never, never)['left'].error.count == 0


def test_slip_is_scored_within_the_intervals_only():
    truth, estimate = np.zeros((100, 4)), np.zeros((100, 4))
    estimate[50:] = 0.2
    stamps = ticks(100)
    calm = slid(slips(estimate), slips(truth), [(stamps[0], stamps[49])])
    wrong = slid(slips(estimate), slips(truth), [(stamps[60], stamps[79])])
    assert calm['left'].error.rms == 0.0
    assert (wrong['left'].error.count, wrong['left'].error.mean) == (20, pytest.approx(0.2))


def test_timestamps_are_compared_with_the_nearest_true_time():
    true = ticks(400, rate=400.0)
    rng = np.random.default_rng(5)
    kept = rng.random(400) > 0.2  # lost batches leave instants without a sample
    stamped = true[kept] + rng.normal(2e5, 3e5, kept.sum()).astype(np.int64)
    found = stamp_score(stamped, true, sigma=0.5e-3)
    assert found.mean == pytest.approx(2e-4, abs=5e-5)
    assert math.sqrt(found.rms ** 2 - found.mean ** 2) == pytest.approx(3e-4, rel=0.1)
    assert found.within_two > 0.99


@pytest.mark.parametrize('instants', [0, 1])
def test_timestamps_can_be_compared_with_few_true_times(instants):
    found = stamp_score(ticks(1) + 1000, ticks(instants), sigma=1e-3)
    assert found.count == instants


def test_the_slip_of_a_side_is_the_mean_of_its_measured_wheels():
    stamps = np.arange(4) * 10**8
    ratio = np.tile([0.1, 0.2, math.nan, 0.4], (4, 1))
    ratio[0, 1] = math.nan  # at standstill
    estimate = SlipEstimate(stamps, ratio, np.full((4, 4), 0.1), ratio)
    true = np.tile([0.15, 0.2, 0.9, 0.2], (4, 1))
    truth = SlipEstimate(stamps, true, np.zeros((4, 4)), true)
    scores = slid(estimate, truth)
    assert (scores['left'].error.count, scores['right'].error.count) == (4, 2)
    assert scores['left'].error.mean == pytest.approx(-0.05)
    assert scores['right'].error.mean == pytest.approx(0.1)
    assert scores['rear_left'].error.count == 0
