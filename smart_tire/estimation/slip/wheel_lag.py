# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Delay of the wheels behind the gyroscope, from the turns that both measure."""

from __future__ import annotations

from collections import deque

import numpy as np

from smart_tire.estimation.slip.state import (
    LAG_SIGMA, LAG_WINDOW, MAX_LAG_RATE, MIN_LAG, SLIP_CORRELATION_TIME, SLIP_LEARNING_TIME)

LAGS = 0.2 * LAG_SIGMA * np.arange(16)  # s, that are compared: up to three sigmas
MAX_LAG = float(LAGS.max())


class WheelLag:
    """
    Most probable delay ``value`` [s] of the wheels, beyond the known one.

    Over windows of ``LAG_WINDOW`` the difference of the side speeds is a linear function of the
    yaw rate at the right delay, with an error that is correlated as the slip is. ``n`` independent
    errors with the correlation coefficient r have the log likelihood -n/2 ln(1 - r^2); the prior
    is half a normal distribution. Slip that builds up looks like a delay of up to ``MIN_LAG``.
    """

    def __init__(self) -> None:
        self.value = 0.0
        self._angles: deque[tuple[float, float]] = deque()  # time [s] and yaw angle [rad]
        self._rate = 0.0     # rad/s, last one
        self._turned = 0.0   # m, difference of the distances of both sides in the window
        self._begin: float | None = None  # s, of the window
        self._duration = 0.0  # s, of all windows
        # means of the wheels' turns, and of the yaw rate by lag; their central second moments
        self._mean, self._means = 0.0, np.zeros(len(LAGS))
        self._own, self._mixed, self._others = 0.0, np.zeros(len(LAGS)), np.zeros(len(LAGS))

    def add_rate(self, time: float, rate: float) -> None:
        """Add a yaw rate [rad/s] of ``time`` [s]."""
        if not self._angles:
            self._angles.append((time, 0.0))
        before, angle = self._angles[-1]
        if time > before:
            self._angles.append((time, angle + 0.5 * (time - before) * (self._rate + rate)))
        self._rate = rate
        while time - self._angles[0][0] > 3.0 * MAX_LAG + LAG_WINDOW:
            self._angles.popleft()

    def add_turn(self, time: float, difference: float, dt: float, moving: bool) -> None:
        """Add the difference [m/s] of the side speeds over ``dt`` [s] before ``time`` [s]."""
        if not moving:
            self._begin = None
            return
        if self._begin is None:
            self._begin, self._turned = time - dt, 0.0
        self._turned += difference * dt
        span = time - self._begin
        if span < LAG_WINDOW:
            return
        if self._angles and self._angles[0][0] <= self._begin - MAX_LAG:
            self._compare(span, time)
        self._begin = None

    def _compare(self, span: float, end: float) -> None:
        times, angles = np.array(self._angles).T
        rates = (np.interp(end - LAGS, times, angles)
                 - np.interp(end - span - LAGS, times, angles)) / span
        self._duration += span
        gain = span / min(self._duration, SLIP_LEARNING_TIME)
        own, others = self._turned / span - self._mean, rates - self._means
        self._mean += gain * own
        self._means += gain * others
        keep = 1.0 - gain
        self._own = keep * (self._own + gain * own * own)
        self._mixed = keep * (self._mixed + gain * own * others)
        self._others = keep * (self._others + gain * others * others)
        lag = self._most_probable()
        step = (lag if lag > MIN_LAG else 0.0) - self.value
        self.value += min(max(step, -MAX_LAG_RATE * span), MAX_LAG_RATE * span)

    def _most_probable(self) -> float:
        with np.errstate(divide='ignore', invalid='ignore'):
            r = np.nan_to_num(np.maximum(self._mixed, 0.0) / np.sqrt(self._own * self._others))
        n = min(self._duration, SLIP_LEARNING_TIME) / SLIP_CORRELATION_TIME
        score = (-0.5 * n * np.log(np.maximum(1.0 - r * r, 1e-9))
                 - 0.5 * (LAGS / LAG_SIGMA) ** 2)
        i = int(np.argmax(score))
        if not 0 < i < len(LAGS) - 1:
            return float(LAGS[i])
        left, middle, right = score[i - 1:i + 2]  # the top of the parabola through three points
        shift = 0.5 * (left - right) / min(left - 2.0 * middle + right, -1e-9)
        return float(LAGS[i] + shift * LAGS[1])
