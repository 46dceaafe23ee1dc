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

"""Recordings: alignment with ground truth before the scored part, and errors after it."""

from __future__ import annotations

import math
from pathlib import Path

from benchmarks.slip.recordings import (
    align_after, bags, identified_params, poses_from, RECORDINGS, remaining_score)
import numpy as np
import pytest
from smart_tire.analysis.metrics import rotated
from smart_tire.analysis.series import PoseSeries
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, RobotParams
from smart_tire.samples import NS_PER_S

SHARED = Path(__file__).resolve().parents[4] / 'shared' / 'data'
BEGIN_NS = 20 * NS_PER_S


def poses(pose):
    """Return a series of the given poses, (n, 3), at 10 Hz."""
    n = len(pose)
    unknown = np.full((n, 3, 3), math.nan)
    return PoseSeries(np.arange(n) * (NS_PER_S // 10), pose, unknown[:, 0], unknown, unknown[:, 0])


@pytest.fixture
def circle():
    """Return a circle of 5 m radius at 0.5 m/s for 60 s."""
    yaw = 0.1 * np.arange(600) / 10
    return np.column_stack([5.0 * np.sin(yaw), 5.0 * (1.0 - np.cos(yaw)), yaw])


def elsewhere(pose, turn=2.0, shift=(30.0, -7.0)):
    """Return poses in another frame."""
    return np.column_stack([rotated(pose[:, :2], turn) + shift, pose[:, 2] + turn])


def test_the_same_path_in_another_frame_has_no_error(circle):
    path = remaining_score(align_after(poses(elsewhere(circle)), poses(circle), BEGIN_NS))
    assert path.rms_m < 1e-9 and path.heading.rms < 1e-9
    assert path.distance_m == pytest.approx(20.0, rel=0.01)
    assert math.isnan(path.nees)


def test_noise_of_single_poses_hardly_rotates_the_path(circle):
    rng = np.random.default_rng(5)
    noisy = circle.copy()
    noisy[:, 2] += rng.normal(0.0, 0.02, len(circle))
    path = remaining_score(align_after(poses(circle), poses(noisy), BEGIN_NS))
    assert path.rms_m < 0.1  # one pose alone would turn it by 0.02 rad: 0.2 m across 10 m


def test_only_errors_after_the_initial_part_are_scored(circle):
    estimated = elsewhere(circle)
    estimated[:150] += 3.0
    estimated[300:, 0] += 0.4
    path = remaining_score(align_after(poses(estimated), poses(circle), BEGIN_NS))
    assert path.end_m == pytest.approx(0.4)
    assert path.rms_m == pytest.approx(0.4 * math.sqrt(0.75))
    assert path.end_percent == pytest.approx(2.0, rel=0.01)


def test_without_truth_to_align_with_there_is_no_score(circle):
    late = poses_from(poses(circle), BEGIN_NS + 1)
    with pytest.raises(EstimatorError, match='no pose'):
        align_after(poses(circle), late, BEGIN_NS)


def test_missing_recordings_are_listed(tmp_path):
    there = RECORDINGS[0].folder
    (tmp_path / there).mkdir()
    assert bags(tmp_path) == (
        {recording.name: tmp_path / there for recording in RECORDINGS
         if recording.folder == there},
        [recording.name for recording in RECORDINGS if recording.folder != there])


@pytest.mark.parametrize('recording', RECORDINGS, ids=lambda recording: recording.name)
def test_known_parameters_are_kept_unless_identified(recording):
    path = SHARED / recording.folder
    if not path.exists():
        pytest.skip(f'the recording {path} is not on this machine')
    params, known = identified_params(path, recording), recording.known
    assert params.robot.track_width == known['track_width']
    assert params.robot.wheelbase == known['wheelbase']
    if not recording.identified:
        assert params.robot.imu == build(RobotParams, known).imu
