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

"""Signals of a recording with their means over windows around wheel samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.recording import DutyRecord, Recording, Signal
from smart_tire.numerics.robust import noise_level
from smart_tire.parameters import RobotParams

Indices = NDArray[np.intp]

DELAY_STEP = 0.01    # s, for derivatives with respect to a delay
EDGE_MARGIN = 0.006  # s around a change of the duty, in which the duty in force is uncertain


class Windows:
    """Windows around wheel samples ``center``, from sample ``center - n`` to ``center + n``."""

    def __init__(self, time: Array, center: Indices, n: int) -> None:
        self._time, self.center, self._n = time, center, n
        self.first, self.last = center - n, center + n

    def second_difference(self, integral: Array) -> Array:
        """Return the means of a signal from its double integral (m,) or (m, 4) at all samples."""
        shape = (-1,) + (1,) * (integral.ndim - 1)
        begin, center, end = (self._time[index].reshape(shape)
                              for index in (self.first, self.center, self.last))
        left = (integral[self.center] - integral[self.first]) / (center - begin)
        right = (integral[self.last] - integral[self.center]) / (end - center)
        return np.asarray(2.0 * (right - left) / (end - begin))

    def mean(self, value: Array) -> Array:
        """
        Return the means of a signal from its samples (m, p).

        The weights of the samples in a window spread less than the window itself, by a sixth of
        the square of their period: the samples are smoothed accordingly.
        """
        time, value = self._time, value.copy()
        value[1:-1] += (value[2:] - 2.0 * value[1:-1] + value[:-2]) / 12.0
        begin, center, end = time[self.first], time[self.center], time[self.last]
        total, weights = np.zeros((len(self.center), value.shape[1])), np.zeros((1, 1))
        for offset in range(1 - self._n, self._n):
            index = self.center + offset
            weight = 0.5 * (time[index + 1] - time[index - 1]) * np.minimum(
                (time[index] - begin) / (center - begin), (end - time[index]) / (end - center))
            total += weight[:, None] * value[index]
            weights = weights + weight[:, None]
        return np.asarray(total / weights)


class Force:
    """Forward specific force at the center of mass, with its integrals."""

    def __init__(self, recording: Recording, robot: RobotParams) -> None:
        imu = recording.imu
        arm_x, arm_y = (place - com for place, com in zip(
            robot.imu.position[:2], robot.center_of_mass[:2]))
        rate = imu.rate[:, 2]
        self._time, self._force = imu.time, imu.force[:, 0] + arm_x * rate ** 2
        self._speed = Signal(imu.time, self._force)
        self._distance = Signal(imu.time, self._speed.integral(imu.time) + arm_y * rate)
        self._distance_integral = Signal(imu.time, self._distance.integral(imu.time))
        self.noise = noise_level(self._force, 2)  # m/s2, of a sample

    def at(self, time: Array) -> Array:
        """Return the force [m/s2] at ``time``, without the yaw acceleration."""
        return np.asarray(np.interp(time, self._time, self._force))

    def around(self, time: Array, offset: float) -> Array:
        """Return force and half its change [m/s2] (n, 2) from before to after by ``offset``."""
        before, after = self.at(time - offset), self.at(time + offset)
        return np.column_stack([self.at(time), 0.5 * (after - before)])

    def mean(self, windows: Windows, time: Array) -> Array:
        """Return the means of the force [m/s2]."""
        return windows.second_difference(self._distance.integral(time))

    def rate(self, windows: Windows, time: Array) -> Array:
        """Return the means of its rate of change [m/s3]."""
        return (self.mean(windows, time + DELAY_STEP)
                - self.mean(windows, time - DELAY_STEP)) / (2.0 * DELAY_STEP)

    def speed(self, time: Array) -> Array:
        """Return the integral of the force [m/s]."""
        return self._speed.integral(time)

    def mean_speed(self, windows: Windows, time: Array) -> Array:
        """Return the means of ``speed`` [m/s]."""
        return windows.second_difference(self._distance_integral.integral(time))


class Duty:
    """Duty of the motors, constant between commands, with its double integral."""

    def __init__(self, duties: DutyRecord, begin: float, end: float) -> None:
        last = max(end, duties.time[-1]) + 1.0
        self._time = np.concatenate([[begin - 1.0], duties.time, [last]])
        self._duty = np.vstack([np.zeros((1, 4)), duties.duty, duties.duty[-1:]])
        length = np.diff(self._time)[:, None]
        once = np.cumsum(self._duty[:-1] * length, axis=0)
        self._once = np.vstack([np.zeros((1, 4)), once])
        twice = np.cumsum(length * (self._once[:-1] + 0.5 * self._duty[:-1] * length), axis=0)
        self._twice = np.vstack([np.zeros((1, 4)), twice])

    def _double_integral(self, time: Array) -> Array:
        index = self._index(time)
        elapsed = (time - self._time[index])[:, None]
        return np.asarray(self._twice[index] + elapsed * (
            self._once[index] + 0.5 * elapsed * self._duty[index]))

    def _index(self, time: Array) -> Indices:
        return np.clip(np.searchsorted(self._time, time, side='right') - 1, 0,
                       len(self._time) - 1)

    def mean(self, windows: Windows, time: Array) -> Array:
        """Return the means of the duty (n, 4)."""
        return windows.second_difference(self._double_integral(time))

    def rate(self, windows: Windows, time: Array) -> Array:
        """Return the means of its rate of change [1/s] (n, 4)."""
        return (self.mean(windows, time + DELAY_STEP)
                - self.mean(windows, time - DELAY_STEP)) / (2.0 * DELAY_STEP)

    def at(self, time: Array) -> Array:
        """Return the duty (n, 4) in force at ``time``; NaN close to a change."""
        before, after = (self._duty[self._index(time + margin)]
                         for margin in (-EDGE_MARGIN, EDGE_MARGIN))
        return np.where(before == after, before, np.nan)


def trapezoids(time: Array, value: Array) -> Array:
    """Return the integral of ``value`` (m, p), linear between the samples."""
    areas = 0.5 * (value[1:] + value[:-1]) * np.diff(time)[:, None]
    return np.concatenate([np.zeros((1, value.shape[1])), np.cumsum(areas, axis=0)])
