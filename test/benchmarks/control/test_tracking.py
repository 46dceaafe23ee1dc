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

"""Path tracking benchmark: scores, requirements, tables, figures, and one short run."""

from __future__ import annotations

from dataclasses import replace
import math

from benchmarks.control import tracking
from benchmarks.control.figures import tracking_figure
from benchmarks.control.icr_kinematics import IcrControl
from benchmarks.control.requirements import missed
from benchmarks.control.run import jobs, label, TITLES, TRACTION, WHEEL_STEPS
from benchmarks.control.scenarios import (
    all_cases, BEST, CALIBRATED_TRACK, FIXED, ICR, KINEMATICS, OTHER, OURS, SHORT, title,
    TrackingCase)
from benchmarks.control.scoring import (
    dense_points, path_errors, score_tracking, SPACING, TrackingScore)
from benchmarks.control.tables import duration_table, tracking_table
from benchmarks.control.tracking import run_tracking, TrackingResult
from benchmarks.control.tracking_results import as_tree, by_case, Combined, combined
from benchmarks.control.traction import scenarios
import numpy as np
import pytest
from smart_tire.control.path_library import figure_eight, line
from smart_tire.parameters.path_following import FollowerParams
from smart_tire.samples import NS_PER_S, Odometry, PlannedPath

ZEROS = (0.0,) * 36
CASE = TrackingCase('lane_change', 'sand', 'true', OURS)


def pose(time, x, y):
    return Odometry(round(time * NS_PER_S), (x, y, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0,) * 3,
                    (0.0,) * 3, ZEROS, ZEROS)


def test_the_tracking_error_is_the_distance_from_the_path_on_both_sides():
    position = np.array([[0.0, 0.0], [0.5, 0.02], [1.0, -0.03], [1.5, 0.0], [2.0, 0.0],
                         [2.1, 0.0]])
    assert path_errors(line(2.0), position) == pytest.approx(
        [0.0, 0.02, 0.03, 0.0, 0.0, 0.1], abs=1e-3)


def test_parts_of_a_path_that_cross_are_not_mixed_up():
    path = figure_eight(0.7)
    points = dense_points(path)
    length = (len(points) - 1) * SPACING
    assert length == pytest.approx(15.7 * 0.7, rel=0.01)
    crossing = len(points) // 2
    assert np.hypot(*points[crossing]) < 0.01
    # away from its own part at the crossing, along the other part
    start = points[crossing - 200:crossing + 1:50]
    straying = np.vstack([start, [[0.05, 0.0], [0.1, 0.0]]])
    assert path_errors(path, np.vstack([points[:crossing - 200:50], straying]))[-1] > 0.04


