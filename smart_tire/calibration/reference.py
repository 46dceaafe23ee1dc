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
Rolling radius, and scale of the gyro, against the poses of a reference.

The distance of an interval is the displacement of the reference along its own heading, so the
noise of its positions does not accumulate as in distances between neighboring poses. The mean
wheel angle gives the same distance, except for three effects that are fitted with priors:

- The reference may not be at ``base_link``.
- In turns both sides slip. Their forces balance at equal slips, so the body travels less than the
  mean of the sides: ``v = u - k (u_R - u_L)^2 / (4 u)``, u the mean, k = 1 - track / effective
  track. Intervals with a turn in place, where this is no longer small, are left out.
- Under acceleration the body lags behind its wheels by a slip of mass over stiffness times
  acceleration.

The slip of straight free rolling is included in the radius, by definition of a rolling radius.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.latency import (
    CHANGE_INTERVAL, DELAYS, MANEUVER_TIME, MAX_DELAY)
from smart_tire.calibration.priors import PRIORS, require
from smart_tire.calibration.recording import (
    CalibrationRecording, MIN_RATE, PoseRecord, rotation_increments, side_slip, Signal,
    WheelRecord)
from smart_tire.calibration.results import MIN_ROBUST
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay import fit_delay
from smart_tire.numerics.least_squares import anticorrelated, Errors, Prior, regression, Rows
from smart_tire.parameters import RobotParams
from smart_tire.samples import LEFT, RIGHT
from smart_tire.uncertain import Uncertain

CLEAR_YAW = 1.0        # rad of yaw in a recording that a gyro bias does not explain
MAX_PIVOT_SHARE = 0.1  # of the angle of an interval from turns in place; warthog_asphalt


@dataclass(frozen=True)
class RadiusFit:
    """The rolling radius, with the intervals it is estimated from."""

    radius: Uncertain          # m, mean of both sides
    time: Array  # (n,) s, centers of the intervals by the timestamps of the reference
    wheel_distance: Array      # (n,) m, of the wheels with that radius, without slip
    reference_distance: Array  # (n,) m, of the reference along its heading


def usable_reference(recording: CalibrationRecording) -> PoseRecord:
    """Return the reference; raise EstimatorError if there is none or it has no yaw."""
    poses, imu = recording.reference, recording.imu
    if poses is None:
        raise EstimatorError('there is no pose reference')
    yaw_change = Signal(imu.time, imu.rate[:, 2]).integral(poses.time)
    if np.ptp(yaw_change) > CLEAR_YAW and np.ptp(poses.yaw) < 0.5 * np.ptp(yaw_change):
        raise EstimatorError(f'the reference yaws by {np.ptp(poses.yaw):.2g} rad while the gyro '
                             f'yaws by {np.ptp(yaw_change):.2g} rad: the reference has no yaw')
    return poses


def fit_gyro_scale(recording: CalibrationRecording) -> tuple[Uncertain, float]:
    """
    Return the gyro rate over the true rate, and the latency of the reference [s].

    Raises EstimatorError if there is no reference or no turn.
    """
    imu, poses = recording.imu, usable_reference(recording)
    first, last = poses.intervals(CHANGE_INTERVAL)
    begin, end, yaw = poses.time[first], poses.time[last], poses.yaw[last] - poses.yaw[first]
    gyro = Signal(imu.time, imu.rate[:, 2])
    inside = (begin > imu.time[0] + MAX_DELAY) & (end < imu.time[-1] - MAX_DELAY)
    # neighbors of turns stay, so that a delay does not move a turn out of its interval
    turning = np.abs(gyro.mean(begin - MAX_DELAY, end + MAX_DELAY)) > MIN_RATE
    begin, end, yaw = (values[inside & turning] for values in (begin, end, yaw))
    matrix = np.column_stack([yaw / (end - begin), np.ones(len(end))])
    fit = fit_delay(
        lambda delay: Rows(end, matrix, gyro.mean(begin - delay, end - delay), np.zeros(len(end))),
        Prior.of(None, None), DELAYS)
    return require('gyro scale', fit.estimate(0), 'the robot hardly yaws'), fit.delay


def fit_radius(wheels: WheelRecord, reference: PoseRecord, latency: float,
               robot: RobotParams,
               turn_slip: float = PRIORS['share of side slip lost in turns'].value) -> RadiusFit:
    """
    Return the mean rolling radius; raise EstimatorError with the reason if not observable.

    ``latency`` [s] is that of the wheel timestamps minus that of the reference; ``turn_slip`` is
    the k above.
    """
    first, last = reference.intervals(MANEUVER_TIME)
    begin, end = reference.time[first] + latency, reference.time[last] + latency
    angle, slip, pivot, missing, change = _rolled(wheels, begin, end)
    min_angle = MANEUVER_TIME * robot.slip.standstill_speed / robot.wheel_radius
    used = (missing == 0.0) & (np.abs(angle) > np.maximum(min_angle, pivot / MAX_PIVOT_SHARE))
    if used.sum() < MIN_ROBUST:
        raise EstimatorError(
            f'{used.sum()} intervals of {MANEUVER_TIME:g} s of rolling with a reference, '
            f'expected at least {MIN_ROBUST}')
    forward, _ = reference.path_components()
    distance = forward[last] - forward[first]
    lost = PRIORS['share of side slip lost in turns'].sigma
    slip, lag = robot.wheel_radius * slip, robot.mass / (4.0 * robot.tire.longitudinal_stiffness)
    rows = Rows(
        0.5 * (begin + end), np.column_stack([
            angle, -slip, -robot.wheel_radius ** 2 * change,
            robot.track_width * (reference.yaw[last] - reference.yaw[first])]), distance,
        np.hypot(lost * slip, PRIORS['slip of free rolling'].sigma * distance)).where(used)
    fit = regression(rows, Prior.of(None, (turn_slip, lost), (lag, lag),
                                    PRIORS['lateral offset of the reference'].prior),
                     Errors(rows.lags(MANEUVER_TIME), anticorrelated(
                         np.append(False, begin[used][1:] == end[used][:-1]))))
    radius = fit.estimate(0)
    if not radius.value > 0.0:
        raise EstimatorError('the reference moves opposite to the wheels')
    return RadiusFit(radius, rows.time, rows.matrix @ fit.values, rows.target)


def _rolled(wheels: WheelRecord, begin: Array, end: Array) -> Array:
    """
    Return what the wheels did from ``begin`` to ``end`` [s] (n,), as rows of (5, n).

    Mean angle [rad]; ``side_slip`` [rad]; half the difference of the sides in turns in place
    [rad]; not zero if a part was not recorded; half the change of w |w| [rad2/s2].
    """
    rotation, complete = rotation_increments(wheels)
    gap, mean = np.diff(wheels.time), rotation.mean(axis=1)
    half = 0.5 * np.abs(rotation[:, RIGHT].mean(axis=1) - rotation[:, LEFT].mean(axis=1))
    pivot = np.where(half > 0.8 * np.abs(mean), half, 0.0)
    sums = np.cumsum(np.stack([mean, side_slip(mean, half), pivot, 1.0 * ~complete]), axis=1)
    outside = (begin < wheels.time[0]) | (end > wheels.time[-1])
    changes = [np.interp(end, wheels.time, np.append(0.0, row))
               - np.interp(begin, wheels.time, np.append(0.0, row)) for row in sums]
    changes[3] = changes[3] + outside
    slow, fast = (np.interp(time, wheels.time[1:] - 0.5 * gap, mean / gap)
                  for time in (begin, end))
    return np.stack([*changes, 0.5 * (fast * np.abs(fast) - slow * np.abs(slow))])
