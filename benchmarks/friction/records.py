"""Passages of one wheel in a run as arrays: what is true, what was told, and what could be."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.friction.cramer_rao import friction_bound
from benchmarks.slip.series import as_truth, TAIL, Truth
from smart_tire.analysis.friction_metrics import column, match
from smart_tire.analysis.series import at, Floats, Stamps
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, Sample, WHEELS

SINGLE, FUSED = 'friction_coefficient_single', 'friction_coefficient'
QUANTITIES = (SINGLE, FUSED, 'critical_slip', 'adhesion_ratio', 'slip', 'total_slip', 'film_slip',
              'normal_load', 'stiffness', 'stretch_voltage', 'peak_interval')
LEAST_SLIP = 1e-3  # -, below it there is no bound
STAYS = 0.05       # m, to either side, within which a wheel is still in the same passage

Columns = dict[str, Floats]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Truths:
    """The true passages of one wheel in order; all arrays have shape (n,)."""

    passages: list[Friction]
    speed: Floats   # m/s, |r w|
    bound: Floats   # least relative sigma of mu from this passage, NaN where nothing slips
    clock_ns: Stamps  # (m,) instants ...
    way: Floats       # ... and how far the wheel has rolled forward then [m]


@dataclass(frozen=True)
class Rows:
    """True passages of one wheel and what was told of them: NaN where that is nothing."""

    stamp_ns: Stamps
    speed: Floats
    bound: Floats
    found: Mask
    true: Columns
    value: Columns
    sigma: Columns
    false: int  # estimates of passages that there were not


def true_passages(records: Iterable[Sample], robot: RobotParams, wheel: str) -> Truths:
    """Return the passages of ``wheel`` in the truth of a run, but for those at its very end."""
    records = list(records)
    motion, index = as_truth(records, robot), WHEELS.index(wheel)
    end = int(motion.stamp_ns[-1]) - round(TAIL * NS_PER_S)
    passages = sorted((one for one in records if isinstance(one, Friction)
                       and one.wheel == wheel and one.stamp_ns < end),
                      key=lambda one: one.stamp_ns)
    speed = np.abs(at(_stamps(passages), motion.stamp_ns, motion.rolling)[:, index])
    bounds = [_bound(one, robot, speed) for one, speed in zip(passages, speed.tolist())]
    return Truths(passages, speed, np.array(bounds, np.float64), motion.stamp_ns,
                  _way(motion, index))


def _stamps(passages: Sequence[Friction]) -> Stamps:
    return np.array([one.stamp_ns for one in passages], np.int64)


def _way(motion: Truth, index: int) -> Floats:
    speed = motion.rolling[:, index]
    steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(motion.stamp_ns) / NS_PER_S
    return np.concatenate([[0.0], np.cumsum(steps)])


def _bound(one: Friction, robot: RobotParams, speed: float) -> float:
    slip, total = one.slip.value, one.total_slip.value
    if not (abs(slip) > LEAST_SLIP and speed > robot.slip.standstill_speed):
        return math.nan
    return friction_bound(robot, one.wheel, slip=slip,
                          sliding=total / one.critical_slip.value, speed=speed)


def rows_of(truths: Truths, estimates: Sequence[Friction], wheel: str) -> Rows:
    """
    Return what ``estimates`` tell of the true passages of ``wheel``.

    Where the wheel stands or turns back in the middle of a passage, its instant may be any.
    """
    last = max((one.stamp_ns for one in truths.passages), default=0)
    found = match([one for one in estimates if one.wheel == wheel], truths.passages)
    false = [one for one in found.false if one.stamp_ns <= last]
    told = []
    for true, estimate in found.pairs:
        if estimate is None:
            estimate = next((one for one in false if _stayed(truths, true, one)), None)
            false = [one for one in false if one is not estimate]
        told.append(estimate)
    return Rows(
        _stamps(truths.passages), truths.speed, truths.bound,
        np.array([one is not None for one in told], bool),
        {name: column(truths.passages, name) for name in QUANTITIES},
        {name: column(told, name) for name in QUANTITIES},
        {name: column(told, name, sigmas=True) for name in QUANTITIES}, len(false))


def _stayed(truths: Truths, one: Friction, other: Friction) -> bool:
    """Return whether the wheel stayed in the same passage between two stamps."""
    begin, end = sorted((one.stamp_ns, other.stamp_ns))
    within = (truths.clock_ns >= begin) & (truths.clock_ns <= end)
    return bool(within.any()) and float(np.ptp(truths.way[within])) < STAYS


def together(parts: Sequence[Rows]) -> Rows:
    """Return the passages of several runs as those of one."""
    def joined(which: str) -> Columns:
        return {name: np.concatenate([getattr(part, which)[name] for part in parts])
                for name in QUANTITIES}
    stamps, speed, bound, found = (np.concatenate([getattr(part, which) for part in parts])
                                   for which in ('stamp_ns', 'speed', 'bound', 'found'))
    return Rows(stamps, speed, bound, found, joined('true'), joined('value'), joined('sigma'),
                sum(part.false for part in parts))


def chosen(rows: Rows, which: Mask) -> Rows:
    """Return the passages ``which`` (n,) of ``rows``."""
    def picked(columns: Columns) -> Columns:
        return {name: values[which] for name, values in columns.items()}
    return Rows(rows.stamp_ns[which], rows.speed[which], rows.bound[which], rows.found[which],
                picked(rows.true), picked(rows.value), picked(rows.sigma), rows.false)
