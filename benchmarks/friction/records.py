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

"""Crossings of one wheel as arrays: ground truth, estimates and Cramer-Rao bound."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math

from benchmarks.friction.cramer_rao import friction_bound
from benchmarks.slip.series import as_truth, EXCLUDED_END, Truth
import numpy as np
from numpy.typing import NDArray
from smart_tire.analysis.friction_metrics import column, match
from smart_tire.analysis.series import at, Floats, Stamps
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, Sample, WHEELS

SINGLE, FUSED = 'friction_coefficient_single', 'friction_coefficient'
QUANTITIES = (SINGLE, FUSED, 'critical_slip', 'adhesion_ratio', 'slip', 'total_slip', 'film_slip',
              'normal_load', 'stiffness', 'stretch_voltage', 'peak_interval')
MIN_BOUND_SLIP = 1e-3     # -, for computing the bound
MAX_CROSSING_TRAVEL = 0.05  # m, of a wheel within the same crossing

Columns = dict[str, Floats]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Truths:
    """True crossings of one wheel, sorted; arrays have shape (n,) unless noted."""

    crossings: list[Friction]
    speed: Floats   # m/s, |r w|
    bound: Floats   # Cramer-Rao bound, relative, NaN without slip
    clock_ns: Stamps  # (m,) timestamps of ``distance``
    distance: Floats  # (m,) m, rolled by the wheel


@dataclass(frozen=True)
class Rows:
    """True crossings of one wheel and their estimates, NaN without estimate."""

    stamp_ns: Stamps
    speed: Floats
    bound: Floats
    found: Mask
    true: Columns
    value: Columns
    sigma: Columns
    false: int  # estimates without a true crossing


def true_crossings(records: Iterable[Sample], robot: RobotParams, wheel: str) -> Truths:
    """Return the true crossings of ``wheel``, except those at the very end."""
    records = list(records)
    motion, index = as_truth(records, robot), WHEELS.index(wheel)
    end = int(motion.stamp_ns[-1]) - round(EXCLUDED_END * NS_PER_S)
    crossings = sorted((one for one in records if isinstance(one, Friction)
                       and one.wheel == wheel and one.stamp_ns < end),
                       key=lambda one: one.stamp_ns)
    speed = np.abs(at(_stamps(crossings), motion.stamp_ns, motion.rolling)[:, index])
    bounds = [_bound(one, robot, speed) for one, speed in zip(crossings, speed.tolist())]
    return Truths(crossings, speed, np.array(bounds, np.float64), motion.stamp_ns,
                  _rolled_distance(motion, index))


def _stamps(crossings: Sequence[Friction]) -> Stamps:
    return np.array([one.stamp_ns for one in crossings], np.int64)


def _rolled_distance(motion: Truth, index: int) -> Floats:
    speed = motion.rolling[:, index]
    steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(motion.stamp_ns) / NS_PER_S
    return np.concatenate([[0.0], np.cumsum(steps)])


def _bound(one: Friction, robot: RobotParams, speed: float) -> float:
    slip, total = one.slip.value, one.total_slip.value
    if not (abs(slip) > MIN_BOUND_SLIP and speed > robot.slip.standstill_speed):
        return math.nan
    return friction_bound(robot, one.wheel, slip=slip,
                          normalized_slip=total / one.critical_slip.value, speed=speed)


def match_rows(truths: Truths, estimates: Sequence[Friction], wheel: str) -> Rows:
    """
    Return the true crossings of ``wheel`` with their ``estimates``.

    If the wheel stops or reverses within a crossing, the timestamps may differ arbitrarily.
    """
    last = max((one.stamp_ns for one in truths.crossings), default=0)
    found = match([one for one in estimates if one.wheel == wheel], truths.crossings)
    false = [one for one in found.false if one.stamp_ns <= last]
    matched = []
    for true, estimate in found.pairs:
        if estimate is None:
            estimate = next((one for one in false if _same_crossing(truths, true, one)), None)
            false = [one for one in false if one is not estimate]
        matched.append(estimate)
    return Rows(
        _stamps(truths.crossings), truths.speed, truths.bound,
        np.array([one is not None for one in matched], bool),
        {name: column(truths.crossings, name) for name in QUANTITIES},
        {name: column(matched, name) for name in QUANTITIES},
        {name: column(matched, name, sigmas=True) for name in QUANTITIES}, len(false))


def _same_crossing(truths: Truths, one: Friction, other: Friction) -> bool:
    """Return whether both timestamps belong to the same crossing."""
    begin, end = sorted((one.stamp_ns, other.stamp_ns))
    within = (truths.clock_ns >= begin) & (truths.clock_ns <= end)
    return bool(within.any()) and float(np.ptp(truths.distance[within])) < MAX_CROSSING_TRAVEL


def concatenated(parts: Sequence[Rows]) -> Rows:
    """Return the rows of several runs as one."""
    def joined(which: str) -> Columns:
        return {name: np.concatenate([getattr(part, which)[name] for part in parts])
                for name in QUANTITIES}
    stamps, speed, bound, found = (np.concatenate([getattr(part, which) for part in parts])
                                   for which in ('stamp_ns', 'speed', 'bound', 'found'))
    return Rows(stamps, speed, bound, found, joined('true'), joined('value'), joined('sigma'),
                sum(part.false for part in parts))


def selected_rows(rows: Rows, which: Mask) -> Rows:
    """Return the rows selected by the mask ``which`` (n,)."""
    def picked(columns: Columns) -> Columns:
        return {name: values[which] for name, values in columns.items()}
    return Rows(rows.stamp_ns[which], rows.speed[which], rows.bound[which], rows.found[which],
                picked(rows.true), picked(rows.value), picked(rows.sigma), rows.false)
