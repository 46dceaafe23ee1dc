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

"""Wheel speeds that the steps of a calibration need, as legs of constant speed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
import math

Leg = tuple[float, float, float]  # duration [s], rpm of the left and of the right wheels

PAUSE = 1.0  # s of standstill between two legs


def shuttle(rpm: float, duration: float) -> tuple[Leg, ...]:
    """Return legs forward and back, with a stop after each."""
    stop = (PAUSE, 0.0, 0.0)
    return (duration, rpm, rpm), stop, (duration, -rpm, -rpm), stop


def turn(left: float, right: float, duration: float) -> tuple[Leg, ...]:
    """Return a turn and its mirror image, with a stop after each."""
    stop = (1.5 * PAUSE, 0.0, 0.0)
    return (duration, left, right), stop, (duration, right, left), stop


REST_LEGS: tuple[Leg, ...] = ((12.0, 0.0, 0.0),)
STRAIGHT_LEGS: tuple[Leg, ...] = (
    *shuttle(110.0, 1.4), *shuttle(60.0, 1.8), *shuttle(140.0, 1.1)) * 3
TURN_LEGS: tuple[Leg, ...] = (
    *turn(90.0, 30.0, 6.0), *turn(60.0, 15.0, 6.0), *turn(-45.0, 45.0, 5.0))


LIFTED_LEGS: tuple[Leg, ...] = tuple(
    leg for rpm in (40.0, 80.0, 120.0) for leg in shuttle(rpm, 4.0))
MAX_SPEED = 1.3      # m/s, of the surface of a wheel
FREE_SPACE_MARGIN = 0.5  # m, free space around the path
PATH_STEP = 0.02     # s
TRACK_FACTORS = (1.0, 2.0)  # effective track over the geometric one: tight and wide turns


def limited(legs: Sequence[Leg], wheel_radius: float) -> list[Leg]:
    """Return legs no faster than ``MAX_SPEED``, for wheels of ``wheel_radius`` [m]."""
    fastest = max(max(abs(left), abs(right)) for _, left, right in legs) * math.tau / 60.0
    scale = min(1.0, MAX_SPEED / max(fastest * wheel_radius, 1e-9))
    return [(duration, scale * left, scale * right) for duration, left, right in legs]


def reach(legs: Sequence[Leg], wheel_radius: float, track: float) -> float:
    """
    Return the distance [m] from the start that a robot on these legs may reach, with a margin.

    Turns may be as tight as those of the geometric ``track`` [m] or twice as wide.
    """
    return FREE_SPACE_MARGIN + max(
        _distance(legs, wheel_radius, factor * track) for factor in TRACK_FACTORS)


def _distance(legs: Sequence[Leg], wheel_radius: float, track: float) -> float:
    x = y = yaw = largest = 0.0
    for duration, left, right in legs:
        speeds = [rpm * math.tau / 60.0 * wheel_radius for rpm in (left, right)]
        for _ in range(round(duration / PATH_STEP)):
            yaw += PATH_STEP * (speeds[1] - speeds[0]) / track
            x += PATH_STEP * 0.5 * sum(speeds) * math.cos(yaw)
            y += PATH_STEP * 0.5 * sum(speeds) * math.sin(yaw)
            largest = max(largest, math.hypot(x, y))
    return largest


def leg_schedule(legs: Sequence[Leg]) -> tuple[list[Leg], float]:
    """Return legs as (start time [s], left, right), and the end time [s]."""
    times = list(accumulate((leg[0] for leg in legs), initial=0.0))
    return [(time, left, right) for time, (_, left, right) in zip(times, legs)], times[-1]
