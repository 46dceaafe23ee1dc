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

"""IMU samples to mean planar measurements over a prediction step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

from smart_tire.estimation.plausibility import is_imu_spike
from smart_tire.estimation.slip.slope_monitor import SlopeMonitor
from smart_tire.estimation.slip.state import ImuReading, ImuStep
from smart_tire.estimation.slip.tilt_rates import TiltExcursion, TiltRates
from smart_tire.estimation.slip.vibration import VibrationMonitor
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.rotation import matrix
from smart_tire.samples import ImuSample

SLOPE_VIBRATION_SHARE = 0.25  # share of the vibration that is pitch and roll; assumed
INITIAL_PERIOD = 0.01        # s, between samples
PERIOD_GAIN = 0.02           # weight of a new sample in the smoothed period


class TrapezoidalMean:
    """Time integral of linearly interpolated IMU readings."""

    def __init__(self, begin: float) -> None:
        self._begin, self._end = begin, begin
        self._sums = [0.0] * len(ImuReading._fields)
        self._count = 0
        self._step_variance = 0.0  # (m/s)^2, of speed, due to the shape between samples

    def add(self, time: float, last: ImuReading, reading: ImuReading) -> None:
        """Add the interval up to ``time`` [s]; nothing if that is before the last one's end."""
        dt = time - self._end
        if dt <= 0.0:
            return
        self._sums = [total + 0.5 * dt * (old + new)
                      for total, old, new in zip(self._sums, last, reading)]
        # variance if it changed stepwise at an unknown time between the samples
        self._step_variance += dt ** 2 / 12.0 * max(
            (reading.force_x - last.force_x) ** 2, (reading.force_y - last.force_y) ** 2)
        self._end, self._count = time, self._count + 1

    @property
    def end(self) -> float:
        """Return the end [s] of the integral."""
        return self._end

    @property
    def duration(self) -> float:
        """Return the length [s] of the integral."""
        return self._end - self._begin

    def step(self, gyro_noise: float, accel_noise: float, slope_sigma: float) -> ImuStep | None:
        """Return the mean, with noise densities for standard deviations of a sample."""
        if not self._count:
            return None
        dt = self.duration
        period = dt / self._count  # white noise per sample becomes noise density
        return ImuStep(
            ImuReading(*(total / dt for total in self._sums)), gyro_noise ** 2 * period,
            accel_noise ** 2 * period + self._step_variance / dt, slope_sigma)


class ImuPreprocessor:
    """Rotates IMU samples into base axes, replaces spikes and monitors vibration."""

    def __init__(self, params: SlipEstimatorParams) -> None:
        self._imu = params.robot.imu
        self.tilt_rates = TiltRates(self._imu)
        self._excursion = TiltExcursion()
        self.slope = SlopeMonitor(params.robot, params.slope_sigma)
        self._rotation: list[list[float]] = matrix(*self._imu.rotation).tolist()
        self._vibration = VibrationMonitor(self._imu.accel_noise)
        self._last_was_spike = False
        self.time: float | None = None         # s, of the last sample
        self.reading: ImuReading | None = None  # last sample, or its substitute in a dropout
        self.period = INITIAL_PERIOD           # s, smoothed
        self.spikes = 0                        # samples rejected as spikes

    @property
    def vibration(self) -> float:
        """Return the standard deviation [m/s2] of the vibration."""
        return self._vibration.sigma

    @property
    def slope_sigma(self) -> float:
        """Return the standard deviation [rad] of slope and body motion on it."""
        return math.hypot(self.slope.sigma, SLOPE_VIBRATION_SHARE * self.vibration / GRAVITY)

    def add(self, time: float, sample: ImuSample) -> ImuReading | None:
        """Add a sample of ``time`` [s]; return its reading, None if it is not newer."""
        if self.time is not None and time <= self.time:
            return None
        reading = self._without_spike(self._in_base_axes(sample))
        self._vibration.update(time, sample.acceleration[2])
        if self.time is not None:
            self.period += PERIOD_GAIN * (min(time - self.time, 1.0) - self.period)
            if self.reading is not None:
                self.tilt_rates.add(time - self.time, self.reading, reading)
        self.time, self.reading = time, reading
        return reading

    def step(self, mean: TrapezoidalMean) -> ImuStep | None:
        """Return the mean with its noise, None if it is of no interval."""
        step = mean.step(self._imu.gyro_noise, math.hypot(self._imu.accel_noise, self.vibration),
                         self.slope_sigma)
        if step is None:
            return None
        reading = self.tilt_rates.without_bias(step.mean)
        density = self.tilt_rates.density(reading.yaw_rate, self.period)
        excursion = self._excursion.update(mean.duration, reading, density)
        return replace(
            step, mean=reading, tilt_variance=density, tilt_gain=self.slope.tilt_gain,
            slope_sigma=math.hypot(step.slope_sigma,
                                   self.slope.tilt_gain * math.sqrt(excursion)))

    def _in_base_axes(self, sample: ImuSample) -> ImuReading:
        x, y, z = self._rotation
        return ImuReading(_dot(z, sample.rate), _dot(x, sample.acceleration),
                          _dot(y, sample.acceleration), _dot(x, sample.rate),
                          _dot(y, sample.rate))

    def _without_spike(self, reading: ImuReading) -> ImuReading:
        """
        Return ``reading``, or the previous one if this is a single spike.

        A real impact lasts longer: a second such reading in a row is accepted.
        """
        last = self.reading
        spike = last is not None and not self._last_was_spike and is_imu_spike(
            reading.yaw_rate - last.yaw_rate, reading.force_x - last.force_x,
            reading.force_y - last.force_y, self.vibration)
        self._last_was_spike = spike
        if last is None or not spike:
            return reading
        self.spikes += 1
        return last


def _dot(row: Sequence[float], vector: Sequence[float]) -> float:
    return row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2]
