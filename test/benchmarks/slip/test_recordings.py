"""Recordings: the truth is laid over the estimate before what is scored, and nothing after."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.slip.recordings import bags, learned, RECORDINGS, rest_score, stretch, track_after
from smart_tire.analysis.metrics import rotated
from smart_tire.analysis.series import PoseSeries
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S

SHARED = Path(__file__).resolve().parents[4] / 'shared' / 'data'
BEGIN_NS = 20 * NS_PER_S


def poses(pose):
    """Return poses (n, 3) at 10 Hz as a series."""
    n = len(pose)
    unknown = np.full((n, 3, 3), math.nan)
    return PoseSeries(np.arange(n) * (NS_PER_S // 10), pose, unknown[:, 0], unknown, unknown[:, 0])


@pytest.fixture
def circle():
    """Return a circle of 5 m radius at 0.5 m/s for 60 s."""
    yaw = 0.1 * np.arange(600) / 10
    return np.column_stack([5.0 * np.sin(yaw), 5.0 * (1.0 - np.cos(yaw)), yaw])


def elsewhere(pose, turn=2.0, shift=(30.0, -7.0)):
    """Return poses as another frame has them."""
    return np.column_stack([rotated(pose[:, :2], turn) + shift, pose[:, 2] + turn])


def test_the_same_path_in_another_frame_has_no_error(circle):
    path = rest_score(track_after(poses(elsewhere(circle)), poses(circle), BEGIN_NS))
    assert path.rms_m < 1e-9 and path.heading.rms < 1e-9
    assert path.distance_m == pytest.approx(20.0, rel=0.01)
    assert math.isnan(path.nees)


def test_noise_of_single_poses_hardly_turns_the_path(circle):
    rng = np.random.default_rng(5)
    noisy = circle.copy()
    noisy[:, 2] += rng.normal(0.0, 0.02, len(circle))
    path = rest_score(track_after(poses(circle), poses(noisy), BEGIN_NS))
    assert path.rms_m < 0.1  # one pose alone would turn it by 0.02 rad: 0.2 m across 10 m


def test_errors_of_the_beginning_do_not_count_and_those_after_it_do(circle):
    guess = elsewhere(circle)
    guess[:150] += 3.0
    guess[300:, 0] += 0.4
    path = rest_score(track_after(poses(guess), poses(circle), BEGIN_NS))
    assert path.end_m == pytest.approx(0.4)
    assert path.rms_m == pytest.approx(0.4 * math.sqrt(0.75))
    assert path.end_percent == pytest.approx(2.0, rel=0.01)


def test_without_truth_to_align_with_there_is_no_score(circle):
    late = stretch(poses(circle), BEGIN_NS + 1)
    with pytest.raises(EstimatorError, match='no pose'):
        track_after(poses(circle), late, BEGIN_NS)


def test_recordings_that_are_not_there_are_named(tmp_path):
    there = RECORDINGS[0].folder
    (tmp_path / there).mkdir()
    assert bags(tmp_path) == (
        {recording.name: tmp_path / there for recording in RECORDINGS
         if recording.folder == there},
        [recording.name for recording in RECORDINGS if recording.folder != there])


@pytest.mark.parametrize('recording', RECORDINGS, ids=lambda recording: recording.name)
def test_what_is_known_of_a_robot_stands_unless_the_beginning_tells_more(recording):
    path = SHARED / recording.folder
    if not path.exists():
        pytest.skip(f'the recording {path} is not on this machine')
    params, known = learned(path, recording), recording.known
    assert params.robot.track_width == known['track_width']
    assert params.slip_sigma == known['slip_sigma']
    told = params.robot.imu.gyro_noise != RobotParams().imu.gyro_noise
    assert told == recording.identified
