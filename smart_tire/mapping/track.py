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
Friction on the tracks of a drive, from its estimates: what maps are made of.

The estimators take both wheels of a side to be on one ground, which changes when the middle
between them crosses a border. So each side has one track, midway between its wheels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from smart_tire.arrays import Array, Instants
from smart_tire.estimates import (
    at, FrictionEstimate, GroundEstimate, PoseEstimate, SIDES, Tabular)
from smart_tire.estimation.ground.unknowns import BLOCK_TIME, GROUND_WALK, LENGTH, TIME_ERROR
from smart_tire.models.tire.brush_tire import LN_FRICTION
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import NS_PER_S

SPACING = 0.025  # m of travel between two rows, a quarter of a cell of 0.1 m
# Of the estimator's random walk of ln mu, variance per meter of travel.
WALK = (GROUND_WALK * LN_FRICTION.sigma) ** 2
# s, error of the time of a change of the ground; measured, 60 borders of benchmarks.friction_map
# --first 101: 0.10 s rms, without bias
CHANGE_SIGMA = 0.1
TIME_TOLERANCE_NS = round(0.5 * BLOCK_TIME * NS_PER_S)  # between reports of one change of ground
COLUMNS = ('stamp_ns', 'position', 'covariance', 'friction', 'sigma', 'common', 'side', 'block')
POSITION = ('x_variance', 'xy_covariance', 'y_variance')


@dataclass(frozen=True, eq=False, repr=False)
class FrictionTrack(Tabular):
    """
    Friction along the tracks of one drive, a row for each ``SPACING`` of travel of a side.

    * ``stamp_ns``: (n,) ns
    * ``position``: (n, 2) m, midway between the wheels of the side, in ``frame``
    * ``covariance``: (n, 3) m2, of the position: x, x with y, y
    * ``friction``: (n,) -, mu
    * ``sigma``: (n,) -, standard deviation of mu
    * ``common``: (n,) -, part of it by errors that all estimates of the robot share
    * ``side``: (n,) 0 left, 1 right
    * ``block``: (n,) number of the part of the drive; errors of two parts are independent, but for
      those in ``common``, those of one part are fully correlated
    * ``drive``, ``robot``: names; drives of one robot share its errors
    """

    stamp_ns: Instants
    position: Array
    covariance: Array
    friction: Array
    sigma: Array
    common: Array
    side: Instants
    block: Instants
    frame: str = 'odom'
    drive: str = ''
    robot: str = ''

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        names = {name: np.full(len(self), getattr(self, name))
                 for name in ('drive', 'robot', 'frame')}
        return {**names, **dict(zip('xy', self.position.T)),
                **dict(zip(POSITION, self.covariance.T)),
                **{name: getattr(self, name)
                   for name in ('friction', 'sigma', 'common', 'side', 'block')}}

    @classmethod
    def of_columns(cls, stamp_ns: Instants, columns: dict[str, Any]) -> Iterator[FrictionTrack]:
        """Yield the tracks in the joined ``columns`` of several drives."""
        drives = np.asarray(columns['drive'])
        for drive in dict.fromkeys(drives.tolist()):
            own = {name: np.asarray(column)[drives == drive] for name, column in columns.items()}
            yield cls(np.asarray(stamp_ns)[drives == drive],
                      np.column_stack([own['x'], own['y']]),
                      np.column_stack([own[name] for name in POSITION]),
                      own['friction'], own['sigma'], own['common'], own['side'], own['block'],
                      str(own['frame'][0]), str(drive), str(own['robot'][0]))


