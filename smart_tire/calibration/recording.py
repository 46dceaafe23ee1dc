# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Arrays of one recording: IMU, wheel encoders and an optional pose reference."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
import math
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.estimation.plausibility import speed_spikes
from smart_tire.estimation.slip.state import MAX_SAMPLE_GAP
from smart_tire.parameters import RobotParams
from smart_tire.recording import seconds, Stream
from smart_tire.rotation import matrix
from smart_tire.samples import LEFT, RIGHT

Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]
Record = TypeVar('Record', bound='Samples')

MAX_GAP_PERIODS = 1.5     # periods; after a longer gap between velocities a message is missing
MIN_RATE = 0.1            # rad/s, of a wheel in motion, and of a body that turns
SMOOTH_TIME = 0.5         # s, in which a body settles after a change of motion, and over which
# motion is interpolated: shorter than a maneuver
MAX_TURN_SHARE = 0.1      # of the speed, half the difference of the sides on straight lines


class Samples:
    """Base of records whose arrays have the same length."""

    def where(self: Record, selected: Mask | Indices) -> Record:
        """Return the ``selected`` samples, by mask or by index."""
        values: dict[str, Any] = {
            item.name: value[selected] for item in fields(self)  # type: ignore[arg-type]
            if isinstance(value := getattr(self, item.name), np.ndarray)}
        return replace(self, **values)  # type: ignore[type-var]


@dataclass(frozen=True)
class ImuRecord(Samples):
    """IMU samples, rotated into the axes of ``base_link``; times [s] increase."""

    time: Array   # (n,) s
    rate: Array   # (n, 3) rad/s
    force: Array  # (n, 3) m/s2, specific force

    @classmethod
    def of(cls, imu: Stream, origin_ns: int, robot: RobotParams) -> ImuRecord:
        """Return the samples of a stream, with times from ``origin_ns`` on."""
        turn = matrix(*robot.imu.rotation)
        return cls(seconds(imu.stamp_ns, origin_ns), imu['rate'] @ turn.T / robot.imu.gyro_scale,
                   imu['acceleration'] @ turn.T)


@dataclass(frozen=True)
class WheelRecord(Samples):
    """Samples of the four wheels in the order of ``WHEELS``; times [s] increase."""

    time: Array             # (n,) s, timestamps
    velocity: Array         # (n, 4) rad/s, means over the periods that end at the timestamps
    position: Array | None  # (n, 4) rad, None unless every sample has positions
    torque: Array | None = None  # (n, 4) N m at the timestamps; NaN where not measured

    @classmethod
    def of(cls, wheels: Stream, origin_ns: int) -> WheelRecord:
        """Return the samples of a stream; a wheel not measured moves like that of its side."""
        velocity, angles = (np.where(np.isnan(one), np.roll(one, 2, axis=1), one)
                            for one in (wheels['velocity'], wheels['position']))
        torques = wheels['effort']
        return cls(seconds(wheels.stamp_ns, origin_ns), velocity,
                   None if np.isnan(angles).any() else angles,
                   None if np.isnan(torques).all() else torques)


@dataclass(frozen=True)
class PoseRecord(Samples):
    """Poses of ``base_link`` in a fixed frame from a reference; times [s] increase."""

    time: Array      # (n,) s
    position: Array  # (n, 2) m
    yaw: Array       # (n,) rad, unwrapped

    def intervals(self, length: float) -> tuple[Indices, Indices]:
        """Return first and last indices of intervals of ``length`` [s] without gaps."""
        gap = np.diff(self.time)
        return _merged(gap, gap <= SMOOTH_TIME, length)

    def path_components(self) -> tuple[Array, Array]:
        """Return forward and lateral path [m] (n,) up to each pose, along the mean heading."""
        heading = 0.5 * (self.yaw[1:] + self.yaw[:-1])
        cos, sin = np.cos(heading), np.sin(heading)
        x, y = np.diff(self.position, axis=0).T
        return (np.concatenate([[0.0], np.cumsum(cos * x + sin * y)]),
                np.concatenate([[0.0], np.cumsum(cos * y - sin * x)]))


@dataclass(frozen=True)
class DutyRecord(Samples):
    """Duties of the motors, each in force until the next one; times [s] increase."""

    time: Array  # (n,) s
    duty: Array  # (n, 4) -1 to 1


@dataclass(frozen=True)
class CalibrationRecording:
    """Input of the calibrations; all times have the same origin."""

    imu: ImuRecord
    wheels: WheelRecord
    reference: PoseRecord | None = None
    duties: DutyRecord | None = None

    def forward_force(self, imu_x: float) -> Array:
        """Return the forward specific force [m/s2] (n,) at ``base_link``; IMU at ``imu_x`` [m]."""
        return self.imu.force[:, 0] + imu_x * self.imu.rate[:, 2] ** 2  # without centripetal force

    def scaled(self, factor: float) -> CalibrationRecording:
        """Return the recording with the forward specific force times ``factor``."""
        return replace(self, imu=replace(self.imu, force=self.imu.force * [factor, 1.0, 1.0]))


