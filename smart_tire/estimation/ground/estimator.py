# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Ground estimator: IMU, wheels and crossings of films in, state of the ground out.

All times are message time; a window ends at multiples of ``HOP_NS``.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.ground.body_model import LOAD, LOSS
from smart_tire.estimation.ground.measurements import MeasuredCrossing, WindowData
from smart_tire.estimation.ground.unknowns import (
    CURVE_ERROR, DYNAMIC, HOP, LENGTH, MAX_GAP, MAX_SIGMA, MODEL_ERROR, ROBOT, SETTLING, SIDES,
    SIZE, Unknown)
from smart_tire.estimation.ground.wheel_motion import CUBIC_POINTS
from smart_tire.estimation.ground.window import GroundWindow, Solution
from smart_tire.estimation.plausibility import is_speed_contradicted
from smart_tire.estimation.streams import GROUND_STATE_PERIOD_NS
from smart_tire.models.tire.brush_tire import critical_slip, LN_RESISTANCE
from smart_tire.models.vehicle.skid_steer import SIDE_SIGNS
from smart_tire.numerics.levenberg_marquardt import solve_spd
from smart_tire.parameters.robot import RobotParams
from smart_tire.rotation import matrix
from smart_tire.samples import (
    GroundState, ImuSample, NS_PER_S, Odometry, WHEELS, WheelSample)
from smart_tire.uncertain import log_normal, Uncertain, UNKNOWN

IMU_COLUMNS, WHEEL_COLUMNS = 4, 9  # as in ``WindowData``
HOP_NS = GROUND_STATE_PERIOD_NS  # between two windows


@dataclass(frozen=True, slots=True)
class WheelState:
    """Slip, load and ground of a wheel, averaged over a crossing of its films."""

    slip: Uncertain = UNKNOWN           # -, B(3)
    normalized_slip: Uncertain = UNKNOWN  # -, |s| / lambda_cr
    load: Uncertain = UNKNOWN           # N
    traction_force: Uncertain = UNKNOWN  # N, on the robot, positive forward
    stiffness: Uncertain = UNKNOWN      # N, C_x
    friction: Uncertain = UNKNOWN       # -, mu
    critical_slip: Uncertain = UNKNOWN  # -


