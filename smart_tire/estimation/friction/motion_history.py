"""
What the slip estimator said about the robot while a wheel's films were in the patch.

Means over a stretch of time, with the sigma of one sample: the errors of a filter last longer
than a passage and do not average out in it.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import TypeVar

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.friction.stiffness_check import StiffnessConsistencyCheck
from smart_tire.models.vehicle.skid_steer import normal_loads
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import NS_PER_S, Odometry, WHEELS, WheelSlip


MEMORY = 1024             # samples of each stream: 8 s at 125 Hz
NEAR_NS = 50_000_000      # a sample further from the stretch does not stand for it
POINTS = 5                # of a stretch, whose mean is taken
SLOPE_NS = 100_000_000    # on either side of the stretch, to tell the acceleration
FEWEST_FOR_SLOPE = 6      # samples
ACCELERATION_SIGMA = 0.03  # m/s2, of the slope of a filtered velocity; 0.17 % of load in turns
V_Y, V_Y_RATE, RATE = 7, 11, 35  # in the row-major 6x6 covariance of the twist

ValueSigma = tuple[float, float]  # value and one sigma
UNKNOWN: ValueSigma = (math.nan, math.inf)
Stamped = TypeVar('Stamped', Odometry, WheelSlip)


@dataclass(frozen=True, slots=True)
class WheelMotion:
    """Mean motion and load of one wheel; ``UNKNOWN`` where the streams do not tell."""

    slip: ValueSigma = UNKNOWN     # -, B(3)'s lambda
    lateral: ValueSigma = UNKNOWN  # m/s, v_y of the wheel's centre
    load: ValueSigma = UNKNOWN     # N, F_z
    slip_rate: float = 0.0       # 1/s, at which the slip changes ...
    slip_bend: float = 0.0       # -, how far it strays from that in the passage, rms
    stiffness_sigma: float | None = None  # relative, of C_x; None where the streams do not tell


class MotionHistory:
    """
    Recent odometry and slip of the robot; stamps must not run backwards.

    ``load_sigma`` is the relative one of a wheel's load beside that of the accelerations.
    """

    def __init__(self, robot: RobotParams, load_sigma: float) -> None:
        self._robot, self._load_sigma = robot, load_sigma
        self._balance = StiffnessConsistencyCheck(robot)
        self._odometry: list[Odometry] = []
        self._slips: list[WheelSlip] = []

    def add_odometry(self, sample: Odometry) -> None:
        """Take in a sample."""
        self._odometry.append(sample)
        if len(self._odometry) > 2 * MEMORY:
            del self._odometry[:MEMORY]

    def add_slip(self, sample: WheelSlip) -> None:
        """Take in a sample."""
        self._slips.append(sample)
        if len(self._slips) > 2 * MEMORY:
            del self._slips[:MEMORY]

    def mean(self, wheel: str, begin_ns: int, end_ns: int) -> WheelMotion:
        """Return the mean motion of ``wheel`` between two instants."""
        index = WHEELS.index(wheel)
        # while film 1 comes, and the others go
        around_ns = max(NEAR_NS, end_ns - begin_ns)
        slips = _between(self._slips, begin_ns - around_ns, end_ns + around_ns)
        slip = _mean(slips, [(s.ratio[index], s.sigma[index]) for s in slips], begin_ns, end_ns)
        near = _between(self._odometry, begin_ns - NEAR_NS, end_ns + NEAR_NS)
        lateral = _mean(near, [self._lateral(o, index) for o in near], begin_ns, end_ns)
        rate, bend = _line([s for s in slips if math.isfinite(s.ratio[index])], index)
        if math.isnan(lateral[0]):
            return WheelMotion(slip, slip_rate=rate, slip_bend=bend)
        wide = _between(self._odometry, begin_ns - SLOPE_NS, end_ns + SLOPE_NS)
        a_x, a_y = self._acceleration(wide)
        return WheelMotion(slip, lateral, self._load(a_x, a_y, index), rate, bend,
                           self._stiffness_sigma(slips, a_x))

    def _lateral(self, odometry: Odometry, index: int) -> ValueSigma:
        covariance = odometry.twist_covariance
        arm = 0.5 * self._robot.wheelbase * (1.0 if index < 2 else -1.0)
        lateral = odometry.linear[1] + arm * odometry.angular[2]
        variance = covariance[V_Y] + 2.0 * arm * covariance[V_Y_RATE] + arm**2 * covariance[RATE]
        return lateral, math.sqrt(max(variance, 0.0))

    def _acceleration(self, odometry: list[Odometry]) -> tuple[float, float]:
        """Return the acceleration [m/s2] of the centre of mass from velocities, body axes."""
        v_x, v_y = np.array([o.linear[:2] for o in odometry]).T
        rate = np.array([o.angular[2] for o in odometry])
        stamps = [o.stamp_ns for o in odometry]
        com_x, com_y, _ = self._robot.center_of_mass
        n = len(stamps)
        square = float(rate @ rate) / n
        return (_slope(stamps, v_x) - float(rate @ v_y) / n - com_x * square,
                _slope(stamps, v_y) + float(rate @ v_x) / n - com_y * square)

    def _stiffness_sigma(self, slips: list[WheelSlip], a_x: float) -> float | None:
        """Return the relative sigma of C_x with the middle one of ``slips``."""
        if not slips:
            return None
        middle = slips[len(slips) // 2]
        pushing = [math.copysign(ratio, sliding)
                   for ratio, sliding in zip(middle.ratio, middle.slip_velocity)]
        # what the wheels' slips share is the error of the robot's speed
        return self._balance.stiffness_sigma(pushing, min(middle.sigma), a_x)

    def _load(self, a_x: float, a_y: float, index: int) -> ValueSigma:
        """Return the wheel's load under the accelerations around a passage."""
        robot = self._robot

        def load(by_x: float, by_y: float) -> float:
            loads = normal_loads(robot.mass, robot.center_of_mass, robot.wheelbase,
                                 robot.track_width, a_x + by_x, a_y + by_y,
                                 radius=robot.wheel_radius)
            return float(loads[index])

        here = load(0.0, 0.0)
        sigma = math.hypot(load(ACCELERATION_SIGMA, 0.0) - here,
                           load(0.0, ACCELERATION_SIGMA) - here)
        return here, math.hypot(sigma, self._load_sigma * here)


