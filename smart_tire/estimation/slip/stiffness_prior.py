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
Prior of C_x: that of the calibrated ground, unless the forces contradict it.

The filter estimates ln C_x with the wide prior of any ground. For the output, its Gaussian is
combined with the probability that the robot is on the calibrated ground, where C_x is known to
``tire.longitudinal_stiffness_sigma``: a mixture, of which mean and variance are reported. All
states follow by their correlation with ln C_x; the filter itself does not use the prior, which
would count it again and again.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.slip.state import State
from smart_tire.parameters import SlipEstimatorParams

CALIBRATED_PROBABILITY = 0.7  # -, that the robot is on the calibrated ground; assumed


class StiffnessPrior:
    """Combines states of the filter with the prior of the calibrated ground."""

    def __init__(self, params: SlipEstimatorParams) -> None:
        calibrated = max(params.robot.tire.longitudinal_stiffness_sigma, 1e-3)
        self._wide = params.ground_stiffness_sigma
        # variance of the ratio of both priors; none if the calibrated one is not narrower
        precision = calibrated ** -2 - self._wide ** -2
        self._variance = 1.0 / precision if precision > 0.0 else math.inf
        self._odds = (CALIBRATED_PROBABILITY / (1.0 - CALIBRATED_PROBABILITY)
                      * self._wide / calibrated)

    def condition(self, x: Sequence[float], P: Array) -> tuple[list[float], Array]:
        """Return state (N,) and covariance (N, N) with the prior."""
        if math.isinf(self._variance):
            return list(x), P
        mean, variance = x[State.LN_STIFFNESS], float(P[State.LN_STIFFNESS, State.LN_STIFFNESS])
        total = self._variance + variance
        odds = self._odds * math.sqrt(self._variance / total) * math.exp(-0.5 * mean ** 2 / total)
        share = odds / (1.0 + odds)
        near, near_variance = mean * self._variance / total, variance * self._variance / total
        new = share * near + (1.0 - share) * mean
        new_variance = (share * (near_variance + (near - new) ** 2)
                        + (1.0 - share) * (variance + (mean - new) ** 2))
        gain = P[:, State.LN_STIFFNESS] / variance
        return ((np.asarray(x) + gain * (new - mean)).tolist(),
                P + (new_variance - variance) * np.outer(gain, gain))
