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
    *turn(100.0, 60.0, 6.0), *turn(60.0, 30.0, 6.0), *turn(-45.0, 45.0, 5.0))


def leg_schedule(legs: Sequence[Leg]) -> tuple[list[Leg], float]:
    """Return legs as (start time [s], left, right), and the end time [s]."""
    times = list(accumulate((leg[0] for leg in legs), initial=0.0))
    return [(time, left, right) for time, (_, left, right) in zip(times, legs)], times[-1]