class GroundEstimator:
    """
    Collects samples, solves a window at each hop and interprets its solution.

    ``load_sigma`` is the relative standard deviation of a wheel's load: mass, suspension.
    """

    def __init__(self, robot: RobotParams, load_sigma: float) -> None:
        self._robot, self._load_sigma = robot, load_sigma
        x_row, y_row, z_row = matrix(*robot.imu.rotation)
        self._rotation = [x_row.tolist(), y_row.tolist(), (z_row / robot.imu.gyro_scale).tolist()]
        self._window = GroundWindow(robot)
        self._origin_ns: int | None = None
        self._imu, self._wheels = array('d'), array('d')  # rows, one after the other
        self._crossings: list[MeasuredCrossing] = []
        self._odometry: Odometry | None = None
        self._imu_seen = False
        self._angles = np.zeros(4)      # rad, integrated where no positions are measured
        self._next_hop_ns: int | None = None
        self.solution: Solution | None = None
        self.failures = 0               # windows without solution
        self.films_used = 0
        self._shown = False             # by torques
        self.observable = False         # torques or samples of films have been received

    @property
    def waits(self) -> bool:
        """Return whether a window can be expected: its motion is measured."""
        return bool(self._imu)

    @property
    def status(self) -> dict[str, str | int | float]:
        """Return the values for diagnostics: what was learned, and why nothing is published."""
        solution = self.solution
        if solution is None:
            return {'ground': 'unknown: no films and no motor torques'
                    if self._imu and self._wheels and not self.observable else
                    'unknown: no motion yet' if self._imu_seen else 'unknown: no imu/data'}
        shown: dict[str, str | int | float] = {
            'ground': 'known' if self.known else 'unknown: no films and no motor torques',
            'ground_changes': self._window.changes, 'wheel_lifts': self._window.lifts,
            'ground_failures': self.failures,
            'ground_tension': f'{solution.tension.size:.1f} sigma: {solution.tension.name}'}
        x, sigma = solution.fit.x, np.sqrt(np.diag(solution.fit.covariance))
        for name, row in (('torque_scale', Unknown.TORQUE_SCALE), ('wheel_radius', Unknown.RADIUS),
                          ('wheel_delay', Unknown.DELAY), ('slope_x', Unknown.SLOPE_X),
                          ('slope_y', Unknown.SLOPE_Y)):
            shown[name] = f'{x[row]:+.4f} +- {sigma[row]:.4f}'
        return shown

    @property
    def end_ns(self) -> int:
        """Return the end of the latest window [ns]."""
        assert self.solution is not None and self._origin_ns is not None
        return self._origin_ns + round(self.solution.end * NS_PER_S)

    @property
    def known(self) -> bool:
        """Return whether films or motor torques have been measured."""
        return self.solution is not None and (self.films_used > 0 or self._shown)

    def add_sample(self, sample: ImuSample | WheelSample | Odometry) -> None:
        """Add a sample; stamps of each kind must increase."""
        if self._origin_ns is None:
            self._origin_ns = sample.stamp_ns
        time = self._seconds(sample.stamp_ns)
        if isinstance(sample, ImuSample):
            self._imu_seen = True
            (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = self._rotation
            (p, q, r), (a, b, c) = sample.rate, sample.acceleration
            self._append(self._imu, (time, zx * p + zy * q + zz * r, xx * a + xy * b + xz * c,
                                     yx * a + yy * b + yz * c))
        elif isinstance(sample, WheelSample):
            self._add_wheels(time - self._robot.encoder.latency, sample)
        elif not self._imu_seen:
            self._add_odometry(time, sample)

    def add_crossing(self, stamp_ns: int, wheel: str, slip: float, normalized_slip: float,
                     covariance: Array, sliding: bool) -> None:
        """Add what the films of ``wheel`` measured: see ``MeasuredCrossing``."""
        if self._origin_ns is not None:
            self.films_used += 1
            self.observable = True
            self._crossings.append(MeasuredCrossing(
                self._seconds(stamp_ns), WHEELS.index(wheel), slip, normalized_slip, covariance,
                sliding))

    def advance(self, now_ns: int, last: bool = False) -> Solution | None:
        """
        Return a new solution if the window moves on with the samples up to ``now_ns``.

        Without films and torques nothing could be published, and no window is solved.
        ``last``: the window ends at ``now_ns``, no further sample follows.
        """
        if self._next_hop_ns is None:
            self._next_hop_ns = (now_ns // HOP_NS + 1) * HOP_NS
        if now_ns < self._next_hop_ns and not last:
            return None
        end_ns = now_ns if last else now_ns // HOP_NS * HOP_NS
        self._next_hop_ns = (now_ns // HOP_NS + 1) * HOP_NS
        if not self._imu or not self._wheels:
            return None
        end = min(self._seconds(end_ns), self._wheels[-WHEEL_COLUMNS] + MAX_GAP,
                  self._imu[-IMU_COLUMNS] + MAX_GAP)
        begin = max(self._imu[0], self._wheels[0], end - LENGTH - SETTLING)
        data = WindowData(np.array(self._imu).reshape(-1, IMU_COLUMNS),
                          np.array(self._wheels).reshape(-1, WHEEL_COLUMNS), self._crossings)
        times = data.wheels[:, 0]
        if end - begin < HOP or (
                self.solution is not None and end <= self.solution.end) or (
                np.count_nonzero((times > begin) & (times <= end)) < CUBIC_POINTS):
            return None
        if not self.observable:
            self._forget(data, end - LENGTH - 2.0 * SETTLING)
            return None
        before = end - HOP if self.solution is None else self.solution.end
        try:
            self.solution = self._window.solve(data, begin, end, end - before)
        except np.linalg.LinAlgError:  # no numbers can be trusted: from the prior again
            self.failures += 1
            self._window, self.solution = GroundWindow(self._robot), None
            return None
        measured = self.solution.measurements
        self._shown |= bool(measured.torque_count.any())
        self._forget(data, end - LENGTH - 2.0 * SETTLING)
        return self.solution

    def state(self, solution: Solution) -> GroundState:
        """Return the state of the ground at the end of a window, friction at the slip there."""
        assert self._origin_ns is not None
        to_one, covariance = solution.hypothesis.one_ground(solution.end), solution.fit.covariance
        x = to_one @ solution.fit.x
        sigma = np.sqrt(np.diag(to_one @ covariance @ to_one.T))

        # as errors of one ground for both sides
        side_stiffness, side_friction, side_resistance = x[SIDES].tolist()

        def scaled(row: Unknown, side: float = 0.0) -> Uncertain:
            value = math.exp(x[row])
            return Uncertain(value, value * math.hypot(float(sigma[row]), side))

        values, slopes = solution.values_at(solution.end, range(len(WHEELS)))
        share, row = values[:, LOAD] / values[:, LOAD].sum(), to_one[Unknown.FRICTION].copy()
        loss = float(share @ values[:, LOSS])
        row[:DYNAMIC] += share @ slopes[:, LOSS]
        friction = math.exp(x[Unknown.FRICTION] + loss)
        friction_sigma = math.hypot(
            _upper(math.sqrt(row @ covariance @ row)), CURVE_ERROR, side_friction)
        share = 1.0 / (1.0 + math.exp(-x[Unknown.LATERAL_SHARE]))
        known = friction_sigma < MAX_SIGMA
        shared = (row @ covariance)[ROBOT]  # with the errors of the robot
        common = shared @ solve_spd(covariance[ROBOT][:, ROBOT], shared)
        # of sides that differ by more than the prior: its mean would be no resistance
        resistance_sigma = math.hypot(float(sigma[Unknown.RESISTANCE]), side_resistance)
        both = float(to_one[Unknown.STIFFNESS] @ covariance @ row) + side_stiffness * side_friction
        stiffness = scaled(Unknown.STIFFNESS, side_stiffness)
        imu_x, imu_y, _ = self._robot.imu.position
        return GroundState(
            self.end_ns, stiffness=stiffness,
            friction_coefficient=Uncertain(
                friction, friction * friction_sigma) if known else UNKNOWN,
            rolling_resistance=log_normal(float(x[Unknown.RESISTANCE]), resistance_sigma)
            if resistance_sigma <= LN_RESISTANCE.sigma else UNKNOWN,
            lateral_share=Uncertain(
                share, share * (1.0 - share) * float(sigma[Unknown.LATERAL_SHARE])),
            lateral_stiffness_ratio=scaled(Unknown.LATERAL_RATIO),
            center_of_mass_x=Uncertain(float(x[Unknown.COM_X]), float(sigma[Unknown.COM_X])),
            center_of_mass_y=Uncertain(float(x[Unknown.COM_Y]), float(sigma[Unknown.COM_Y])),
            imu_x=Uncertain(imu_x + float(x[Unknown.IMU_X]), float(sigma[Unknown.IMU_X])),
            imu_y=Uncertain(imu_y + float(x[Unknown.IMU_Y]), float(sigma[Unknown.IMU_Y])),
            motor_friction=scaled(Unknown.MOTOR_FRICTION),
            torque_scale=scaled(Unknown.TORQUE_SCALE),
            stiffness_friction_correlation=both * stiffness.value / (
                stiffness.sigma * friction_sigma),
            friction_common_sigma=min(math.hypot(math.sqrt(common), CURVE_ERROR), friction_sigma),
            change_age_left=self._window.change_age(0, solution.end),
            change_age_right=self._window.change_age(1, solution.end))

    def wheel_state(self, solution: Solution, stamp_ns: int, wheel: str) -> WheelState:
        """
        Return the state of ``wheel`` around an instant within the window.

        Its friction is unknown where an event or a disturbance is: the ground may just change.
        """
        time, index, fit = self._seconds(stamp_ns), WHEELS.index(wheel), solution.fit
        (values,), (slopes,) = solution.values_at(time, [index])
        covariance = fit.covariance
        spread = np.sqrt(np.einsum('ij,jk,ik->i', slopes, covariance[:DYNAMIC, :DYNAMIC], slopes))
        slip, normalized, load, force, loss = map(float, values)
        x, row = fit.x, np.zeros((3, SIZE))
        stiffness = solution.hypothesis.ground(index % 2, time).start
        friction = stiffness + Unknown.FRICTION - Unknown.STIFFNESS
        row[0, [stiffness, Unknown.SIDE_STIFFNESS]] = 1.0, SIDE_SIGNS[index]
        row[1, [friction, Unknown.SIDE_FRICTION]] = 1.0, SIDE_SIGNS[index]
        row[2] = row[1] - row[0]
        logs = row @ x + [0.0, loss, loss]
        row[1:, :DYNAMIC] += slopes[LOSS]
        errors = np.sqrt(np.einsum('ij,jk,ik->i', row, covariance, row))
        load_sigma = math.hypot(float(spread[2]), self._load_sigma * load)
        friction_sigma = _upper(float(errors[1]))
        mu_sigma = math.hypot(friction_sigma, CURVE_ERROR)
        mu, c_x = math.exp(logs[1]), math.exp(logs[0])
        critical = float(critical_slip(mu, load, c_x))
        known = friction_sigma < MAX_SIGMA and not solution.hypothesis.is_disturbed(time)
        return WheelState(
            Uncertain(slip, float(spread[0])), Uncertain(normalized, float(spread[1])),
            Uncertain(load, load_sigma),
            Uncertain(force, math.hypot(float(spread[3]), MODEL_ERROR * force)),
            Uncertain(c_x, c_x * float(errors[0])),
            Uncertain(mu, mu * mu_sigma) if known else UNKNOWN,
            Uncertain(critical, critical * math.hypot(float(errors[2]), load_sigma / load))
            if known else UNKNOWN)

    def _seconds(self, stamp_ns: int) -> float:
        assert self._origin_ns is not None
        return (stamp_ns - self._origin_ns) / NS_PER_S

    def _append(self, rows: array[float], row: tuple[float, ...]) -> None:
        """Append ``row``, which begins with its time [s]; after a gap, the window restarts."""
        if rows and row[0] - rows[-len(row)] > MAX_GAP:
            del rows[:]
        if not rows or row[0] > rows[-len(row)]:
            rows.extend(row)

    def _add_wheels(self, time: float, sample: WheelSample) -> None:
        """Add angles; those of a wheel that is not measured are those of its side."""
        speed = _of_sides(sample.velocity)
        before = self._angles
        if sample.position is None:
            elapsed = time - self._wheels[-WHEEL_COLUMNS] if self._wheels else 0.0
            self._angles = before + speed * min(max(elapsed, 0.0), MAX_GAP)
        else:
            self._angles = _of_sides(sample.position)
            if self._wheels and any(map(
                    is_speed_contradicted, (self._angles - before) / max(
                        time - self._wheels[-WHEEL_COLUMNS], 1e-3), speed)):
                del self._wheels[:]  # the counter was reset
        effort = sample.effort or (math.nan,) * 4
        self.observable |= sample.effort is not None and math.isfinite(sum(sample.effort))
        self._append(self._wheels, (time, *self._angles, *effort))

    def _add_odometry(self, time: float, sample: Odometry) -> None:
        """Add the motion of an estimate of others in place of the IMU, at its position."""
        last, self._odometry = self._odometry, sample
        if last is None or sample.stamp_ns <= last.stamp_ns:
            return
        elapsed = (sample.stamp_ns - last.stamp_ns) / NS_PER_S
        u, v, w = sample.linear[0], sample.linear[1], sample.angular[2]
        du, dv, dw = ((new - old) / elapsed for new, old in (
            (u, last.linear[0]), (v, last.linear[1]), (w, last.angular[2])))
        arm_x, arm_y, _ = self._robot.imu.position
        self._append(self._imu, (time, w, du - v * w - dw * arm_y - w * w * arm_x,
                                 dv + u * w + dw * arm_x - w * w * arm_y))

    def _forget(self, data: WindowData, time: float) -> None:
        """Drop samples before ``time`` [s]."""
        for values, rows in ((self._imu, data.imu), (self._wheels, data.wheels)):
            del values[:rows[rows[:, 0] < time].size]
        self._crossings = [one for one in self._crossings if one.time >= time]


def _upper(sigma: float) -> float:
    """
    Return how far a friction may be larger, relative, for the ``sigma`` of its logarithm.

    Adhering tires show 1 / mu with a Gaussian error: mu is less certain to larger values.
    """
    return sigma / (1.0 - sigma) if sigma < 1.0 else math.inf


def _of_sides(values: Sequence[float]) -> Array:
    """Return values (4,) of the wheels; NaN is replaced by the other wheel of the side."""
    found = np.array(values, dtype=float)
    other = found[[2, 3, 0, 1]]
    return np.where(np.isnan(found), other, found)
