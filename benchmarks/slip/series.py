"""What an estimator made of a run, and what was true, as plain series."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
import math

import numpy as np

from smart_tire.analysis.series import Floats, PoseSeries, Series, SlipSeries, Stamps, Table
from smart_tire.models.vehicle.skid_steer import icr, SIDE_SIGNS
from smart_tire.parameters import RobotParams
from smart_tire.samples import Icr, LEFT, NS_PER_S, Odometry, RIGHT, Sample, WheelSlip

MEMBERS = (LEFT, RIGHT)  # wheels of the two sides
NO_STAMPS: Stamps = np.empty(0, np.int64)
TAIL = 0.5               # s, at the end of a run: estimates of it may still be awaited
MIN_TURN = 0.05          # rad/s; slower, the true centre of rotation is too far away to be told


@dataclass(frozen=True)
class IcrSeries:
    """Centres of rotation in ``base_link``; there are none while the robot does not turn."""

    stamp_ns: Stamps = field(default_factory=NO_STAMPS.copy)
    place: Floats = field(default_factory=lambda: np.empty((0, 2)))  # m, x = S and y


@dataclass(frozen=True)
class Statistic:
    """Normalised innovations squared over time, over their degrees of freedom: 1 is right."""

    stamp_ns: Stamps = field(default_factory=NO_STAMPS.copy)
    value: Floats = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class EstimateSeries:
    """
    What one method made of a run.

    Covariances and sigmas that a method does not give are NaN.
    """

    poses: PoseSeries
    slips: SlipSeries
    icr: IcrSeries = field(default_factory=IcrSeries)
    innovations: Statistic = field(default_factory=Statistic)
    step_us: float = math.nan  # CPU time per step of the grid


@dataclass(frozen=True)
class Truth:
    """The true run; all arrays share the stamps."""

    stamp_ns: Stamps
    poses: PoseSeries
    ratio: Floats    # (n, 4), NaN where neither wheel nor robot moves
    rolling: Floats  # (n, 4) m/s, r w
    radius: float    # m

    @property
    def icr(self) -> IcrSeries:
        """Return the true centres of rotation, NaN while the robot hardly turns."""
        twist = self.poses.twist.copy()
        twist[np.abs(twist[:, 2]) < MIN_TURN] = math.nan
        return IcrSeries(self.stamp_ns, np.column_stack(icr(*twist.T)))


def collected(records: Iterable[Sample]) -> tuple[Series, IcrSeries]:
    """Return poses and slips of ``records``, and the centres of rotation among them."""
    series, centres = Series(), Table(2)
    for record in records:
        if isinstance(record, Icr):
            centres.add(record.stamp_ns, (record.x, record.y))
        else:
            series.add(record)
    return series, IcrSeries(*centres.arrays())


def as_estimate(records: Iterable[Sample], innovations: Statistic | None = None,
                step_us: float = math.nan) -> EstimateSeries:
    """Return what ``records`` (Odometry, WheelSlip, Icr) tell."""
    series, centres = collected(records)
    return EstimateSeries(
        series.poses(), series.slips(), centres, innovations or Statistic(), step_us)


def as_truth(records: Iterable[Sample], robot: RobotParams) -> Truth:
    """
    Return the truth of ``records``: an Odometry and a WheelSlip at every stamp.

    The last ``TAIL`` is left out: no estimator has told of it when the messages end.
    """
    series, sliding = Series(), Table(4)
    for record in records:
        if isinstance(record, (Odometry, WheelSlip)):
            series.add(record)
        if isinstance(record, WheelSlip):
            sliding.add(record.stamp_ns, record.slip_velocity)
    poses, slips, (stamps, slide) = series.poses(), series.slips(), sliding.arrays()
    told = (np.searchsorted(stamps, stamps[-1] - round(TAIL * NS_PER_S), side='right')
            if len(stamps) else 0)
    if not (np.array_equal(poses.stamp_ns, stamps) and told > 1):
        raise ValueError('truth needs two or more instants with both odometry and slip')
    v_x, W = poses.twist[:, 0], poses.twist[:, 2]
    ground = v_x[:, np.newaxis] - 0.5 * robot.track_width * SIDE_SIGNS * W[:, np.newaxis]
    return Truth(stamps[:told], _until(poses, told), slips.ratio[:told],
                 (slide + ground)[:told], robot.wheel_radius)


def _until(poses: PoseSeries, count: int) -> PoseSeries:
    return PoseSeries(poses.stamp_ns[:count], poses.pose[:count], poses.twist[:count],
                      poses.pose_covariance[:count], poses.twist_variance[:count])


def side_means(values: Floats) -> Floats:
    """Return the means (n, 2) of the two wheels of each side of ``values`` (n, 4)."""
    return np.stack([values[:, wheels].mean(axis=1) for wheels in MEMBERS], axis=1)
