# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Runs next to each other: alignment, rows, tables of other programs, the figure."""

import csv
from dataclasses import replace
import math

import numpy as np
import pytest

from smart_tire.analysis.comparison import (
    comparison_csv, comparison_tables, ERRORS, named, rows_of, write_comparison)
from smart_tire.analysis.dead_reckoning import baselines, GYRO_WHEELS, WHEELS_ONLY
from smart_tire.analysis.metrics import (
    ALIGNMENTS, carried, compared_poses, pose_score, SE2, START, UNALIGNED)
from smart_tire.analysis.motion_figures import comparison_figure
from smart_tire.analysis.result import Result
from smart_tire.parameters import RobotParams
from smart_tire.recording import SampleArrays
from support.driving import drive, driven, ramp
from support.ideal_robot import odometry

ROBOT = RobotParams()
PLACE = np.array([3.0, -1.0, 2.5])  # x, y, yaw of the frame of a reference


def path(places, begin_ns=0):
    """Return poses at 10 Hz."""
    return SampleArrays(odometry(begin_ns + i * 100_000_000, x, y, yaw=yaw, variance=0.01)
                        for i, (x, y, yaw) in enumerate(places))


def curve(scale=1.0, count=200):
    """Return poses of a spiral, ``scale`` times as large."""
    yaw = np.linspace(0.0, 5.0, count)
    radius = scale * (2.0 + 0.2 * yaw)
    return np.column_stack([radius * np.sin(yaw), radius * (1.0 - np.cos(yaw)), yaw])


@pytest.fixture(scope='module')
def run():
    """Return the result of a run with slip, whose estimates are exact but for 1 %."""
    rolling = ramp([(0, 0, 0), (2, 0, 0), (3, .5, .4), (12, .5, .4)])
    found = drive(rolling, rolling * [0.1, 0.0], icr=0.0, robot=ROBOT)
    true = found.pose[::100]
    return Result(path(true * [1.01, 1.01, 1.0], 1_700_000_000_000_000_000),
                  truth=path(true, 1_700_000_000_000_000_000),
                  dead_reckoning=baselines(SampleArrays(found.samples), ROBOT))


@pytest.mark.parametrize('align', ALIGNMENTS)
def test_the_same_path_in_another_frame_has_no_error_if_it_is_aligned(align):
    true = carried(curve(), np.zeros(3), PLACE)
    poses = Result(path(curve()), truth=path(true), align=align).filtered.poses
    expected = math.hypot(*PLACE[:2]) if align == UNALIGNED else 0.0
    assert math.hypot(*poses.error[0, :2]) == pytest.approx(expected, abs=1e-9)
    if align != UNALIGNED:
        assert np.abs(poses.error).max() < 1e-9


def test_least_squares_are_below_any_other_alignment():
    noisy = curve(1.05) + np.random.default_rng(1).normal(0.0, 0.05, (200, 3))
    result = Result(path(noisy), truth=path(carried(curve(), np.zeros(3), PLACE)), align=SE2)
    fitted = pose_score(result.filtered.poses)
    by_start = pose_score(replace(result, align=START).filtered.poses)
    assert fitted.position_rms_m < by_start.position_rms_m
    poses = result.filtered.poses
    for step in np.eye(3) * 1e-3:
        for sign in (1.0, -1.0):
            moved = carried(poses.true, np.zeros(3), sign * step)
            assert np.sum((poses.estimated - moved)[:, :2] ** 2) > np.sum(poses.error[:, :2] ** 2)
    assert math.isnan(fitted.position_normalized_rms) and math.isnan(fitted.position_within_two)


@pytest.mark.parametrize('align', ALIGNMENTS)
def test_a_whole_turn_between_two_frames_is_no_heading_error(align):
    own = path(curve()).poses()
    turned = replace(own, pose=own.pose + [0.0, 0.0, 2.0 * math.tau])
    assert np.abs(compared_poses(own, turned, align).error).max() < 1e-6


def test_displacements_in_each_meter_are_those_of_a_scale():
    found = pose_score(Result(driven(1000, speed=1.01, variance=0.04),
                              truth=driven(1000, speed=1.0)).filtered.poses)
    assert found.drift_per_meter_m == pytest.approx(0.01, rel=0.02)
    assert math.isnan(pose_score(Result(driven(50), truth=driven(50)).filtered.poses)
                      .drift_per_meter_m)  # 0.25 m


def test_each_run_has_rows_of_dead_reckoning_at_the_same_times(run):
    rows = list(rows_of({'a': run.filtered}))
    assert [(label, method) for label, method, _ in rows] == [
        ('a', 'estimate'), ('a', GYRO_WHEELS), ('a', WHEELS_ONLY)]
    own, gyro, wheels = (tree['pose'] for _, _, tree in rows)
    assert rows[0][2]['nees'] == pytest.approx(own['position_normalized_rms'] ** 2, rel=1e-4)
    assert own['position_end_m'] == pytest.approx(0.01 * own['distance_m'], rel=0.3)
    assert own['distance_m'] == pytest.approx(gyro['distance_m'], rel=0.04)  # to its end
    assert own['position_rms_m'] < gyro['position_rms_m'] < wheels['position_rms_m']
    assert rows[1][2]['slip'] is rows[1][2]['nees'] is rows[1][2]['friction'] is None


