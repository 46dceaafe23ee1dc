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
Wheel speeds of the drawn robots: manoeuvres with random speeds, sides and durations.

A manoeuvre is a list of (duration [s], left, right [rpm]).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

Part = tuple[float, float, float]
Parts = list[Part]
Manoeuvre = Callable[[np.random.Generator], Parts]

STOP: Part = (1.2, 0.0, 0.0)


def turn(rng: np.random.Generator, seconds: float, fast: float = 120.0, slow: float = 60.0
         ) -> Parts:
    """Return a constant turn to a random side."""
    return [(seconds, fast, slow) if rng.random() < 0.5 else (seconds, slow, fast)]


def s_curves(rng: np.random.Generator, count: int, fast: float = 120.0, slow: float = 70.0,
             period: float = 6.0) -> Parts:
    """Return ``count`` double curves that keep the mean heading; speeds vary by 10 %."""
    fast, slow = np.array([fast, slow]) * rng.uniform(0.9, 1.1, 2)
    sides = [(fast, slow), (slow, fast)]
    first, second = sides if rng.random() < 0.5 else sides[::-1]
    quarter = 0.25 * period
    return [(quarter, *first), (2.0 * quarter, *second), (quarter, *first)] * count


def starts(rng: np.random.Generator, count: int) -> Parts:
    """Return ``count`` straight runs of 2.5 to 4 s with 60 to 100 rpm and stops."""
    parts: Parts = []
    for speed, seconds in zip(rng.uniform(60.0, 100.0, count), rng.uniform(2.5, 4.0, count)):
        parts += [(seconds, speed, speed), (0.8, 0.0, 0.0)]
    return parts


def random_legs(rng: np.random.Generator, seconds: float) -> Parts:
    """Return random legs: straight, curved to both sides, and stops."""
    parts: Parts = []
    while sum(part[0] for part in parts) < seconds:
        mean, difference = rng.uniform(55.0, 110.0), rng.uniform(-40.0, 40.0)
        kind = rng.random()
        parts.append(STOP if kind < 0.15 else (
            rng.uniform(2.0, 4.0), mean + difference * (kind > 0.3),
            mean - difference * (kind > 0.3)))
    return parts


def spin_and_reverse(rng: np.random.Generator) -> Parts:
    """Return a spin in place, a reverse turn and a reverse straight, with stops."""
    speed = rng.uniform(45.0, 65.0) * rng.choice([-1.0, 1.0])
    back = -rng.uniform(50.0, 80.0)
    return [(3.0, speed, -speed), STOP, (3.0, back, 1.4 * back), STOP, (3.0, back, back), STOP]


def mixed(rng: np.random.Generator, seconds: float) -> Parts:
    """Return S-curves, starts, a turn and random legs."""
    parts = [*s_curves(rng, 2), *starts(rng, 2), *turn(rng, 5.0)]
    return parts + random_legs(rng, seconds - sum(part[0] for part in parts))


def concrete(rng: np.random.Generator) -> Parts:
    """Return a turn of 120/60 rpm, S-curves and random legs."""
    return [*turn(rng, 12.0), STOP, *s_curves(rng, 2), *random_legs(rng, 16.0)]


def slow_turn(rng: np.random.Generator) -> Parts:
    """Return 60/80 rpm to one side, and after a stop to the other one."""
    (first,) = turn(rng, 21.0, 80.0, 60.0)
    return [first, STOP, (first[0], first[2], first[1])]


def sand_turn(rng: np.random.Generator) -> Parts:
    """Return 120/60 rpm to one side, and after a stop to the other one."""
    (first,) = turn(rng, 22.0)
    return [first, STOP, (18.0, first[2], first[1])]


def mixed_with_spin(rng: np.random.Generator) -> Parts:
    """Return mixed manoeuvres with a spin and reverse."""
    return [*s_curves(rng, 2), STOP, *spin_and_reverse(rng), *random_legs(rng, 18.0)]


def across_fields(rng: np.random.Generator) -> Parts:
    """Return S-curves along x."""
    return s_curves(rng, 8)


def circles(rng: np.random.Generator) -> Parts:
    """Return circles of 120/60 rpm to a random side, of 0.8 m radius on concrete."""
    return [*turn(rng, 32.0), STOP, *s_curves(rng, 1)]


def sand_straight(rng: np.random.Generator) -> Parts:
    """Return straight runs with starts and stops."""
    return starts(rng, 11)


def walking_pace(rng: np.random.Generator) -> Parts:
    """Return straight runs of 2 to 6 s at 22 to 88 rpm (0.2 to 0.8 m/s), with stops between."""
    speed = rng.uniform(22.0, 88.0)
    return [part for seconds in rng.uniform(2.0, 6.0, 8)
            for part in ((seconds, speed, speed), STOP)]


MIXED: Manoeuvre = partial(mixed, seconds=42.0)
