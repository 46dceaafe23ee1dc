"""A run as arrays: what the inertial unit, the wheels and a reference of the pose recorded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.samples import LEFT, RIGHT


BRIDGED = 2.0    # s, a gap between positions over which their difference still is a mean speed
STRETCHED = 1.5  # periods; a longer gap between velocities has lost a message
SPIKE = 3.0      # rad/s by which one reading may stand out of its neighbours and their difference
SPIKE_FACTOR = 8.0  # times what readings usually stand out, beyond that
NEAR = 0.5       # s around motion that belongs to it: wheels may be late, bodies sway


@dataclass(frozen=True)
class ImuRecord:
    """Readings of the inertial unit, turned into the axes of ``base_link``; times [s] rise."""

    time: Array   # (n,) s
    rate: Array   # (n, 3) rad/s
    force: Array  # (n, 3) m/s2, specific force


@dataclass(frozen=True)
class WheelRecord:
    """Readings of the four wheels in the order of ``WHEELS``; times [s] rise."""

    time: Array             # (n,) s, stamps
    velocity: Array         # (n, 4) rad/s, means over the periods that end at the stamps
    position: Array | None  # (n, 4) rad, where every reading has them


@dataclass(frozen=True)
class PoseRecord:
    """Poses of ``base_link`` in a fixed frame by a reference; times [s] rise."""

    time: Array      # (n,) s
    position: Array  # (n, 2) m
    yaw: Array       # (n,) rad, runs on over a full turn

    def stretches(self, length: float, longest_gap: float) -> Iterator[tuple[int, int]]:
        """Yield first and last index of stretches of ``length`` [s] without longer gaps [s]."""
        first, time = 0, self.time.tolist()
        for index in range(1, len(time)):
            if time[index] - time[index - 1] > longest_gap:
                first = index
            elif time[index] - time[first] >= length:
                yield first, index
                first = index


@dataclass(frozen=True)
class Recording:
    """All that an identification reads; times count from one common origin."""

    imu: ImuRecord
    wheels: WheelRecord
    reference: PoseRecord | None = None


@dataclass(frozen=True)
class WheelIntervals:
    """Turns of the wheels over stretches of time that do not overlap."""

    begin: Array  # (n,) s, by the stamps
    end: Array    # (n,) s
    angle: Array  # (n, 4) rad

    @property
    def duration(self) -> Array:
        """Return the lengths [s] of the stretches, shape (n,)."""
        return self.end - self.begin

    @property
    def sides(self) -> Array:
        """Return the mean speeds [rad/s] of the left and of the right wheels, (n, 2)."""
        speed = self.angle / self.duration[:, None]
        return np.stack([speed[:, LEFT].mean(axis=1), speed[:, RIGHT].mean(axis=1)], axis=1)

    def where(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> WheelIntervals:
        """Return the ``chosen`` stretches, by mask or by index."""
        return WheelIntervals(self.begin[chosen], self.end[chosen], self.angle[chosen])

    def around_motion(self, least_speed: float) -> NDArray[np.bool_]:
        """Return which stretches lie near one in which a wheel is faster than this [rad/s]."""
        fastest = np.abs(self.angle / self.duration[:, None]).max(axis=1)
        moving = self.end[fastest > least_speed]
        if not len(moving):
            return np.zeros(len(self.end), bool)
        after = np.searchsorted(moving, self.end)
        left = moving[np.maximum(after - 1, 0)]
        right = moving[np.minimum(after, len(moving) - 1)]
        return np.minimum(np.abs(self.end - left), np.abs(right - self.end)) <= NEAR


class Signal:
    """A sampled signal that runs straight between its samples, and its integral."""

    def __init__(self, time: Array, value: Array) -> None:
        self.time, self._value = time, value
        steps = 0.5 * (value[1:] + value[:-1]) * np.diff(time)
        self._integral = np.concatenate([[0.0], np.cumsum(steps)])

    def integral(self, time: Array) -> Array:
        """Return the integral from the first sample to ``time`` [s]; the ends go on straight."""
        left = np.searchsorted(self.time[1:-1], time)
        gone, step = time - self.time[left], self.time[left + 1] - self.time[left]
        slope = (self._value[left + 1] - self._value[left]) / step
        return np.asarray(self._integral[left] + gone * (self._value[left] + 0.5 * slope * gone))

    def mean(self, begin: Array, end: Array) -> Array:
        """Return the means between ``begin`` and ``end`` [s]."""
        return (self.integral(end) - self.integral(begin)) / (end - begin)

    def around(self, time: Array, reach: float) -> Array:
        """Return the means over ``reach`` [s] to either side of ``time``."""
        return self.mean(time - reach, time + reach)


def angles_between(wheels: WheelRecord) -> tuple[Array, NDArray[np.bool_]]:
    """
    Return the turns [rad] (n - 1, 4) between readings, and which of them were really seen.

    Where a message is missing, positions bridge the gap; a velocity describes its own period
    only. What no wheel can have done, there and back within two readings, was not seen either.
    """
    gap = np.diff(wheels.time)
    if wheels.position is not None:
        angle, whole = np.diff(wheels.position, axis=0), gap <= BRIDGED
    else:
        angle = wheels.velocity[1:] * gap[:, None]
        whole = gap <= STRETCHED * float(np.median(gap))
    speed = angle / gap[:, None]
    before, after = np.roll(speed, 1, axis=0), np.roll(speed, -1, axis=0)
    aside = np.abs(speed - 0.5 * (before + after))
    moving = aside[aside > 0.0]  # where rounding and stamps alone do much at high rates
    usual = float(np.median(moving)) if moving.size else 0.0
    beyond = aside - np.abs(after - before) - SPIKE - SPIKE_FACTOR * usual
    beyond[[0, -1]] = 0.0  # they have one neighbour only
    return angle, whole & (beyond <= 0.0).all(axis=1)


def wheel_intervals(wheels: WheelRecord, shortest: float) -> WheelIntervals:
    """
    Return the turns between readings, of several together where one lasts less than ``shortest``.

    Stretches of which a part was not seen are left out.
    """
    angle, whole = angles_between(wheels)
    rows = list(_together(np.diff(wheels.time), whole, shortest))
    first = np.array([row[0] for row in rows], dtype=int)
    last = np.array([row[1] for row in rows], dtype=int)
    turned = np.concatenate([np.zeros((1, 4)), np.cumsum(angle, axis=0)])
    return WheelIntervals(wheels.time[first], wheels.time[last], turned[last] - turned[first])


def _together(gap: Array, whole: NDArray[np.bool_], shortest: float) -> Iterator[tuple[int, int]]:
    """Yield first and last reading of stretches without a hole, each long enough."""
    first, length = 0, 0.0
    for index, (step, good) in enumerate(zip(gap.tolist(), whole.tolist())):
        if not good:
            first, length = index + 1, 0.0
            continue
        length += step
        if length >= shortest * (1.0 - 1e-3):  # stamps jitter
            yield first, index + 1
            first, length = index + 1, 0.0


def period(time: Array) -> float:
    """Return the usual period [s] between times; NaN of fewer than two."""
    return float(np.median(np.diff(time))) if len(time) > 1 else math.nan