@dataclass(frozen=True)
class WheelIntervals(Samples):
    """Wheel rotation over time intervals that do not overlap."""

    begin: Array  # (n,) s, by the timestamps of the wheels
    end: Array    # (n,) s
    angle: Array  # (n, 4) rad

    @property
    def duration(self) -> Array:
        """Return the lengths [s] of the intervals, shape (n,)."""
        return self.end - self.begin

    @property
    def center(self) -> Array:
        """Return the centers [s] of the intervals, shape (n,)."""
        return 0.5 * (self.begin + self.end)

    @property
    def sides(self) -> Array:
        """Return the mean speeds [rad/s] of the left and the right wheels, shape (n, 2)."""
        speed = self.angle / self.duration[:, None]
        return np.stack([speed[:, LEFT].mean(axis=1), speed[:, RIGHT].mean(axis=1)], axis=1)

    def near_motion(self, min_speed: float) -> Mask:
        """Return a mask of intervals near one in which a wheel exceeds ``min_speed`` [rad/s]."""
        fastest = np.abs(self.angle / self.duration[:, None]).max(axis=1)
        moving = self.end[fastest > min_speed]
        if not len(moving):
            return np.zeros(len(self.end), bool)
        after = np.searchsorted(moving, self.end)
        left = moving[np.maximum(after - 1, 0)]
        right = moving[np.minimum(after, len(moving) - 1)]
        return np.minimum(np.abs(self.end - left), np.abs(right - self.end)) <= SMOOTH_TIME


class Signal:
    """A sampled signal, linearly interpolated, and its integral."""

    def __init__(self, time: Array, value: Array) -> None:
        from scipy.interpolate import make_interp_spline  # at first use: takes a part of a second
        self.time = time
        self._integral = make_interp_spline(time, value, k=1).antiderivative()

    def integral(self, time: Array) -> Array:
        """Return the integral from the first sample to ``time`` [s], extrapolated linearly."""
        return np.asarray(self._integral(time))

    def mean(self, begin: Array, end: Array) -> Array:
        """Return the means between ``begin`` and ``end`` [s]."""
        return (self.integral(end) - self.integral(begin)) / (end - begin)

    def centered_mean(self, time: Array, reach: float) -> Array:
        """Return the means from ``reach`` [s] before to ``reach`` after ``time``."""
        return self.mean(time - reach, time + reach)


def rotation_increments(wheels: WheelRecord) -> tuple[Array, Mask]:
    """
    Return the rotation [rad] (n - 1, 4) between samples, and a mask of those that are valid.

    Positions bridge lost messages; a velocity describes its own period only. A change that no
    wheel can make, to a value and back within two samples, is not valid either.
    """
    gap = np.diff(wheels.time)
    if wheels.position is not None:
        angle, complete = np.diff(wheels.position, axis=0), gap <= MAX_SAMPLE_GAP
    else:
        angle = wheels.velocity[1:] * gap[:, None]
        complete = gap <= MAX_GAP_PERIODS * float(np.median(gap))
    return angle, complete & ~speed_spikes(angle / gap[:, None]).any(axis=1)


def wheel_intervals(wheels: WheelRecord, min_duration: float) -> WheelIntervals:
    """
    Return the rotation between samples, merged to intervals of at least ``min_duration`` [s].

    Intervals that contain an invalid increment are left out.
    """
    angle, complete = rotation_increments(wheels)
    first, last = _merged(np.diff(wheels.time), complete, min_duration)
    rotation = np.concatenate([np.zeros((1, 4)), np.cumsum(angle, axis=0)])
    return WheelIntervals(wheels.time[first], wheels.time[last], rotation[last] - rotation[first])


def _merged(gap: Array, complete: Mask, min_duration: float) -> tuple[Indices, Indices]:
    """Return first and last samples of intervals without an incomplete gap, each long enough."""
    rows, first, length = [], 0, 0.0
    for index, (step, usable) in enumerate(zip(gap.tolist(), complete.tolist())):
        first, length = (first, length + step) if usable else (index + 1, 0.0)
        if length >= min_duration * (1.0 - 1e-3):  # tolerance for timestamp jitter
            rows.append((first, index + 1))
            first, length = index + 1, 0.0
    first_last = np.array(rows, dtype=int).reshape(-1, 2)
    return first_last[:, 0], first_last[:, 1]


def covered(time: Array, begin: Array, end: Array, max_gap: float) -> Mask:
    """Return whether samples at ``time`` cover intervals without a gap longer than ``max_gap``."""
    gaps = np.append(0, np.cumsum(np.diff(time) > max_gap))
    first = np.clip(np.searchsorted(time, begin, 'right') - 1, 0, len(time) - 1)
    last = np.clip(np.searchsorted(time, end), 0, len(time) - 1)
    return np.asarray((begin >= time[0]) & (end <= time[-1]) & (gaps[first] == gaps[last]))


def side_slip(mean: Array, half_difference: Array) -> Array:
    """
    Return what two sides lose if both slip equally in a turn, in the unit of the arguments.

    For speeds or rotations ``mean`` u and ``half_difference`` d >= 0 of the sides, all (n,), it is
    d^2 / u, at most d.
    """
    ratio = half_difference / np.maximum(np.abs(mean), 1e-9)
    return np.asarray(np.sign(mean) * half_difference * np.minimum(1.0, ratio))


def period(time: Array) -> float:
    """Return the median period [s] between times; NaN for fewer than two."""
    return float(np.median(np.diff(time))) if len(time) > 1 else math.nan
