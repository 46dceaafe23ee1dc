# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters of the estimators and of the controller (``config/tuning.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import inlined, param, reliability

INCREMENTS = 'increments'  # value of odom_twist


@dataclass(frozen=True, kw_only=True)
class SlipEstimatorParams:
    """Slip estimator: extended Kalman filter on IMU and wheel speeds."""

    reorder_window: float = param(
        0.03, 's', 'span of message timestamps that are sorted before use', (0.0, 1.0))
    differential_slip_sigma: float = param(
        0.05, '-', 'prior sigma of half the slip difference about the ICRs', (1e-3, 1.0))
    common_slip_sigma: float = param(
        0.04, '-', 'prior sigma of the slip common to both sides at constant speed', (1e-3, 1.0))
    free_rolling_slip_sigma: float = param(
        0.005, '-', 'least sigma of the slip about the ICRs, which is learned', (1e-4, 1.0))
    icr_x: float = param(
        0.0, 'm', 'initial S: x of the instantaneous center of rotation in base_link',
        (-10.0, 10.0))
    icr_x_sigma: float = param(0.2, '-', 'sigma of icr_x, divided by the wheelbase', (0.0, 10.0))
    lateral_sigma: float = param(
        0.006, 'm/s', 'least sigma of the lateral speed about B(8), which is learned', (1e-5, 1.0))
    slope_sigma: float = param(
        0.01, 'rad', 'initial sigma of the ground slope, which is learned', (0.0, 1.0))
    ground_delay: float = param(
        0.3, 's', 'message time after which a ground_state takes effect', (0.0, 0.8))
    odom_rate: float = param(
        125.0, 'Hz', 'largest rate of odom and /tf: every n-th instant of the grid of 8 ms',
        (1.0, 125.0))
    odom_twist: str = param(
        'estimate', '-', 'twist of odom; increments: mean velocity since the last message, for '
        'filters that take errors of messages as independent', choices=('estimate', INCREMENTS))
    publish_imu_tf: bool = param(
        True, '-', 'publish imu_link on /tf_static; false: robot_state_publisher does')
    reliability: str = reliability()
    robot: RobotParams = inlined(RobotParams)


@dataclass(frozen=True, kw_only=True)
class FrictionEstimatorParams:
    """Friction estimator: one estimate per patch crossing of a wheel's films."""

    reorder_window: float = param(
        0.06, 's', 'span of message timestamps that are sorted before use', (0.0, 1.0))
    load_sigma: float = param(
        0.02, '-', 'relative standard deviation of a wheel load: uneven ground, suspension',
        (0.0, 1.0))
    reliability: str = reliability()
    robot: RobotParams = inlined(RobotParams)
