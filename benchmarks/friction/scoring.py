"""
Scores of told friction against the truth.

Errors of mu are relative to the true one. Normalised errors are those of mu F_z / C_x, which is
what a passage tells, by the sigma without those of C_x and load: the simulator has the C_x of the
robot's description, so mu itself would seem told better than it can be known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from benchmarks.friction.records import chosen, FUSED, Mask, Rows, SINGLE
from smart_tire.analysis.metrics import score
from smart_tire.analysis.series import Floats

Figures = dict[str, float]

IQR = 1.349         # interquartile range of Gaussian errors over their sigma
JUDGED_BOUND = 0.1  # relative sigma of mu; where the bound is larger one passage tells little
NEAR = 0.1          # relative error of mu from which on a change counts as found
FAST = 0.1          # -, slip above which a revolution must tell friction
SAME = 1e-3         # relative, of the true mu on one ground
FEWEST = 3          # passages on a ground that is judged
LEAST = 1e-4        # smallest relative sigma: below, the sigmas of C_x and load are all there is


KINDS = {'single': SINGLE, 'fused': FUSED}
OTHERS = ('adhesion_ratio', 'slip', 'film_slip')


@dataclass(frozen=True)
class Change:
    """Another ground, or the first: how many revolutions until the fused mu was near."""

    first: bool
    revolutions: float  # the one that found it included; infinite if none did
    fast: int           # of these with a slip above ``FAST``; one more than there were if none did


def spread(error: Floats) -> float:
    """Return the standard deviation of ``error`` from its interquartile range; NaN of nothing."""
    if not len(error):
        return math.nan
    low, high = np.percentile(error, (25.0, 75.0))
    return float(high - low) / IQR


def changes(rows: Rows) -> list[Change]:
    """Return how fast each ground was known that the wheel was on for ``FEWEST`` passages."""
    mu, fused, slip = rows.true[FUSED], rows.value[FUSED], np.abs(rows.true['slip'])
    edges = np.flatnonzero(np.abs(np.diff(mu)) > SAME * mu[:-1]) + 1
    found: list[Change] = []
    for begin, end in zip([0, *edges], [*edges, len(mu)]):
        if end - begin < FEWEST:
            continue
        near = np.flatnonzero(np.abs(fused[begin:end] - mu[begin:end]) < NEAR * mu[begin:end])
        until = begin + int(near[0]) + 1 if len(near) else end
        fast = int(np.count_nonzero(slip[begin:until] > FAST)) + (not len(near))
        found.append(Change(not found, float(until - begin) if len(near) else math.inf, fast))
    return found


def figures_of(rows: Rows, grounds: Sequence[Change], ms: float) -> Figures:
    """
    Return all figures of one or more runs; NaN where there is nothing to judge.

    Errors are those of passages over one ground: the truth of others is a mean.
    """
    figures = {'passages': float(len(rows.found)), 'found': _share(rows.found),
               'false': float(rows.false), 'ms': ms}
    one = on_one_ground(rows)
    mixed = chosen(rows, ~one)
    figures |= {'mixed': float(len(mixed.found)), 'mixed_within_two': score(
        mixed.value[SINGLE] - mixed.true[SINGLE], mixed.sigma[SINGLE]).within_two}
    rows = chosen(rows, one)
    figures |= {'slip_median': _quantile(rows.true['slip'], 0.5),
                'total_slip_median': _quantile(rows.true['total_slip'], 0.5),
                'bound_median': _quantile(rows.bound, 0.5)}
    for name, quantity in KINDS.items():
        figures |= _error_figures(name, rows, quantity)
    squares = {'single': single_squares(rows), 'fused': _squares(rows, 'critical_slip'),
               **{name: _squares(rows, name) for name in OTHERS}}
    figures |= {f'nees_{name}': _mean(square) for name, square in squares.items()}
    figures |= {f'{name}_rms': score(rows.value[name] - rows.true[name], rows.sigma[name]).rms
                for name in OTHERS}
    return figures | _bounded_figures(rows, squares['single']) | _change_figures(grounds)


def on_one_ground(rows: Rows) -> Mask:
    """Return which passages (n,) have the mu of their neighbour before or behind."""
    mu = rows.true[FUSED]
    same = np.abs(np.diff(mu)) <= SAME * mu[:-1]
    mask: Mask = np.append(same, False) | np.append(False, same)
    return mask


def _error_figures(name: str, rows: Rows, quantity: str) -> Figures:
    """Return errors of mu relative to the true one, and how often it is within its sigma."""
    error, sigma = _relative(rows, quantity), rows.sigma[quantity] / rows.true[quantity]
    whole = score(error, sigma)
    return {f'{name}_told': _share(np.isfinite(error)),
            f'{name}_median': _quantile(np.abs(error), 0.5),
            f'{name}_90': _quantile(np.abs(error), 0.9), f'{name}_bias': _quantile(error, 0.5),
            f'{name}_within_one': whole.within_one, f'{name}_within_two': whole.within_two}


def _bounded_figures(rows: Rows, squares: Floats) -> Figures:
    """Return the figures of single passages where the bound says that one tells much."""
    telling = rows.bound < JUDGED_BOUND
    error, bound = _relative(rows, SINGLE)[telling], rows.bound[telling]
    told = np.isfinite(error)
    return {'bounded': float(len(bound)), 'bounded_told': _share(told),
            'bounded_bias': _quantile(error, 0.5),
            'bounded_over_bound': spread(error[told] / bound[told]),
            'bounded_nees': _mean(squares[telling])}


def reading_figures(read_off: Sequence[Floats], parts: Sequence[Rows]) -> Figures:
    """Return the figures of mu as the paper reads it: over the true one, and errors."""
    ratio = np.concatenate([mu / rows.true[SINGLE] for mu, rows in zip(read_off, parts)])
    return {'read_told': _share(np.isfinite(ratio)), 'read_ratio': _quantile(ratio, 0.5),
            'read_median': _quantile(np.abs(ratio - 1.0), 0.5),
            'read_90': _quantile(np.abs(ratio - 1.0), 0.9)}


def single_squares(rows: Rows) -> Floats:
    """Return the normalised squared errors (n,) of mu F_z / C_x from single passages."""
    value = rows.value
    told = value[SINGLE] * value['normal_load'] / value['stiffness']
    true = rows.true[SINGLE] * rows.true['normal_load'] / rows.true['stiffness']
    error: Floats = ((1.0 - true / told) * value[SINGLE] / own_sigma(rows))**2
    return error


def own_sigma(rows: Rows) -> Floats:
    """Return the sigma (n,) of mu from single passages without those of C_x and load."""
    value, sigma = rows.value, rows.sigma
    relative = (sigma[SINGLE] / value[SINGLE])**2 - sum(
        (sigma[name] / value[name])**2 for name in ('normal_load', 'stiffness'))
    own: Floats = value[SINGLE] * np.sqrt(np.maximum(relative, LEAST**2))
    return own


def _squares(rows: Rows, name: str) -> Floats:
    error: Floats = ((rows.value[name] - rows.true[name]) / rows.sigma[name])**2
    return error


def _change_figures(grounds: Sequence[Change]) -> Figures:
    figures: Figures = {}
    for name, first in (('start', True), ('jump', False)):
        own = [one for one in grounds if one.first == first]
        needed = np.array([one.revolutions for one in own])
        figures |= {
            f'{name}s': float(len(own)), f'{name}s_found': _share(np.isfinite(needed)),
            f'{name}_revolutions': float(np.median(needed)) if own else math.nan,
            f'{name}_worst': float(needed.max()) if own else math.nan,
            f'{name}_fast_worst': float(max((one.fast for one in own), default=math.nan))}
    return figures


def _relative(rows: Rows, name: str) -> Floats:
    error: Floats = rows.value[name] / rows.true[name] - 1.0
    return error


def _quantile(values: Floats, share: float) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, share)) if len(known) else math.nan


def _share(mask: Mask) -> float:
    return float(np.mean(mask)) if len(mask) else math.nan


def _mean(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if len(known) else math.nan
