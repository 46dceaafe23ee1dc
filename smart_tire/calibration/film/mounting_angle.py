"""
Where the films sit on the wheel, as an angle against the zero of ``wheel_states.position``.

The angle of a film is the wheel's position [rad], modulo a turn, at which the middle of the film
is at the middle of the patch; positions grow rolling forward, so film 2 has the larger angle. If
stamps of films and wheels are late against each other, it is off by that times the wheel's speed:
passages at several speeds, or forward and backward, tell both.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.errors import EstimatorError
from smart_tire.numerics.robust import MAD_TO_SIGMA
from smart_tire.uncertain import Uncertain


FEWEST = 3             # passages
LATENESS_SIGMA = 0.003  # s, of what is known of the latencies between films and wheels; assumed
LARGEST_SCATTER = 0.1  # rad, 9 mm of the paper's wheel: more than any fit is off
LEAST_SCATTER = 1e-3   # rad, below which passages do not scatter; a tenth of a millimetre
OUTLIER = 3.0          # scatters, beyond which a passage does not count


def film_angle(angles: Sequence[float], speeds: Sequence[float]) -> Uncertain:
    """
    Return the angle [rad], 0 to 2 pi, of which ``angles`` are readings at ``speeds`` [rad/s].

    Raises EstimatorError with the reason where they do not tell it.
    """
    if len(angles) < FEWEST:
        raise EstimatorError(f'{len(angles)} passages, expected at least {FEWEST}')
    if not all(map(math.isfinite, angles)):
        raise EstimatorError('wheel_states without positions')
    first = _commonest(np.asarray(angles))
    off = np.angle(np.exp(1j * (np.asarray(angles) - first)))
    middle = float(np.median(off))
    scatter = max(MAD_TO_SIGMA * float(np.median(np.abs(off - middle))), LEAST_SCATTER)
    if scatter > LARGEST_SCATTER:
        raise EstimatorError(f'passages at angles that scatter by {scatter:.2f} rad: positions '
                             'of wheel_states begin anew within the recording')
    near = np.abs(off - middle) < OUTLIER * scatter
    slopes = np.stack([np.ones(int(near.sum())), np.asarray(speeds)[near]])
    normal = slopes @ slopes.T / scatter ** 2 + np.diag([0.0, LATENESS_SIGMA ** -2])
    covariance = np.linalg.inv(normal)
    angle = float((covariance @ (slopes @ off[near]))[0]) / scatter ** 2
    return Uncertain((first + angle) % math.tau, math.sqrt(float(covariance[0, 0])))


def _commonest(angles: Array) -> float:
    """Return the one of ``angles`` to which all are nearest."""
    apart = np.abs(np.angle(np.exp(1j * (angles[:, np.newaxis] - angles))))
    return float(angles[int(np.argmin(apart.sum(axis=1)))])
