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

"""Coefficient of a linear slip model, estimated recursively."""

from __future__ import annotations

from dataclasses import dataclass
import math

GATE = 5.0         # -, innovations beyond this many times their spread are clipped to it
SPREAD_TIME = 1.0  # s, of the mean over squared innovations
MIN_SPREAD = 5e-3  # m/s, of innovations, lower limit: that of wheel speeds and odometry


@dataclass(frozen=True)
class Prior:
    """Value of a coefficient before any measurement, its standard deviation and range."""

    mean: float
    sigma: float
    low: float
    high: float


class SlipCoefficient:
    """
    Scalar Kalman filter of the coefficient in ``measured = value * regressor``.

    The coefficient is an Ornstein-Uhlenbeck process: its correlation decreases with e to the power
    of ``change``, the sum of changes of all that it depends on over their correlation lengths.

    The variance of the measurement is that of past innovations, which contains the noise of the
    estimates as well as what the linear model leaves out.
    """

    def __init__(self, prior: Prior, spread: float) -> None:
        self._prior, self._first_spread = prior, spread
        self.reset()

    def reset(self) -> None:
        """Return to the prior, and to the first ``spread`` [m/s] of the innovations."""
        self.value, self._variance = self._prior.mean, self._prior.sigma ** 2
        self._spread2 = self._first_spread ** 2

    def after(self, change: float) -> float:
        """Return the value that is expected after a ``change`` since the last update."""
        return self._prior.mean + math.exp(-change) * (self.value - self._prior.mean)

    def update(self, regressor: float, measured: float, sigma: float, change: float,
               duration: float) -> None:
        """
        Advance by ``change`` within ``duration`` [s], and correct with a measurement [m/s].

        Innovations beyond ``GATE`` times their spread are clipped; so one outlier changes little,
        while another ground widens the spread and is learned.
        """
        prior, kept = self._prior, math.exp(-2.0 * change)
        self.value = self.after(change)
        self._variance = kept * self._variance + (1.0 - kept) * prior.sigma ** 2
        if not math.isfinite(regressor * regressor + measured):
            return
        limit = GATE * max(math.sqrt(self._spread2), MIN_SPREAD)
        innovation = min(max(measured - self.value * regressor, -limit), limit)
        noise = max(self._spread2, sigma * sigma, MIN_SPREAD * MIN_SPREAD)
        gain = self._variance * regressor / (self._variance * regressor * regressor + noise)
        self.value = min(max(self.value + gain * innovation, prior.low), prior.high)
        self._variance *= 1.0 - gain * regressor
        share = min(duration / SPREAD_TIME, 1.0)
        self._spread2 += share * (innovation * innovation - self._spread2)
