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

"""
Rolling radius from the distances that a pose reference and the wheels traveled.

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

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.recording import PoseRecord, WheelRecord
from smart_tire.calibration.robot.rolled_distance import WheelRotationLog
from smart_tire.errors import EstimatorError
from smart_tire.numerics.regression import HUBER_THRESHOLD, Prior, robust_regression
from smart_tire.numerics.robust import noise_level
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain

DISTANCE_INTERVAL = 2.0       # s of motion per interval: several lengths of a robot
MAX_POSE_GAP = 0.5            # s between poses of an interval
MIN_INTERVALS = 5             # below this number the residuals do not determine their noise
TURN_SLIP = 0.3  # prior of k, its sigma, and standard deviation of single intervals from it
MAX_PIVOT_SHARE = 0.1         # of the angle of an interval from turns in place
FREE_ROLLING_SLIP = 0.01      # share of the distance: varying slip of straight rolling; chosen
REFERENCE_OFFSET_SIGMA = 0.3  # tracks; lateral offset of the reference from the center; assumed
MAX_RADIUS_SIGMA = 0.02  # relative standard error above which a radius is refused: slip of 0.02
HAC_LAGS = 2                  # intervals whose slips may be correlated
MAX_ANTICORRELATION = 0.49    # of neighbors; one half if all noise comes from the poses


@dataclass(frozen=True)
class RadiusFit:
    """The rolling radius, with the intervals it is estimated from."""

    radius: Uncertain          # m, mean of both sides
    time: Array  # (n,) s, centers of the intervals by the timestamps of the reference
    wheel_distance: Array      # (n,) m, of the wheels with that radius, without slip
    reference_distance: Array  # (n,) m, of the reference along its heading


@dataclass(frozen=True)
class _Distances:
    begin: Array               # (n,) s
    end: Array                 # (n,) s
    angle: Array               # (n,) rad
    side_slip: Array           # (n,) rad
    speed_change: Array        # (n,) rad2/s2
    reference_distance: Array  # (n,) m
    yaw_change: Array          # (n,) rad

    @property
    def contiguous(self) -> NDArray[np.bool_]:
        """Return a mask (n,) of intervals that begin where the previous one ended."""
        return np.append(False, self.begin[1:] == self.end[:-1])[:len(self.end)]


def fit_radius(wheels: WheelRecord, reference: PoseRecord, latency: float,
               robot: RobotParams, turn_slip: float = TURN_SLIP) -> RadiusFit:
    """
    Return the mean rolling radius; raise EstimatorError with the reason if not observable.

    ``latency`` [s] is that of the wheel timestamps minus that of the reference; ``turn_slip`` is
    the k above.
    """
    distances = _distances(wheels, reference, latency, robot)
    if len(distances.end) < MIN_INTERVALS:
        raise EstimatorError(
            f'{len(distances.end)} intervals of {DISTANCE_INTERVAL:g} s of rolling with a '
            f'reference, expected at least {MIN_INTERVALS}')
    side_slip, radius = robot.wheel_radius * distances.side_slip, robot.wheel_radius
    slip_per_acceleration = robot.mass / (4.0 * robot.tire.longitudinal_stiffness)  # s2/m
    matrix = np.column_stack([distances.angle, -side_slip, -radius ** 2 * distances.speed_change,
                              robot.track_width * distances.yaw_change])
    prior = Prior(np.array([0.0, turn_slip, slip_per_acceleration, 0.0]),
                  np.array([np.inf, TURN_SLIP, slip_per_acceleration, REFERENCE_OFFSET_SIGMA]))
    model_sigma = np.linalg.norm([
        TURN_SLIP * side_slip, FREE_ROLLING_SLIP * distances.reference_distance,
        np.full(len(side_slip), math.sqrt(2.0) * _noise(reference))], axis=0)
    fit = robust_regression(
        matrix, distances.reference_distance, prior, model_sigma=model_sigma,
        initial_sigma=0.1 * float(np.median(np.abs(distances.reference_distance))),
        hac_lags=HAC_LAGS,
        whitener=lambda normalized: _whitener(normalized, distances.contiguous))
    _check(fit.estimate(0))
    return RadiusFit(fit.estimate(0), 0.5 * (distances.begin + distances.end),
                     matrix @ fit.coefficients, distances.reference_distance)


def _check(radius: Uncertain) -> None:
    if not radius.value > 0.0:
        raise EstimatorError('the reference moves opposite to the wheels')
    if radius.sigma > MAX_RADIUS_SIGMA * radius.value:
        raise EstimatorError(
            f'standard error of {100.0 * radius.sigma / radius.value:.2g} %, expected at most '
            f'{100.0 * MAX_RADIUS_SIGMA:g} %')


def _distances(wheels: WheelRecord, reference: PoseRecord, latency: float,
               robot: RobotParams) -> _Distances:
    """Return the intervals of ``DISTANCE_INTERVAL`` seconds in which the wheels roll."""
    path_length, _ = reference.path_components()
    wheel_log = WheelRotationLog(wheels)
    min_angle = DISTANCE_INTERVAL * robot.slip.standstill_speed / robot.wheel_radius
    time = reference.time + latency
    rows = []
    for first, last in reference.intervals(DISTANCE_INTERVAL, MAX_POSE_GAP):
        rotation = wheel_log.between(time[first], time[last])
        if rotation is not None and abs(rotation.angle) > max(
                min_angle, rotation.pivot_angle / MAX_PIVOT_SHARE):
            rows.append((time[first], time[last], rotation.angle, rotation.side_slip,
                         rotation.speed_change, path_length[last] - path_length[first],
                         reference.yaw[last] - reference.yaw[first]))
    return _Distances(*np.array(rows).reshape(-1, 7).T)


def _noise(reference: PoseRecord) -> float:
    """Return the white noise [m] of the positions of the reference."""
    return max(noise_level(axis) for axis in reference.position.T)


def _whitener(normalized: Array, contiguous: NDArray[np.bool_]) -> Callable[[Array], Array]:
    """
    Return a function that removes the correlation of contiguous rows, from residuals in sigmas.

    An error of a pose makes one distance longer and the next one shorter, so the errors of
    neighboring rows are anticorrelated.
    """
    clipped = np.clip(normalized, -HUBER_THRESHOLD, HUBER_THRESHOLD)
    anticorrelation = -float(np.sum((clipped[1:] * clipped[:-1])[contiguous[1:]])
                             / np.sum(clipped ** 2))
    return lambda rows: _whitened(rows, contiguous, anticorrelation)


def _whitened(values: Array, contiguous: NDArray[np.bool_], anticorrelation: float) -> Array:
    """
    Return rows (n, ...) without the noise that each shares with the previous one.

    Contiguous rows have unit noise correlated by minus ``anticorrelation``: a row-by-row solution
    with the Cholesky factor of that covariance.
    """
    correlation = min(max(anticorrelation, 0.0), MAX_ANTICORRELATION)
    result, diagonal = np.array(values), 1.0
    for index in range(1, len(values)):
        below = -correlation / diagonal if contiguous[index] else 0.0
        diagonal = math.sqrt(1.0 - below ** 2)
        result[index] = (values[index] - below * result[index - 1]) / diagonal
    return result
