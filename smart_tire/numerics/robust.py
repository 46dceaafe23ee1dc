# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Robust statistics: standard deviations from medians, weights of M-estimators."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.uncertain import Uncertain

MAD_TO_SIGMA = 1.4826  # standard deviation over median absolute deviation, normal distribution


def mad_sigma(residuals: ArrayLike) -> float:
    """
    Return the standard deviation of zero-mean ``residuals`` (n,), n > 0, from their median.

    It is 1.4826 times the median absolute residual (MAD), insensitive to up to half outliers.

    >>> mad_sigma([-1.0, 1.0, -1.0, 1.0, 1e6])
    1.4826
    """
    return MAD_TO_SIGMA * float(np.median(np.abs(residuals)))


def noise_level(signal: Array, order: int = 3) -> float:
    """
    Return the standard deviation of white noise on a smooth ``signal`` (n,), 0 if n <= order.

    It comes from differences of this ``order``, to which the signal itself contributes little: an
    upper bound. White noise increases by the root of binomial(2 order, order) in them.

    >>> noise_level(np.array([0.0, 1.0, 4.0, 9.0, 16.0]))  # third differences of a parabola
    0.0
    """
    if len(signal) <= order:
        return 0.0
    differences = np.diff(signal, order)
    return mad_sigma(differences) / math.sqrt(math.comb(2 * order, order))


def measurement_noise(residuals: Array, model_sigma: Array) -> float:
    """
    Return the standard deviation of the noise in ``residuals`` (n,) without model errors.

    ``model_sigma`` (n,) is the standard deviation of the model error of each row; the estimate
    uses the half of the rows in which it is smallest. At least 1e-9.

    >>> measurement_noise(np.array([1.0, -1.0, 5.0, 9.0]), np.array([0.0, 0.0, 4.0, 8.0]))
    1.4826
    """
    reliable = residuals[model_sigma <= np.median(model_sigma)]
    return max(mad_sigma(reliable), 1e-9)


def huber_weights(residuals: Array, threshold: float) -> Array:
    """
    Return Huber's weights min(1, threshold / |r|) of normalized ``residuals`` (n,).

    ``threshold`` > 0 has the unit of the residuals: one for residuals in standard deviations.

    >>> huber_weights(np.array([0.0, -1.0, 4.0]), 2.0)
    array([1. , 1. , 0.5])
    """
    weights: Array = threshold / np.maximum(np.abs(residuals), threshold)
    return weights


def winsorized_mean(values: Sequence[float], limit: float) -> Uncertain:
    """
    Return the mean of ``values`` with its standard error, robust against outliers.

    Values further than ``limit`` standard deviations (``mad_sigma``) from the median are moved to
    that limit. The standard error of a single value is infinite.

    >>> winsorized_mean([1.0, 2.0, 3.0, 1000.0], 3.0).value
    3.23695
    """
    median = float(np.median(values))
    bound = limit * mad_sigma(np.asarray(values) - median)
    clipped = np.clip(values, median - bound, median + bound)
    sigma = float(np.std(clipped, ddof=1)) / math.sqrt(len(clipped)) if len(clipped) > 1 else (
        math.inf)
    return Uncertain(float(np.mean(clipped)), sigma)
