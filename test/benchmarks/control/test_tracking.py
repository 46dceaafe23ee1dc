# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Path tracking benchmark: scores, requirements, tables, and one short run."""

from dataclasses import replace
import math

from benchmarks.control import tracking
from benchmarks.control.icr_kinematics import IcrControl
from benchmarks.control.run import missed, tables
from benchmarks.control.scenarios import (
    BEST, CASES, ICR, KINEMATICS, OTHER, OURS, SHORT, TrackingCase)
from benchmarks.control.tracking import (
    dense_points, path_errors, run_tracking, score_tracking, SPACING)
from benchmarks.scoring import combined, part_of
import numpy as np
import pytest
from smart_tire.control.path_library import figure_eight, line
from smart_tire.parameters.path_following import FollowerParams
from smart_tire.samples import NS_PER_S, PlannedPath
from support.ideal_robot import odometry

CASE = TrackingCase('lane_change', 'sand', 'true')


def pose(time, x, y=0.0, yaw_rate=0.0):
    return odometry(round(time * NS_PER_S), x, y, yaw_rate=yaw_rate)


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


def test_localization_error_is_taken_at_the_same_time_and_yaw_acceleration_over_a_period():
    truth = [pose(0.1 * n, 0.1 * n) for n in range(21)]
    followed = [pose(0.1 * n + 0.05, 0.1 * n + 0.05, 0.03) for n in range(19)]
    errors = score_tracking(line(2.0), truth, followed)
    assert errors['localization'].figures['rms'] == pytest.approx(0.03, abs=1e-6)
    # the control error is that of the pose that was followed, not of the true one
    assert errors['control'].figures['rms'] == pytest.approx(0.03, abs=1e-6)
    assert errors['true'].figures['max'] == pytest.approx(0.0, abs=1e-6)
    truth = [pose(0.01 * n, 0.01 * n, yaw_rate=0.02 * n) for n in range(201)]  # 2 rad/s2
    errors = score_tracking(line(2.0), truth, truth)
    assert errors['yaw'].figures['rms'] == pytest.approx(2.0, rel=0.05)


def row(**changes):
    """Return a row of the table with these changes; the errors are 10, 10 and 20 mm."""
    base = {'control_rms': 0.01, 'control.max': 0.1, 'true_rms': 0.03, 'localization_rms': 0.01,
            'length': 5.0, 'yaw.rms': 0.5, 'duration': 20.0, 'arrived': 1.0}
    return {f'{name}.{figure}': value for name in KINEMATICS for figure, value in base.items()
            } | {f'{SHORT}.control_rms': 0.02} | changes


@pytest.mark.parametrize('changes, expected', [
    ({}, []), ({'ours.control_rms': 0.0149}, []), ({'ours.control_rms': 0.0151}, ['error']),
    ({'ours.control_rms': 0.0149, 'ideal.control_rms': 0.0148}, ['error']),
    ({'ours.control_rms': 0.019, 'best.yaw.rms': 1.3}, []),
    ({'ours.control_rms': 0.019, 'best.arrived': 0.9}, []),
    ({'ours.arrived': 0.67}, ['arrival']), ({'ours.duration': 22.0}, ['time']),
    ({'ours.yaw.rms': 1.3}, ['yaw']), ({'ours.localization_rms': 0.026}, ['localization']),
    ({'ours.localization_rms': 0.024}, [])])
def test_control_and_localization_errors_are_required_on_their_own(changes, expected):
    found = row(**changes)
    assert missed(found) == expected
    errors, requirements = tables({CASE.name: found}, None)
    assert list(errors.columns[0].cells) == [CASE.title]
    assert list(requirements.columns[1].cells) == [', '.join(expected) or 'none']


def test_only_the_kinematics_differ_between_the_runs_of_a_case():
    stacks = {name: replace(CASE, kinematics=name).stack() for name in KINEMATICS}
    for name, stack in stacks.items():
        trajectory = replace(stack.trajectory, slip_compensation=True)
        assert (trajectory == stacks[OURS].trajectory) is (name in (ICR, OURS))
        assert replace(trajectory, follower=FollowerParams()) == stacks[OURS].trajectory
        assert stack.estimators == stacks[OURS].estimators
        assert stack.wheels == stacks[OURS].wheels
        assert stack.trajectory.slip_compensation == (name in (ICR, OURS))
        assert (stack.control is IcrControl) == (name == ICR)
    look_ahead = [stacks[name].trajectory.follower.look_ahead_time for name in (SHORT, BEST)]
    assert look_ahead == [0.35, 0.1]
    assert CASE.simulator(1) == replace(CASE, kinematics=SHORT).simulator(1)
    assert CASE.simulator(1) != CASE.simulator(2)


def test_the_ground_is_the_one_in_the_name_and_the_software_does_not_know_the_other_plant():
    bases = {one.ground: one.simulator(1).ground for one in CASES.values()}
    assert (bases['concrete'].base, bases['sand'].base) == ('concrete', 'sand')
    assert [patch.surface for patch in bases['change'].patches] == ['sand']
    other = replace(CASE, plant=OTHER)
    assert CASE.stack() == other.stack()
    assert (CASE.simulator(1).robot.mass, other.simulator(1).robot.mass) == (10.9, 15.0)


@pytest.mark.parametrize('localization', ['true', 'estimated'])
def test_the_robot_software_follows_a_path_in_closed_loop(localization, monkeypatch):
    monkeypatch.setattr(tracking.TrackingCase, 'wanted', lambda case: PlannedPath(
        0, 'odom', ((0.0, 0.0, math.nan), (0.25, 0.0, math.nan))))
    found = part_of(combined([run_tracking(replace(CASE, localization=localization), 101)]), OURS)
    assert found['arrived'] == 1.0 and 0.0 < found['control.rms'] < 0.01
    assert found['length'] == pytest.approx(0.25)
    assert (found['localization.rms'] < 1e-3) == (localization == 'true')
    assert found['localization.rms'] < 0.05
