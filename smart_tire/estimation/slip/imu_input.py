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
import math

from smart_tire.estimation.plausibility import is_imu_spike
from smart_tire.estimation.slip.state import ImuReading, ImuStep
from smart_tire.parameters import RobotParams
from smart_tire.rotation import matrix
from smart_tire.samples import ImuSample

INITIAL_PERIOD = 0.01     # s, between samples
PERIOD_GAIN = 0.02        # weight of a new sample in the smoothed period; assumed
VIBRATION_TIME = 1.0      # s, time constant of mean and variance of the vertical force; assumed
TURN_TIME = 0.2           # s, in which tires build up the slip of a turn: some 10 cm of travel
DRIVE_JERK = 1.0          # m/s2 per sqrt(s), random walk of a robot's acceleration; assumed
YAW_ACCEL_TIME = 0.03     # s, time constant of the yaw acceleration: three samples at 100 Hz


class ImuInput:
    """
    Rotates IMU samples into base axes, replaces spikes and integrates them over steps.

    ``vibration`` is the standard deviation of the vertical force beyond the IMU's noise: planar
    motion does not excite it, while rough ground vibrates all axes alike.
    """

    def __init__(self, robot: RobotParams) -> None:
        self._imu = robot.imu
        self._rotation: list[list[float]] = matrix(*robot.imu.rotation).tolist()
        self._last_was_spike = False
        self._vertical: list[float] | None = None  # mean [m/s2] and variance of the force
        self.time: float | None = None          # s, of the last sample
        self.reading: ImuReading | None = None  # last one, or its substitute in a dropout
        self.period = INITIAL_PERIOD            # s, smoothed
        self.yaw_accel = 0.0                    # rad/s2, smoothed
        self.turn_rate = 0.0                    # rad/s, yaw rate smoothed over ``TURN_TIME``
        self._begin_rate = 0.0                  # rad/s, that at the begin of the step
        self.force: tuple[float, float] | None = None  # m/s2, without vibration
        self.spikes = 0                         # samples rejected as spikes
        self.vibration = 0.0                    # m/s2

    def add(self, time: float, sample: ImuSample) -> ImuReading | None:
        """Add a sample of ``time`` [s]; return its reading, None if it is not newer."""
        if self.time is not None and time <= self.time:
            return None
        reading = self._without_spike(self._in_base_axes(sample))
        dt = self.period if self.time is None else min(time - self.time, 1.0)
        self._measure_vibration(sample.acceleration[2], dt)
        if self.time is not None and self.reading is not None:
            self.period += PERIOD_GAIN * (dt - self.period)
            self.yaw_accel += dt / (dt + YAW_ACCEL_TIME) * (
                (reading.yaw_rate - self.reading.yaw_rate) / dt - self.yaw_accel)
        self.turn_rate += dt / (dt + TURN_TIME) * (reading.yaw_rate - self.turn_rate)
        self.time, self.reading = time, reading
        return reading

    def step(self, begin: float, readings: Sequence[tuple[float, ImuReading]],
             density: float = 0.0) -> ImuStep:
        """
        Return the mean over linearly interpolated ``readings`` with their times [s].

        The first one is the last of the previous step, which ended at ``begin`` [s]. ``density``
        [(m/s2)^2 s] is the least one of the noise of the forces.
        """
        begin_rate, self._begin_rate = self._begin_rate, self.turn_rate
        rate = x = y = shape = 0.0
        for (_, (old_rate, old_x, old_y)), (time, (new_rate, new_x, new_y)) in zip(
                readings, readings[1:]):
            dt = time - begin
            begin = time
            rate += 0.5 * dt * (old_rate + new_rate)
            x += 0.5 * dt * (old_x + new_x)
            y += 0.5 * dt * (old_y + new_y)
            # variance if the force changed stepwise at an unknown time between the samples
            shape += dt * dt / 12.0 * max((new_x - old_x) ** 2, (new_y - old_y) ** 2)
        duration = readings[-1][0] - readings[0][0]
        period = duration / (len(readings) - 1)
        own = self.force_variance * period
        mean = ImuReading(rate / duration, *self._without_vibration(
            x / duration, y / duration, duration, own))
        return ImuStep(
            duration, mean, self._imu.gyro_noise ** 2 * period,
            max(density, own) + shape / duration, begin_rate, self.turn_rate)

    def _without_vibration(self, force_x: float, force_y: float, dt: float, density: float
                           ) -> tuple[float, float]:
        """
        Return the force of the motion: the steady Kalman filter of a random walk in white noise.

        Vibration and pitching that are integrated between wheel samples would be taken for motion.
        """
        time = math.sqrt(density) / DRIVE_JERK
        gain = -math.expm1(-dt / time) if time > 0.0 else 1.0
        x, y = self.force or (force_x, force_y)
        self.force = x + gain * (force_x - x), y + gain * (force_y - y)
        return self.force

    @property
    def force_variance(self) -> float:
        """Return the variance [(m/s2)^2] of a horizontal force: noise and vibration."""
        return self._imu.accel_noise ** 2 + self.vibration ** 2

    def _measure_vibration(self, force: float, dt: float) -> None:
        if self._vertical is None:
            self._vertical = [force, 0.0]
        mean, variance = self._vertical
        gain = 1.0 - math.exp(-dt / VIBRATION_TIME)
        self._vertical = [mean + gain * (force - mean),
                          variance + gain * ((force - mean) ** 2 - variance)]
        self.vibration = math.sqrt(max(
            self._vertical[1] - 2.0 * self._imu.accel_noise ** 2, 0.0))

    def _in_base_axes(self, sample: ImuSample) -> ImuReading:
        x, y, z = self._rotation
        return ImuReading(_dot(z, sample.rate), _dot(x, sample.acceleration),
                          _dot(y, sample.acceleration))

    def _without_spike(self, reading: ImuReading) -> ImuReading:
        """Return ``reading``, or the previous one if this is a single spike, not an impact."""
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
