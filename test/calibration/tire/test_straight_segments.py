"""Straight runs of a recording, and errors that are as large and as linked as is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.driving import STEP
from support.identifying import recorded, turning_run
from support.straight import CONCRETE, motion, straight_run

from smart_tire.calibration.recording import ImuRecord, WheelRecord
from smart_tire.calibration.tire.straight_segments import (
    FEWEST, LONGEST, straight_runs, white_noise)
from smart_tire.parameters import RobotParams

ROBOT = RobotParams()


def without(recording, begin, end):
    """Return a recording whose inertial unit was silent between two times [s]."""
    imu = recording.imu
    heard = (imu.time < begin) | (imu.time > end)
    return replace(recording, imu=ImuRecord(imu.time[heard], imu.rate[heard], imu.force[heard]))


def test_a_start_and_the_way_after_it_are_one_run():
    runs = straight_runs(straight_run(CONCRETE, 1), ROBOT)
    assert runs.count == 1 and set(runs.run) == {0}
    assert 1.0 < runs.begin[0] < 1.5 and runs.end[-1] > 19.5
    assert (runs.begin[1:] == runs.end[:-1]).all()
    rolling, _ = motion(CONCRETE)
    middle = 0.5 * (runs.begin + runs.end)
    assert runs.speed == pytest.approx(rolling[(middle / STEP).astype(int)], abs=0.1)


def test_a_robot_that_turns_or_stands_has_none():
    assert straight_runs(straight_run(CONCRETE, 1, pace=lambda time: 0.0), ROBOT) is None
    turning = straight_runs(recorded(turning_run(1, 20.0, turn=0.6)), ROBOT)
    assert turning is None or len(turning.row) < 40


def test_where_the_unit_was_silent_a_run_ends():
    recording = straight_run(CONCRETE, 2)
    runs = straight_runs(without(recording, 10.0, 10.3), ROBOT)
    assert runs.count == 2
    assert not ((runs.end > 10.0) & (runs.begin < 10.3)).any()


def test_where_a_wheel_reading_is_missing_a_run_ends():
    recording = straight_run(CONCRETE, 2, positions=False)
    wheels = recording.wheels
    heard = np.arange(len(wheels.time)) != 200
    runs = straight_runs(replace(recording, wheels=WheelRecord(
        wheels.time[heard], wheels.velocity[heard], None)), ROBOT)
    assert runs.count == 2


def test_stretches_that_are_left_out_end_a_run_and_short_runs_go():
    recording = straight_run(CONCRETE, 3)
    rows = straight_runs(recording, ROBOT).row
    runs = straight_runs(recording, ROBOT, rows[[FEWEST - 1, 100]])
    assert runs.count == 2
    assert runs.row.tolist() == [*rows[FEWEST:100], *rows[101:]]
    assert runs.lasted[runs.reading_run == 1].min() <= 0.01


def test_long_runs_go_on_as_others():
    runs = straight_runs(straight_run(CONCRETE, 4, seconds=40.0), ROBOT)
    assert runs.count == 2
    assert np.bincount(runs.run).max() == LONGEST


def test_wheels_that_are_read_often_give_stretches_of_usual_length():
    runs = straight_runs(straight_run(CONCRETE, 5, wheel_rate=200.0), ROBOT)
    assert np.median(runs.end - runs.begin) == pytest.approx(0.05, abs=0.006)


def test_errors_of_wheels_and_unit_are_white_and_of_unit_size_once_whitened():
    """Against the truth: what wheels measure, less how the integral of the unit strays."""
    squares, links = [], []
    rolling, over_ground = motion(CONCRETE)
    gone = np.cumsum(rolling) * STEP
    distance = np.cumsum(over_ground) * STEP
    fine = np.arange(len(rolling)) * STEP
    for seed in range(8):
        runs = straight_runs(straight_run(CONCRETE, seed), ROBOT)
        true, ground = (np.interp(runs.end, fine, way) - np.interp(runs.begin, fine, way)
                        for way in (gone, distance))
        # a constant bias is fitted, and so the slope of what strays is no error
        steps = 0.5 * (runs.gained[1:] + runs.gained[:-1]) * np.diff(runs.time)
        felt = np.concatenate([[0.0], np.cumsum(steps)])
        way = np.interp(runs.end, runs.time, felt) - np.interp(runs.begin, runs.time, felt)
        lasted = runs.end - runs.begin
        error = runs.speed - true / lasted + (ground - way) / lasted
        design = np.column_stack([np.ones(len(error)), 0.5 * (runs.begin + runs.end)])
        white, columns = runs.whitened(error), runs.whitened(design)
        white = white - columns @ np.linalg.lstsq(columns, white, rcond=None)[0]
        squares.append(np.sum(white ** 2) / (len(white) - 2))
        links.append(np.sum(white[1:] * white[:-1]) / np.sum(white ** 2))
    assert 0.85 < np.mean(squares) < 1.15
    assert abs(np.mean(links)) < 0.1


def test_white_noise_is_told_apart_from_what_changes_slowly():
    rng = np.random.default_rng(1)
    slow = 5.0 * np.sin(np.arange(5000) / 100.0)
    assert white_noise(slow + rng.normal(0.0, 0.3, 5000)) == pytest.approx(0.3, rel=0.05)
    assert white_noise(np.array([1.0, 2.0])) == 0.0