def test_smoothed_estimates_are_a_run_and_dead_reckoning_is_not_repeated(run):
    runs = named({'a': replace(run, smoothed=run.estimates), 'b': run})
    assert list(runs) == ['a, filtered', 'a, smoothed', 'b']
    assert [label for label, method, _ in rows_of(runs) if method == GYRO_WHEELS] == [
        'a, filtered']  # all have the same


def test_slip_and_friction_are_those_of_all_wheels():
    (_, _, tree), = rows_of({'a': Result(
        driven(slip=(0.1, 0.2, 0.1, 0.2), sigma=0.06), truth=driven(slip=0.1, sigma=0.0)
    ).filtered})
    assert tree['slip']['rms'] == pytest.approx(0.1 * math.sqrt(0.5))
    assert tree['slip']['within_two'] == 1.0 and tree['slip']['within_one'] == 0.5
    assert tree['friction'] is None


def test_without_a_reference_there_are_estimates_only(run):
    alone, = comparison_tables({'a': replace(run, truth=SampleArrays()).filtered})
    assert alone.title == 'Estimates' and alone.rows[0][-1] == '-'
    ends, errors = comparison_tables({'a': run.filtered})
    assert ends.rows[0][:2] == alone.rows[0][:2] and len(errors.rows) == 3


def test_csv_and_latex_have_the_rows_of_the_table(run, tmp_path):
    runs = {'50 % & more': run.filtered}
    write_comparison(tmp_path / 'new', runs, figure=False)
    head, *rows = csv.reader((tmp_path / 'new' / 'comparison.csv').open())
    assert head == ['run', 'method', *(key for _, key, _ in ERRORS)] and len(rows) == 3
    (_, _, tree), *_ = rows_of(runs)
    assert float(rows[0][2]) == tree['pose']['position_rms_m'] and rows[1][-1] == ''
    latex = (tmp_path / 'new' / 'comparison.tex').read_text().splitlines()
    assert latex[0] == r'\begin{tabular}{ll' + 'r' * len(ERRORS) + '}'
    assert latex[4].startswith(r'50 \% \& more & estimate & ') and latex[4].endswith(r' \\')
    assert {line.count(' & ') for line in latex[2:3] + latex[4:7]} == {len(ERRORS) + 1}
    assert comparison_csv(runs) == (tmp_path / 'new' / 'comparison.csv').read_text()


@pytest.mark.parametrize('align', ALIGNMENTS)
def test_paths_are_drawn_in_one_frame(align, run):
    frame = carried(run.truth.poses().pose, np.zeros(3), PLACE)
    moved = replace(run, truth=path(frame, 1_700_000_000_000_000_000), align=align)
    figure = comparison_figure(named({'a': moved, 'b': moved}))
    lines = {mark.label: np.stack([mark.curve.x, mark.curve.y]) for mark in figure.panels[0].marks
             if mark.kind == 'line'}
    assert list(lines) == [GYRO_WHEELS, 'a', 'b', 'truth']
    expected = (run.truth.poses().pose if align == START else frame)[:, :2].T
    assert lines['truth'] == pytest.approx(expected, abs=1e-6)
    own = lines['a'] if align != UNALIGNED else lines['a'] - lines['a'][:, :1] + expected[:, :1]
    if align != UNALIGNED:
        assert np.abs(own - lines['truth']).max() < 0.06  # 1 % of 4 m, and its fit
    areas = [mark for mark in figure.panels[0].marks if mark.kind == 'area']
    assert len(areas) == (2 if align == START else 0)
    assert [[mark.label for mark in panel.marks] for panel in figure.panels[1:]] == [
        ['a', 'b', GYRO_WHEELS]] * 2


def test_each_reference_is_drawn_once(run):
    other = replace(run, truth=path(1.2 * curve(count=90), 1_700_000_000_000_000_000))
    for second, count in ((run, 1), (other, 2)):
        figure = comparison_figure(named({'a': run, 'b': second}))
        assert [mark.label for mark in figure.panels[0].marks].count('truth') == count


def test_runs_without_poses_or_overlap_are_left_out_of_the_figure(run):
    late = replace(run, estimates=path(curve()), dead_reckoning={})
    figure = comparison_figure(named({'a': run, 'b': late, 'c': Result(SampleArrays())}))
    assert {'a', 'b'} <= {mark.label for mark in figure.panels[0].marks}
    assert [mark.label for mark in figure.panels[1].marks] == ['a', GYRO_WHEELS]
    assert comparison_figure(named({'c': Result(SampleArrays())})) is None
