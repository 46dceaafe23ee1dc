"""Bags to what identifications read, and what they find to parameter files."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
import math
from pathlib import Path

import numpy as np

from smart_tire.analysis.series import PoseSeries, seconds, Series, Stamps, Table
from smart_tire.bags import Bag
from smart_tire.calibration.recording import ImuRecord, PoseRecord, Recording, WheelRecord
from smart_tire.calibration.robot import geometry, icr
from smart_tire.calibration.robot.geometry import Geometry
from smart_tire.calibration.robot.icr import IcrFit
from smart_tire.errors import BagError, EstimatorError
from smart_tire.parameters import build, known_names, load_files, NODE_PARAMS, RobotParams, specs
from smart_tire.rotation import matrix
from smart_tire.samples import ImuSample, Odometry, WheelSample

REFERENCES = ('ground_truth/odom', 'overhead/odom')  # the first one that is there is taken
NO_REFERENCE = 'none'
LEAST = 20  # readings of a stream, below which there is nothing to identify


@dataclass(frozen=True)
class Span:
    """A stretch of a bag, in seconds after its first reading of an input."""

    since: float = 0.0
    until: float = math.inf


def load_robot(files: Iterable[Path]) -> RobotParams:
    """Return the robot that parameter files describe to the slip estimator; ParameterError."""
    return build(RobotParams, load_files(files, 'slip_estimator', known_names(
        NODE_PARAMS.values()), specs(RobotParams)))


def identify_geometry(path: Path, robot: RobotParams, *, since: float = 0.0,
                      until: float = math.inf, reference: str | None = None) -> Geometry:
    """
    Return what the bag at ``path`` tells between ``since`` and ``until`` [s after its start].

    ``reference`` names the topic of the reference, 'none' for none; by default it is found.
    Raises BagError if the bag can not be read, EstimatorError if it lacks the inputs.
    """
    recording = read_recording(path, robot, Span(since, until), reference)
    return geometry.identify_geometry(recording, robot)


def identify_icr(path: Path, robot: RobotParams, *, since: float = 0.0, until: float = math.inf,
                 reference: str | None = None) -> IcrFit:
    """Return S from the bag at ``path``; as ``identify_geometry``, EstimatorError if untold."""
    recording = read_recording(path, robot, Span(since, until), reference)
    return icr.identify_icr(recording, robot)


def read_recording(path: Path, robot: RobotParams, span: Span,
                   reference: str | None = None) -> Recording:
    """Return the inputs, in axes of ``base_link``, and the reference of a bag."""
    with Bag(path) as bag:
        topic = _reference(bag, reference)
        wanted = ('imu/data', 'wheel_states', *([topic] if topic else []))
        imu, wheels, poses = Table(6), _Wheels(), Series()
        for _, _, sample in bag.samples(wanted):
            if isinstance(sample, ImuSample):
                imu.add(sample.stamp_ns, (*sample.rate, *sample.acceleration))
            elif isinstance(sample, WheelSample):
                wheels.add(sample)
            elif isinstance(sample, Odometry):
                poses.add(sample)
    stamps, values = imu.arrays()
    for name, count in (('imu/data', len(stamps)), ('wheel_states', len(wheels))):
        if count < LEAST:
            raise EstimatorError(f'{path}: {count} readings of {name}, expected at least {LEAST}')
    origin = min(int(stamps[0]), wheels.first_ns)
    chosen = _within(stamps, origin, span)
    turn = matrix(*robot.imu.rotation)
    record = ImuRecord(seconds(stamps[chosen], origin), values[chosen, :3] @ turn.T,
                       values[chosen, 3:] @ turn.T)
    return Recording(record, wheels.record(origin, span),
                     _pose_record(poses.poses(), origin, span) if topic else None)


def _reference(bag: Bag, asked: str | None) -> str | None:
    """Return the topic of the reference; None without one."""
    if asked == NO_REFERENCE:
        return None
    names = REFERENCES if asked is None else (asked.strip('/'),)
    there = bag.match(names)
    if asked is not None and not there:
        raise BagError(f'{bag.path}: has no {asked}, expected one of {", ".join(REFERENCES)}')
    return next((name for name in names if name in there), None)


def _within(stamps: Stamps, origin: int, span: Span) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    time = seconds(stamps, origin)
    return (time >= span.since) & (time <= span.until)


class _Wheels:
    """Wheel readings as they come in."""

    def __init__(self) -> None:
        self._speeds, self._angles = Table(4), Table(4)

    def __len__(self) -> int:
        return len(self._speeds)

    def add(self, sample: WheelSample) -> None:
        self._speeds.add(sample.stamp_ns, sample.velocity)
        self._angles.add(sample.stamp_ns, sample.position or (math.nan,) * 4)

    @property
    def first_ns(self) -> int:
        return int(self._speeds.arrays()[0][0])

    def record(self, origin: int, span: Span) -> WheelRecord:
        stamps, speeds = self._speeds.arrays()
        angles = self._angles.arrays()[1]
        chosen = _within(stamps, origin, span)
        angles = angles[chosen]
        return WheelRecord(seconds(stamps[chosen], origin), speeds[chosen],
                           None if np.isnan(angles).any() else angles)


def _pose_record(poses: PoseSeries, origin: int, span: Span) -> PoseRecord | None:
    chosen = _within(poses.stamp_ns, origin, span)
    if chosen.sum() < LEAST:
        return None
    return PoseRecord(seconds(poses.stamp_ns[chosen], origin), poses.pose[chosen, :2],
                      poses.pose[chosen, 2])
