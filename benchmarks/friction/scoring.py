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

"""
Scores of friction estimates against ground truth.

Errors of mu are relative to the true one. A crossing determines mu F_z / C_x, so normalized errors
are those of this ratio, with the sigma of mu without the contributions of C_x and load. (The
simulator uses the nominal C_x, so that mu itself would appear too accurate.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from benchmarks.friction.records import FUSED, Mask, Rows, selected_rows, SINGLE
import numpy as np
from smart_tire.analysis.metrics import score
from smart_tire.analysis.series import Floats

Figures = dict[str, float]

IQR_TO_SIGMA = 1.349  # interquartile range of Gaussian errors over their sigma
MAX_INFORMATIVE_BOUND = 0.1  # relative sigma of mu
MAX_CONVERGED_ERROR = 0.1    # relative, of the fused mu after a change of surface
FAST_SLIP = 0.1              # -, above which a crossing must determine mu
MAX_SAME_FRICTION = 1e-3     # relative difference of the true mu on one surface
MIN_SURFACE_CROSSINGS = 3    # on a surface, for scoring
MIN_RELATIVE_SIGMA = 1e-4    # without C_x and load

KINDS = {'single': SINGLE, 'fused': FUSED}
OTHERS = ('adhesion_ratio', 'slip', 'film_slip')


@dataclass(frozen=True)
class Change:
    """A change of surface, or the first surface: crossings until fused mu has converged."""

    first: bool
    revolutions: float  # including the converged one; infinite if none
    fast: int           # those with slip above ``FAST_SLIP``; one more if none converged


def spread(error: Floats) -> float:
    """Return the standard deviation from the interquartile range; NaN without values."""
    if not len(error):
        return math.nan
    low, high = np.percentile(error, (25.0, 75.0))
    return float(high - low) / IQR_TO_SIGMA


def changes(rows: Rows) -> list[Change]:
    """Return the convergence on each surface with ``MIN_SURFACE_CROSSINGS`` or more."""
    mu, fused, slip = rows.true[FUSED], rows.value[FUSED], np.abs(rows.true['slip'])
    edges = np.flatnonzero(np.abs(np.diff(mu)) > MAX_SAME_FRICTION * mu[:-1]) + 1
    found: list[Change] = []
    for begin, end in zip([0, *edges], [*edges, len(mu)]):
        if end - begin < MIN_SURFACE_CROSSINGS:
            continue
        error = np.abs(fused[begin:end] - mu[begin:end])
        near = np.flatnonzero(error < MAX_CONVERGED_ERROR * mu[begin:end])
        until = begin + int(near[0]) + 1 if len(near) else end
        fast = int(np.count_nonzero(slip[begin:until] > FAST_SLIP)) + (not len(near))
        found.append(Change(not found, float(until - begin) if len(near) else math.inf, fast))
    return found


def figures_of(rows: Rows, surfaces: Sequence[Change], ms: float) -> Figures:
    """
    Return all figures of one or more runs; NaN without data.

    Errors are those of crossings on a single surface; otherwise the true mu is a mean.
    """
    figures = {'crossings': float(len(rows.found)), 'found': _share(rows.found),
               'false': float(rows.false), 'ms': ms}
    one = on_one_surface(rows)
    mixed = selected_rows(rows, ~one)
    figures |= {'mixed': float(len(mixed.found)), 'mixed_within_two': score(
        mixed.value[SINGLE] - mixed.true[SINGLE], mixed.sigma[SINGLE]).within_two}
    rows = selected_rows(rows, one)
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
    return figures | _bounded_figures(rows, squares['single']) | _change_figures(surfaces)


def on_one_surface(rows: Rows) -> Mask:
    """Return which crossings (n,) have the mu of their predecessor or successor."""
    mu = rows.true[FUSED]
    same = np.abs(np.diff(mu)) <= MAX_SAME_FRICTION * mu[:-1]
    mask: Mask = np.append(same, False) | np.append(False, same)
    return mask


def _error_figures(name: str, rows: Rows, quantity: str) -> Figures:
    """Return relative errors of mu, and the shares within one and two sigma."""
    error, sigma = _relative(rows, quantity), rows.sigma[quantity] / rows.true[quantity]
    whole = score(error, sigma)
    return {f'{name}_finite': _share(np.isfinite(error)),
            f'{name}_median': _quantile(np.abs(error), 0.5),
            f'{name}_90': _quantile(np.abs(error), 0.9), f'{name}_bias': _quantile(error, 0.5),
            f'{name}_within_one': whole.within_one, f'{name}_within_two': whole.within_two}


def _bounded_figures(rows: Rows, squares: Floats) -> Figures:
    """Return the figures of single crossings with a bound below ``MAX_INFORMATIVE_BOUND``."""
    informative = rows.bound < MAX_INFORMATIVE_BOUND
    error, bound = _relative(rows, SINGLE)[informative], rows.bound[informative]
    finite = np.isfinite(error)
    return {'bounded': float(len(bound)), 'bounded_finite': _share(finite),
            'bounded_bias': _quantile(error, 0.5),
            'bounded_over_bound': spread(error[finite] / bound[finite]),
            'bounded_nees': _mean(squares[informative])}


def peak_figures(from_peaks: Sequence[Floats], parts: Sequence[Rows]) -> Figures:
    """Return the figures of mu by the method of paper B: ratio to the true one, and errors."""
    ratio = np.concatenate([mu / rows.true[SINGLE] for mu, rows in zip(from_peaks, parts)])
    return {'peaks_finite': _share(np.isfinite(ratio)), 'peaks_ratio': _quantile(ratio, 0.5),
            'peaks_median': _quantile(np.abs(ratio - 1.0), 0.5),
            'peaks_90': _quantile(np.abs(ratio - 1.0), 0.9)}


def single_squares(rows: Rows) -> Floats:
    """Return the normalized squared errors (n,) of mu F_z / C_x from single crossings."""
    value = rows.value
    finite = value[SINGLE] * value['normal_load'] / value['stiffness']
    true = rows.true[SINGLE] * rows.true['normal_load'] / rows.true['stiffness']
    error: Floats = ((1.0 - true / finite) * value[SINGLE] / own_sigma(rows))**2
    return error


def own_sigma(rows: Rows) -> Floats:
    """Return the sigma (n,) of mu from single crossings without those of C_x and load."""
    value, sigma = rows.value, rows.sigma
    relative = (sigma[SINGLE] / value[SINGLE])**2 - sum(
        (sigma[name] / value[name])**2 for name in ('normal_load', 'stiffness'))
    own: Floats = value[SINGLE] * np.sqrt(np.maximum(relative, MIN_RELATIVE_SIGMA**2))
    return own


def _squares(rows: Rows, name: str) -> Floats:
    error: Floats = ((rows.value[name] - rows.true[name]) / rows.sigma[name])**2
    return error


def _change_figures(surfaces: Sequence[Change]) -> Figures:
    figures: Figures = {}
    for name, first in (('start', True), ('jump', False)):
        own = [one for one in surfaces if one.first == first]
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
