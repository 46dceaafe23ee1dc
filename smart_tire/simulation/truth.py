# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Ground truth of the simulated robot: motion, slip, and the quantities of each crossing."""

from __future__ import annotations

from collections.abc import Iterator
import math

import numpy as np

from smart_tire import rotation
from smart_tire.arrays import Array
from smart_tire.messages import topic_of
from smart_tire.models.tire import brush_tire, strain_charge
from smart_tire.models.vehicle import skid_steer
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import four, Friction, NAN, Odometry, WheelSlip
from smart_tire.simulation.films import FilmSampler, patch_position, WheelTrace
from smart_tire.simulation.plant import Plant
from smart_tire.uncertain import Uncertain, UNKNOWN

Truth = Odometry | WheelSlip | Friction

ZERO_COVARIANCE = (0.0,) * 36
# arguments of CrossingTruth._quantities, averaged over a crossing
MEAN_QUANTITIES = ('rolling_speed', 'slip', 'total_slip', 'friction', 'load', 'stiffness', 'force')


def truth_topic(truth: Truth) -> str:
    """Return the topic of ``truth``."""
    return f'ground_truth/{topic_of(truth)}'


def true_odometry(plant: Plant, stamp_ns: int) -> Odometry:
    """Return pose and twist of the plant; ``odom`` is its start pose."""
    x, y, yaw = plant.start
    cos, sin = math.cos(yaw), math.sin(yaw)
    position = (cos * (plant.x - x) + sin * (plant.y - y),
                cos * (plant.y - y) - sin * (plant.x - x), 0.0)
    return Odometry(stamp_ns, position, rotation.quaternion(0.0, 0.0, plant.yaw - yaw),
                    (plant.v_x, plant.v_y, 0.0), (0.0, 0.0, plant.yaw_rate),
                    ZERO_COVARIANCE, ZERO_COVARIANCE)


def true_slip(plant: Plant, robot: RobotParams, stamp_ns: int) -> WheelSlip:
    """Return the wheel slips of the plant; NaN at standstill."""
    rolling = robot.wheel_radius * np.array(plant.wheel_speed)
    v_x = np.array(plant.wheel_v_x)
    ratio = skid_steer.slip_ratio(rolling, v_x, robot.slip.standstill_speed)
    sigma = np.where(np.isnan(ratio), 1.0, 0.0)
    return WheelSlip(stamp_ns, four(ratio.tolist()), four((rolling - v_x).tolist()),
                     four(sigma.tolist()))


