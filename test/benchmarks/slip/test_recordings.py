# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recordings: true velocities, alignment of the paths, and the baseline."""

import math

from benchmarks.slip.recordings import (
    baseline, displacement_errors, path_errors, RecordedTruth, recording_jobs, recording_rows,
    RECORDINGS, truth_from)
import numpy as np
import pytest
from smart_tire.analysis.metrics import rotated
from smart_tire.parameters import build, RobotParams
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample

STAMPS = np.arange(600) * (NS_PER_S // 10)


@pytest.fixture
def circle():
    """Return the truth on a circle of 5 m radius at 0.5 m/s for 60 s."""
    yaw = 0.1 * STAMPS / NS_PER_S
    return truth_from(STAMPS, np.column_stack(
        [5.0 * np.sin(yaw), 5.0 * (1.0 - np.cos(yaw)), np.angle(np.exp(1j * yaw))]))


def elsewhere(pose, turn=2.0, shift=(30.0, -7.0)):
    """Return poses in another frame."""
    return np.column_stack([rotated(pose[:, :2], turn) + shift, pose[:, 2] + turn])


def rms(errors):
    return {name: one.figures['rms'] for name, one in errors.items()}


def test_velocities_are_those_in_body_axes(circle):
    assert circle.twist[10:-10] == pytest.approx(np.tile([0.5, 0.0, 0.1], (580, 1)), abs=3e-3)
    assert circle.pose[-1, 2] == pytest.approx(5.99)  # unwrapped
    later = circle.after(20 * NS_PER_S)
    assert (len(later.stamp_ns), later.stamp_ns[0]) == (400, 20 * NS_PER_S)


@pytest.mark.parametrize('errors', [path_errors, displacement_errors])
def test_the_same_path_in_another_frame_has_no_error(circle, errors):
    assert all(value < 1e-9 for value in rms(errors(circle, elsewhere(circle.pose))).values())


def test_errors_are_those_after_the_common_start(circle):
    moved = elsewhere(circle.pose)
    moved[300:, 0] += 0.4
    assert rms(path_errors(circle, moved))['path'] == pytest.approx(0.4 * math.sqrt(0.5))
    over_window = rms(displacement_errors(circle, moved))['path']
    assert over_window == pytest.approx(0.4 * math.sqrt(20 / 580))  # only across the jump


def test_wheels_and_gyroscope_follow_a_circle(circle):
    stamps = range(0, 60 * NS_PER_S, NS_PER_S // 50)
    rate = [0.1 if stamp >= 2 * NS_PER_S else 0.0 for stamp in stamps]
    samples = [ImuSample(stamp, (0.0, 0.0, 9.8), (0.0, 0.0, 0.02 + turn))
               for stamp, turn in zip(stamps, rate)]
    samples += [WheelSample(stamp, (5.0 if turn else 0.0,) * 4)
                for stamp, turn in zip(stamps, rate)]
    pose, speed, sides = baseline(samples, STAMPS, build(RobotParams, {'wheel_radius': 0.1}))
    inside = slice(30, 590)
    assert speed[inside] == pytest.approx(np.full(560, 0.5))
    assert sides[inside] == pytest.approx(np.full((560, 2), 0.5))
    assert pose[589, 2] == pytest.approx(0.1 * 56.9, abs=0.01)  # without the bias


def test_missing_recordings_are_listed(tmp_path, capsys):
    first, *others = RECORDINGS
    (tmp_path / first).mkdir()
    (job,) = recording_jobs(tmp_path)
    assert job.args == (tmp_path / first,)
    assert capsys.readouterr().out.splitlines() == [
        f'{name}: not in {tmp_path}, skipped (--data DIR)' for name in others]


def test_ratios_are_to_the_baseline_of_the_same_times():
    rows = {name: {f'{method}{part}.v_x.{figure}': value
                   for method, scale in (('live', 1.0), ('smoothed', 2.0))
                   for part, value in (('', scale), ('.baseline', ratio))
                   for figure in ('rms', 'within_two')}
            for name, ratio in (('a', 2.0), ('b', 4.0))}
    lines = dict(recording_rows(rows))
    assert lines['a: live']['v_x.ratio'] == 0.5 and lines['b: smoothed']['v_x.ratio'] == 0.5
    assert lines['median of ratios: live']['v_x.ratio'] == pytest.approx(0.375)
    assert lines['largest ratio: smoothed']['v_x.ratio'] == 1.0


def test_standard_errors_of_velocities_are_those_of_late_stamps_along_the_motion():
    """A robot at 1.5 m/s on a straight line at 40 degrees, whose poses are up to 20 ms late."""
    rng, yaw = np.random.default_rng(4), 0.7
    time = STAMPS / NS_PER_S + rng.normal(0.0, 0.02, len(STAMPS))
    truth = truth_from(STAMPS, np.column_stack(
        [1.5 * time * np.cos(yaw), 1.5 * time * np.sin(yaw), np.full(len(time), yaw)]))
    inner = slice(10, -10)
    error, sigma = truth.twist[inner] - [1.5, 0.0, 0.0], truth.sigma[inner]
    # six poses of 10 Hz; errors have a t distribution with three degrees of freedom
    assert np.std(error[:, 0]) == pytest.approx(0.03 / (0.1 * np.sqrt(17.5)), rel=0.15)
    assert np.median(np.abs(error[:, 0]) / sigma[:, 0]) == pytest.approx(0.765, rel=0.15)
    assert np.abs(sigma[:, 1:]).max() < 1e-9


def test_velocities_need_poses_on_both_sides():
    truth = truth_from(STAMPS[:3], np.zeros((3, 3)))
    assert isinstance(truth, RecordedTruth)
    assert np.isnan(truth.twist).all() and np.isnan(truth.sigma).all()
