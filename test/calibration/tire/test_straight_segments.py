"""Straight segments of a recording, and the covariance of their errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.driving import STEP
from support.identifying import recorded, turning_run
from support.straight import CONCRETE, motion, straight_run

from smart_tire.calibration.recording import ImuRecord, WheelRecord
from smart_tire.calibration.tire.straight_segments import (
    MAX_SEGMENT_INTERVALS, MIN_SEGMENT_INTERVALS, straight_segments)
from smart_tire.numerics.robust import noise_level
from smart_tire.parameters import RobotParams

ROBOT = RobotParams()


def without(recording, begin, end):
    """Return a recording without IMU samples between two times [s]."""
    imu = recording.imu
    received = (imu.time < begin) | (imu.time > end)
    return replace(recording, imu=ImuRecord(
        imu.time[received], imu.rate[received], imu.force[received]))


def test_a_start_and_the_drive_after_it_are_one_segment():
    segments = straight_segments(straight_run(CONCRETE, 1), ROBOT)
    assert segments.count == 1 and set(segments.segment) == {0}
    assert 1.0 < segments.begin[0] < 1.5 and segments.end[-1] > 19.5
    assert (segments.begin[1:] == segments.end[:-1]).all()
    rolling, _ = motion(CONCRETE)
    middle = 0.5 * (segments.begin + segments.end)
    assert segments.speed == pytest.approx(rolling[(middle / STEP).astype(int)], abs=0.1)


def test_turns_and_standstill_have_no_straight_segment():
    assert straight_segments(straight_run(CONCRETE, 1, pace=lambda time: 0.0), ROBOT) is None
    turning = straight_segments(recorded(turning_run(1, 20.0, turn=0.6)), ROBOT)
    assert turning is None or len(turning.row) < 40


def test_an_imu_gap_ends_a_segment():
    recording = straight_run(CONCRETE, 2)
    segments = straight_segments(without(recording, 10.0, 10.3), ROBOT)
    assert segments.count == 2
    assert not ((segments.end > 10.0) & (segments.begin < 10.3)).any()


def test_a_missing_wheel_sample_ends_a_segment():
    recording = straight_run(CONCRETE, 2, positions=False)
    wheels = recording.wheels
    received = np.arange(len(wheels.time)) != 200
    segments = straight_segments(replace(recording, wheels=WheelRecord(
        wheels.time[received], wheels.velocity[received], None)), ROBOT)
    assert segments.count == 2


def test_excluded_intervals_end_a_segment_and_short_segments_are_dropped():
    recording = straight_run(CONCRETE, 3)
    rows = straight_segments(recording, ROBOT).row
    segments = straight_segments(recording, ROBOT, rows[[MIN_SEGMENT_INTERVALS - 1, 100]])
    assert segments.count == 2
    assert segments.row.tolist() == [*rows[MIN_SEGMENT_INTERVALS:100], *rows[101:]]
    assert segments.elapsed[segments.sample_segment == 1].min() <= 0.01


def test_long_segments_are_split():
    segments = straight_segments(straight_run(CONCRETE, 4, seconds=40.0), ROBOT)
    assert segments.count == 2
    assert np.bincount(segments.segment).max() == MAX_SEGMENT_INTERVALS


def test_a_high_wheel_rate_gives_merged_intervals():
    segments = straight_segments(straight_run(CONCRETE, 5, wheel_rate=200.0), ROBOT)
    assert np.median(segments.end - segments.begin) == pytest.approx(0.05, abs=0.006)


def test_whitened_errors_are_white_with_unit_variance():
    """Errors of wheel speeds minus those of the integrated acceleration, against truth."""
    squares, correlations = [], []
    rolling, over_ground = motion(CONCRETE)
    rolled = np.cumsum(rolling) * STEP
    distance = np.cumsum(over_ground) * STEP
    fine = np.arange(len(rolling)) * STEP
    for seed in range(8):
        segments = straight_segments(straight_run(CONCRETE, seed), ROBOT)
        true, ground = (np.interp(segments.end, fine, path) - np.interp(segments.begin, fine, path)
                        for path in (rolled, distance))
        # the estimated bias removes a linear trend of the error
        steps = 0.5 * (segments.speed_gain[1:] + segments.speed_gain[:-1]) * np.diff(segments.time)
        integral = np.concatenate([[0.0], np.cumsum(steps)])
        integrated = np.interp(segments.end, segments.time, integral) - np.interp(
            segments.begin, segments.time, integral)
        duration = segments.end - segments.begin
        error = segments.speed - true / duration + (ground - integrated) / duration
        design = np.column_stack([np.ones(len(error)), 0.5 * (segments.begin + segments.end)])
        white, columns = segments.whitened(error), segments.whitened(design)
        white = white - columns @ np.linalg.lstsq(columns, white, rcond=None)[0]
        squares.append(np.sum(white ** 2) / (len(white) - 2))
        correlations.append(np.sum(white[1:] * white[:-1]) / np.sum(white ** 2))
    assert 0.85 < np.mean(squares) < 1.15
    assert abs(np.mean(correlations)) < 0.1


def test_white_noise_is_separated_from_slow_changes():
    rng = np.random.default_rng(1)
    slow = 5.0 * np.sin(np.arange(5000) / 100.0)
    assert noise_level(slow + rng.normal(0.0, 0.3, 5000), 2) == pytest.approx(0.3, rel=0.05)
    assert noise_level(np.array([1.0, 2.0]), 2) == 0.0
