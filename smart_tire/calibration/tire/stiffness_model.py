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
Straight-line motion of a robot on brush tires as a sparse least-squares problem.

Unknown are, for each step of a segment, the speed of the body and of the wheels, an acceleration
by slope, and the timestamp errors of the wheels. The force balance ties them to each other, the
accelerometer to the body, and the rolled distances to the wheels. So all measurements have their
errors, and no noisy measurement is a regressor: that would bias the stiffness. Speeds are in the
units of the sensors, with their scale errors: otherwise a wrong scale would reduce the residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
import math

import numpy as np
from scipy import sparse

from smart_tire.arrays import Array
from smart_tire.calibration.tire.straight_segments import Mask, MIN_SPEED, StraightSegment
from smart_tire.models.constants import GRAVITY
from smart_tire.models.vehicle.skid_steer import normal_loads
from smart_tire.parameters import RobotParams

SLIP_FLOOR = 0.1          # m/s, minimum denominator of the slip; such rows have no weight
LOW_SPEED_ERROR = 10.0    # m/s2, of the force balance below MIN_SPEED: no information
MAX_WHEEL_ACCELERATION = 4.0  # m/s2; the wheel samples do not resolve faster changes
DRAG_SPEED = 0.02         # m/s, below which drag is linear in the speed
LOAD_FILTER = 5           # steps, of the acceleration that transfers load
STATIONARY_SIGMA = 0.001  # m/s, of a body at standstill
WHEEL_JERK = 1.0          # m/s2 per step of 10 ms, change of the wheel acceleration; a wide prior
JERK_STEP = 0.01          # s, of the above
SLOPE_SIGMA = 0.1         # m/s2, g times the slope at the start of a segment; assumed
SLOPE_WALK = 0.02         # m/s2 per root of a second, its changes; assumed
ROUGHNESS_SIGMA = 0.001   # m/s, of the mean speed of an interval, from uneven ground; assumed


class Common(IntEnum):
    """Parameters of all segments."""

    STIFFNESS = 0      # ln of C_x [N]
    DRAG = 1           # share of the weight, against the motion
    FRICTION = 2       # ln of mu
    LATENCY_ERROR = 3  # s, of the wheel timestamps in addition to the configured latency
    ACCEL_SCALE = 4    # relative error of measured accelerations: scale, and pitching of the body
    ACCEL_BIAS = 5     # m/s2, bias of the accelerometer and tilt of its mounting


@dataclass(frozen=True)
class Noise:
    """Standard deviations that the residuals determine."""

    stamp: float  # s, jitter of the timestamps of the wheels
    force: float  # m/s2, error of the force balance of a step, as an acceleration


@dataclass(frozen=True)
class Block:
    """Normalized residuals, and their derivatives by common and by local unknowns."""

    residual: Array
    by_common: Array          # (rows, len(Common))
    by_local: sparse.csr_array
    group: str = ''           # whose noise is estimated
    counted: Mask | None = None  # rows that determine it, None: all


