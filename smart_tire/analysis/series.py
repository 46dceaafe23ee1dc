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

"""Samples collected into arrays, one row per timestamp, sorted by timestamp."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smart_tire.rotation import euler
from smart_tire.samples import (
    Friction, GROUND_ESTIMATES, GroundState, NS_PER_S, Odometry, Sample, TireSample, WheelSample,
    WheelSlip)

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]
# Rows and columns of x, y and yaw in the 6x6 covariances of ROS.
PLANAR = (0, 1, 5)
PLANAR_COVARIANCE = tuple(6 * row + column for row in PLANAR for column in PLANAR)
PLANAR_VARIANCE = tuple(7 * row for row in PLANAR)


class Table:
    """Growing table of numbers with timestamps; stores no object per row."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._stamps = array('q')
        self._values = array('d')

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, stamp_ns: int, row: Sequence[float]) -> None:
        """Append one row; its length must equal the table width."""
        self._stamps.append(stamp_ns)
        self._values.extend(row)

    def arrays(self) -> tuple[Stamps, Floats]:
        """Return timestamps (n,) and values (n, width), sorted; of equal timestamps the last."""
        stamps = np.array(self._stamps, np.int64)
        values = np.array(self._values, np.float64).reshape(-1, self._width)
        order = np.argsort(stamps, kind='stable')
        stamps, values = stamps[order], values[order]
        last = np.append(np.diff(stamps) > 0, True)[:len(stamps)]
        return stamps[last], values[last]


@dataclass(frozen=True)
class PoseSeries:
    """Planar poses and twists; yaw is unwrapped."""

    stamp_ns: Stamps
    pose: Floats             # (n, 3) m, m, rad: x, y, yaw
    twist: Floats            # (n, 3) m/s, m/s, rad/s: v_x, v_y, yaw rate; NaN if unknown
    pose_covariance: Floats  # (n, 3, 3) of x, y, yaw
    twist_variance: Floats   # (n, 3)


@dataclass(frozen=True)
class SlipSeries:
    """Slip ratios of the four wheels in the order of ``WHEELS``; NaN at standstill."""

    stamp_ns: Stamps
    ratio: Floats  # (n, 4)
    sigma: Floats  # (n, 4)

    def measured(self, wheels: Sequence[int]) -> list[int]:
        """Return those of ``wheels`` (indices) that have a slip; all if none has."""
        found = [wheel for wheel in wheels if np.isfinite(self.ratio[:, wheel]).any()]
        return found or list(wheels)


@dataclass(frozen=True)
class GroundSeries:
    """States of the ground: the quantities ``GROUND_ESTIMATES``; NaN where unknown."""

    stamp_ns: Stamps
    value: Floats  # (n, 7)
    sigma: Floats  # (n, 7)