def friction_track(poses: PoseEstimate, grounds: GroundEstimate, crossings: FrictionEstimate,
                   robot: RobotParams, *, frame: str = 'odom', drive: str = '', name: str = ''
                   ) -> FrictionTrack:
    """
    Return the friction along the tracks of ``poses``, in ``frame``; ``name`` is the robot's.

    Between two estimates on one ground it is interpolated; it is unknown before the first one,
    where the estimators do not know it, and in gaps longer than their window. Estimates from
    between a change and the first report of it are of the ground before, and are not used.
    """
    sides = [_side(index, poses, grounds, crossings, robot) for index in range(len(SIDES))]
    columns: dict[str, Any] = {column: np.concatenate(parts)
                               for column, *parts in zip(COLUMNS, *sides)}
    return FrictionTrack(**columns, frame=frame, drive=drive, robot=name)


def _side(side: int, poses: PoseEstimate, grounds: GroundEstimate, crossings: FrictionEstimate,
          robot: RobotParams) -> tuple[Any, ...]:
    """Return the columns of the track of one side."""
    positions = side_positions(poses.pose, robot, side)
    driven = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1)))
    rows_at = np.searchsorted(driven, np.arange(0.0, driven[-1], SPACING)) if len(poses) > 1 \
        else np.empty(0, np.int64)
    stamps, travel = poses.stamp_ns[rows_at], driven[rows_at]
    changes, reported = ground_changes(grounds, side)
    log, sigma, common = (np.full(len(stamps), math.nan) for _ in range(3))
    block = np.zeros(len(stamps), np.int64)
    first = 0
    for begin, end, times, values in _segments(side, changes, reported, grounds, crossings):
        rows = np.flatnonzero((stamps >= begin) & (stamps < end))
        if not len(rows) or not np.isfinite(values[0]).any():
            continue
        log[rows], sigma[rows], common[rows] = _between(
            stamps[rows], begin, end, times, np.column_stack(values)).T
        own = np.median((values[1] ** 2 - values[2] ** 2)[np.isfinite(values[0])])
        # an error of variance P that a random walk of q per meter renews has the correlation
        # length P / q; means over twice this length are independent
        length = 2.0 * max(float(own), WALK * SPACING) / WALK
        parts = ((travel[rows] - travel[rows[0]]) / length).astype(np.int64)
        block[rows] = first + parts
        first += int(parts[-1]) + 1
    for change in changes.tolist():
        _mix(log, sigma, (stamps - change) / NS_PER_S)
    known = np.isfinite(log)
    mu = np.exp(log[known])
    jacobian = _jacobian(poses.pose[rows_at[known]], robot, side)
    spread = jacobian @ poses.covariance[rows_at[known]] @ jacobian.transpose(0, 2, 1)
    return (stamps[known], positions[rows_at[known]], spread.reshape(-1, 4)[:, [0, 1, 3]], mu,
            mu * sigma[known], mu * common[known], np.full(known.sum(), side), block[known])


def _mix(log: Array, sigma: Array, since: Array) -> None:
    """
    Mix both grounds of a change, ``since`` [s], where the error of its time may exchange them.

    In place: mean and standard deviation of the mixture. Where one ground is unknown, so are
    both at times at which estimators use no measurements.
    """
    near = np.flatnonzero(np.abs(since) < 3.0 * CHANGE_SIGMA)
    sides = [near[since[near] < 0.0], near[since[near] >= 0.0]]
    edges = [log[rows[[index]]] for rows, index in zip(sides, (-1, 0)) if len(rows)]
    if len(edges) < 2 or not np.isfinite(edges).all():
        log[np.abs(since) < TIME_ERROR] = math.nan
        return
    for rows, other in zip(sides, edges[::-1]):
        wrong = np.array([0.5 * math.erfc(abs(one) / CHANGE_SIGMA / math.sqrt(2.0))
                          for one in since[rows].tolist()])
        apart = other - log[rows]
        log[rows] += wrong * apart
        sigma[rows] = np.sqrt(sigma[rows] ** 2 + wrong * (1.0 - wrong) * apart ** 2)


