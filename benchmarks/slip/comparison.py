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

"""Estimates of one run by the estimator under test and by the methods for comparison."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.efforts import has_efforts, without_efforts
from benchmarks.slip.candidates import live_estimate, smoothed_estimate
from benchmarks.slip.inputs import as_inputs
from benchmarks.slip.odometry import fitted_scale, fitted_track, gyro_odometry, wheel_odometry
from benchmarks.slip.plain_ekf import plain_ekf
from benchmarks.slip.series import EstimateSeries
from smart_tire.analysis.series import PoseSeries
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.samples import Sample

LIVE, SMOOTHED = 'live', 'smoothed'
LIVE_TORQUE, SMOOTHED_TORQUE = 'live_torque', 'smoothed_torque'
WITH_TORQUE = {LIVE_TORQUE: 'live, with torque', SMOOTHED_TORQUE: 'smoothed, with torque'}
OWN = LIVE, SMOOTHED, *WITH_TORQUE  # the estimator under test
METHODS = {
    LIVE: 'live',
    SMOOTHED: 'smoothed',
    **WITH_TORQUE,  # only if torques were measured
    'wheels': 'wheels, geometric track',
    'wheels_fitted': 'wheels, best-fit track',
    'gyro': 'gyro + wheels',
    'gyro_fitted': 'gyro + wheels, best-fit radius',
    'plain_ekf': 'robot_localization-style EKF',
}


def compare_methods(samples: Sequence[Sample], params: SlipEstimatorParams,
                    truth: PoseSeries) -> dict[str, EstimateSeries]:
    """
    Return the estimates of all ``METHODS`` from ``samples`` in order of reception.

    Fitted constants of the methods for comparison are fitted to ``truth``. Only ``WITH_TORQUE``
    use motor torques, and are left out if there are none.
    """
    inputs = as_inputs(samples, params.robot)
    track, plain = fitted_track(inputs, truth), without_efforts(samples)
    return {
        LIVE: live_estimate(plain, params),
        SMOOTHED: smoothed_estimate(plain, params),
        **({LIVE_TORQUE: live_estimate(samples, params),
            SMOOTHED_TORQUE: smoothed_estimate(samples, params)} if has_efforts(samples) else {}),
        'wheels': wheel_odometry(inputs, params.robot.track_width),
        'wheels_fitted': wheel_odometry(inputs, track),
        'gyro': gyro_odometry(inputs),
        'gyro_fitted': gyro_odometry(inputs, fitted_scale(inputs, truth)),
        'plain_ekf': plain_ekf(inputs, track)}
