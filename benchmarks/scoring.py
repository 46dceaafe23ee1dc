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
The one score of all benchmarks: errors of a quantity and their standard deviations.

A run gives errors by quantity and single values. Over several seeds errors are pooled; the share
within two sigma and the NEES are means over the runs, as the errors of one run are correlated.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
import math

import numpy as np
from numpy.typing import ArrayLike
from smart_tire.arrays import Array

Figures = dict[str, float]
IQR_TO_SIGMA = 1.349  # interquartile range of Gaussian errors over their sigma
OVER_RUNS = 'within_two', 'nees'


@dataclass(frozen=True)
class Errors:
    """Errors of one quantity and their standard deviations, shape (n,); NaN if not estimated."""

    error: Array
    sigma: Array

    @classmethod
    def without_sigma(cls, error: Iterable[float]) -> Errors:
        """Return errors of an estimate that has no standard deviation."""
        values = np.array(list(error), np.float64)
        return cls(values, np.full(len(values), math.nan))

    @property
    def figures(self) -> Figures:
        """
        Return the share of finite errors, their statistics, and the consistency of the sigmas.

        It is unknown if most sigmas are. Median, 90 % quantile and maximum are of absolute
        errors, the bias is the median error. Spread is the standard deviation of error over
        sigma, from the interquartile range.
        """
        known = np.isfinite(self.error)
        error, sigma = self.error[known], self.sigma[known]
        with np.errstate(divide='ignore', invalid='ignore'):
            ratio = np.where(error == 0.0, 0.0, error / sigma)
        given = ~np.isnan(sigma)
        ratio = ratio[given] if mean(given) > 0.5 else ratio[:0]
        size = np.abs(error)
        low, high = _quantiles(ratio, 0.25, 0.75)
        median, large = _quantiles(size, 0.5, 0.9)
        most = max(np.abs(self.error[~np.isnan(self.error)]).tolist(), default=math.nan)
        return {'finite': mean(known), 'mean': mean(error), 'bias': _quantiles(error, 0.5)[0],
                'rms': math.sqrt(mean(error**2)), 'median': median, 'q90': large, 'max': most,
                'within_two': mean(np.abs(ratio) <= 2.0), 'nees': mean(ratio**2),
                'spread': (high - low) / IQR_TO_SIGMA}


@dataclass(frozen=True)
class Run:
    """Scores of one run, or of one method in it."""

    row: str
    seed: int
    errors: Mapping[str, Errors] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)

    @property
    def figures(self) -> dict[str, Figures]:
        """Return the figures of each quantity."""
        return {name: one.figures for name, one in self.errors.items()}


def combined(runs: Sequence[Run]) -> Figures:
    """Return 'quantity.figure' of the pooled errors; mean, its error, and maximum of values."""
    found: Figures = {}
    for name in dict.fromkeys(name for run in runs for name in run.errors):
        own = [run.errors[name] for run in runs if name in run.errors]
        each = [one.figures for one in own]
        whole = pooled(own).figures | {part: mean([one[part] for one in each])
                                       for part in OVER_RUNS}
        found |= {f'{name}.{part}': value for part, value in whole.items()}
    for name in dict.fromkeys(name for run in runs for name in run.values):
        values = [run.values[name] for run in runs if name in run.values]
        found |= {name: mean(values), f'{name}.max': max(values),
                  f'{name}.error': standard_error(values)}
    return found


def pooled(parts: Sequence[Errors]) -> Errors:
    """Return the errors of several runs as one."""
    return Errors(np.concatenate([one.error for one in parts]),
                  np.concatenate([one.sigma for one in parts]))


def part_of(figures: Mapping[str, float], prefix: str) -> Figures:
    """Return the figures whose names begin with ``prefix`` and a dot, without it."""
    return {name.removeprefix(f'{prefix}.'): value for name, value in figures.items()
            if name.startswith(f'{prefix}.')}


def mean(values: ArrayLike) -> float:
    """Return the mean of the values that are not NaN; NaN without any."""
    array = np.asarray(values, np.float64)
    known = array[~np.isnan(array)]
    return float(np.mean(known)) if len(known) else math.nan


def standard_error(values: Sequence[float]) -> float:
    """Return the standard error of the mean of the values; NaN with less than two."""
    if len(values) < 2:
        return math.nan
    return float(np.std(values, ddof=1)) / math.sqrt(len(values))


def _quantiles(values: Array, *shares: float) -> list[float]:
    return np.quantile(values, shares).tolist() if len(values) else [math.nan] * len(shares)
