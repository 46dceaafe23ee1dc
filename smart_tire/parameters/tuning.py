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

"""Parameters of the estimators and of the controller (``config/tuning.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import inlined, param

RELIABILITIES = ('reliable', 'best_effort')


@dataclass(frozen=True, kw_only=True)
class SlipEstimatorParams:
    """Slip estimator: extended Kalman filter on IMU and wheel speeds."""

    reorder_window: float = param(
        0.03, 's', 'span of message timestamps that are sorted before use', low=0.0, high=1.0)
    constraint: str = param(
        'plain', '-', 'form of the kinematic constraint B(7): plain, or as printed in paper B',
        choices=('plain', 'printed'))
    differential_slip_sigma: float = param(
        0.15, '-', 'prior sigma of the slip difference between left and right', low=1e-3,
        high=1.0)
    common_slip_sigma: float = param(
        0.07, '-', 'prior sigma of the slip common to both sides at constant speed',
        low=1e-3, high=1.0)
    free_rolling_slip_sigma: float = param(
        0.015, '-', 'sigma of the slip of freely rolling wheels on firm ground',
        low=1e-4, high=1.0)
    slip_random_walk: float = param(
        0.005, '1/sqrt(s)', 'random walk of the slip of each side', low=0.0, high=1.0)
    slip_change_gain: float = param(
        1.0, '-', 'sigma of slip-velocity change per unit change of wheel or ground speed',
        low=0.0, high=10.0)
    icr_x: float = param(
        0.0, 'm', 'initial S: x of the instantaneous center of rotation in base_link',
        low=-10.0, high=10.0)
    icr_x_sigma: float = param(
        0.2, '-', 'sigma of icr_x, divided by the wheelbase', low=0.0, high=10.0)
    icr_x_random_walk: float = param(
        0.005, '1/sqrt(s)', 'random walk of S, divided by the wheelbase', low=0.0, high=1.0)
    lateral_sigma: float = param(
        0.006, 'm/s', 'sigma of the lateral speed about B(8), correlated over 0.1 s',
        low=1e-5, high=1.0)
    slope_sigma: float = param(
        0.0002, 'rad', 'prior sigma of the ground slope, which is learned: laboratory floor',
        low=0.0, high=1.0)
    force_balance: str = param(
        'auto', '-', 'use tire forces and motor torques; auto: with films',
        choices=('auto', 'on', 'off'))
    ground_stiffness_sigma: float = param(
        0.5, '-', 'sigma of ln C_x on ground other than the calibrated one', low=0.01, high=2.0)
    ground_friction_sigma: float = param(
        0.7, '-', 'sigma of ln mu / C_x on unknown ground', low=0.01, high=2.0)
    publish_imu_tf: bool = param(
        True, '-', 'publish imu_link on /tf_static; false: robot_state_publisher does')
    reliability: str = param(
        'reliable', '-', 'QoS reliability of the input subscriptions', choices=RELIABILITIES)
    robot: RobotParams = inlined(RobotParams)

    def __post_init__(self) -> None:
        if self.force_balance == 'on' and not all(self.robot.joints.measured):
            raise ValueError('force_balance: on, but the forces of a wheel that is not measured '
                             '(empty joints.*) are unknown; expected auto or off')


@dataclass(frozen=True, kw_only=True)
class FrictionEstimatorParams:
    """Friction estimator: one estimate per patch crossing of a wheel's films."""

    reorder_window: float = param(
        0.06, 's', 'span of message timestamps that are sorted before use', low=0.0, high=1.0)
    method: str = param(
        'waveform', '-', 'fit of the whole waveform, or the method of paper B',
        choices=('waveform', 'two_peaks'))
    map: str = param(  # noqa: A003
        'exact', '-', 'two_peaks only: peak interval to adhesion length, exact or as printed',
        choices=('exact', 'printed'))
    load_sigma: float = param(
        0.02, '-', 'relative standard deviation of a wheel load: uneven ground, suspension',
        low=0.0, high=1.0)
    reliability: str = param(
        'reliable', '-', 'QoS reliability of the input subscriptions', choices=RELIABILITIES)
    robot: RobotParams = inlined(RobotParams)

    def __post_init__(self) -> None:
        film, patch = self.robot.film, self.robot.tire.contact_length
        if self.method == 'two_peaks' and film.length >= patch:
            raise ValueError(f'method: two_peaks needs a film.length ({film.length} m) below '
                             f'tire.contact_length ({patch} m)')
        if self.method == 'two_peaks' and film.release != 'fig8':
            raise ValueError(f'method: two_peaks needs film.release fig8, not {film.release}: '
                             'the second peak occurs only with fig8')