def test_a_score_counts_from_the_start_to_the_end_only():
    truth = [pose(0.1 * n, 0.1 * n, 1.0 if n in (0, 20) else 0.01) for n in range(21)]
    score = score_tracking(line(2.0), truth, truth, start_ns=NS_PER_S // 10,
                           end_ns=19 * NS_PER_S // 10, arrived=True)
    assert (score.rms, score.maximum) == pytest.approx((0.01, 0.01), abs=2e-4)
    assert score.final == pytest.approx(math.hypot(0.1, 0.01), abs=1e-3)
    assert score.duration == pytest.approx(1.8)
    assert score.localization == 0.0 and score.arrived


def test_the_localization_error_is_taken_at_the_same_time():
    truth = [pose(0.1 * n, 0.1 * n, 0.0) for n in range(21)]
    followed = [pose(0.1 * n + 0.05, 0.1 * n + 0.05, 0.03) for n in range(19)]
    score = score_tracking(line(2.0), truth, followed, start_ns=0, end_ns=2 * NS_PER_S,
                           arrived=False)
    assert score.localization == pytest.approx(0.03, abs=1e-6)
    # the control error is that of the pose that was followed, not of the true one
    assert (score.rms, score.true_rms) == pytest.approx((0.03, 0.0), abs=1e-6)


def test_the_yaw_acceleration_is_that_of_the_mean_over_the_period_of_the_controller():
    truth = [replace(pose(0.01 * n, 0.01 * n, 0.0), angular=(0.0, 0.0, 0.02 * n))
             for n in range(201)]  # 2 rad/s2
    score = score_tracking(line(2.0), truth, truth, start_ns=0, end_ns=2 * NS_PER_S, arrived=True)
    assert score.yaw_acceleration == pytest.approx(2.0, rel=0.05)
    assert score.length == pytest.approx(2.0)


def score(**values):
    return replace(TrackingScore(0.03, 0.1, 0.03, 0.01, 5.0, 0.5, 0.0, 20.0, True), **values)


def test_seeds_are_combined_by_rms_maximum_and_share():
    both = combined([score(), score(rms=0.04, maximum=0.2, duration=30.0, arrived=False)])
    assert both == Combined(
        pytest.approx(math.sqrt((0.03**2 + 0.04**2) / 2)), 0.2, pytest.approx(0.03),
        pytest.approx(0.01), 5.0, pytest.approx(0.5), 25.0, 0.5)


def row(ours=None, best=None, short=None):
    """Return a row of the table with these changes; the errors are 10, 10 and 20 mm."""
    base = combined([score(rms=0.01)])
    return {SHORT: replace(base, rms=0.02, **(short or {})), BEST: replace(base, **(best or {})),
            OURS: replace(base, **(ours or {}))}


@pytest.mark.parametrize('ours, best, short, expected', [
    ({}, {}, {}, []), ({'rms': 0.0149}, {}, {}, []), ({'rms': 0.0151}, {}, {}, ['error']),
    ({'rms': 0.0149}, {}, {'rms': 0.0148}, ['error']),
    ({'rms': 0.019}, {'yaw_acceleration': 1.3}, {}, []),
    ({'rms': 0.019}, {'arrived': 0.9}, {}, []),
    ({'arrived': 0.67}, {}, {}, ['arrival']), ({'duration': 22.0}, {}, {}, ['time']),
    ({'yaw_acceleration': 1.3}, {}, {}, ['yaw']),
    ({'yaw_acceleration': 1.3}, {}, {'yaw_acceleration': 1.4}, ['yaw']),
    ({'localization': 0.026}, {}, {}, ['localization']), ({'localization': 0.024}, {}, {}, [])])
def test_control_and_localization_errors_are_required_on_their_own(ours, best, short, expected):
    rows = row(ours, best)
    rows[SHORT] = replace(rows[SHORT], **short)
    assert missed(rows) == expected


def test_only_the_kinematics_differ_between_the_runs_of_a_case():
    stacks = {name: replace(CASE, kinematics=name).stack() for name in KINEMATICS}
    for name, stack in stacks.items():
        trajectory = replace(stack.trajectory, effective_track=0.38, slip_compensation=True)
        assert (trajectory == stacks[OURS].trajectory) is (name in (FIXED, ICR, OURS))
        assert replace(trajectory, follower=FollowerParams()) == stacks[OURS].trajectory
        assert stack.estimators == stacks[OURS].estimators
        assert replace(stack.wheels, effective_track=0.38) == stacks[OURS].wheels
        assert stack.wheels.effective_track == stack.trajectory.effective_track
        assert stack.trajectory.slip_compensation == (name in (ICR, OURS))
        assert (stack.control is IcrControl) == (name == ICR)
    assert stacks[FIXED].wheels.effective_track == CALIBRATED_TRACK
    assert CASE.simulator(1) == replace(CASE, kinematics=SHORT).simulator(1)
    assert CASE.simulator(1) != CASE.simulator(2)


def test_the_ground_of_a_case_is_the_one_in_its_name():
    bases = {one.ground: one.simulator(1).ground for one in all_cases()}
    assert (bases['concrete'].base, bases['sand'].base) == ('concrete', 'sand')
    assert [patch.surface for patch in bases['change'].patches] == ['sand']


def test_the_software_does_not_know_the_other_plant():
    own, other = CASE, replace(CASE, plant=OTHER)
    assert own.stack() == other.stack()
    assert (own.simulator(1).robot.mass, other.simulator(1).robot.mass) == (10.9, 15.0)


def test_every_run_has_a_title_and_its_jobs():
    assert len(TITLES) == 2 + len({case.name for case in all_cases()})
    assert len(set(TITLES.values())) == len(TITLES)
    starts = len(scenarios([1, 2]))
    assert starts > 0 and len(jobs([1, 2], [TRACTION])) == starts
    assert len(jobs([1, 2], list(TITLES))) == 1 + starts + 2 * len(list(all_cases()))
    assert len(jobs([1, 2], [WHEEL_STEPS])) == 1
    assert len(jobs([1, 2], [CASE.name])) == 2 * len(KINEMATICS)
    assert title(CASE.name) == 'lane change, sand, true pose'


@pytest.fixture(scope='module')
def short_path():
    """Replace the path of the case by a short one; return results of its kinematics."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tracking.TrackingCase, 'wanted', lambda case: PlannedPath(
            0, 'odom', ((0.0, 0.0, math.nan), (0.25, 0.0, math.nan))))
        result = run_tracking(CASE, 101, traced=True)
        yield [replace(result, case=replace(CASE, kinematics=name)) for name in KINEMATICS]


def test_the_robot_software_follows_a_path_in_closed_loop(short_path):
    result = short_path[0]
    assert result.score.arrived and result.reason == ''
    assert 0.0 < result.score.rms < 0.01
    assert result.score.localization < 1e-3
    assert result.score.final < 0.05
    trace = result.trace
    assert trace is not None
    assert trace.time[0] == pytest.approx(0.0, abs=0.06)
    assert trace.position[-1, 0] == pytest.approx(0.25, abs=0.05)
    assert trace.used.shape == trace.slip.shape == (len(trace.time), 4)
    assert trace.slip.max() > 0.05 and 0.1 < trace.used.max() <= 1.0


def test_results_make_rows_a_table_and_a_figure(short_path):
    rows = by_case(short_path)
    assert list(rows) == [CASE.name] and list(rows[CASE.name]) == list(KINEMATICS)
    tree = as_tree(short_path)
    assert tree[CASE.name][OURS]['seeds']['101']['reason'] == ''
    table = tracking_table(rows)
    assert list(table.columns[0].cells) == ['lane change, sand, true pose']
    times = duration_table(rows)
    assert list(times.columns[-1].cells) == ['100%']
    assert label(short_path[0]).endswith(', ideal, seed 101')
    figure = tracking_figure(CASE, {one.case.kinematics: one.trace for one in short_path})
    assert [ax.get_title() for ax in figure.axes[:3]] == [
        f'lane change, sand, true pose:\n{KINEMATICS[name]}' for name in (SHORT, FIXED, OURS)]


def test_a_missed_requirement_is_named():
    results = [TrackingResult(replace(CASE, kinematics=name), 1, score(
        rms=0.03 if name == OURS else 0.015), '', None) for name in KINEMATICS]
    assert str(list(tracking_table(by_case(results)).columns[-1].cells)[0]) == 'error'


def test_the_estimators_are_part_of_the_loop():
    case = replace(CASE, localization='estimated')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tracking.TrackingCase, 'wanted', lambda case: PlannedPath(
            0, 'odom', ((0.0, 0.0, math.nan), (0.25, 0.0, math.nan))))
        found = run_tracking(case, 101, traced=False).score
    assert found.arrived and 0.0 < found.localization < 0.05
