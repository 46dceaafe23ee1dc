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

"""Mean side speeds between two wheel samples."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.estimation.plausibility import is_speed_contradicted
from smart_tire.numerics.rates import mean_rates
from smart_tire.parameters import RobotParams
from smart_tire.samples import Four, WheelSample

MAX_SAMPLE_GAP = 2.0   # s; after a longer gap positions are not differenced
RESIDUAL_GAIN = 0.5    # weight of a new sample in the smoothed wheel residual
INITIAL_PERIOD = 0.05  # s, assumed for the velocities of the first sample


@dataclass(frozen=True, slots=True)
class WheelSpeeds:
    """Mean speeds over the period that ends at a wheel sample."""

    duration: float                   # s
    wheel_speeds: Four                # m/s, r w; that of the side for a wheel not measured
    side_speeds: tuple[float, float]  # m/s, left and right
    variance: float                   # (m/s)^2 of a side speed, due to quantization
    from_positions: bool              # positions were differenced, so timestamp errors matter


class WheelOdometry:
    """
    Differences positions, or takes velocities if there are no positions.

    Velocities are means over the period that ends at the stamp: after a lost message they still
    describe one period, while positions bridge the gap. The speed of a side is the mean of its
    wheels that are measured.
    """

    def __init__(self, robot: RobotParams) -> None:
        self._radius = robot.wheel_radius  # m, effective rolling radius
        self._count = 2.0 * math.pi / robot.encoder.counts_per_revolution * robot.wheel_radius
        self._encoders = robot.joints.encoders_per_side
        self._last: tuple[float, WheelSample] | None = None
        self._period: float | None = None
        self.side_speeds = (0.0, 0.0)                     # m/s, latest
        self.wheel_residual: Four = (0.0, 0.0, 0.0, 0.0)  # m/s, wheel minus mean of its side
        self.independent = False  # the sides differed once; otherwise both are only their mean
        self.position_jumps = 0

    @property
    def started(self) -> bool:
        """Return whether there has been a sample."""
        return self._last is not None

    def update(self, time: float, sample: WheelSample) -> WheelSpeeds | None:
        """Return the mean speeds up to ``time`` [s]; None if it is not newer than the last."""
        if self._last is None:
            self._last = (time, sample)
            return self._from_velocities(sample, INITIAL_PERIOD)
        before, previous = self._last
        if time <= before:
            return None
        gap, self._last = time - before, (time, sample)
        self._period = gap if self._period is None else (
            self._period + 0.1 * (min(gap, 2.0 * self._period) - self._period))
        speeds = self._position_differences(previous, sample, gap)
        if speeds is not None and gap < MAX_SAMPLE_GAP:
            return self._mean_speeds(gap, speeds, from_positions=True)
        return self._from_velocities(sample, min(gap, 1.5 * self._period))

    def _position_differences(self, previous: WheelSample, sample: WheelSample,
                              gap: float) -> Four | None:
        if previous.position is None or sample.position is None:
            return None
        rates = mean_rates(previous.position, sample.position, gap)
        if any(map(is_speed_contradicted, rates, sample.velocity)):
            self.position_jumps += 1
            return None
        return tuple(self._radius * rate for rate in rates)  # type: ignore[return-value]

    def _from_velocities(self, sample: WheelSample, duration: float) -> WheelSpeeds:
        speeds: Four = tuple(self._radius * w for w in sample.velocity)  # type: ignore[assignment]
        return self._mean_speeds(duration, speeds, from_positions=False)

    def _mean_speeds(self, duration: float, speeds: Four, from_positions: bool) -> WheelSpeeds:
        left, right = _mean(speeds[0], speeds[2]), _mean(speeds[1], speeds[3])
        speeds = tuple(side if math.isnan(speed) else speed  # type: ignore[assignment]
                       for speed, side in zip(speeds, (left, right) * 2))
        self.side_speeds = left, right
        self.independent = self.independent or left != right
        self.wheel_residual = tuple(  # type: ignore[assignment]
            old + RESIDUAL_GAIN * (speeds[i] - self.side_speeds[i % 2] - old)
            for i, old in enumerate(self.wheel_residual))
        # both ends are uniform over a count; a side is the mean of its encoders
        variance = (self._count / duration) ** 2 / (6.0 * self._encoders)
        return WheelSpeeds(duration, speeds, self.side_speeds, variance, from_positions)


def _mean(front: float, rear: float) -> float:
    """Return the mean speed of a side; NaN is a wheel that is not measured."""
    if math.isnan(front) or math.isnan(rear):
        return rear if math.isnan(front) else front
    return 0.5 * (front + rear)
