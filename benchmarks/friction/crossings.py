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
Crossings of one wheel as arrays: ground truth and estimates, on which ground, and their errors.

Errors of mu are relative to the true one. A crossing determines mu F_z / C_x, so the consistency
of single crossings is that of this ratio, with the sigma of mu without the contributions of C_x
and load. (The simulator uses the nominal C_x, so that mu itself would appear too accurate.)
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math

from benchmarks.friction.cramer_rao import friction_bound
from benchmarks.motion import as_truth, EXCLUDED_END, Mask, Truth
from benchmarks.scoring import Errors
import numpy as np
from smart_tire.analysis.friction_metrics import column, match
from smart_tire.arrays import Array, Instants
from smart_tire.estimates import at
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, Sample, WHEELS

SINGLE, FUSED = 'friction_coefficient_single', 'friction_coefficient'
QUANTITIES = (SINGLE, FUSED, 'critical_slip', 'adhesion_ratio', 'slip', 'total_slip', 'film_slip',
              'normal_load', 'stiffness', 'peak_interval')
MIN_BOUND_SLIP = 1e-3     # -, for computing the bound
MAX_CROSSING_TRAVEL = 0.05  # m, of a wheel within the same crossing
COUNTED_FROM = 5          # revolution of the film's wheel after the start or a change of ground
MAX_INFORMATIVE_BOUND = 0.1  # relative sigma of mu
MAX_CONVERGED_ERROR = 0.1    # relative, of the fused mu after a change of surface
MAX_SAME_FRICTION = 1e-3     # relative difference of the true mu on one surface
MIN_SURFACE_CROSSINGS = 3    # on a surface, for scoring
MIN_RELATIVE_SIGMA = 1e-4    # without C_x and load

Columns = dict[str, Array]


@dataclass(frozen=True)
class Truths:
    """True crossings of one wheel, sorted; arrays have shape (n,) unless noted."""

    crossings: list[Friction]
    speed: Array   # m/s, |r w|
    clock_ns: Instants  # (m,) timestamps of ``distance``
    distance: Array  # (m,) m, rolled by the wheel


@dataclass(frozen=True)
class Rows:
    """True crossings of one wheel and their estimates, NaN without estimate."""

    stamp_ns: Instants
    speed: Array
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
    return Truths(crossings, speed, motion.stamp_ns, _rolled_distance(motion, index))


def _stamps(crossings: Sequence[Friction]) -> Instants:
    return np.array([one.stamp_ns for one in crossings], np.int64)


def _rolled_distance(motion: Truth, index: int) -> Array:
    speed = motion.rolling[:, index]
    steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(motion.stamp_ns) / NS_PER_S
    return np.concatenate([[0.0], np.cumsum(steps)])


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
        _stamps(truths.crossings), truths.speed,
        np.array([one is not None for one in matched], bool),
        {name: column(truths.crossings, name) for name in QUANTITIES},
        {name: column(matched, name) for name in QUANTITIES},
        {name: column(matched, name, sigmas=True) for name in QUANTITIES}, len(false))


def _same_crossing(truths: Truths, one: Friction, other: Friction) -> bool:
    """Return whether both timestamps belong to the same crossing."""
    begin, end = sorted((one.stamp_ns, other.stamp_ns))
    within = (truths.clock_ns >= begin) & (truths.clock_ns <= end)
    return bool(within.any()) and float(np.ptp(truths.distance[within])) < MAX_CROSSING_TRAVEL


def revolutions_on_ground(rows: Rows, quantities: Sequence[str] = (FUSED, 'stiffness')) -> Array:
    """
    Return which revolution (n,) on the present ground each crossing is, from 1.

    The ground changes with any of its true ``quantities``.
    """
    changed = np.zeros(len(rows.stamp_ns), bool)
    for name in quantities:
        changed[1:] |= _changes(rows.true[name])
    index = np.arange(len(changed))
    begin = np.maximum.accumulate(np.where(changed, index, 0))
    return np.asarray(index - begin + 1, np.float64)


def _changes(true: Array) -> Mask:
    changed: Mask = np.abs(np.diff(true)) > MAX_SAME_FRICTION * true[:-1]
    return changed


def on_one_surface(rows: Rows) -> Mask:
    """Return which crossings (n,) have the mu of their predecessor or successor."""
    same = ~_changes(rows.true[FUSED])
    mask: Mask = np.append(same, False) | np.append(False, same)
    return mask


def relative_errors(rows: Rows, name: str, when: Mask) -> Errors:
    """Return the relative errors of a quantity in the crossings ``when`` (n,)."""
    true, value, sigma = (columns[name][when] for columns in (rows.true, rows.value, rows.sigma))
    return Errors(value / true - 1.0, sigma / true)


def absolute_errors(rows: Rows, name: str, when: Mask) -> Errors:
    """Return the errors of a quantity in the crossings ``when`` (n,)."""
    true, value, sigma = (columns[name][when] for columns in (rows.true, rows.value, rows.sigma))
    return Errors(value - true, sigma)


def ratio_errors(rows: Rows, when: Mask) -> Errors:
    """Return the errors of mu F_z / C_x from single crossings, in units of mu."""
    value, true = ({name: columns[name][when] for name in (SINGLE, 'normal_load', 'stiffness')}
                   for columns in (rows.value, rows.true))
    ratio, exact = (one[SINGLE] * one['normal_load'] / one['stiffness'] for one in (value, true))
    relative = (rows.sigma[SINGLE][when] / value[SINGLE])**2 - sum(
        (rows.sigma[name][when] / value[name])**2 for name in ('normal_load', 'stiffness'))
    return Errors((1.0 - exact / ratio) * value[SINGLE],
                  value[SINGLE] * np.sqrt(np.maximum(relative, MIN_RELATIVE_SIGMA**2)))


def bounded_errors(rows: Rows, truths: Truths, robot: RobotParams, when: Mask) -> Errors:
    """Return the relative errors of informative single crossings; sigma is the bound."""
    bound = np.array([_bound(one, robot, speed)
                      for one, speed in zip(truths.crossings, truths.speed.tolist())], np.float64)
    informative = when & (bound < MAX_INFORMATIVE_BOUND)
    return Errors(relative_errors(rows, SINGLE, informative).error, bound[informative])


def _bound(one: Friction, robot: RobotParams, speed: float) -> float:
    slip, total = one.slip.value, one.total_slip.value
    if not (abs(slip) > MIN_BOUND_SLIP and speed > robot.slip.standstill_speed):
        return math.nan
    return friction_bound(robot, one.wheel, slip=slip,
                          normalized_slip=total / one.critical_slip.value, speed=speed)


def convergence(rows: Rows) -> list[float]:
    """
    Return the revolutions until the fused mu is within 10 %, on each surface; infinite if never.

    Surfaces with less than ``MIN_SURFACE_CROSSINGS`` do not count; the first one is the start.
    """
    mu, fused = rows.true[FUSED], rows.value[FUSED]
    edges = np.flatnonzero(_changes(mu)) + 1
    found: list[float] = []
    for begin, end in zip([0, *edges], [*edges, len(mu)]):
        error = np.abs(fused[begin:end] - mu[begin:end])
        near = np.flatnonzero(error < MAX_CONVERGED_ERROR * mu[begin:end])
        if end - begin >= MIN_SURFACE_CROSSINGS:
            found.append(float(near[0] + 1) if len(near) else math.inf)
    return found
