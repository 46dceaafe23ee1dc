"""
How a smoothed course errs within a stretch of time, as a sum of polynomials.

What is left after least-jerk smoothing is noise below the smoothing's cut-off: slow, so that in a
passage a shift, a change of scale and a few more polynomials hold all of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
import math

import numpy as np
from scipy.special import spherical_jn

from smart_tire.arrays import Array


ORDERS = np.arange(2, 14)  # of the Legendre polynomials; 0 is a shift, 1 a scale
LEAST = 1e-5               # m, below which a polynomial does not matter: 1 mV at the steepest
BANDS = np.geomspace(0.3, 60.0, 50)  # cut-off times duration, of the table
PHASES = np.linspace(0.0, 240.0, 12001)  # frequency times duration, over which it integrates


@dataclass(frozen=True, slots=True)
class TrajectoryErrors:
    """
    One sigma of what is uncertain in the distances of a passage.

    ``warps`` [m] belong to Legendre polynomials of order 2, 3, ... over the stretch of distance
    that was sampled.
    """

    scale: float = 0.0  # -, relative, of the scale
    warps: tuple[float, ...] = ()


def warps(density: float, cutoff: float, duration: float) -> tuple[float, ...]:
    """
    Return one sigma [m] of each Legendre polynomial, from order 2 up to the last that matters.

    The error has the density ``density / (1 + (w / cutoff)^6)`` [m^2 s] over frequencies w
    [rad/s], two-sided; ``duration`` [s] is that of the stretch.
    """
    band = min(max(cutoff * duration, BANDS[0]), BANDS[-1])
    at = np.interp(math.log(band), np.log(BANDS), np.arange(len(BANDS)))
    below = min(int(at), len(BANDS) - 2)
    table = _table()
    logs = table[below] + (at - below) * (table[below + 1] - table[below])
    sigmas = np.sqrt(density / duration) * np.exp(0.5 * logs)
    count = int(np.count_nonzero(np.maximum.accumulate(sigmas[::-1])[::-1] > LEAST))
    return tuple(sigmas[:count].tolist())


@cache
def _table() -> Array:
    """Return the logarithm of duration * variance / density, (bands, orders)."""
    # a component e^(iwt) over a stretch T has the part (2k + 1) j_k(w T / 2) of polynomial k
    parts = np.array([(2 * k + 1)**2 * spherical_jn(k, 0.5 * PHASES)**2 for k in ORDERS])
    passed = 1.0 / (1.0 + (PHASES / BANDS[:, np.newaxis])**6)
    found: Array = np.log(passed @ parts.T * (PHASES[1] / math.pi))
    return found
