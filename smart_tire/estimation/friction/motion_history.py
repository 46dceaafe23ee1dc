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
Motion, load and ground of a wheel during a patch crossing, from the estimates of slip_estimator.

Means over an interval keep the standard deviation of one sample: the errors of a filter are
correlated for longer than a crossing and do not average out.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import TypeVar

import numpy as np

from smart_tire.arrays import Array
from smart_tire.models.vehicle.skid_steer import normal_loads
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GroundState, NS_PER_S, Odometry, WHEELS, WheelSlip
from smart_tire.uncertain import Uncertain, UNKNOWN

HISTORY_LENGTH = 1024        # samples of each stream: 8 s at 125 Hz, 65 s of ground states
MEAN_MARGIN_NS = 50_000_000  # a sample further from the interval does not represent it
MEAN_POINTS = 5              # in an interval, of which the mean is taken
SLOPE_MARGIN_NS = 100_000_000  # on either side of the interval, for accelerations
MIN_SLOPE_SAMPLES = 6
ACCELERATION_SIGMA = 0.03    # m/s2, of the slope of a filtered velocity; 0.17 % of load in turns
VAR_V_Y, COV_V_Y_YAW, VAR_YAW = 7, 11, 35  # in the row-major 6x6 covariance of the twist

Stamped = TypeVar('Stamped', Odometry, WheelSlip, GroundState)


@dataclass(frozen=True, slots=True)
class WheelMotion:
    """Mean motion and load of one wheel, and its ground; ``UNKNOWN`` without samples."""

    slip: Uncertain = UNKNOWN              # -, B(3)'s lambda
    lateral_velocity: Uncertain = UNKNOWN  # m/s, v_y of the wheel center
    load: Uncertain = UNKNOWN              # N, F_z
    slip_rate: float = 0.0       # 1/s, slope of a linear fit to the slip ...
    slip_residual: float = 0.0   # -, ... and its rms residual
    stiffness: Uncertain = UNKNOWN  # N, C_x; the calibrated one without samples
    slip_correlation: float = 0.0   # -, of the error of ln C_x with that of the slip


class MotionHistory:
    """
    Recent odometry, slip and ground of the robot; timestamps must not decrease.

    ``load_sigma`` is the relative standard deviation of a wheel's load, in addition to that from
    the accelerations.
    """

    def __init__(self, robot: RobotParams, load_sigma: float) -> None:
        self._robot, self._load_sigma = robot, load_sigma
        nominal = robot.tire.longitudinal_stiffness
        self._calibrated = Uncertain(nominal, robot.tire.longitudinal_stiffness_sigma * nominal)
        self._odometry: list[Odometry] = []
        self._slips: list[WheelSlip] = []
        self._grounds: list[GroundState] = []

    def add_odometry(self, sample: Odometry) -> None:
        """Add a sample."""
        _append(self._odometry, sample)

    def add_slip(self, sample: WheelSlip) -> None:
        """Add a sample."""
        _append(self._slips, sample)

    def add_ground(self, sample: GroundState) -> None:
        """Add a sample."""
        _append(self._grounds, sample)

    def mean(self, wheel: str, begin_ns: int, end_ns: int) -> WheelMotion:
        """Return the mean motion of ``wheel`` between two instants."""
        index = WHEELS.index(wheel)
        # wide enough for the entry of film 1 and the release of the last film
        around_ns = max(MEAN_MARGIN_NS, end_ns - begin_ns)
        slips = _between(self._slips, begin_ns - around_ns, end_ns + around_ns)
        slip = _mean(slips, [Uncertain(s.ratio[index], s.sigma[index]) for s in slips], begin_ns,
                     end_ns)
        near = _between(self._odometry, begin_ns - MEAN_MARGIN_NS, end_ns + MEAN_MARGIN_NS)
        lateral = _mean(near, [self._lateral_velocity(o, index) for o in near], begin_ns, end_ns)
        rate, residual = _linear_fit([s for s in slips if math.isfinite(s.ratio[index])], index)
        stiffness, correlation = self._ground(end_ns, index)
        if math.isnan(lateral.value):
            load = UNKNOWN
        else:
            wide = _between(self._odometry, begin_ns - SLOPE_MARGIN_NS, end_ns + SLOPE_MARGIN_NS)
            load = self._load(*self._acceleration(wide), index)
        return WheelMotion(slip, lateral, load, rate, residual, stiffness, correlation)

    def _lateral_velocity(self, odometry: Odometry, index: int) -> Uncertain:
        """Return v_y [m/s] of a wheel center."""
        covariance = odometry.twist_covariance
        arm = 0.5 * self._robot.wheelbase * (1.0 if index < 2 else -1.0)
        lateral = odometry.linear[1] + arm * odometry.angular[2]
        variance = (covariance[VAR_V_Y] + 2.0 * arm * covariance[COV_V_Y_YAW]
                    + arm**2 * covariance[VAR_YAW])
        return Uncertain(lateral, math.sqrt(max(variance, 0.0)))

    def _acceleration(self, odometry: list[Odometry]) -> tuple[float, float]:
        """Return the acceleration [m/s2] of the center of mass from velocities, body axes."""
        v_x, v_y = np.array([o.linear[:2] for o in odometry]).T
        rate = np.array([o.angular[2] for o in odometry])
        stamps = [o.stamp_ns for o in odometry]
        com_x, com_y, _ = self._robot.center_of_mass
        n = len(stamps)
        square = float(rate @ rate) / n
        return (_slope(stamps, v_x) - float(rate @ v_y) / n - com_x * square,
                _slope(stamps, v_y) + float(rate @ v_x) / n - com_y * square)

    def _ground(self, stamp_ns: int, index: int) -> tuple[Uncertain, float]:
        """Return C_x [N] by the latest sample and the correlation of its error with slip."""
        count = bisect_right(self._grounds, stamp_ns, key=_stamp)
        if not count:
            return self._calibrated, 0.0
        ground = self._grounds[count - 1]
        return ground.stiffness, 0.0

    def _load(self, a_x: float, a_y: float, index: int) -> Uncertain:
        """Return the wheel's load [N] with the accelerations during a crossing."""
        robot = self._robot

        def load(by_x: float, by_y: float) -> float:
            loads = normal_loads(robot.mass, robot.center_of_mass, robot.wheelbase,
                                 robot.track_width, a_x + by_x, a_y + by_y,
                                 radius=robot.wheel_radius)
            return float(loads[index])

        nominal = load(0.0, 0.0)
        sigma = math.hypot(load(ACCELERATION_SIGMA, 0.0) - nominal,
                           load(0.0, ACCELERATION_SIGMA) - nominal)
        return Uncertain(nominal, math.hypot(sigma, self._load_sigma * nominal))