class SegmentModel:
    """Residuals of one segment; local unknowns are v, u (m + 1), slope (m) and timestamps."""

    def __init__(self, segment: StraightSegment, robot: RobotParams) -> None:
        self.segment, self.robot = segment, robot
        m, n = len(segment.force), len(segment.distance)
        self._m, self._step = m, np.diff(segment.time)
        self._v, self._u, self._slope, self._stamp = np.cumsum([0, m + 1, m + 1, m]).tolist()
        self.size = self._stamp + n + 1
        count = math.tau / robot.encoder.counts_per_revolution * robot.wheel_radius / (
            math.sqrt(12.0 * 4.0))  # m; quantization error is uniform, mean of four wheels
        self.distance_resolution = math.sqrt(2.0) * count  # m, of a rolled distance
        self._distance_sigma = np.hypot(self.distance_resolution,
                                        ROUGHNESS_SIGMA * np.diff(segment.stamps))
        mid = sparse.diags_array([0.5, 0.5], offsets=[0, 1], shape=(m, m + 1))
        slope = sparse.diags_array([-1.0 / self._step, 1.0 / self._step], offsets=[0, 1],
                                   shape=(m, m + 1))
        self._resolved = _resolved(segment)
        self._mid, self._rate = mid.tocsr(), slope.tocsr()
        self._loads, self._linear = self._axle_loads(), self._linear_rows()

    def order(self) -> Array:
        """Return the times [s] of the local unknowns: sorted by them, the equations are banded."""
        time = self.segment.time
        return np.concatenate([time, time, 0.5 * (time[1:] + time[:-1]), self.segment.stamps])

    def start(self) -> Array:
        """Return initial values of the local unknowns: no slip."""
        segment, values = self.segment, np.zeros(self.size)
        center = 0.5 * (segment.stamps[1:] + segment.stamps[:-1])
        speed = np.interp(segment.time, center, segment.speed)
        values[self._v:self._u] = values[self._u:self._slope] = speed
        return values

    def speeds(self, local: Array) -> tuple[Array, Array]:
        """Return the speeds [m/s] of body and wheels (m + 1,)."""
        return local[self._v:self._u], local[self._u:self._slope]

    def slope(self, local: Array) -> Array:
        """Return the accelerations [m/s2] (m,) by slope."""
        return local[self._slope:self._stamp]

    def blocks(self, common: Array, local: Array, noise: Noise) -> list[Block]:
        """Return all residuals."""
        return [self._kinematics(common, local), self._balance(common, local, noise),
                self._rolling(common, local), self._timestamps(local, noise),
                *self._linear_blocks(local)]

    def motion(self, common: Array, local: Array) -> tuple[Array, Array]:
        """Return slip and tire force [N] of one wheel in each step, positive in traction."""
        v, u = (self._mid @ speed for speed in self.speeds(local))
        v = v / (1.0 + common[Common.ACCEL_SCALE])
        slip = (u - v) / np.maximum(np.abs(u), SLIP_FLOOR)
        force = sum(self._axle(common, slip, load)[0] for load in self._loads)
        return slip * np.sign(u), 0.25 * np.asarray(force) * np.sign(u)

    def _embed(self, matrix: sparse.csr_array, first: int) -> sparse.csr_array:
        """Return ``matrix`` as columns of the local unknowns from ``first`` on."""
        coo = matrix.tocoo()
        return sparse.csr_array((coo.data, (coo.row, coo.col + first)),
                                shape=(matrix.shape[0], self.size))

    def _kinematics(self, common: Array, local: Array) -> Block:
        """Return the residuals of the accelerometer against the speed of the body."""
        segment = self.segment
        by_common = np.zeros((self._m, len(Common)))
        by_common[:, Common.ACCEL_BIAS] = 1.0
        residual = (self._rate @ self.speeds(local)[0] + local[self._slope:self._stamp]
                    + common[Common.ACCEL_BIAS] - segment.force)
        by_local = self._embed(self._rate, self._v) + self._embed(
            sparse.eye_array(self._m).tocsr(), self._slope)
        return Block(residual / segment.noise, by_common / segment.noise, by_local / segment.noise,
                     'accelerometer')

    def _balance(self, common: Array, local: Array, noise: Noise) -> Block:
        """Return the residuals of the force balance, as accelerations."""
        v_nodes, u_nodes = self.speeds(local)
        scale, mass = 1.0 + common[Common.ACCEL_SCALE], self.robot.mass
        felt, u = self._mid @ v_nodes, self._mid @ u_nodes
        v, size = felt / scale, np.maximum(np.abs(u), SLIP_FLOOR)
        slip = (u - v) / size
        force, by_slip, by_stiffness, by_friction = (
            sum(parts) for parts in zip(*(self._axle(common, slip, load)
                                          for load in self._loads)))
        direction, drag = np.tanh(v / DRAG_SPEED), GRAVITY * common[Common.DRAG]
        net = force / mass - drag * direction  # m/s2
        fast = self._resolved & (np.minimum(np.abs(u), np.abs(v)) > MIN_SPEED)
        sigma = np.where(fast, noise.force, LOW_SPEED_ERROR)
        by_common = np.zeros((self._m, len(Common)))
        by_common[:, Common.STIFFNESS] = -scale * by_stiffness / mass
        by_common[:, Common.FRICTION] = -scale * by_friction / mass
        by_common[:, Common.DRAG] = scale * GRAVITY * direction
        net_by_v = -by_slip / (mass * size) - drag * (1.0 - direction ** 2) / DRAG_SPEED
        by_common[:, Common.ACCEL_SCALE] = -net + net_by_v * v
        by_u = np.where(np.abs(u) > SLIP_FLOOR, v / (size * np.where(u == 0.0, 1.0, u)),
                        1.0 / size)
        weigh = sparse.diags_array(1.0 / sigma)
        by_local = weigh @ (
            self._embed(self._rate - sparse.diags_array(net_by_v) @ self._mid, self._v)
            + self._embed(sparse.diags_array(-scale * by_slip * by_u / mass) @ self._mid, self._u)
            + self._embed(sparse.eye_array(self._m).tocsr(), self._slope))
        residual = self._rate @ v_nodes + local[self._slope:self._stamp] - scale * net
        return Block(residual / sigma, by_common / sigma[:, None], by_local, 'force', fast)

    def _axle_loads(self) -> Array:
        """Return the loads [N] of both axles (2, m), from the measured acceleration."""
        robot, window = self.robot, np.full(LOAD_FILTER, 1.0 / LOAD_FILTER)
        force = np.convolve(np.pad(self.segment.force, LOAD_FILTER // 2, 'edge'), window, 'valid')
        loads = normal_loads(robot.mass, robot.center_of_mass, robot.wheelbase,
                             robot.track_width, force, 0.0, radius=robot.wheel_radius)
        return np.maximum(np.stack([loads[:, :2].sum(axis=1), loads[:, 2:].sum(axis=1)]), 1e-3)

    def _axle(self, common: Array, slip: Array, load: Array) -> tuple[Array, Array, Array, Array]:
        """Return the force [N] of an axle, and derivatives by slip, ln of C_x, ln of mu."""
        stiffness, friction = 2.0 * np.exp(common[[Common.STIFFNESS, Common.FRICTION]])
        limit = 0.5 * friction * load
        t = np.minimum(stiffness * np.abs(slip) / (3.0 * limit), 1.0)
        size = limit * t * (3.0 - 3.0 * t + t * t)
        slope = limit * 3.0 * (1.0 - t) ** 2  # by t
        sign = np.sign(slip)
        return (sign * size, slope * stiffness / (3.0 * limit), sign * slope * t,
                sign * (size - slope * t))

    def _rolling(self, common: Array, local: Array) -> Block:
        """Return the residuals of the rolled distances."""
        segment, u = self.segment, self.speeds(local)[1]
        latency = common[Common.LATENCY_ERROR]
        stamps, late = segment.stamps - latency, local[self._stamp:]
        n = len(stamps) - 1
        between = sparse.diags_array([-1.0, 1.0], offsets=[0, 1], shape=(n, n + 1)).tocsr()
        rolled, ends = _integrals(segment.time, stamps), _interpolation(segment.time, stamps)
        # a late timestamp belongs to a shorter distance
        shortened = rolled - between @ sparse.diags_array(late) @ ends
        speed = ends @ u
        rate = np.diff(u) / self._step
        change = rate[np.clip(np.searchsorted(segment.time, stamps) - 1, 0, self._m - 1)]
        by_common = np.zeros((n, len(Common)))
        by_common[:, Common.LATENCY_ERROR] = -(between @ (speed - change * late))
        residual = shortened @ u - segment.distance
        sigma = self._distance_sigma
        weigh = sparse.diags_array(1.0 / sigma)
        return Block(residual / sigma, by_common / sigma[:, None],
                     self._embed((weigh @ shortened).tocsr(), self._u)
                     + self._embed((weigh @ (-between @ sparse.diags_array(speed))).tocsr(),
                                   self._stamp))

    def _timestamps(self, local: Array, noise: Noise) -> Block:
        late = local[self._stamp:]
        return Block(late / noise.stamp, np.zeros((len(late), len(Common))), self._embed(
            sparse.eye_array(len(late)).tocsr() / noise.stamp, self._stamp), 'stamp')

    def _linear_rows(self) -> list[sparse.csr_array]:
        """Return rows of the priors: smooth wheel speed, slow slope, standstill."""
        m, step = self._m, self._step
        second = (sparse.diags_array([-1.0, 1.0], offsets=[0, 1], shape=(m - 1, m))
                  @ self._rate) / (WHEEL_JERK * math.sqrt(float(np.median(step)) / JERK_STEP))
        walk = sparse.diags_array([-1.0, 1.0], offsets=[0, 1], shape=(m - 1, m)) / (
            SLOPE_WALK * math.sqrt(float(np.median(step))))
        first = sparse.csr_array(([1.0 / SLOPE_SIGMA], ([0], [0])), shape=(1, m))
        still = np.flatnonzero(self.segment.stationary)
        zero = sparse.csr_array((np.full(len(still), 1.0 / STATIONARY_SIGMA), (
            np.arange(len(still)), still)), shape=(len(still), m + 1))
        return [self._embed(second.tocsr(), self._u), self._embed(walk.tocsr(), self._slope),
                self._embed(first, self._slope), self._embed(zero, self._v)]

    def _linear_blocks(self, local: Array) -> list[Block]:
        return [Block(rows @ local, np.zeros((rows.shape[0], len(Common))), rows)
                for rows in self._linear]


def _resolved(segment: StraightSegment) -> Mask:
    """Return a mask of the steps in which the wheel samples resolve changes of the wheel speed."""
    middle = 0.5 * (segment.time[1:] + segment.time[:-1])
    center = 0.5 * (segment.stamps[1:] + segment.stamps[:-1])
    resolved = np.ones(len(middle), bool)
    fast = np.abs(np.diff(segment.speed)) > MAX_WHEEL_ACCELERATION * np.diff(center)
    for index in np.flatnonzero(fast):
        resolved &= (middle < segment.stamps[index]) | (middle > segment.stamps[index + 2])
    return resolved


def _interpolation(time: Array, at: Array) -> sparse.csr_array:
    """Return weights (n, m) of a signal at ``time`` (m,) in its values ``at`` (n,)."""
    index = np.clip(np.searchsorted(time, at) - 1, 0, len(time) - 2)
    share, row = (at - time[index]) / np.diff(time)[index], np.arange(len(at))
    return sparse.csr_array((np.concatenate([1.0 - share, share]), (
        np.tile(row, 2), np.concatenate([index, index + 1]))), shape=(len(at), len(time)))


def _integrals(time: Array, ends: Array) -> sparse.csr_array:
    """Return weights (n, m) of a signal at ``time`` (m,) in its integrals between ``ends``."""
    index = np.clip(np.searchsorted(time, ends) - 1, 0, len(time) - 2)
    n, step = len(ends) - 1, np.diff(time)
    rows = np.repeat(np.arange(n), np.diff(index))  # of the steps that begin in an interval
    whole = np.arange(index[0], index[-1])
    part = ends - time[index]
    late = 0.5 * part ** 2 / step[index]
    begin, end, interval = index[:-1], index[1:], np.arange(n)
    entries = [(rows, whole, 0.5 * step[whole]), (rows, whole + 1, 0.5 * step[whole]),
               (interval, end, (part - late)[1:]), (interval, end + 1, late[1:]),
               (interval, begin, -(part - late)[:-1]), (interval, begin + 1, -late[:-1])]
    row, column, weight = (np.concatenate(values) for values in zip(*entries))
    return sparse.csr_array((weight, (row, column)), shape=(n, len(time)))
