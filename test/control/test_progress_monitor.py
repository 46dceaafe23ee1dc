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

"""Conditions under which following stops, on numbers of progress alone."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
import pytest

from smart_tire.control.ground_motion import Motion
from smart_tire.control.path_geometry import PathPoint, Segment
from smart_tire.control.stop_conditions import ProgressMonitor
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.parameters.path_following import ArrivalParams, PathCheckParams
from smart_tire.samples import NS_PER_S

PARAMS = TrajectoryControllerParams(
    checks=PathCheckParams(progress_timeout=2.0, max_cross_track_error=0.5),
    arrival=ArrivalParams(xy_tolerance=0.05))
LINE = Segment(np.array([0.0, 1.0]), np.array([0.0, 0.0]))
STILL = Motion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass
class Follower:
    """What the monitor reads of a path follower."""

    progress: tuple[float, float] = (0.0, -math.inf)
    point: PathPoint | None = None
    finished: bool = False
    segment: Segment | None = LINE
    end_segment: Segment | None = LINE
    on_last_segment: bool = True

    def advance(self):
        return self.progress


def check(monitor, seconds=0.0, motion=STILL, **follower):
    return monitor.check(Follower(**follower), motion, round(seconds * NS_PER_S), PARAMS)


def later(before, after):
    """Return whether ``after`` is progress from ``before``."""
    monitor = ProgressMonitor()
    check(monitor, progress=before)
    check(monitor, 1.9, progress=after)
    return not check(monitor, 2.1, progress=after)


@pytest.mark.parametrize(('before', 'after', 'progress'), [
    ((0.0, -math.inf), (0.021, -math.inf), True),
    ((0.0, -math.inf), (0.019, -math.inf), False),
    ((0.0, -math.inf), (-1.0, -math.inf), False),
    ((0.0, -math.inf), (0.0, -1.0), True),
    ((0.0, -1.0), (0.0, -0.959), True),
    ((0.0, -1.0), (0.0, -0.961), False),
    ((0.0, -1.0), (0.0, -math.inf), False)])
def test_progress_is_a_distance_or_an_angle(before, after, progress):
    assert later(before, after) == progress


def test_progress_is_counted_from_the_last_mark():
    monitor = ProgressMonitor()
    for seconds in range(6):
        assert not check(monitor, 1.0 * seconds, progress=(0.015 * seconds, -math.inf))
    assert not check(monitor, 6.0, progress=(0.0, -math.inf))
    assert 'no progress for 2 s' in check(monitor, 6.1, progress=(0.0, -math.inf))


def point(offset):
    return PathPoint(0.5, 0.0, offset, 0.0, 0.0)


def test_the_distance_from_the_path_is_limited_on_both_sides():
    for side in (1.0, -1.0):
        monitor = ProgressMonitor()
        assert not check(monitor, point=point(0.0))
        assert not check(monitor, point=point(0.0))
        assert not check(monitor, point=point(0.49 * side))
        assert '0.51 m from the path, expected at most 0.5 m' in check(
            monitor, point=point(0.51 * side))


def test_a_begin_off_the_path_allows_more_until_the_robot_is_near():
    monitor = ProgressMonitor()
    assert not check(monitor, point=point(0.8))
    assert not check(monitor, point=point(1.29))
    assert not check(monitor, point=point(0.26))  # not near yet: half the limit
    assert not check(monitor, point=point(1.29))
    assert check(monitor, point=point(1.31))
    assert not check(monitor, point=point(0.24))
    assert check(monitor, point=point(0.51))


@pytest.mark.parametrize(('x', 'y', 'missed'), [
    (1.0, 0.049, False), (1.0, -0.051, True), (0.949, 0.0, True), (1.04, 0.04, True)])
@pytest.mark.parametrize('state', [{'finished': True}, {'segment': None}])
def test_the_end_is_checked_once_after_the_last_segment(state, x, y, missed):
    monitor, there = ProgressMonitor(), Motion(x, y, 0.0, 0.0, 0.0, 0.0)
    assert not check(monitor, motion=there)  # still on the segment
    assert not check(monitor, motion=there, segment=None, on_last_segment=False)
    assert ('m from the end of the path' in check(monitor, motion=there, **state)) == missed
    assert not check(monitor, motion=there, **state)


def test_a_path_without_segments_has_no_end():
    assert not check(ProgressMonitor(), segment=None, end_segment=None, finished=True)


def test_waiting_for_odometry_is_limited():
    monitor = ProgressMonitor()
    assert not monitor.waiting(5)
    assert not monitor.waiting(5 + 10 * NS_PER_S)
    assert 'odom: none for 10 s' in monitor.waiting(6 + 10 * NS_PER_S)
