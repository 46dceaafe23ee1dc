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
Mounting angles of the films, against the zero of ``wheel_states.position``.

The angle of a film is the wheel position [rad], modulo one revolution, at which the center of the
film is at the center of the patch. Positions increase when rolling forward, so film 2 has the
larger angle. A latency between films and wheels shifts the angle by its product with the wheel
speed; crossings at several speeds, or in both directions, make both observable.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.results import SIGNIFICANT_SIGMAS
from smart_tire.errors import EstimatorError
from smart_tire.numerics.robust import mad_sigma
from smart_tire.uncertain import Uncertain

MIN_CROSSINGS = 3
LATENCY_SIGMA = 0.003  # s, of the configured latency between films and wheels; assumed
MAX_SCATTER = 0.1      # rad, 9 mm of the paper's wheel: more than the error of any fit
MIN_SCATTER = 1e-3     # rad, lower limit of the scatter: a tenth of a millimeter


def film_angle(angles: Sequence[float], speeds: Sequence[float]) -> Uncertain:
    """
    Return the angle [rad], 0 to 2 pi, from readings ``angles`` at ``speeds`` [rad/s].

    Raises EstimatorError with the reason if it is not observable.
    """
    if len(angles) < MIN_CROSSINGS:
        raise EstimatorError(f'{len(angles)} crossings, expected at least {MIN_CROSSINGS}')
    if not all(map(math.isfinite, angles)):
        raise EstimatorError('wheel_states without positions')
    first = _medoid(np.asarray(angles))
    deviations = np.angle(np.exp(1j * (np.asarray(angles) - first)))
    median = float(np.median(deviations))
    scatter = max(mad_sigma(deviations - median), MIN_SCATTER)
    if scatter > MAX_SCATTER:
        raise EstimatorError(f'angles of crossings scatter by {scatter:.2f} rad: wheel_states '
                             'positions restart within the recording')
    inliers = np.abs(deviations - median) < SIGNIFICANT_SIGMAS * scatter
    design = np.stack([np.ones(int(inliers.sum())), np.asarray(speeds)[inliers]])
    normal = design @ design.T / scatter ** 2 + np.diag([0.0, LATENCY_SIGMA ** -2])
    covariance = np.linalg.inv(normal)
    angle = float((covariance @ (design @ deviations[inliers]))[0]) / scatter ** 2
    return Uncertain((first + angle) % math.tau, math.sqrt(float(covariance[0, 0])))


def _medoid(angles: Array) -> float:
    """Return the element of ``angles`` with the least sum of distances to the others."""
    distance = np.abs(np.angle(np.exp(1j * (angles[:, np.newaxis] - angles))))
    return float(angles[int(np.argmin(distance.sum(axis=1)))])
