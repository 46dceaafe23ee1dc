# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Reference of path tracking: pure pursuit with regulated speed.

The laws and, but for the look-ahead, the default parameters are those of the controller of nav2
(Macenski et al., "Regulated Pure Pursuit for Robot Path Tracking", 2023). Maneuvers, turns in
place, limits of acceleration and arrival are ours.
"""

from __future__ import annotations

import math

import numpy as np
from smart_tire.control.ground_motion import wrap
from smart_tire.control.path_follower import Conditions, PathFollower
from smart_tire.control.path_geometry import FORWARD, PathPoint, Segment
from smart_tire.control.trajectory_control import TrajectoryControl

LOOK_AHEAD = 0.3        # m, lookahead_dist: with its default, 0.6 m, errors are larger
REGULATED_RADIUS = 0.9  # m, regulated_linear_scaling_min_radius
REGULATED_SPEED = 0.25  # m/s, regulated_linear_scaling_min_speed
APPROACH = 0.6          # m, approach_velocity_scaling_dist
ALIGN_ANGLE = 0.785     # rad, rotate_to_heading_min_angle


class PursuitFollower(PathFollower):
    """Drives along a circle through a point ahead on the path."""

    def _follow(self, now: Conditions, segment: Segment, point: PathPoint) -> tuple[float, float]:
        motion, end = now.motion, segment.point(segment.length, *segment.end)
        ahead = point.distance + LOOK_AHEAD
        beyond = max(ahead - segment.length, 0.0)  # the path continues straight
        x, y = (float(np.interp(ahead, segment.distance, values))
                for values in (segment.x, segment.y))
        dx = x + beyond * math.cos(end.heading) - motion.x
        dy = y + beyond * math.sin(end.heading) - motion.y
        yaw = math.atan2(dy, dx) - (0.0 if segment.direction == FORWARD else math.pi)
        error = wrap(yaw - motion.yaw)
        if self._must_align(error, ALIGN_ANGLE):
            return self._turn(now, yaw, ends=False)
        curvature = 2.0 * math.sin(error) / max(math.hypot(dx, dy), 0.5 * LOOK_AHEAD)
        regulated = max(now.limits.speed / max(1.0, REGULATED_RADIUS * abs(curvature)),
                        REGULATED_SPEED)
        approach = max(now.params.arrival.approach_speed,
                       now.limits.speed * (segment.length - point.distance) / APPROACH)
        speed = now.limits.next_speed(min(regulated, approach), abs(self._v_x), now.dt)
        rate = now.limits.next_yaw_rate(speed * curvature, self._yaw_rate, speed, now.dt)
        return segment.direction * speed, rate


class PursuitControl(TrajectoryControl):
    """Trajectory control with pure pursuit."""

    def _drive(self, follower: PathFollower) -> None:
        super()._drive(PursuitFollower(follower.maneuvers, *self._last))
