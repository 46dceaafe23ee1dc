# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Progress of a path that trajectory_controller follows, and the rest of it after a stop."""

from __future__ import annotations

from itertools import accumulate
import math
from typing import TYPE_CHECKING

import numpy as np

from smart_tire.cli._path_file import Poses
from smart_tire.cli._stack import RobotError
from smart_tire.control.trajectory_control import PathState
from smart_tire.samples import Vector3

if TYPE_CHECKING:
    from smart_tire.samples import PathProgress

ANSWER_TIME = 3.0    # s until the controller reports that it follows, or why not
OLD_REPORT_TIME = 0.6  # s in which a report may still be that of the path before
SILENCE_TIME = 3.0   # s without a report, nominally four per second
MIN_MEAN_SPEED = 0.05  # m/s, expected at least
EXTRA_TIME = 30.0    # s, beyond the time at this speed
SEARCH_LENGTH = 1.5    # m that the robot may have driven since its latest report
PLACES = 151           # on that length, for one per centimeter
JOIN_RATIO = 2.0       # distance along the path over that from it: turns by 27 degrees
MIN_REST = 0.05        # m of the path that are sent again at least; arrival.xy_tolerance


class Following:
    """
    The progress of one path; times are seconds of one steady clock.

    ``end_state`` raises RobotError if the controller does not answer, falls silent, or does not
    arrive in the time of a mean speed of ``MIN_MEAN_SPEED``. ``remaining`` is the distance [m]
    that was reported last.
    """

    def __init__(self, length: float, time: float, patience: float = 1.0) -> None:
        """
        Begin with a path of ``length`` [m] that was published at ``time``.

        The controller has ``patience`` times the usual times to answer and to report: on a busy
        host it may report the end of the path before for long.
        """
        self.remaining, self._patience = length, patience
        self._begin = self._heard = time
        self._limit = EXTRA_TIME + length / MIN_MEAN_SPEED
        self._latest: PathProgress | None = None
        self._started = False

    def end_state(self, report: PathProgress | None, time: float) -> PathState | None:
        """Return the state in which the path has ended, None while it is followed."""
        if report is not None and report is not self._latest:
            self._latest, self._heard = report, time
        elif time - self._heard > self._patience * SILENCE_TIME:
            raise RobotError('trajectory_controller does not report its progress (path_progress)')
        if time - self._begin > self._limit:
            raise RobotError(f'the end of the path was not reached within {self._limit:.0f} s')
        if self._latest is None:
            return None
        state = PathState(self._latest.state)
        if state == PathState.FOLLOWING:
            self._started = True
            if math.isfinite(self._latest.remaining_distance):
                self.remaining = self._latest.remaining_distance
            return None
        answered = time - self._begin > self._patience * OLD_REPORT_TIME
        if self._started or state != PathState.IDLE and answered:
            return state
        if time - self._begin > self._patience * ANSWER_TIME:
            raise RobotError('trajectory_controller has not received the path')
        return None


def note(report: PathProgress | None) -> str:
    """Return the progress as text."""
    if report is None:
        return 'waiting for trajectory_controller'
    text = PathState(report.state).name.lower()
    if math.isfinite(report.remaining_distance):
        text += f', {report.remaining_distance:.2f} m left'
    if math.isfinite(report.cross_track_error):
        text += f', {report.cross_track_error:+.3f} m from the path'
    return text


def remaining_path(poses: Poses, remaining: float, position: tuple[float, float]) -> Poses:
    """
    Return the path from ``position`` on to those of its places that are still to be driven.

    It leaves the path at the place nearest to ``position``, which is searched among the last
    ``remaining`` [m], and there on the next ``SEARCH_LENGTH`` only: paths may cross themselves. It
    joins the path ``JOIN_RATIO`` times the distance from it further on, or at its end.
    """
    along = np.array([0.0, *accumulate(map(_distance, poses, poses[1:]))])
    last = max(along[-1] - MIN_REST, 0.0)
    first = min(max(along[-1] - remaining, 0.0), last)
    places = np.linspace(first, min(first + SEARCH_LENGTH, last), PLACES)
    x, y = (np.interp(places, along, column) for column in np.array(poses).T[:2])
    away = np.hypot(x - position[0], y - position[1])
    nearest = int(np.argmin(away))
    join = min(places[nearest] + JOIN_RATIO * away[nearest], along[-1])
    later = int(np.searchsorted(along, join))  # a turn in place at this place is still to be made
    start = position if math.dist(position, poses[-1][:2]) > MIN_REST else (
        float(x[nearest]), float(y[nearest]))
    return (*start, poses[max(later - 1, 0)][2]), *poses[later:]


def _distance(one: Vector3, other: Vector3) -> float:
    return math.dist(one[:2], other[:2])
