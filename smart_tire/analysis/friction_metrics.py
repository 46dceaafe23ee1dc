"""How true the friction of single passages is, and whether its sigma says so."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.analysis.metrics import Score, score
from smart_tire.analysis.series import Floats
from smart_tire.samples import Friction, NS_PER_S
from smart_tire.uncertain import UNKNOWN

# A wheel at 300 rpm takes four times this [s] for a turn, so no passage finds the wrong partner.
TOLERANCE = 0.05
GENTLE_SLIP = 0.05  # below it one pass tells little (PHYSICS.md B)
TELLING = 0.6       # a relative sigma above it is no figure
KINDS = ('traction', 'braking', 'gentle')


@dataclass(frozen=True)
class Matches:
    """True passages with the estimate that belongs to each, if any, and estimates of nothing."""

    pairs: list[tuple[Friction, Friction | None]]  # truth, estimate
    false: list[Friction]


@dataclass(frozen=True)
class FrictionScore:
    """Friction from single passages of one kind; shares are NaN of nothing."""

    passages: int                 # that there were in truth
    found: int
    telling: int                  # found, finite, and relative sigma below ``TELLING``
    telling_share: float          # of ``passages``
    median_relative_error: float  # of the telling ones, without sign
    median_bias: float            # of the telling ones, relative, with sign
    within_one: float             # share of the telling ones within one sigma
    within_two: float
    fused_median_relative_error: float  # of the fused values that are finite
    fused_within_two: float
    adhesion_ratio: Score         # of the found ones that have one


def match(estimates: Iterable[Friction], truths: Iterable[Friction],
          tolerance: float = TOLERANCE) -> Matches:
    """Return each true passage with the nearest estimate of its wheel within ``tolerance`` [s]."""
    truths = sorted(truths, key=lambda passage: passage.stamp_ns)
    estimates = sorted(estimates, key=lambda passage: passage.stamp_ns)
    near = sorted((abs(e.stamp_ns - t.stamp_ns), i, j)
                  for wheel in {truth.wheel for truth in truths}
                  for i, t, j, e in _candidates(truths, estimates, wheel, tolerance))
    partner: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, j in near:
        if i not in partner and j not in taken:
            partner[i] = j
            taken.add(j)
    pairs = [(truth, estimates[partner[i]] if i in partner else None)
             for i, truth in enumerate(truths)]
    return Matches(pairs, [e for j, e in enumerate(estimates) if j not in taken])


def _candidates(truths: Sequence[Friction], estimates: Sequence[Friction], wheel: str,
                tolerance: float) -> Iterable[tuple[int, Friction, int, Friction]]:
    ours = [(j, e) for j, e in enumerate(estimates) if e.wheel == wheel]
    stamps = np.array([e.stamp_ns for _, e in ours], np.int64)
    reach = round(tolerance * NS_PER_S)
    for i, truth in enumerate(truths):
        if truth.wheel == wheel:
            first = np.searchsorted(stamps, truth.stamp_ns - reach)
            last = np.searchsorted(stamps, truth.stamp_ns + reach, side='right')
            for j, estimate in ours[first:last]:
                yield i, truth, j, estimate


def kind_of(truth: Friction) -> str:
    """Return which of ``KINDS`` a true passage is: by the sign and size of its slip."""
    slip = truth.slip.value
    if abs(slip) > GENTLE_SLIP:
        return 'traction' if slip > 0.0 else 'braking'
    return 'gentle'


def friction_scores(pairs: Sequence[tuple[Friction, Friction | None]]) -> dict[str, FrictionScore]:
    """Return the score of each kind of passage that occurs among ``pairs``."""
    kinds = [kind_of(truth) for truth, _ in pairs]
    return {kind: friction_score([pair for pair, own in zip(pairs, kinds) if own == kind])
            for kind in KINDS if kind in kinds}


def friction_score(pairs: Sequence[tuple[Friction, Friction | None]]) -> FrictionScore:
    """Return the score of ``pairs``, truth first."""
    true = column([truth for truth, _ in pairs], 'friction_coefficient')
    guesses = [guess for _, guess in pairs]
    single = column(guesses, 'friction_coefficient_single')
    sigma = column(guesses, 'friction_coefficient_single', sigmas=True)
    told = telling(single, sigma)
    relative = (single - true)[told] / true[told]
    own = score((single - true)[told], sigma[told])
    fused = column(guesses, 'friction_coefficient')
    together = score(fused - true, column(guesses, 'friction_coefficient', sigmas=True))
    adhesion = (column(guesses, 'adhesion_ratio')
                - column([truth for truth, _ in pairs], 'adhesion_ratio'))
    return FrictionScore(
        len(pairs), sum(guess is not None for guess in guesses), int(told.sum()),
        float(told.sum()) / len(pairs) if pairs else math.nan,
        _median(np.abs(relative)), _median(relative), own.within_one, own.within_two,
        _median(np.abs(fused - true) / true), together.within_two,
        score(adhesion, column(guesses, 'adhesion_ratio', sigmas=True)))


def column(passages: Sequence[Friction | None], name: str, sigmas: bool = False) -> Floats:
    """Return one quantity, or its sigma, of each passage; NaN where there is none."""
    quantities = [UNKNOWN if passage is None else passage.quantity(name) for passage in passages]
    return np.array([one.sigma if sigmas else one.value for one in quantities], np.float64)


def telling(value: Floats, sigma: Floats) -> NDArray[np.bool_]:
    """Return which values are finite with a relative sigma below ``TELLING``."""
    return np.isfinite(value) & (sigma < TELLING * np.abs(value))


def _median(values: Floats) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else math.nan
