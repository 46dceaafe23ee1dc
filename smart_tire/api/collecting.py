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

"""Samples collected into the arrays of results and recordings."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
import math
from typing import cast

import numpy as np

from smart_tire.analysis.series import Series, Table
from smart_tire.api.results import (
    Estimates, FrictionEstimate, GroundEstimate, PoseEstimate, Quantity, RotationCenter,
    SlipEstimate, Truth)
from smart_tire.arrays import Array, Instants
from smart_tire.samples import (
    Friction, FRICTION_QUANTITIES, Icr, Sample, WHEELS, WheelSlip)


class Collector:
    """Estimates, or ground truth, added one by one and returned as arrays."""

    def __init__(self) -> None:
        self._series = Series()
        self._slips, self._centers = Table(3 * len(WHEELS)), Table(2)

    def add(self, sample: Sample) -> None:
        """Add an estimate."""
        self._series.add(sample)
        if isinstance(sample, WheelSlip):
            self._slips.add(sample.stamp_ns,
                            sample.ratio + sample.sigma + sample.slip_velocity)
        elif isinstance(sample, Icr):
            self._centers.add(sample.stamp_ns, (sample.x, sample.y))

    def estimates(self) -> Estimates:
        """Return everything added."""
        return Estimates(self._pose(), self._slip(), RotationCenter(*self._centers.arrays()),
                         self._ground(), friction_arrays(self._series.crossings))

    def truth(self) -> Truth:
        """Return pose, slip and friction."""
        return Truth(self._pose(), self._slip(), friction_arrays(self._series.crossings))

    def _pose(self) -> PoseEstimate:
        poses = self._series.poses()
        return PoseEstimate(poses.stamp_ns, poses.pose, poses.twist, poses.pose_covariance,
                            np.sqrt(poses.twist_variance))

    def _slip(self) -> SlipEstimate:
        stamps, rows = self._slips.arrays()
        return SlipEstimate(stamps, *np.split(rows, 3, axis=1))

    def _ground(self) -> GroundEstimate:
        grounds = self._series.grounds()
        return GroundEstimate(grounds.stamp_ns, *(
            map(Quantity, grounds.value.T, grounds.sigma.T)))


def friction_arrays(crossings: Iterable[Friction]) -> FrictionEstimate:
    """Return the estimates of ``crossings``, in order of time."""
    ordered = sorted(crossings, key=lambda crossing: crossing.stamp_ns)
    pairs = np.array([[one.quantity(name) for name in FRICTION_QUANTITIES] for one in ordered],
                     dtype=float).reshape(-1, len(FRICTION_QUANTITIES), 2)
    return FrictionEstimate(
        np.array([one.stamp_ns for one in ordered], np.int64),
        np.array([one.wheel for one in ordered], np.str_),
        *(Quantity(pairs[:, i, 0], pairs[:, i, 1]) for i in range(len(FRICTION_QUANTITIES))))


class Rows:
    """Growing table of numbers in order of reception; a row may be longer than those before."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._stamps, self._received, self._values = array('q'), array('q'), array('d')

    def add(self, stamp_ns: int, receive_ns: int, row: Sequence[float]) -> None:
        """Append one row; missing numbers at its end are NaN."""
        if len(row) > self._width:
            self._widen(len(row))
        self._stamps.append(stamp_ns)
        self._received.append(receive_ns)
        self._values.extend(row)
        self._values.extend([math.nan] * (self._width - len(row)))

    def arrays(self) -> tuple[Instants, Instants, Array]:
        """Return timestamps (n,), receive times (n,) and values (n, width)."""
        return (np.array(self._stamps, np.int64), np.array(self._received, np.int64),
                np.array(self._values, float).reshape(-1, self._width))

    def _widen(self, width: int) -> None:
        old = np.array(self._values, float).reshape(-1, self._width)
        wide = np.full((len(old), width), math.nan)
        wide[:, :self._width] = old
        self._width, self._values = width, array('d', cast('list[float]', wide.ravel().tolist()))