class CrossingTruth:
    """
    Detects complete crossings of the patch by a group of films of one wheel, e.g. a pair.

    ``group`` are the indices of the films, by default those of the first group. By the position
    of their center, within ``_reach`` of that of the patch::

                  enters at a side              leaves at the other side
        outside -------------------> inside ----------------------------> outside, a crossing
           ^                           |     leaves at the side of entry
           +---------------------------+-------------------------------- no crossing

    Films that are inside at first have no side of entry: they leave without a crossing.
    """

    def __init__(self, films: FilmSampler, robot: RobotParams,
                 group: tuple[int, ...] | None = None) -> None:
        group = robot.film_groups[0] if group is None else group
        self._wheel, self._robot = films.wheel, robot
        self._first, last = films.center_angles[group[0]], films.center_angles[group[-1]]
        self._center = 0.5 * (self._first + last)  # rad
        # film 1 is in the first group only
        self._gain = robot.film.gains(films.wheel)[0] if group[0] == 0 else NAN
        # m, distance of the group from the patch center at which all films are outside
        self._reach = 0.5 * (robot.wheel_radius * (last - self._first) + robot.film.length
                             + robot.tire.contact_length)
        self._last: tuple[int, float] | None = None  # time and position [m] of the latest sample
        self._entry = 0.0      # side of entry of the present crossing, -1 or 1; 0: none
        self._center_ns = 0    # time at the patch center
        # sums and counts while the first film is inside
        self._sums = np.zeros((2, len(MEAN_QUANTITIES)))

    def ended_in(self, trace: WheelTrace) -> list[Friction]:
        """Return the crossings that end in ``trace``; traces are consecutive."""
        radius = self._robot.wheel_radius
        past, _ = patch_position(trace.angle, self._center, radius)
        if self._last is not None and not self._entry and np.all(np.abs(past) >= self._reach):
            self._last = trace.stamps_ns[-1], float(past[-1])
            return []
        return list(self._crossings(trace, past.tolist()))

    def _crossings(self, trace: WheelTrace, positions: list[float]) -> Iterator[Friction]:
        table = self._table(trace)
        for i, (stamp_ns, position) in enumerate(zip(trace.stamps_ns, positions)):
            last_ns, last = self._last or (stamp_ns, position)
            inside, was_inside = abs(position) < self._reach, abs(last) < self._reach
            if inside and not was_inside:
                self._entry = math.copysign(1.0, last)
                self._sums[:] = 0.0
            if self._entry and (position < 0.0) != (last < 0.0):
                share = last / (last - position)
                self._center_ns = last_ns + round(share * (stamp_ns - last_ns))
            if inside and self._entry:
                self._sums += table[i]
            if was_inside and not inside:
                if self._entry and (position > 0.0) != (self._entry > 0.0):
                    yield self._crossing()
                self._entry = 0.0
            self._last = stamp_ns, position

    def _table(self, trace: WheelTrace) -> Array:
        """Return values and weights of ``MEAN_QUANTITIES``, shape (n, 2, quantities)."""
        tire, robot = self._robot.tire, self._robot
        past, _ = patch_position(trace.angle, self._first, robot.wheel_radius)
        inside = np.abs(past) <= 0.5 * (tire.contact_length - robot.film.length)
        s_x, s_y = trace.slip_vector()
        force, _ = brush_tire.brush_force(s_x, s_y, trace.friction, trace.load, trace.stiffness)
        slip = skid_steer.slip_ratio(trace.rolling_speed, trace.v_x, robot.slip.standstill_speed)
        values = np.stack([trace.rolling_speed, slip, np.hypot(s_x, s_y), trace.friction,
                           trace.load, trace.stiffness, force])
        valid = inside & np.isfinite(values)
        return np.stack([np.where(valid, values, 0.0), valid]).transpose(2, 0, 1)

    def _crossing(self) -> Friction:
        sums, counts = self._sums
        means = np.divide(sums, counts, out=np.full_like(sums, np.nan), where=counts > 0.0)
        values = self._quantities(**dict(zip(MEAN_QUANTITIES, means.tolist())))
        return Friction(self._center_ns, self._wheel, **{
            name: UNKNOWN if math.isnan(value) else Uncertain(value, 0.0)
            for name, value in values.items()})

    def _quantities(self, *, rolling_speed: float, slip: float, total_slip: float,
                    friction: float, load: float, stiffness: float,
                    force: float) -> dict[str, float]:
        """Return FRICTION_QUANTITIES from the mean values of a crossing."""
        film, length = self._robot.film.length, self._robot.tire.contact_length
        critical = float(brush_tire.critical_slip(friction, load, stiffness))
        adhesion = float(brush_tire.adhesion_ratio(total_slip, friction, load, stiffness))
        stretch = interval = NAN
        if slip > 0.0 and not math.isnan(self._gain):  # two peaks exist in traction only
            x_m = float(strain_charge.peak_position(adhesion * length, film, length))
            stretch = self._gain * float(strain_charge.overlap_integral(
                x_m, slip, total_slip, critical, film, length))
            interval = (length - x_m) / abs(rolling_speed)
        return {
            'friction_coefficient': friction, 'friction_coefficient_single': friction,
            'adhesion_ratio': adhesion, 'adhesion_length': adhesion * length,
            'stretch_voltage': stretch, 'peak_interval': interval,
            'slip': slip, 'film_slip': slip, 'total_slip': total_slip,
            'normal_load': load, 'stiffness': stiffness, 'critical_slip': critical,
            'traction_force': force}
