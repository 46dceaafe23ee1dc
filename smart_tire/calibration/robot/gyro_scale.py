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

"""Scale factor of the gyro against the yaw of a pose reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import PoseRecord, Recording, Signal
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay_regression import DelayProblem, fit_delay, Rows
from smart_tire.numerics.regression import Prior
from smart_tire.uncertain import Uncertain

YAW_INTERVAL = 1.0  # s, of the changes of yaw: as long as a turn, to average noise of the poses
MAX_POSE_GAP = 0.5      # s between poses
MAX_DELAY = 1.0         # s, search range of the latency of the reference
DELAY_STEP = 0.05       # s, of the search
MIN_YAW_RATE = 0.05     # rad/s; slower intervals do not make the scale observable
CLEAR_YAW = 1.0         # rad of yaw in a recording that a gyro bias does not explain
MAX_SCALE_SIGMA = 0.05  # standard error above which a scale is refused


@dataclass(frozen=True)
class GyroScaleFit:
    """Scale factor of the gyro and latency of the reference."""

    scale: Uncertain    # gyro rate over true rate
    latency: Uncertain  # s, of the timestamps of the reference against the gyro


def fit_gyro_scale(recording: Recording) -> GyroScaleFit:
    """Return the gyro scale; raise EstimatorError if there is no reference or no turn."""
    begin, end, yaw_change = _yaw_changes(usable_reference(recording))
    imu = recording.imu
    gyro = Signal(imu.time, imu.rate[:, 2])
    inside = (begin > imu.time[0] + MAX_DELAY) & (end < imu.time[-1] - MAX_DELAY)
    begin, end, yaw_change = begin[inside], end[inside], yaw_change[inside]
    if len(end):
        # neighbors of turns stay, so that a delay does not move a turn out of its interval
        rate = np.abs(gyro.mean(begin - MAX_DELAY, end + MAX_DELAY))
        begin, end, yaw_change = (
            values[rate > MIN_YAW_RATE] for values in (begin, end, yaw_change))
    duration = end - begin

    def rows(delay: float) -> Rows:
        rate = gyro.mean(begin - delay, end - delay)
        return Rows(np.column_stack([yaw_change / duration, np.ones(len(end))]), rate)

    problem = DelayProblem(rows, lambda delay: np.zeros(len(end)), end,
                           Prior(np.zeros(2), np.full(2, np.inf)))
    fit = fit_delay(problem, np.arange(-MAX_DELAY, MAX_DELAY + DELAY_STEP, DELAY_STEP))
    scale = Uncertain(float(fit.coefficients[0]), fit.coefficient_sigma(0))
    if scale.sigma > MAX_SCALE_SIGMA:
        raise EstimatorError(f'standard error of {scale.sigma:.2g}, expected at most '
                             f'{MAX_SCALE_SIGMA:g}: the robot hardly yaws')
    return GyroScaleFit(scale, Uncertain(fit.delay, fit.sigma))


def usable_reference(recording: Recording) -> PoseRecord:
    """Return the reference; raise EstimatorError if there is none or it has no yaw."""
    poses, imu = recording.reference, recording.imu
    if poses is None:
        raise EstimatorError('there is no pose reference')
    yaw_change = Signal(imu.time, imu.rate[:, 2]).integral(poses.time)
    if np.ptp(yaw_change) > CLEAR_YAW and np.ptp(poses.yaw) < 0.5 * np.ptp(yaw_change):
        raise EstimatorError(f'the reference yaws by {np.ptp(poses.yaw):.2g} rad while the gyro '
                             f'yaws by {np.ptp(yaw_change):.2g} rad: the reference has no yaw')
    return poses


def _yaw_changes(reference: PoseRecord) -> tuple[Array, Array, Array]:
    """Return begin, end [s] and change of yaw [rad] of intervals of the reference."""
    ends = np.array(list(reference.intervals(YAW_INTERVAL, MAX_POSE_GAP)), int).reshape(-1, 2)
    first, last = ends.T
    return (reference.time[first], reference.time[last],
            reference.yaw[last] - reference.yaw[first])
