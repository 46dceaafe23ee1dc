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
Error model of a smoothed trajectory within an interval, as a sum of Legendre polynomials.

The error of minimum-jerk smoothing is noise below the cut-off frequency of the smoothing. It is
slow, so within a crossing a shift, a scale error and a few more polynomials represent it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
import math

import numpy as np
from scipy.special import spherical_jn

from smart_tire.arrays import Array

ORDERS = np.arange(2, 14)    # of the Legendre polynomials; 0 is a shift, 1 a scale error
MIN_SHAPE_SIGMA = 1e-5       # m, below which a polynomial is negligible: 1 mV at the steepest edge
BANDWIDTHS = np.geomspace(0.3, 60.0, 50)  # cut-off frequency times duration, of the table
PHASES = np.linspace(0.0, 240.0, 12001)  # frequency times duration, integration variable


@dataclass(frozen=True, slots=True)
class TrajectoryErrors:
    """
    Standard deviations of the errors of the distances in a crossing.

    ``shape_sigmas`` [m] belong to Legendre polynomials of order 2, 3, ... over the sampled
    distance.
    """

    scale_sigma: float = 0.0  # -, relative, of the scale
    shape_sigmas: tuple[float, ...] = ()


def shape_error_sigmas(density: float, cutoff: float, duration: float) -> tuple[float, ...]:
    """
    Return the standard deviation [m] of each Legendre polynomial from order 2 to the last needed.

    The error has the two-sided density ``density / (1 + (w / cutoff)^6)`` [m^2 s] over angular
    frequency w [rad/s]; ``duration`` [s] is that of the interval.
    """
    bandwidth = min(max(cutoff * duration, BANDWIDTHS[0]), BANDWIDTHS[-1])
    at = np.interp(math.log(bandwidth), np.log(BANDWIDTHS), np.arange(len(BANDWIDTHS)))
    below = min(int(at), len(BANDWIDTHS) - 2)
    table = _log_variances()
    logs = table[below] + (at - below) * (table[below + 1] - table[below])
    sigmas = np.sqrt(density / duration) * np.exp(0.5 * logs)
    count = int(np.count_nonzero(
        np.maximum.accumulate(sigmas[::-1])[::-1] > MIN_SHAPE_SIGMA))
    return tuple(sigmas[:count].tolist())


@cache
def _log_variances() -> Array:
    """Return the logarithm of duration * variance / density, (bandwidths, orders)."""
    # e^(iwt) over an interval T has the coefficient (2k + 1) j_k(w T / 2) of polynomial k
    gains = np.array([(2 * k + 1)**2 * spherical_jn(k, 0.5 * PHASES)**2 for k in ORDERS])
    response = 1.0 / (1.0 + (PHASES / BANDWIDTHS[:, np.newaxis])**6)
    found: Array = np.log(response @ gains.T * (PHASES[1] / math.pi))
    return found
