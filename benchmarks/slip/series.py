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

"""Estimates and ground truth of a run as time series."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
import math

import numpy as np

from smart_tire.analysis.series import Floats, Stamps
from smart_tire.models.vehicle.skid_steer import icr, SIDE_SIGNS
from smart_tire.parameters import RobotParams
from smart_tire.recording import PoseSeries, Recording, SlipSeries
from smart_tire.samples import Icr, LEFT, NS_PER_S, RIGHT, Sample, WheelSlip

SIDE_WHEELS = (LEFT, RIGHT)  # of the two sides
NO_STAMPS: Stamps = np.empty(0, np.int64)
EXCLUDED_END = 0.5  # s, at the end of a run, for which estimates may be missing
MIN_YAW_RATE = 0.05  # rad/s, for a true ICR


@dataclass(frozen=True)
class IcrSeries:
    """Instantaneous centers of rotation in ``base_link``, only while the robot turns."""

    stamp_ns: Stamps = field(default_factory=NO_STAMPS.copy)
    position: Floats = field(default_factory=lambda: np.empty((0, 2)))  # m, x = S and y


@dataclass(frozen=True)
class Statistic:
    """Normalized innovation squared per degree of freedom over time: 1 if consistent."""

    stamp_ns: Stamps = field(default_factory=NO_STAMPS.copy)
    value: Floats = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class EstimateSeries:
    """
    Estimates of a run by one method.

    Covariances and sigmas are NaN if the method does not provide them.
    """

    poses: PoseSeries
    slips: SlipSeries
    icr: IcrSeries = field(default_factory=IcrSeries)
    innovations: Statistic = field(default_factory=Statistic)
    step_us: float = math.nan  # CPU time per step of the grid


@dataclass(frozen=True)
class Truth:
    """Ground truth of a run; all arrays share the timestamps."""

    stamp_ns: Stamps
    poses: PoseSeries
    ratio: Floats    # (n, 4), NaN at standstill
    rolling: Floats  # (n, 4) m/s, r w
    radius: float    # m

    @property
    def icr(self) -> IcrSeries:
        """Return the true ICR, NaN below ``MIN_YAW_RATE``."""
        twist = self.poses.twist.copy()
        twist[np.abs(twist[:, 2]) < MIN_YAW_RATE] = math.nan
        return IcrSeries(self.stamp_ns, np.column_stack(icr(*twist.T)))


def collect(records: Iterable[Sample]) -> tuple[Recording, IcrSeries]:
    """Return poses and slips, and the ICR series, of ``records``."""
    series = Recording(records)
    centers = series.stream(Icr).ordered
    return series, IcrSeries(centers.stamp_ns, centers['position'])


def as_estimate(records: Iterable[Sample], innovations: Statistic | None = None,
                step_us: float = math.nan) -> EstimateSeries:
    """Return the estimates in ``records`` (Odometry, WheelSlip, Icr) as series."""
    series, centers = collect(records)
    return EstimateSeries(
        series.poses(), series.slips(), centers, innovations or Statistic(), step_us)


def as_truth(records: Iterable[Sample], robot: RobotParams) -> Truth:
    """
    Return the ground truth in ``records``: an Odometry and a WheelSlip at every timestamp.

    The last ``EXCLUDED_END`` is excluded.
    """
    series = Recording(records)
    poses, slips, sliding = series.poses(), series.slips(), series.stream(WheelSlip).ordered
    stamps, slip_velocity = sliding.stamp_ns, sliding['velocity']
    count = (np.searchsorted(stamps, stamps[-1] - round(EXCLUDED_END * NS_PER_S), side='right')
             if len(stamps) else 0)
    if not (np.array_equal(poses.stamp_ns, stamps) and count > 1):
        raise ValueError('ground truth needs at least two timestamps with odometry and slip')
    v_x, W = poses.twist[:, 0], poses.twist[:, 2]
    ground = v_x[:, np.newaxis] - 0.5 * robot.track_width * SIDE_SIGNS * W[:, np.newaxis]
    return Truth(stamps[:count], _first(poses, count), slips.ratio[:count],
                 (slip_velocity + ground)[:count], robot.wheel_radius)


def _first(poses: PoseSeries, count: int) -> PoseSeries:
    return PoseSeries(poses.stamp_ns[:count], poses.pose[:count], poses.twist[:count],
                      poses.pose_covariance[:count], poses.twist_variance[:count])


def side_means(values: Floats) -> Floats:
    """Return the means (n, 2) of the two wheels of each side of ``values`` (n, 4)."""
    return np.stack([values[:, wheels].mean(axis=1) for wheels in SIDE_WHEELS], axis=1)