def _between(wanted: Instants, begin: float, end: float, times: Instants, table: Array) -> Array:
    """
    Return rows of ``table`` (m, 3) at ``wanted`` (n,), interpolated; NaN where they are unknown.

    After a change of the ground, until something is known, it is the first one that is known;
    before a change the last one.
    """
    times, rows = np.unique(times, return_index=True)
    table, known = table[rows], np.flatnonzero(np.isfinite(table[rows, 0]))
    first = known[0] if math.isfinite(begin) else 0
    last = known[-1] + 1 if math.isfinite(end) else len(times)
    edges = [[int(one)] if math.isfinite(one) else [] for one in (begin, end)]
    return at(wanted, np.concatenate([edges[0], times[first:last], edges[1]]).astype(np.int64),
              np.concatenate([table[first:first + len(edges[0])], table[first:last],
                              table[last - len(edges[1]):last]]), LENGTH)


def _segments(side: int, changes: Instants, reported: Instants, grounds: GroundEstimate,
              crossings: FrictionEstimate
              ) -> Iterator[tuple[float, float, Instants, tuple[Array, Array, Array]]]:
    """
    Yield begin and end [ns] on each ground, and the estimates there.

    Their timestamps (m,), ln mu, its standard deviation and the common part of it, NaN where it is
    unknown. They are those of patch crossings of the side, without any those of both sides.
    """
    right = np.char.endswith(crossings.wheel, SIDES[1]) if len(crossings) else np.empty(0, bool)
    own = right == (side == 1)
    both = np.isfinite(grounds.change_age)
    sources = [
        (crossings.stamp_ns[own], crossings.friction_coefficient.value[own],
         crossings.friction_coefficient.sigma[own]),
        # while only one side has changed, both are on different grounds
        *((grounds.stamp_ns[rows], grounds.friction_coefficient.value[rows],
           grounds.friction_coefficient.sigma[rows]) for rows in [both[:, 0] == both[:, 1]])]
    for begin, end, since in zip((-math.inf, *changes), (*changes, math.inf),
                                 (-math.inf, *reported)):
        chosen = [(one[0] >= max(begin, since)) & (one[0] < end) for one in sources]
        source, used = next((
            (one, used) for one, used in zip(sources, chosen)
            if np.isfinite(one[1][used]).any()), (sources[-1], chosen[-1]))
        times, value, sigma = (column[used] for column in source)
        relative = sigma / value
        common = relative if not len(grounds) else np.minimum(relative, np.interp(
            times, grounds.stamp_ns, grounds.friction_common_sigma))
        yield begin, end, times, (np.log(value), relative, common)


def ground_changes(grounds: GroundEstimate, side: int) -> tuple[Instants, Instants]:
    """Return when [ns] the ground under a side has changed, and when this was first reported."""
    age = grounds.change_age[:, side]
    rows = np.flatnonzero(np.isfinite(age))
    times = grounds.stamp_ns[rows] - np.round(age[rows] * NS_PER_S).astype(np.int64)
    new = np.append(True, np.diff(times) > TIME_TOLERANCE_NS)[:len(times)]
    return times[new], grounds.stamp_ns[rows[new]]


def side_positions(pose: Array, robot: RobotParams, side: int) -> Array:
    """Return the positions (n, 2) [m] midway between the wheels of a side, from (n, 3) poses."""
    return pose[:, :2] + _arm(pose, robot, side)


def _arm(pose: Array, robot: RobotParams, side: int) -> Array:
    half = 0.5 * robot.track_width * (1 - 2 * side)
    return half * np.column_stack([-np.sin(pose[:, 2]), np.cos(pose[:, 2])])


def _jacobian(pose: Array, robot: RobotParams, side: int) -> Array:
    """Return the derivatives (n, 2, 3) of ``side_positions`` by x, y and yaw."""
    arm = _arm(pose, robot, side)
    found = np.tile(np.eye(2, 3), (len(pose), 1, 1))
    found[:, 0, 2], found[:, 1, 2] = -arm[:, 1], arm[:, 0]
    return found
