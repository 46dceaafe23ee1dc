# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A value with its standard deviation: result type of estimators and calibrations."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

MAX_RELATIVE_SIGMA = 0.2  # relative standard error above which a value is not observable


class Uncertain(NamedTuple):
    """A value and its standard deviation; ``UNKNOWN`` is NaN with an infinite one."""

    value: float
    sigma: float

    @property
    def determined(self) -> bool:
        """Return whether the standard error is small enough for the value to be used."""
        return self.sigma <= MAX_RELATIVE_SIGMA * abs(self.value)


UNKNOWN = Uncertain(math.nan, math.inf)


def fused(a: Uncertain, b: Uncertain) -> Uncertain:
    """
    Return the mean of two independent estimates, weighted by 1 / sigma^2.

    >>> fused(Uncertain(1.0, 0.5), Uncertain(3.0, 0.5)).value
    2.0
    """
    a, b = sorted((a, b), key=lambda one: one.sigma)
    if a.sigma in (0.0, math.inf):
        return a
    weight = (a.sigma / b.sigma) ** 2  # of b, that of a is 1: the square of no sigma overflows
    return Uncertain((a.value + weight * b.value) / (1.0 + weight),
                     a.sigma / math.sqrt(1.0 + weight))


def weighted_mean(estimates: Sequence[Uncertain]) -> Uncertain:
    """Return the mean weighted by 1 / sigma^2, its sigma scaled by the scatter (Birge ratio)."""
    weights = [item.sigma ** -2 for item in estimates]
    value = sum(w * item.value for w, item in zip(weights, estimates)) / sum(weights)
    squares = sum(w * (item.value - value) ** 2 for w, item in zip(weights, estimates))
    birge = math.sqrt(max(1.0, squares / max(len(estimates) - 1, 1)))
    return Uncertain(value, birge / math.sqrt(sum(weights)))


def log_normal(mean: float, sigma: float) -> Uncertain:
    """
    Return the mean of a log-normal quantity, from ``mean`` and ``sigma`` of its logarithm.

    Its standard deviation is half the way to the upper limit of 95 %: most are close, some far.

    >>> print('{:.3f} +- {:.3f}'.format(*log_normal(math.log(0.02), 1.0)))
    0.033 +- 0.057
    """
    value = math.exp(mean + 0.5 * sigma ** 2)
    return Uncertain(value, 0.5 * (math.exp(mean + 2.0 * sigma) - value))
