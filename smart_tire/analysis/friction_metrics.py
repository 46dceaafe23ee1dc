# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Accuracy and consistency of friction estimates, crossing by crossing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.analysis.metrics import median, Score, score
from smart_tire.arrays import Array, Instants
from smart_tire.samples import Friction, NS_PER_S
from smart_tire.uncertain import UNKNOWN

MAX_STAMP_DIFFERENCE = 0.05  # s, between estimate and truth; a quarter revolution at 300 rpm
MAX_LOW_SLIP = 0.05          # -, below it a single crossing contains little information
MAX_RELATIVE_SIGMA = 0.6     # of an informative estimate
KINDS = ('traction', 'braking', 'low slip')


@dataclass(frozen=True)
class Matches:
    """True crossings with their estimates, and estimates without a true crossing."""

    pairs: list[tuple[Friction, Friction | None]]  # truth, estimate
    false: list[Friction]


@dataclass(frozen=True)
class FrictionScore:
    """Scores of one kind of crossings; shares are NaN without crossings."""

    crossings: int                # in the ground truth
    found: int
    informative: int              # relative sigma below ``MAX_RELATIVE_SIGMA``
    informative_share: float      # of ``crossings``
    median_relative_error: float  # of the absolute error of informative estimates
    median_bias: float            # of the signed relative error of informative estimates
    within_one: float             # share of informative estimates with an error below sigma
    within_two: float
    fused_median_relative_error: float  # of finite fused estimates
    fused_within_two: float
    adhesion_ratio: Score         # of finite estimates


def match(estimates: Iterable[Friction], truths: Iterable[Friction]) -> Matches:
    """Return the pairs of true crossings and nearest estimates."""
    from scipy.optimize import linear_sum_assignment  # at first use: takes a part of a second
    truths, estimates = (sorted(several, key=lambda one: one.stamp_ns)
                         for several in (truths, estimates))
    apart = np.abs(np.subtract.outer(stamps_of(truths), stamps_of(estimates)))
    other_wheel = np.not_equal.outer(*(np.array([one.wheel for one in several], str)
                                       for several in (truths, estimates)))
    reach = round(MAX_STAMP_DIFFERENCE * NS_PER_S)
    cost = np.where(other_wheel | (apart > reach), 2 * reach, apart)  # two of these: no match
    partner = {int(i): int(j) for i, j in zip(*linear_sum_assignment(cost)) if cost[i, j] <= reach}
    taken = set(partner.values())
    return Matches([(truth, estimates[partner[i]] if i in partner else None)
                    for i, truth in enumerate(truths)],
                   [one for j, one in enumerate(estimates) if j not in taken])


def kind_of(truth: Friction) -> str:
    """Return the kind of a true crossing, by sign and magnitude of its slip."""
    slip = truth.slip.value
    if abs(slip) > MAX_LOW_SLIP:
        return 'traction' if slip > 0.0 else 'braking'
    return 'low slip'


def friction_scores(pairs: Sequence[tuple[Friction, Friction | None]]) -> dict[str, FrictionScore]:
    """Return the scores of all kinds of crossings in ``pairs``."""
    kinds = [kind_of(truth) for truth, _ in pairs]
    return {kind: friction_score([pair for pair, own in zip(pairs, kinds) if own == kind])
            for kind in KINDS if kind in kinds}


def friction_score(pairs: Sequence[tuple[Friction, Friction | None]]) -> FrictionScore:
    """Return the score of ``pairs`` (truth, estimate)."""
    true = column([truth for truth, _ in pairs], 'friction_coefficient')
    estimates = [estimate for _, estimate in pairs]
    single = column(estimates, 'friction_coefficient_single')
    sigma = column(estimates, 'friction_coefficient_single', sigmas=True)
    usable = is_informative(single, sigma)
    relative = (single - true)[usable] / true[usable]
    single_score = score((single - true)[usable], sigma[usable])
    fused = column(estimates, 'friction_coefficient')
    fused_score = score(fused - true, column(estimates, 'friction_coefficient', sigmas=True))
    adhesion = (column(estimates, 'adhesion_ratio')
                - column([truth for truth, _ in pairs], 'adhesion_ratio'))
    return FrictionScore(
        len(pairs), sum(estimate is not None for estimate in estimates), int(usable.sum()),
        float(usable.sum()) / len(pairs) if pairs else math.nan,
        median(np.abs(relative)), median(relative),
        single_score.within_one, single_score.within_two,
        median(np.abs(fused - true) / true), fused_score.within_two,
        score(adhesion, column(estimates, 'adhesion_ratio', sigmas=True)))


def column(crossings: Sequence[Friction | None], name: str, sigmas: bool = False) -> Array:
    """Return one quantity, or its sigma, of each crossing; NaN if not available."""
    quantities = [UNKNOWN if crossing is None else crossing.quantity(name)
                  for crossing in crossings]
    return np.array([one.sigma if sigmas else one.value for one in quantities], np.float64)


def of_wheel(crossings: Sequence[Friction], wheel: str) -> list[Friction]:
    """Return the crossings of ``wheel`` in order of time."""
    return sorted((p for p in crossings if p.wheel == wheel), key=lambda p: p.stamp_ns)


def stamps_of(crossings: Sequence[Friction]) -> Instants:
    """Return the timestamps [ns] of ``crossings``."""
    return np.array([crossing.stamp_ns for crossing in crossings], np.int64)


def is_informative(value: Array, sigma: Array) -> NDArray[np.bool_]:
    """Return which values are finite with a relative sigma below ``MAX_RELATIVE_SIGMA``."""
    return np.isfinite(value) & (sigma < MAX_RELATIVE_SIGMA * np.abs(value))
