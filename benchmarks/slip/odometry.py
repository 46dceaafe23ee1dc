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
Dead reckoning by wheels, and by gyroscope and wheels, for comparison.

The methods get the best possible inputs: angles instead of speeds, speeds by central differences
(not causal), the gyroscope bias from the initial standstill. Fitted constants are fitted to the
ground truth of the same run.
"""

from __future__ import annotations

import math

from benchmarks.slip.inputs import Inputs
from benchmarks.slip.series import EstimateSeries
import numpy as np
from smart_tire.analysis.metrics import aligned
from smart_tire.analysis.series import at, Floats, PoseSeries, SlipSeries, Stamps
from smart_tire.models.vehicle.skid_steer import slip_ratio
from smart_tire.samples import NS_PER_S

MIN_SIDE_DIFFERENCE = 0.1  # m, of the rolled distances, for fitting a track
MAX_GAP = 5.0              # s, bridged by linear interpolation


def wheel_odometry(inputs: Inputs, track: float) -> EstimateSeries:
    """Return the odometry of a differential drive with ``track`` [m]."""
    travel, rolling = inputs.travel, inputs.rolling
    yaw = _heading(inputs, track)
    rate = (rolling[:, 1] - rolling[:, 0]) / track
    return _dead_reckoning(inputs, inputs.wheel_ns, yaw, travel.mean(axis=1), rate, rolling)


def fitted_track(inputs: Inputs, truth: PoseSeries) -> float:
    """Return the track [m] that fits the true heading best in the least squares sense."""
    estimate = wheel_odometry(inputs, 1.0)  # for which yaw is the difference of the sides
    estimated, true, _ = aligned(truth, estimate.poses)
    if not len(estimated):
        return inputs.robot.track_width
    difference, turned = estimated[:, 2] - estimated[0, 2], true[:, 2] - true[0, 2]
    if np.ptp(difference) < MIN_SIDE_DIFFERENCE:
        return inputs.robot.track_width
    return float(difference @ difference / (difference @ turned))


def gyro_odometry(inputs: Inputs, scale: float = 1.0) -> EstimateSeries:
    """Return dead reckoning by gyroscope heading and mean wheel distance times ``scale``."""
    stamps = inputs.imu_ns
    bias = inputs.rate[:inputs.stationary].mean() if inputs.stationary else 0.0
    rate = inputs.rate - bias
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(stamps) / NS_PER_S
    yaw = np.concatenate([[0.0], np.cumsum(steps)])
    travel = at(stamps, inputs.wheel_ns, inputs.travel, MAX_GAP)
    rolling = at(stamps, inputs.wheel_ns, inputs.rolling, MAX_GAP)
    known = np.isfinite(travel[:, 0])
    return _dead_reckoning(inputs, stamps[known], yaw[known], scale * travel[known].mean(axis=1),
                           rate[known], rolling[known], scale)


def fitted_scale(inputs: Inputs, truth: PoseSeries) -> float:
    """Return the factor on the wheel radius that fits the true position best."""
    estimated, true, _ = aligned(truth, gyro_odometry(inputs).poses)
    if not len(estimated):
        return 1.0
    reckoned, true_path = estimated[:, :2] - estimated[0, :2], true[:, :2] - true[0, :2]
    square = float(np.sum(reckoned ** 2))
    if square <= MIN_SIDE_DIFFERENCE ** 2:
        return 1.0
    return float(np.sum(reckoned * true_path)) / square


def _heading(inputs: Inputs, track: float) -> Floats:
    difference = inputs.travel[:, 1] - inputs.travel[:, 0]
    heading: Floats = (difference - difference[0]) / track
    return heading


def _dead_reckoning(inputs: Inputs, stamps: Stamps, yaw: Floats, distance: Floats, rate: Floats,
                    rolling: Floats, scale: float = 1.0) -> EstimateSeries:
    """Return the estimate for travel of ``distance`` [m] with heading ``yaw`` [rad] along arcs."""
    turn = np.diff(yaw)
    chord = np.diff(distance) * np.sinc(0.5 * turn / math.pi)
    mean_yaw = yaw[:-1] + 0.5 * turn
    x, y = (np.concatenate([[0.0], np.cumsum(chord * f(mean_yaw))]) for f in (np.cos, np.sin))
    v_x = scale * rolling.mean(axis=1)
    twist = np.column_stack([v_x, np.zeros(len(v_x)), rate])
    unknown = np.full((len(yaw), 3, 3), math.nan)
    poses = PoseSeries(stamps, np.column_stack([x, y, yaw]), twist, unknown, unknown[:, 0])
    half = 0.5 * inputs.robot.track_width
    return EstimateSeries(poses, side_slips(stamps, rolling, np.column_stack(
        [v_x - half * rate, v_x + half * rate]), inputs.robot.slip.standstill_speed))


def side_slips(stamps: Stamps, rolling: Floats, ground: Floats, standstill: float,
               ground_sigma: Floats | None = None) -> SlipSeries:
    """Return slips from r w and v_x (n, 2) of the sides; sigmas from ``ground_sigma`` if given."""
    ratio = slip_ratio(rolling, ground, standstill)
    sigma = np.full_like(ratio, math.nan)
    if ground_sigma is not None:
        sigma = np.minimum(ground_sigma / np.maximum(np.abs(rolling), 1e-9), 1.0)
    sigma = np.where(np.isnan(ratio), 1.0, sigma)
    sides = [0, 1, 0, 1]
    return SlipSeries(stamps, ratio[:, sides], sigma[:, sides])