def _append(samples: list[Stamped], sample: Stamped) -> None:
    """Append ``sample``; at twice the history's length, remove the older half."""
    samples.append(sample)
    if len(samples) > 2 * HISTORY_LENGTH:
        del samples[:HISTORY_LENGTH]


def _between(samples: list[Stamped], begin_ns: int, end_ns: int) -> list[Stamped]:
    low = bisect_left(samples, begin_ns, key=_stamp)
    return samples[low:bisect_right(samples, end_ns, key=_stamp)]


def _stamp(sample: Odometry | WheelSlip | GroundState) -> int:
    return sample.stamp_ns


def _mean(samples: Sequence[Odometry | WheelSlip], estimates: list[Uncertain], begin_ns: int,
          end_ns: int) -> Uncertain:
    """Return the mean of ``estimates`` between two instants; UNKNOWN where one is NaN."""
    if not samples:
        return UNKNOWN
    points = [begin_ns + i * (end_ns - begin_ns) / (MEAN_POINTS - 1) for i in range(MEAN_POINTS)]
    stamps = [sample.stamp_ns for sample in samples]
    value, sigma = (sum(np.interp(points, stamps, column).tolist()) / MEAN_POINTS
                    for column in zip(*estimates))
    finite = math.isfinite(value) and math.isfinite(sigma)
    return Uncertain(value, sigma) if finite else UNKNOWN


def _linear_fit(slips: list[WheelSlip], index: int) -> tuple[float, float]:
    """Return slope [1/s] and rms residual of a linear fit to a wheel's slips."""
    stamps, ratios = [s.stamp_ns for s in slips], np.array([s.ratio[index] for s in slips])
    slope = _slope(stamps, ratios)
    if not slope:
        return 0.0, 0.0
    residual = ratios - slope * (np.array(stamps) - stamps[0]) / NS_PER_S
    return slope, float(np.std(residual))


def _slope(stamps: list[int], values: Array | list[float]) -> float:
    """Return the slope [1/s] of a linear fit to ``values``, 0 with too few of them."""
    if len(stamps) < MIN_SLOPE_SAMPLES:
        return 0.0
    times = (np.array(stamps) - stamps[0]) / NS_PER_S
    times -= times.mean()
    return float(times @ np.asarray(values) / (times @ times))