class Series:
    """Samples of a recording: poses, slips, ground, crossings, film voltages, wheel speeds."""

    def __init__(self) -> None:
        self._poses = Table(18)
        self._slips = Table(8)
        self._grounds = Table(2 * len(GROUND_ESTIMATES))
        self._speeds = Table(4)
        self._films: dict[tuple[str, int], Table] = {}
        self.crossings: list[Friction] = []
        self._handlers: dict[type, Callable[[Any], None]] = {
            Odometry: self._add_odometry, WheelSlip: self._add_slip,
            GroundState: self._add_ground, Friction: self._add_friction,
            TireSample: self._add_films, WheelSample: self._add_wheels}

    def add(self, sample: Sample) -> None:
        """Add one sample; other sample types are ignored."""
        handler = self._handlers.get(type(sample))
        if handler is not None:
            handler(sample)

    def poses(self) -> PoseSeries:
        """Return poses and twists."""
        stamps, rows = self._poses.arrays()
        pose = rows[:, :3].copy()
        pose[:, 2] = np.unwrap(pose[:, 2])
        return PoseSeries(stamps, pose, rows[:, 3:6], rows[:, 6:15].reshape(-1, 3, 3),
                          rows[:, 15:])

    def slips(self) -> SlipSeries:
        """Return the slips of the four wheels."""
        stamps, rows = self._slips.arrays()
        return SlipSeries(stamps, rows[:, :4], rows[:, 4:])

    def grounds(self) -> GroundSeries:
        """Return the states of the ground."""
        stamps, rows = self._grounds.arrays()
        return GroundSeries(stamps, *np.hsplit(rows, 2))

    def speeds(self) -> tuple[Stamps, Floats]:
        """Return timestamps and the four wheel speeds [rad/s]."""
        return self._speeds.arrays()

    def film_wheels(self) -> list[str]:
        """Return the wheels with film samples."""
        return sorted({wheel for wheel, _ in self._films})

    def films(self, wheel: str) -> tuple[Stamps, Floats]:
        """Return timestamps and voltages (n, films) of ``wheel`` with the usual film count."""
        tables = [table for (name, _), table in self._films.items() if name == wheel]
        return max(tables, key=len).arrays()

    def _add_odometry(self, sample: Odometry) -> None:
        pose, twist = sample.pose_covariance, sample.twist_covariance
        known = twist[0] != -1.0
        rate = sample.angular[2]
        self._poses.add(sample.stamp_ns, (
            *sample.position[:2], euler(sample.orientation)[2],
            *((*sample.linear[:2], rate) if known else (math.nan,) * 3),
            *(pose[i] for i in PLANAR_COVARIANCE),
            *(twist[i] if known else math.nan for i in PLANAR_VARIANCE)))

    def _add_slip(self, sample: WheelSlip) -> None:
        self._slips.add(sample.stamp_ns, sample.ratio + sample.sigma)

    def _add_ground(self, sample: GroundState) -> None:
        estimates = [getattr(sample, name) for name in GROUND_ESTIMATES]
        self._grounds.add(sample.stamp_ns, [*(estimate.value for estimate in estimates),
                                            *(estimate.sigma for estimate in estimates)])

    def _add_friction(self, sample: Friction) -> None:
        self.crossings.append(sample)

    def _add_films(self, sample: TireSample) -> None:
        key = sample.wheel, len(sample.volts)
        if key not in self._films:
            self._films[key] = Table(len(sample.volts))
        self._films[key].add(sample.stamp_ns, sample.volts)

    def _add_wheels(self, sample: WheelSample) -> None:
        self._speeds.add(sample.stamp_ns, sample.velocity)


def seconds(stamp_ns: Stamps, origin_ns: int) -> Floats:
    """Return timestamps as seconds after ``origin_ns``, without loss of precision."""
    return (stamp_ns - origin_ns) / NS_PER_S


def at(wanted_ns: Stamps, stamp_ns: Stamps, values: Floats, max_gap: float = 0.5) -> Floats:
    """
    Return ``values`` (n, ...), linearly interpolated at ``wanted_ns``.

    NaN outside the timestamps, in gaps longer than ``max_gap`` [s], and next to a NaN.
    """
    result = np.full((len(wanted_ns), *values.shape[1:]), math.nan)
    if len(stamp_ns) < 2:
        return result
    right = np.clip(np.searchsorted(stamp_ns, wanted_ns), 1, len(stamp_ns) - 1)
    left = right - 1
    gap = stamp_ns[right] - stamp_ns[left]
    inside = ((stamp_ns[left] <= wanted_ns) & (wanted_ns <= stamp_ns[right])
              & (gap <= max_gap * NS_PER_S))
    share = ((wanted_ns - stamp_ns[left]) / gap).reshape(-1, *(1,) * (values.ndim - 1))
    between = (1.0 - share) * values[left] + share * values[right]
    result[inside] = between[inside]
    return result


def time_origin(estimates: Series) -> int:
    """Return the timestamp [ns] of the first estimate, at which the time axes are zero."""
    crossings = np.array([crossing.stamp_ns for crossing in estimates.crossings], np.int64)
    stamps = np.concatenate([estimates.slips().stamp_ns, estimates.poses().stamp_ns, crossings])
    return int(stamps.min(initial=np.iinfo(np.int64).max))
