"""
Straight segments of a recording, with wheel speeds and integrated acceleration.

The errors of the wheel speed against the integral of the acceleration have a known covariance:
timestamp jitter and quantization, shared by neighboring intervals with opposite signs, and the
random walk of the integrated accelerometer noise since the start of the segment. A segment begins
and ends in motion: its initial speed is unknown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from smart_tire.arrays import Array
from smart_tire.calibration.recording import Recording, Signal, wheel_intervals, WheelIntervals
from smart_tire.numerics.robust import noise_level
from smart_tire.parameters import RobotParams

Indices = NDArray[np.intp]

MIN_INTERVAL = 0.05    # s; shorter intervals between wheel samples are merged
MIN_SPEED = 0.2        # m/s; at lower speeds quantization and static friction dominate
MAX_TURN_SHARE = 0.05  # of the speed: lateral speed, or half the difference of the sides
MIN_SEGMENT_INTERVALS = 6
MAX_SEGMENT_INTERVALS = 400  # longer segments are split: the covariance is a dense matrix
MAX_IMU_GAP = 0.05           # s between IMU samples; over longer gaps the speed is not integrated
ROUGHNESS_SIGMA = 0.001      # m/s, of an interval, from uneven ground; assumed


@dataclass(frozen=True)
class StraightSegments:
    """
    All straight segments of a recording: n intervals between wheel samples, m IMU samples.

    The IMU samples cover the whole recording; ``sample_segment`` is the segment of each, and
    samples between two segments belong to either.
    """

    row: Indices  # (n,) of the intervals among all intervals of the recording
    begin: Array                         # (n,) s, by the timestamps of the wheels
    end: Array                           # (n,) s
    speed: Array                         # (n,) m/s, mean r w of the four wheels
    segment: Indices                     # (n,) index of the segment, from 0
    count: int                           # of segments
    time: Array                          # (m,) s, of the IMU samples
    force: Array                         # (m,) m/s2, forward specific force
    speed_gain: Array                    # (m,) m/s, its integral since the start of the segment
    elapsed: Array                       # (m,) s since the start of the segment
    sample_segment: Indices              # (m,)
    covariance_roots: tuple[Array, ...]  # per segment, lower Cholesky factor for ``speed``

    def whitened(self, rows: Array) -> Array:
        """Return ``rows`` (n,) or (n, p) of wheel speeds, whitened by their covariance."""
        white = np.empty_like(rows)
        for number, root in enumerate(self.covariance_roots):
            own = self.segment == number
            white[own] = solve_triangular(root, rows[own], lower=True, check_finite=False)
        return white


def straight_segments(recording: Recording, robot: RobotParams,
                      left_out: Indices | None = None) -> StraightSegments | None:
    """
    Return the straight segments of a recording, None if there are none.

    ``left_out`` are rows of intervals to exclude, each of which ends a segment.
    """
    intervals = wheel_intervals(recording.wheels, MIN_INTERVAL)
    straight = _is_straight(intervals, recording, robot)
    if left_out is not None:
        straight[left_out] = False
    segments = list(_contiguous(straight, intervals))
    if not segments:
        return None
    selected = np.zeros(len(intervals.begin), bool)
    selected[np.concatenate(segments)] = True
    segment = np.repeat(np.arange(len(segments)), [len(rows) for rows in segments])
    segment_begins = intervals.begin[[rows[0] for rows in segments]]
    imu = recording.imu
    force = recording.forward_force(robot.imu.position[0])
    sample_segment = np.clip(np.searchsorted(
        intervals.end[[rows[-1] for rows in segments]], imu.time), 0, len(segments) - 1)
    speed_gain = Signal(imu.time, force).integral(imu.time)
    selection = intervals.where(selected)
    speed = robot.wheel_radius * selection.sides.mean(axis=1)
    errors = _SpeedErrors(imu.time, force, _noise(imu.time, force, selection, robot), robot)
    roots = tuple(errors.root(selection.where(segment == number), speed[segment == number])
                  for number in range(len(segments)))
    return StraightSegments(
        np.flatnonzero(selected), selection.begin, selection.end, speed, segment, len(segments),
        imu.time, force,
        speed_gain - np.interp(segment_begins, imu.time, speed_gain)[sample_segment],
        imu.time - segment_begins[sample_segment], sample_segment, roots)


def _is_straight(intervals: WheelIntervals, recording: Recording,
                 robot: RobotParams) -> NDArray[np.bool_]:
    """Return a mask of intervals that are covered by IMU samples and straight."""
    sides = robot.wheel_radius * intervals.sides
    speed = np.abs(sides.mean(axis=1))
    half_difference = 0.5 * np.abs(sides[:, 1] - sides[:, 0])
    imu = recording.imu
    rate = Signal(imu.time, imu.rate[:, 2] - float(np.median(imu.rate[:, 2])))
    lever = 0.5 * math.hypot(robot.wheelbase, robot.track_width)
    lateral_speed = lever * np.abs(rate.mean(intervals.begin, intervals.end))
    gaps = np.flatnonzero(np.diff(imu.time) > MAX_IMU_GAP)
    covered = (intervals.begin > imu.time[0] + MAX_IMU_GAP) & (
        intervals.end < imu.time[-1] - MAX_IMU_GAP)
    for index in gaps:
        covered &= (intervals.end < imu.time[index] - MAX_IMU_GAP) | (
            intervals.begin > imu.time[index + 1] + MAX_IMU_GAP)
    return covered & (speed > MIN_SPEED) & (half_difference < MAX_TURN_SHARE * speed) & (
        lateral_speed < MAX_TURN_SHARE * speed)


def _contiguous(straight: NDArray[np.bool_], intervals: WheelIntervals) -> Iterator[Indices]:
    """Yield the indices of contiguous straight intervals."""
    contiguous = straight[1:] & straight[:-1] & (intervals.begin[1:] == intervals.end[:-1])
    breaks = np.flatnonzero(~contiguous) + 1
    for part in np.split(np.arange(len(straight)), breaks):
        for first in range(0, len(part), MAX_SEGMENT_INTERVALS):
            rows = part[first:first + MAX_SEGMENT_INTERVALS]
            if straight[part[0]] and len(rows) >= MIN_SEGMENT_INTERVALS:
                yield rows


def _noise(time: Array, force: Array, intervals: WheelIntervals, robot: RobotParams) -> float:
    """Return the standard deviation [m/s2] of a sample in motion, including vibration."""
    after = np.searchsorted(intervals.end, time)
    moving = intervals.begin[np.minimum(after, len(intervals.end) - 1)] <= time
    return max(robot.imu.accel_noise, noise_level(force[moving], 2))


class _SpeedErrors:
    """Covariance of the wheel speeds against the integral of the accelerometer."""

    def __init__(self, time: Array, force: Array, noise: float, robot: RobotParams) -> None:
        jump_variance = np.maximum(np.diff(force) ** 2 - 2.0 * noise ** 2, 0.0)
        # the time of a jump of the acceleration between two samples is uniformly distributed
        steps = np.diff(time) ** 2 * (noise ** 2 + jump_variance / 12.0)
        self._time = time
        self._walk_variance = np.concatenate([[0.0], np.cumsum(steps)])  # (m/s)^2
        encoder = robot.encoder
        self._jitter = encoder.stamp_jitter
        # quantization error is uniform; a speed is the mean of four wheels
        self._count = math.tau / encoder.counts_per_revolution * robot.wheel_radius / (
            math.sqrt(12.0 * 4.0))

    def root(self, intervals: WheelIntervals, speed: Array) -> Array:
        """Return the Cholesky factor of the covariance (n, n) of one segment's speeds [m/s]."""
        n, begin, end = len(speed), intervals.begin, intervals.end
        values = np.interp([begin[0], *0.5 * (begin + end)], self._time, self._walk_variance)
        walk = values[1:] - values[0]
        covariance = np.minimum(walk[:, None], walk[None, :])
        ends = np.eye(n, n + 1, 1) - np.eye(n, n + 1)
        for sigma in (self._jitter * speed, np.full(n, self._count)):
            differences = ends * (sigma / intervals.duration)[:, None]
            covariance = covariance + differences @ differences.T
        covariance.flat[::n + 1] += ROUGHNESS_SIGMA ** 2
        return np.asarray(cholesky(covariance, lower=True))
