"""
Straight runs of a recording: what wheels and accelerometer say of the same stretches of time.

What errs in the wheels' speed beyond the accelerometer's integral has a known shape: stamps and
counts, the same for two neighbouring stretches with opposite signs, and the accelerometer's noise
summed up since the run began. A run begins and ends in motion: how fast it was then is unknown.
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
from smart_tire.numerics.robust import MAD_TO_SIGMA
from smart_tire.parameters import RobotParams

Indices = NDArray[np.intp]

SHORTEST = 0.05     # s, of a stretch; of wheels that are read more often, several go together
LEAST_SPEED = 0.2   # m/s; slower, a count of the encoder and the tire's standing are too much
TURNING = 0.05      # of the speed, sideways or of one side beyond the other, in a straight run
FEWEST = 6          # stretches of a run
LONGEST = 400       # stretches, after which a run goes on as another: their errors are all linked
GAP = 0.05          # s between readings of the inertial unit, over which speed is not integrated
ROUGHNESS = 0.001   # m/s, of a stretch beyond stamps and counts: uneven ground; assumed


@dataclass(frozen=True)
class StraightRuns:
    """
    All straight runs of a recording: n stretches between wheel readings, m readings of the unit.

    The unit's readings cover all of the recording; ``reading_run`` says which run each belongs
    to, and readings between two runs belong to either.
    """

    row: Indices          # (n,) of the stretches among all stretches of the recording
    begin: Array          # (n,) s, by the stamps of the wheels
    end: Array            # (n,) s
    speed: Array          # (n,) m/s, mean r w of the four wheels
    run: Indices          # (n,) which run, from 0
    count: int            # of runs
    time: Array           # (m,) s, of the unit's readings
    force: Array          # (m,) m/s2, forward specific force
    gained: Array         # (m,) m/s, its integral since the run began
    lasted: Array         # (m,) s since the run began
    reading_run: Indices  # (m,)
    roots: tuple[Array, ...]  # of each run, lower triangular root of the covariance of ``speed``

    def whitened(self, rows: Array) -> Array:
        """Return ``rows`` (n,) or (n, p) of wheel speeds over their linked errors."""
        white = np.empty_like(rows)
        for number, root in enumerate(self.roots):
            own = self.run == number
            white[own] = solve_triangular(root, rows[own], lower=True, check_finite=False)
        return white


def straight_runs(recording: Recording, robot: RobotParams,
                  left_out: Indices | None = None) -> StraightRuns | None:
    """
    Return the straight runs of a recording, None where there is none.

    ``left_out`` are rows of stretches that are not to be used, each of which ends a run.
    """
    stretches = wheel_intervals(recording.wheels, SHORTEST)
    straight = _is_straight(stretches, recording, robot)
    if left_out is not None:
        straight[left_out] = False
    runs = list(_runs(straight, stretches))
    if not runs:
        return None
    chosen = np.zeros(len(stretches.begin), bool)
    chosen[np.concatenate(runs)] = True
    run = np.repeat(np.arange(len(runs)), [len(rows) for rows in runs])
    begins = stretches.begin[[rows[0] for rows in runs]]
    imu = recording.imu
    # The unit sits off the middle: what turning makes it feel is not a change of speed.
    force = imu.force[:, 0] + robot.imu.position[0] * imu.rate[:, 2] ** 2
    reading_run = np.clip(np.searchsorted(
        stretches.end[[rows[-1] for rows in runs]], imu.time), 0, len(runs) - 1)
    gained = Signal(imu.time, force).integral(imu.time)
    kept = stretches.where(chosen)
    speed = robot.wheel_radius * kept.sides.mean(axis=1)
    errors = _Errors(imu.time, force, _noise(imu.time, force, kept, robot), robot)
    return StraightRuns(
        np.flatnonzero(chosen), kept.begin, kept.end, speed, run, len(runs), imu.time, force,
        gained - np.interp(begins, imu.time, gained)[reading_run],
        imu.time - begins[reading_run], reading_run,
        tuple(errors.root(kept.where(run == number), speed[run == number])
              for number in range(len(runs))))


def _is_straight(stretches: WheelIntervals, recording: Recording,
                 robot: RobotParams) -> NDArray[np.bool_]:
    """Return which stretches, seen by the unit from end to end, go straight ahead."""
    sides = robot.wheel_radius * stretches.sides
    speed = np.abs(sides.mean(axis=1))
    apart = 0.5 * np.abs(sides[:, 1] - sides[:, 0])
    imu = recording.imu
    rate = Signal(imu.time, imu.rate[:, 2] - float(np.median(imu.rate[:, 2])))
    arm = 0.5 * math.hypot(robot.wheelbase, robot.track_width)
    sideways = arm * np.abs(rate.mean(stretches.begin, stretches.end))
    missed = np.flatnonzero(np.diff(imu.time) > GAP)
    seen = (stretches.begin > imu.time[0] + GAP) & (stretches.end < imu.time[-1] - GAP)
    for index in missed:
        seen &= (stretches.end < imu.time[index] - GAP) | (
            stretches.begin > imu.time[index + 1] + GAP)
    return seen & (speed > LEAST_SPEED) & (apart < TURNING * speed) & (
        sideways < TURNING * speed)


def _runs(straight: NDArray[np.bool_], stretches: WheelIntervals) -> Iterator[Indices]:
    """Yield the indices of stretches that follow each other without a hole."""
    linked = straight[1:] & straight[:-1] & (stretches.begin[1:] == stretches.end[:-1])
    breaks = np.flatnonzero(~linked) + 1
    for part in np.split(np.arange(len(straight)), breaks):
        for first in range(0, len(part), LONGEST):
            rows = part[first:first + LONGEST]
            if straight[part[0]] and len(rows) >= FEWEST:
                yield rows


def _noise(time: Array, force: Array, stretches: WheelIntervals, robot: RobotParams) -> float:
    """Return one sigma [m/s2] of a reading in motion: a unit that shakes errs more."""
    after = np.searchsorted(stretches.end, time)
    moving = stretches.begin[np.minimum(after, len(stretches.end) - 1)] <= time
    return max(robot.imu.accel_noise, white_noise(force[moving]))


class _Errors:
    """Covariance of the wheels' speeds beyond the integral of the accelerometer."""

    def __init__(self, time: Array, force: Array, noise: float, robot: RobotParams) -> None:
        jump = np.maximum(np.diff(force) ** 2 - 2.0 * noise ** 2, 0.0)
        # where between two readings the acceleration jumped is anybody's guess
        steps = np.diff(time) ** 2 * (noise ** 2 + jump / 12.0)
        self._time, self._walk = time, np.concatenate([[0.0], np.cumsum(steps)])  # (m/s)^2
        encoder = robot.encoder
        self._jitter = encoder.stamp_jitter
        # a count is uniform; a speed is the mean of four wheels
        self._count = math.tau / encoder.counts_per_revolution * robot.wheel_radius / (
            math.sqrt(12.0 * 4.0))

    def root(self, stretches: WheelIntervals, speed: Array) -> Array:
        """Return the root of the covariance (n, n) of one run's speeds [m/s]."""
        n, begin, end = len(speed), stretches.begin, stretches.end
        middles = np.interp([begin[0], *0.5 * (begin + end)], self._time, self._walk)
        walked = middles[1:] - middles[0]
        covariance = np.minimum(walked[:, None], walked[None, :])
        ends = np.eye(n, n + 1, 1) - np.eye(n, n + 1)
        for each in (self._jitter * speed, np.full(n, self._count)):
            links = ends * (each / stretches.duration)[:, None]
            covariance = covariance + links @ links.T
        covariance.flat[::n + 1] += ROUGHNESS ** 2
        return np.asarray(cholesky(covariance, lower=True))


def white_noise(signal: Array) -> float:
    """Return one sigma of the white noise in a signal, from its second differences."""
    if len(signal) < 3:
        return 0.0
    return MAD_TO_SIGMA * float(np.median(np.abs(np.diff(signal, 2)))) / math.sqrt(6.0)
