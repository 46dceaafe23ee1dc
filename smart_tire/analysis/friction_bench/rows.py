"""Passages of one wheel in a run as arrays: what is true, what was told, and what could be."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.analysis.passages import column, match
from smart_tire.analysis.series import at, Floats, Stamps
from smart_tire.analysis.slip_bench.tracks import as_truth, TAIL, Truth
from smart_tire.estimation.friction_bound import friction_bound
from smart_tire.parameters import RobotParams
from smart_tire.samples import Friction, NS_PER_S, Sample, WHEELS

SINGLE, FUSED = 'friction_coefficient_single', 'friction_coefficient'
QUANTITIES = (SINGLE, FUSED, 'critical_slip', 'adhesion_ratio', 'slip', 'total_slip', 'film_slip',
              'normal_load', 'stiffness', 'stretch_voltage', 'peak_interval')
LEAST_SLIP = 1e-3  # -, below it there is no bound
SAME_PLACE = 0.02  # m, rolled between the stamps of one passage; half of what jitter may do

Columns = dict[str, Floats]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Truths:
    """The true passages of one wheel in order; all arrays have shape (n,)."""

    passages: list[Friction]
    speed: Floats   # m/s, |r w|
    bound: Floats   # least relative sigma of mu from this passage, NaN where nothing slips
    clock_ns: Stamps  # (m,) instants ...
    way: Floats       # ... and how far the wheel has rolled then [m], in either direction


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
    speed = np.abs(motion.rolling[:, index])
    steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(motion.stamp_ns) / NS_PER_S
    return np.concatenate([[0.0], np.cumsum(steps)])


def _bound(one: Friction, robot: RobotParams, speed: float) -> float:
    slip, total = one.value['slip'], one.value['total_slip']
    if not (abs(slip) > LEAST_SLIP and speed > robot.slip.standstill_speed):
        return math.nan
    return friction_bound(robot, one.wheel, slip=slip,
                          sliding=total / one.value['critical_slip'], speed=speed)


def rows_of(truths: Truths, estimates: Sequence[Friction], wheel: str) -> Rows:
    """
    Return what ``estimates`` tell of the true passages of ``wheel``.

    The two belong together by where the wheel has rolled to: while it stands in the middle of a
    passage, its instant may be any.
    """
    own = [one for one in estimates if one.wheel == wheel and one.stamp_ns <= truths.clock_ns[-1]]
    placed, true = ([replace(one, stamp_ns=place) for one, place in zip(
        passages, _places(truths, passages))] for passages in (own, truths.passages))
    found = match(placed, true, SAME_PLACE)
    told = [estimate for _, estimate in found.pairs]
    end = max(_places(truths, truths.passages), default=0)
    return Rows(
        _stamps(truths.passages), truths.speed, truths.bound,
        np.array([one is not None for one in told], bool),
        {name: column(truths.passages, name) for name in QUANTITIES},
        {name: column(told, name) for name in QUANTITIES},
        {name: column(told, name, sigmas=True) for name in QUANTITIES},
        sum(one.stamp_ns <= end for one in found.false))


def _places(truths: Truths, passages: Sequence[Friction]) -> list[int]:
    """Return how far the wheel had rolled at the passages, in units of 1 nm."""
    ways = np.interp(_stamps(passages), truths.clock_ns, truths.way)
    places: list[int] = np.rint(ways * NS_PER_S).astype(np.int64).tolist()
    return places


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
