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

"""Parameters of path following: limits of the motion, follower, arrival, friction, stops."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.parameters.spec import param


@dataclass(frozen=True, kw_only=True)
class MotionLimitParams:
    """Limits of the commanded motion, on any ground."""

    acceleration: float = param(
        0.5, 'm/s2', 'maximum acceleration', low=0.01, high=20.0, live=True)
    deceleration: float = param(
        0.5, 'm/s2', 'maximum deceleration, except for stops', low=0.01, high=20.0, live=True)
    lateral_acceleration: float = param(
        1.0, 'm/s2', 'maximum of speed times yaw rate', low=0.01, high=20.0, live=True)
    yaw_rate: float = param(1.5, 'rad/s', 'maximum yaw rate', low=0.05, high=20.0, live=True)
    yaw_acceleration: float = param(
        4.0, 'rad/s2', 'maximum yaw acceleration', low=0.05, high=200.0, live=True)


@dataclass(frozen=True, kw_only=True)
class FollowerParams:
    """Look-ahead pursuit with curvature feed-forward, and turning in place."""

    look_ahead_time: float = param(
        0.6, 's', 'look-ahead distance over speed', low=0.05, high=10.0, live=True)
    min_look_ahead: float = param(
        0.18, 'm', 'minimum look-ahead distance', low=0.02, high=10.0, live=True)
    max_look_ahead: float = param(
        0.8, 'm', 'maximum look-ahead distance', low=0.02, high=20.0, live=True)
    actuation_delay: float = param(
        0.15, 's', 'from cmd_vel to the motion of the body: dead time and lag', low=0.0,
        high=1.0, live=True)
    corner_angle: float = param(
        0.8, 'rad', 'corners of the path above it are turned in place', low=0.1, high=math.pi)
    align_angle: float = param(
        0.6, 'rad', 'heading error at rest that is turned in place; twice while driving',
        low=0.05, high=1.5, live=True)
    spin_rate: float = param(
        1.0, 'rad/s', 'maximum yaw rate of turning in place', low=0.05, high=20.0, live=True)
    min_spin_rate: float = param(
        0.2, 'rad/s', 'minimum yaw rate of turning in place', low=0.01, high=5.0, live=True)

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
        0.05, 'm', 'maximum distance from the goal at arrival', low=0.001, high=5.0, live=True)
    yaw_tolerance: float = param(
        0.08, 'rad', 'maximum yaw error at arrival and after turning in place', low=0.005,
        high=math.pi, live=True)
    approach_speed: float = param(
        0.05, 'm/s', 'minimum speed before the end of a segment', low=0.001, high=1.0, live=True)
    reverse_distance: float = param(
        0.6, 'm', 'a goal behind within this distance is reached in reverse', low=0.0,
        high=100.0, live=True)


@dataclass(frozen=True, kw_only=True)
class FrictionLimitParams:
    """Acceleration that the friction coefficients of ``tire_friction`` allow."""

    share: float = param(
        0.7, '-', 'share of friction used by the accelerations of the body', low=0.05, high=1.0,
        live=True)
    sigmas: float = param(
        2.0, '-', 'standard deviations from the estimate to the lower bound', low=0.0, high=5.0,
        live=True)
    unknown: float = param(
        0.3, '-', 'friction coefficient without recent estimate', low=0.01, high=2.0, live=True)
    minimum: float = param(
        0.02, '-', 'minimum of the lower bound', low=1e-3, high=1.0, live=True)
    fade_distance: float = param(
        2.0, 'm', 'distance in which the weight of an estimate decreases to 1/e', low=0.05,
        high=1e3, live=True)
    fade_time: float = param(
        30.0, 's', 'time in which the weight of an estimate decreases to 1/e', low=1.0,
        high=3600.0, live=True)


@dataclass(frozen=True, kw_only=True)
class PathCheckParams:
    """Conditions under which a path is refused, and under which the robot stops."""

    max_start_distance: float = param(
        1.0, 'm', 'a path that begins further from the robot is refused', low=0.01, high=100.0,
        live=True)
    max_path_length: float = param(
        1000.0, 'm', 'a longer path is refused; also a goal further away', low=0.1, high=1e4,
        live=True)
    max_path_poses: int = param(
        5000, '-', 'a path of more poses is refused; reading takes 6 us per pose', low=2,
        high=20_000, live=True)
    max_cross_track_error: float = param(
        0.5, 'm', 'stop if the robot is further from the path', low=0.02, high=100.0, live=True)
    odom_timeout: float = param(
        0.5, 's', 'stop if the latest odom is older', low=0.05, high=10.0, live=True)
    odom_jump: float = param(
        0.2, 'm', 'stop if the position changes by this more than the twist explains',
        low=0.01, high=10.0, live=True)
    max_slip: float = param(
        0.8, '-', 'stop if the motions in odom and of the wheels differ by more slip', low=0.5,
        high=1.0, live=True)
    progress_timeout: float = param(
        5.0, 's', 'stop without progress for this long', low=0.5, high=600.0, live=True)
