# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters of path following: limits of the motion, follower, arrival, friction, stops."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.parameters.spec import param


@dataclass(frozen=True, kw_only=True)
class MotionLimitParams:
    """Limits of the commanded motion, on any ground."""

    acceleration: float = param(0.5, 'm/s2', 'maximum acceleration', (0.01, 20.0))
    deceleration: float = param(
        0.5, 'm/s2', 'maximum deceleration, except for stops', (0.01, 20.0))
    lateral_acceleration: float = param(
        1.0, 'm/s2', 'maximum of speed times yaw rate', (0.01, 20.0))
    yaw_rate: float = param(1.5, 'rad/s', 'maximum yaw rate', (0.05, 20.0))
    yaw_acceleration: float = param(4.0, 'rad/s2', 'maximum yaw acceleration', (0.05, 200.0))


@dataclass(frozen=True, kw_only=True)
class FollowerParams:
    """Look-ahead pursuit with curvature feed-forward, and turning in place."""

    look_ahead_time: float = param(0.6, 's', 'look-ahead distance over speed', (0.05, 10.0))
    min_look_ahead: float = param(0.18, 'm', 'minimum look-ahead distance', (0.02, 10.0))
    max_look_ahead: float = param(0.8, 'm', 'maximum look-ahead distance', (0.02, 20.0))
    actuation_delay: float = param(
        0.15, 's', 'from cmd_vel to the motion of the body; more if odom shows it',
        (0.0, 1.0))
    corner_angle: float = param(
        0.8, 'rad', 'corners of the path above it are turned in place', (0.1, math.pi), live=False)
    align_angle: float = param(
        0.6, 'rad', 'heading error at rest that is turned in place; twice while driving',
        (0.05, 1.5))
    spin_rate: float = param(1.0, 'rad/s', 'maximum yaw rate of turning in place', (0.05, 20.0))
    min_spin_rate: float = param(0.2, 'rad/s', 'minimum yaw rate of turning in place', (0.01, 5.0))

    def __post_init__(self) -> None:
        if self.min_look_ahead > self.max_look_ahead:
            raise ValueError(f'min_look_ahead: {self.min_look_ahead:g}, expected at most '
                             f'max_look_ahead, {self.max_look_ahead:g}')
        if self.min_spin_rate > self.spin_rate:
            raise ValueError(f'min_spin_rate: {self.min_spin_rate:g}, expected at most '
                             f'spin_rate, {self.spin_rate:g}')


@dataclass(frozen=True, kw_only=True)
class ArrivalParams:
    """Arrival at the end of a path or at a goal."""

    xy_tolerance: float = param(
        0.05, 'm', 'maximum distance from the goal at arrival, judged at 0.9 of it', (0.001, 5.0))
    yaw_tolerance: float = param(
        0.08, 'rad', 'maximum yaw error at arrival and after turning in place', (0.005, math.pi))
    approach_speed: float = param(
        0.05, 'm/s', 'minimum speed before the end of a segment', (0.001, 1.0))
    reverse_distance: float = param(
        0.6, 'm', 'a goal behind within this distance is reached in reverse', (0.0, 100.0))


@dataclass(frozen=True, kw_only=True)
class GroundParams:
    """Friction of unknown ground, and how fast a measurement of the ground loses its weight."""

    unknown: float = param(
        0.2, '-', 'friction coefficient of unknown ground, until it is estimated', (0.01, 2.0))
    fade_distance: float = param(
        2.0, 'm', 'distance in which the weight of measured ground decreases to 1/e', (0.05, 1e3))
    fade_time: float = param(
        30.0, 's', 'time in which the weight of measured ground decreases to 1/e', (1.0, 3600.0))


@dataclass(frozen=True, kw_only=True)
class FrictionLimitParams(GroundParams):
    """Acceleration that the friction coefficient of ``ground_state`` allows."""

    share: float = param(
        0.7, '-', 'share of friction used by the accelerations of the body', (0.05, 1.0))
    sigmas: float = param(
        2.0, '-', 'standard deviations from the estimate to the lower bound', (0.0, 5.0))
    minimum: float = param(0.02, '-', 'minimum of the lower bound', (1e-3, 1.0))


@dataclass(frozen=True, kw_only=True)
class PathCheckParams:
    """Conditions under which a path is refused, and under which the robot stops."""

    max_start_distance: float = param(
        1.0, 'm', 'a path that begins further from the robot is refused', (0.01, 100.0))
    max_path_length: float = param(
        1000.0, 'm', 'a longer path is refused; also a goal further away', (0.1, 1e4))
    max_path_poses: int = param(
        5000, '-', 'a path of more poses is refused; reading takes 6 us per pose', (2, 20_000))
    max_cross_track_error: float = param(
        0.5, 'm', 'stop if the robot is further from the path', (0.02, 100.0))
    odom_timeout: float = param(0.5, 's', 'stop if the latest odom is older', (0.05, 10.0))
    odom_jump: float = param(
        0.2, 'm', 'stop if the position changes by this more than the twist explains',
        (0.01, 10.0))
    max_slip: float = param(
        0.8, '-', 'stop if the motions in odom and of the wheels differ by more slip', (0.5, 1.0))
    progress_timeout: float = param(5.0, 's', 'stop without progress for this long', (0.5, 600.0))
