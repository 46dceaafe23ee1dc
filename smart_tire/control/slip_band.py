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

"""Bands of wheel speeds within slip limits, and how wheels stop whatever the estimates are."""

from __future__ import annotations

import math

from smart_tire.samples import Four


def slip_band(speed: float, slip: float, floor: float) -> tuple[float, float]:
    """
    Return the rolling speeds r w [m/s] with at most this slip when braking and when driving.

    ``speed`` [m/s] is that of the wheel center, ``slip`` [-] the limit relative to r w. A sliding
    speed of ``floor`` [m/s] is always within, half of it for braking.

    >>> slip_band(0.8, 0.2, 0.05)
    (0.6666666666666667, 1.0)
    >>> slip_band(-0.8, 0.2, 0.05)
    (-1.0, -0.6666666666666667)
    >>> slip_band(0.0, 0.2, 0.05)
    (-0.05, 0.05)
    """
    if speed < 0.0:
        low, high = slip_band(-speed, slip, floor)
        return -high, -low
    braking = speed - 0.5 * floor  # below zero the sliding speed grows to the floor of a start
    low = min(speed / (1.0 + slip), braking if braking > 0.0 else 2.0 * braking)
    return low, max(speed / (1.0 - slip), speed + floor)


def share_within(start: float, wanted: float, band: tuple[float, float]) -> float:
    """Return the largest share of the way to ``wanted`` that is within ``band``, 0 to 1."""
    low, high = band
    way = wanted - start
    room = high - start if way > 0.0 else low - start
    if way == 0.0 or room / way >= 1.0:
        return 1.0
    return max(room / way, 0.0)


def lowered(speed: float, step: float) -> float:
    """Return ``speed``, nearer to zero by ``step``."""
    return math.copysign(max(abs(speed) - step, 0.0), speed)


def obeys(speed: float, wanted: float) -> bool:
    """Return whether a wheel turns as wanted, no faster."""
    return 0.0 <= speed * wanted <= wanted * wanted and (wanted != 0.0 or speed == 0.0)


def stopping_speed(speed: float, wanted: float, held: float) -> float:
    """
    Return ``speed`` of a wheel, at most ``held`` if that is not what is wanted.

    Whatever the estimates are, a wheel that is to stop does so in the end, and none turns against
    both the command and its own motion.
    """
    if obeys(speed, wanted):
        return speed
    return min(max(speed, min(held, wanted, 0.0)), max(held, wanted, 0.0))


def most_held(before: Four, wanted: Four, limited: Four, step: float, radius: float) -> Four:
    """Return the speeds [rad/s] that may be held against a command to stop in the next step."""
    a, b, c, d = (
        speed / radius if obeys(speed, target) else lowered(held, step / radius)
        for held, target, speed in zip(before, wanted, limited))
    return a, b, c, d
