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

"""The gyroscope's horizontal axes: their errors, and whether they show the changes of slope."""

from __future__ import annotations

import math

from smart_tire.estimation.slip.slope_spread import SlopeResidual
from smart_tire.estimation.slip.state import ImuReading
from smart_tire.parameters.robot import ImuParams

TILT_BIAS_RANDOM_WALK = 2e-5  # rad/s per sqrt(s)
MOUNTING_ERROR_SIGMA = 0.009  # rad, share of the yaw rate that a horizontal axis measures
ERROR_CORRELATION_TIME = 2.0  # s, of bias and mounting error, over which a slope is estimated
EXCURSION_TIME = 1.0          # s, time constant of the high-pass of roll and pitch
EXCURSION_SIGMAS = 4.0        # standard deviations of an angle; below it is noise
NOISE_WINDOW = 1.0            # s, for the variance of the noise
INITIAL_TILT_GAIN = 0.75      # before any change of slope; assumed
MAX_TILT_GAIN = 0.95
INITIAL_TILT_WEIGHT = 30.0    # of the initial gain, in squared standard deviations
MAX_CHANGE_WEIGHT = 30.0      # of one change of slope
SIGNIFICANT_CHANGE = 2.5      # standard deviations of a change of slope; below it is noise


class TiltRates:
    """
    Roll and pitch rate without their bias, which is learned at standstill.

    Their white noise is half the mean square of the change from sample to sample, so that it
    contains vibration but not the slow motion over hills.
    """

    def __init__(self, imu: ImuParams) -> None:
        self._noise = self._min_noise = imu.gyro_noise ** 2
        self._bias = [0.0, 0.0]    # rad/s, about x and y
        self._bias_variance = imu.gyro_bias ** 2
        self._sums = [0.0, 0.0]    # rad/s, since the last wheel sample
        self._count = 0

    def add(self, duration: float, last: ImuReading, reading: ImuReading) -> None:
        """Add a reading, ``duration`` [s] after the last one."""
        change = (reading.roll_rate - last.roll_rate) ** 2 + (
            reading.pitch_rate - last.pitch_rate) ** 2
        gain = 1.0 - math.exp(-duration / NOISE_WINDOW)
        self._noise += gain * (0.25 * change - self._noise)
        self._sums = [self._sums[0] + reading.roll_rate, self._sums[1] + reading.pitch_rate]
        self._count += 1

    def finish_period(self, duration: float, stationary: bool) -> None:
        """Learn the bias from the readings of the last ``duration`` [s] if stationary."""
        sums, count = self._sums, self._count
        self._sums, self._count = [0.0, 0.0], 0
        self._bias_variance += TILT_BIAS_RANDOM_WALK ** 2 * duration
        if stationary and count:
            noise = max(self._noise, self._min_noise) / count
            gain = self._bias_variance / (self._bias_variance + noise)
            self._bias = [bias + gain * (total / count - bias)
                          for bias, total in zip(self._bias, sums)]
            self._bias_variance *= 1.0 - gain

    def without_bias(self, reading: ImuReading) -> ImuReading:
        """Return ``reading`` without the biases of roll and pitch rate."""
        return reading._replace(roll_rate=reading.roll_rate - self._bias[0],
                                pitch_rate=reading.pitch_rate - self._bias[1])

    def density(self, yaw_rate: float, period: float) -> float:
        """Return the noise density [(rad/s)^2 s] of samples with ``period`` [s]."""
        lasting = self._bias_variance + (MOUNTING_ERROR_SIGMA * yaw_rate) ** 2
        return (max(self._noise, self._min_noise) * period
                + 2.0 * ERROR_CORRELATION_TIME * lasting)


class TiltExcursion:
    """
    Present departure of roll and pitch from their recent mean, by the gyroscope.

    A speed bump or a curb tilts the robot by more than the learned slope before wheels and
    accelerometer show it.
    """

    def __init__(self) -> None:
        self._angles = [0.0, 0.0]  # rad, high-pass of roll and pitch

    def update(self, duration: float, reading: ImuReading, density: float) -> float:
        """
        Add a mean ``reading`` without bias over ``duration`` [s]; return the variance [rad^2].

        ``density`` [(rad/s)^2 s] is that of the noise of its rates; smaller angles are noise.
        """
        decay = math.exp(-duration / EXCURSION_TIME)
        self._angles = [decay * (angle + duration * rate) for angle, rate in zip(
            self._angles, (reading.roll_rate, reading.pitch_rate))]
        noise = EXCURSION_SIGMAS ** 2 * 0.5 * EXCURSION_TIME * density
        return max(0.0, max(angle ** 2 for angle in self._angles) - noise)


class TiltConsistency:
    """
    Share of the changes of slope, as the accelerometer sees them, that the gyroscope shows.

    It is small for an IMU whose horizontal rates are missing or in other axes.
    """

    def __init__(self) -> None:
        self._seen = INITIAL_TILT_WEIGHT  # sum of squared changes over their variance
        self._missed = INITIAL_TILT_WEIGHT * (1.0 - INITIAL_TILT_GAIN)
        self._last: tuple[tuple[SlopeResidual | None, ...], tuple[float, ...]] | None = None

    @property
    def gain(self) -> float:
        """Return the share, 0 to ``MAX_TILT_GAIN``."""
        return min(max(0.0, 1.0 - self._missed / self._seen), MAX_TILT_GAIN)

    def restart(self) -> None:
        """Forget the last window."""
        self._last = None

    def update(self, residuals: tuple[SlopeResidual | None, ...], tilts: tuple[float, ...],
               noise: float) -> None:
        """
        Compare the changes of ``residuals`` and ``tilts`` since the last window.

        ``tilts`` [m/s2] are gravity times the mean angles by the gyroscope, with the variance
        ``noise`` of their changes.
        """
        last, self._last = self._last, (residuals, tilts)
        if last is None:
            return
        for old, new, before, after in zip(last[0], residuals, last[1], tilts):
            if old is not None and new is not None:
                self._compare(new.value - old.value, after - before,
                              old.noise + new.noise + noise)

    def _compare(self, change: float, tilt: float, variance: float) -> None:
        largest = max(change ** 2, tilt ** 2) / variance
        if largest > SIGNIFICANT_CHANGE ** 2:
            self._seen += min(largest, MAX_CHANGE_WEIGHT)
            self._missed += min((change - tilt) ** 2 / variance, MAX_CHANGE_WEIGHT)
