# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Followed paths of a recording: when they begin and end, tracking errors, their figure."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.analysis.driven_paths import driven_lines, driven_tree, grounds_of, PathLog
from smart_tire.analysis.motion_figures import path_figure, tracking_figure
from smart_tire.analysis.offline import analyze
from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.control.trajectory_control import PathState
from smart_tire.parameters import build, SimulatorParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import NAN, NS_PER_S, PathProgress, PlannedPath
from support.ideal_robot import odometry

START = 1_700_000_000 * NS_PER_S
SPEED = 0.5  # m/s


def stamp(seconds):
    return START + round(seconds * NS_PER_S)


def poses(y=0.0, yaw=0.0, until=10.0):
    """Return a drive along x from 2 s on, in a frame that is turned by ``yaw``."""
    series = SampleArrays()
    for seconds in np.arange(0.0, until, 0.02):
        x = SPEED * max(seconds - 2.0, 0.0)
        own_y = y * min(x, 1.0)
        series.add_sample(odometry(stamp(seconds), math.cos(yaw) * x - math.sin(yaw) * own_y,
                                   math.sin(yaw) * x + math.cos(yaw) * own_y, yaw))
    return series.poses()


def straight(seconds, begin=0.0, end=3.0):
    return PlannedPath(stamp(seconds), 'odom', ((begin, 0.0, NAN), (end, 0.0, NAN)))


STRAIGHT = straight(2.0)


def log(*states, paths=(STRAIGHT,)):
    """Return a log with progress four times a second, the states change at given times."""
    found = PathLog()
    for path in paths:
        found.add_message(path.stamp_ns + 1000, path)
    for seconds in np.arange(0.0, 10.0, 0.25):
        state = [state for since, state in states if since <= seconds][-1]
        found.add_message(0, PathProgress(stamp(seconds), NAN, NAN, int(state)))
    return found


FOLLOWED = (0.0, PathState.IDLE), (2.25, PathState.FOLLOWING), (8.0, PathState.ARRIVED)


def test_a_path_ends_with_the_first_other_state():
    [drive] = log(*FOLLOWED).driven(poses(), SampleArrays().poses())
    assert drive.state == PathState.ARRIVED
    assert drive.duration == pytest.approx(6.0)
    assert drive.estimated[[0, -1], 0] == pytest.approx([0.0, 3.0])
    assert not len(drive.true)


def test_the_state_before_the_path_does_not_end_it():
    [drive] = log((0.0, PathState.ARRIVED), (2.5, PathState.FOLLOWING),
                  (8.0, PathState.STOPPED)).driven(poses(), SampleArrays().poses())
    assert drive.state == PathState.STOPPED and drive.duration == pytest.approx(6.0)


def test_a_refused_path_was_not_driven():
    assert log((0.0, PathState.IDLE), (2.25, PathState.REFUSED)).driven(poses(), poses()) == []


def test_a_new_path_ends_the_one_before():
    first, second = log((0.0, PathState.IDLE), (2.25, PathState.FOLLOWING),
                        (8.0, PathState.ARRIVED), paths=(
                            straight(2.0), straight(5.0, 1.5))).driven(poses(), poses())
    assert first.end_ns < second.begin_ns == stamp(5.0)
    assert first.state == PathState.FOLLOWING and second.state == PathState.ARRIVED


def test_errors_in_truth_are_those_since_the_path_began():
    # The frame of the truth is turned; the estimate drifts to the side by 0.1 m.
    [drive] = log(*FOLLOWED).driven(poses(y=0.1), poses(yaw=1.0))
    tree = driven_tree(drive)
    assert tree['in_odom']['max_m'] == pytest.approx(0.1, abs=1e-6)
    assert tree['in_odom']['end_m'] == pytest.approx(0.1, abs=1e-3)
    assert tree['in_truth']['max_m'] < 1e-6
    assert tree['in_truth']['completed'] == pytest.approx(1.0)
    assert (tree['state'], tree['duration_s']) == ('arrived', pytest.approx(6.0))
    text = '\n'.join(driven_lines('lane_change', tree))
    assert 'lane_change: arrived after 6.0 s, 3.0 m driven, 100% of the path' in text
    assert 'in truth: 0.000 m rms' in text and 'as estimated: 0.082 m rms, 0.100 m at' in text


def test_without_truth_the_errors_are_those_of_the_estimate():
    [drive] = log(*FOLLOWED).driven(poses(y=0.1), SampleArrays().poses())
    tree = driven_tree(drive)
    assert tree['in_truth'] is None
    assert 'in truth' not in '\n'.join(driven_lines('path', tree))
    assert len(tracking_figure(drive).panels[1].marks) == 2  # zero and estimate


def test_a_path_in_another_frame_is_not_compared():
    other = PlannedPath(stamp(2.0), 'map', straight(2.0).poses)
    assert log(*FOLLOWED, paths=(other,)).driven(poses(), poses()) == []
    assert log(*FOLLOWED, paths=(other,)).wanted() == []


def test_a_path_in_a_bag_is_drawn_with_the_analysis(drive, bag_of, tmp_path):
    begin = drive[0][0]
    path = PlannedPath(begin, 'odom', ((0.0, 0.0, NAN), (1.0, 0.5, NAN)))
    events = [(begin, 'path', path), *(event for event in drive
                                       if event[0] < begin + 2 * NS_PER_S)]
    result = analyze(bag_of(tmp_path / 'bag', events), None, EstimatorParams())
    [wanted] = result.contents.paths.wanted()
    assert wanted.tolist() == [[0.0, 0.0], [1.0, 0.5]]
    assert path_figure(result.result).panels[0].marks[0].label == 'wanted'


def test_the_figure_shows_wanted_driven_and_true_path():
    [drive] = log(*FOLLOWED).driven(poses(y=0.1), poses())
    path, error = tracking_figure(drive).panels
    assert [mark.label for mark in path.marks] == ['wanted', 'driven, estimate', 'truth', 'start']
    assert error.marks[1].curve.y[-1] == pytest.approx(0.1, abs=1e-6)
    assert error.marks[2].curve.y[-1] == pytest.approx(0.0, abs=1e-6)


def test_the_ground_is_shown_in_the_frame_of_the_start():
    params = build(SimulatorParams, {'start': [1.0, 0.0, math.pi / 2]})
    grounds = grounds_of(params)
    assert grounds.base == 'sand' and [area.surface for area in grounds.areas] == ['concrete']
    # the robot looks along y of the world: its x is 3 m to the border, its y 4 m (x = -3)
    corners = grounds.areas[0].corners
    assert corners.max(axis=0) == pytest.approx([3.0, 4.0])
    assert corners.min(axis=0) == pytest.approx([-3.0, -2.0])
    [drive] = log(*FOLLOWED).driven(poses(y=0.1), poses())
    figure = tracking_figure(drive, grounds)
    area = figure.panels[0].marks[-1]
    assert (area.label, area.kind) == ('concrete', 'area')
    assert 'Around the shaded patches: sand.' in figure.caption