def _between(samples: list[Stamped], begin_ns: int, end_ns: int) -> list[Stamped]:
    low = bisect_left(samples, begin_ns, key=_stamp)
    return samples[low:bisect_right(samples, end_ns, key=_stamp)]


def _stamp(sample: Odometry | WheelSlip) -> int:
    return sample.stamp_ns


def _mean(samples: Sequence[Odometry | WheelSlip], estimates: list[ValueSigma], begin_ns: int,
          end_ns: int) -> ValueSigma:
    """Return the mean of ``estimates`` between two instants; UNKNOWN where one is NaN."""
    if not samples:
        return UNKNOWN
    points = [begin_ns + i * (end_ns - begin_ns) / (POINTS - 1) for i in range(POINTS)]
    stamps = [sample.stamp_ns for sample in samples]
    value, sigma = (sum(np.interp(points, stamps, column).tolist()) / POINTS
                    for column in zip(*estimates))
    return (value, sigma) if math.isfinite(value) and math.isfinite(sigma) else UNKNOWN


def _line(slips: list[WheelSlip], index: int) -> tuple[float, float]:
    """Return the slope [1/s] of the straight line through a wheel's slips, and the rms off it."""
    stamps, ratios = [s.stamp_ns for s in slips], np.array([s.ratio[index] for s in slips])
    slope = _slope(stamps, ratios)
    if not slope:
        return 0.0, 0.0
    off = ratios - slope * (np.array(stamps) - stamps[0]) / NS_PER_S
    return slope, float(np.std(off))


def _slope(stamps: list[int], values: Array | list[float]) -> float:
    """Return the slope [1/s] of the straight line through ``values``, 0 if too few tell."""
    if len(stamps) < FEWEST_FOR_SLOPE:
        return 0.0
    times = (np.array(stamps) - stamps[0]) / NS_PER_S
    times -= times.mean()
    return float(times @ np.asarray(values) / (times @ times))
