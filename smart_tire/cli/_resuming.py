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

"""A path that is resumed after the robot has stopped because its host was late."""

from __future__ import annotations

from itertools import accumulate
import math
import re
from typing import TYPE_CHECKING

import numpy as np

from smart_tire.cli._path_file import Poses
from smart_tire.control.trajectory_control import State
from smart_tire.samples import Vector3

if TYPE_CHECKING:
    from smart_tire.cli._dashboard import Dashboard
    from smart_tire.cli._drive_session import Session

# Reasons of the controller to stop: late data, and what they cause if they were late before: a
# wrong pose, or motors that their driver has stopped because boards answer late.
LATE = re.compile(r'(odom|path): -?[\d.]+ s (old|ahead)')
CAUSED = re.compile(r'odom: |[\d.]+ m from the (end of the )?path|no progress')
MAX_LATENESS = 0.5     # s, of odom and wheel_states; the default of checks.odom_timeout
MAX_RESUMPTIONS = 10   # of one path
PATIENCE = 10.0        # longest waits for the controller over those for a robot
SEARCH_LENGTH = 1.5    # m that the robot may have driven since its latest report
PLACES = 151           # on that length, for one per centimeter
JOIN_RATIO = 2.0       # distance along the path over that from it: turns by 27 degrees
MIN_REST = 0.05        # m of the path that are sent again at least; arrival.xy_tolerance


def follow_resuming(session: Session, name: str, poses: Poses,
                    dashboard: Dashboard) -> tuple[State, str]:
    """
    Follow a path, and the rest of it after each stop for late data.

    Returns the last state and the reason for it, empty on arrival. A stop for another reason is
    final, and so is the one after ``MAX_RESUMPTIONS``. The controller predicts the pose over the
    age of ``odom``, so that the robot of a late host seems to be far from the path.
    """
    rest, reason = poses, ''
    for _ in range(MAX_RESUMPTIONS + 1):
        state = session.follow(name, rest, dashboard, patience=PATIENCE)
        if state == State.ARRIVED:
            return state, ''
        reason = session.reason(state)
        if not (LATE.match(reason) or session.lateness > MAX_LATENESS
                and CAUSED.match(reason)):
            return state, reason
        session.await_standstill()
        rest = remaining_path(rest, session.remaining, session.start_pose()[:2])
    return state, f'the host is late, stopped {MAX_RESUMPTIONS + 1} times, the last one: {reason}'


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
