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

"""Conditions under which a robot that follows a path stops."""

from __future__ import annotations

import math

from smart_tire.control.motion_monitor import Motion
from smart_tire.control.path_follower import PathFollower
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.samples import NS_PER_S

MIN_ADVANCE = 0.02  # m
MIN_TURN = 0.04     # rad
MAX_WAIT = 10.0     # s, for the first odometry


class ProgressMonitor:
    """Watches the distance from the path, and the progress along it."""

    def __init__(self) -> None:
        self._waiting_ns: int | None = None
        self._mark: tuple[float, float] | None = None  # progress at ``_mark_ns``
        self._mark_ns = 0
        self._allowed = math.inf  # m, from the path: the robot may begin off it
        self._checked_end = False

    def waiting(self, now_ns: int) -> str:
        """Return the reason to stop while there is no odometry yet; empty if there is none."""
        if self._waiting_ns is None:
            self._waiting_ns = now_ns
        if now_ns - self._waiting_ns <= MAX_WAIT * NS_PER_S:
            return ''
        return f'odom: none for {MAX_WAIT:g} s, expected poses of the robot'

    def check(self, follower: PathFollower, motion: Motion, now_ns: int,
              params: TrajectoryControllerParams) -> str:
        """Return the reason to stop; empty if there is none."""
        return (self._check_error(follower, params) or self._check_end(follower, motion, params)
                or self._check_progress(follower, now_ns, params))

    def _check_error(self, follower: PathFollower, params: TrajectoryControllerParams) -> str:
        if follower.point is None:
            return ''
        error, limit = follower.point.offset(), params.checks.max_cross_track_error
        if math.isinf(self._allowed):
            self._allowed = error + limit
        elif error < 0.5 * limit:
            self._allowed = limit
        if error <= max(self._allowed, limit):
            return ''
        return f'{error:.2f} m from the path, expected at most {self._allowed:g} m'

    def _check_end(self, follower: PathFollower, motion: Motion,
                   params: TrajectoryControllerParams) -> str:
        """Check the distance from the end once the last segment has been driven."""
        segment = follower.end_segment
        driven = follower.finished or (follower.segment is None and follower.on_last_segment)
        if segment is None or not driven or self._checked_end:
            return ''
        self._checked_end = True
        x, y = segment.end
        miss, limit = math.hypot(motion.x - x, motion.y - y), params.arrival.xy_tolerance
        if miss <= limit:
            return ''
        return f'{miss:.3f} m from the end of the path, expected at most {limit:g} m'

    def _check_progress(self, follower: PathFollower, now_ns: int,
                        params: TrajectoryControllerParams) -> str:
        now, timeout = follower.advance(), params.checks.progress_timeout
        mark = self._mark
        if mark is None or now[0] > mark[0] + MIN_ADVANCE or now[1] > mark[1] + MIN_TURN:
            self._mark, self._mark_ns = now, now_ns
        elif now_ns - self._mark_ns > timeout * NS_PER_S:
            return f'no progress for {timeout:g} s: blocked, or the wheels do not turn'
        return ''
