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

"""Standstill detection from wheels and IMU together."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import dataclass
import math

from smart_tire.estimation.slip.state import ImuReading

QUIET_TIME = 0.4        # s for which the IMU must have been quiet
BIAS_WINDOW = 1.0       # s over which the yaw rate must be constant to count as the gyro bias
MIN_SAMPLES = 4         # in the quiet time
QUIET_NOISE_RATIO = 3.0  # a standard deviation below this multiple of the IMU's noise is quiet
BIAS_TREND_SIGMAS = 2.5  # between the means of two halves of a constant yaw rate
UNWINDING_SHARE = 0.1   # of the last yaw rate, right after the wheels have stopped ...
UNWINDING_TIME = 1.5    # s, ... and its decay time; simulated tires with linear springs
MAX_STATIONARY_WHEEL_SPEED = 0.01  # m/s; one encoder count gives less


@dataclass(frozen=True, slots=True)
class StationaryInterval:
    """The present standstill, up to now."""

    rate: float             # rad/s, mean of the measured rate about z
    sigma: float            # rad/s, of that mean, due to noise
    unwinding_sigma: float  # rad/s, of a residual yaw motion, correlated over about a second
    duration: float         # s
    rate_settled: bool      # the yaw rate is constant, so that it is the gyro bias


class ZeroVelocityDetector:
    """
    Detects standstill: stationary wheels and a quiet IMU for some time.

    A robot pushed at constant speed with locked wheels satisfies both; the caller must also check
    that the estimated speed is small, or that standstill has lasted.
    """

    def __init__(self, gyro_noise: float, accel_noise: float) -> None:
        self._noise = gyro_noise
        self._limits = (QUIET_NOISE_RATIO * gyro_noise, *(QUIET_NOISE_RATIO * accel_noise,) * 2)
        self._window: deque[tuple[float, ImuReading]] = deque()
        self._rates: deque[float] = deque()  # rad/s, those of the window
        self._quiet_since: float | None = None
        self._last_turn: tuple[float, float] | None = None  # time [s] and yaw rate [rad/s]

    def update(self, time: float, reading: ImuReading) -> None:
        """Add an IMU reading at ``time`` [s]."""
        window = self._window
        window.append((time, reading))
        self._rates.append(reading.yaw_rate)
        while window[0][0] < time - BIAS_WINDOW:
            window.popleft()
            self._rates.popleft()

    def detect(self, time: float, wheel_speed: float) -> StationaryInterval | None:
        """
        Return the standstill that lasts at ``time`` [s], None if the robot moves.

        To be called at each wheel sample; ``wheel_speed`` [m/s] is that of the fastest wheel.
        """
        rolling = wheel_speed >= MAX_STATIONARY_WHEEL_SPEED
        if rolling or not self._is_quiet():
            self._quiet_since = None
            if rolling and self._window:
                self._last_turn = time, self._peak_yaw_rate()
            return None
        if self._quiet_since is None:
            self._quiet_since = time
        duration = time - self._quiet_since
        rates = list(self._rates)
        half = len(rates) // 2
        trend = abs(_mean(rates[half:]) - _mean(rates[:half]))
        settled = duration >= BIAS_WINDOW - QUIET_TIME and (
            trend < BIAS_TREND_SIGMAS * 2.0 * self._noise / math.sqrt(len(rates)))
        return StationaryInterval(_mean(rates), self._noise / math.sqrt(len(rates)),
                                  self._unwinding_sigma(time), duration, settled)

    def _peak_yaw_rate(self) -> float:
        """Return the decaying maximum of the yaw rate [rad/s]: the twist of the tires."""
        latest = abs(_mean(self._rates))
        if self._last_turn is None:
            return latest
        time, rate = self._last_turn
        return max(latest, rate * math.exp((time - self._window[-1][0]) / BIAS_WINDOW))

    def _unwinding_sigma(self, time: float) -> float:
        """
        Return the standard deviation [rad/s] of the yaw rate that remains after a stop.

        Tires that were twisted in a turn unwind after the wheels have stopped: the IMU is quiet
        and the yaw rate small, but not zero.
        """
        if self._last_turn is None:
            return 0.0
        since, rate = self._last_turn
        return UNWINDING_SHARE * rate * math.exp((since - time) / UNWINDING_TIME)

    def _is_quiet(self) -> bool:
        newest = self._window[-1][0] if self._window else 0.0
        recent = [reading for time, reading in self._window if time >= newest - QUIET_TIME]
        if len(recent) < MIN_SAMPLES or newest - self._window[0][0] < 0.75 * QUIET_TIME:
            return False
        return all(_standard_deviation(column) < limit
                   for column, limit in zip(zip(*recent), self._limits))


def _mean(values: Collection[float]) -> float:
    return sum(values) / len(values)


def _standard_deviation(values: Sequence[float]) -> float:
    mean = _mean(values)
    return math.sqrt(sum((value - mean) ** 2 for value in values) / len(values))
