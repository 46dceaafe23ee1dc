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
Special rules of the slip estimator, and how each one is switched off.

A rule is off while some module constants, functions or methods have other values, or with other
parameters. The product contains no switch.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass, field
import math
from types import MappingProxyType
from typing import Any
from unittest import mock

PACKAGE = 'smart_tire.estimation.slip'
ALL_RULES = 'all_rules'  # the estimator with all rules


@dataclass(frozen=True)
class Rule:
    """
    A rule and what replaces it.

    ``patches`` are new values by module and attribute below ``PACKAGE``, ``params`` those of
    fields of ``SlipEstimatorParams``.
    """

    title: str
    patches: Mapping[str, Any] = field(default_factory=dict)
    params: Mapping[str, Any] = field(default_factory=dict)


@contextmanager
def switched_off(rule: Rule) -> Iterator[None]:
    """Apply the patches of ``rule`` within the context; AttributeError if one does not exist."""
    with ExitStack() as stack:
        for target, value in rule.patches.items():
            stack.enter_context(mock.patch(f'{PACKAGE}.{target}', value))
        yield


def _nothing(*_: Any) -> None:
    """Do nothing, in place of a method."""


def _false(*_: Any) -> bool:
    return False


def _linearized(update: Any, residual: Any) -> Any:
    """Return the balance at the present state, in place of ``ForceUpdate._longitudinal``."""
    return update._model.longitudinal_balance(update._ekf.x.tolist(), residual)


RULES: Mapping[str, Rule] = MappingProxyType({
    ALL_RULES: Rule('none is off'),
    # wheel measurements
    'nis_inflation': Rule(
        'wheel noise grows with the normalized innovation', {'ekf.NIS_INFLATION': 0.0}),
    'outliers': Rule('outliers inflate the noise', {'robust_ekf.OUTLIER_SIGMAS': math.inf}),
    # slip process
    'innovation_change': Rule(
        'slip changes with lasting innovations', {'slip_process.INNOVATION_SIGMAS': math.inf}),
    'speed_change': Rule(
        'slip changes with wheel and ground speed', params={'slip_change_gain': 0.0}),
    'change_threshold': Rule(
        'small changes of speed do not change the slip',
        {'slip_process.MIN_GROUND_SPEED_CHANGE': 0.0, 'slip_process.STAMP_JITTER_SIGMAS': 0.0}),
    'soft_ground': Rule(
        'common slip is likely where it was observed',
        {'slip_process.SlipPrior.update_soft_ground': _nothing}),
    'free_rolling': Rule(
        'prior of freely rolling wheels and rolling radius',
        {'wheel_correction.WheelCorrector._correct_free_rolling': _nothing}),
    'radius': Rule(
        'rolling radius is estimated', {'wheel_correction.RadiusEstimator.update': _nothing}),
    'unobserved_slip': Rule(
        'sigma grows with changes of ground speed between wheel samples',
        {'prediction.UNOBSERVED_SLIP_SHARE': 0.0}),
    # lateral constraint
    'icr_change': Rule(
        'S changes with lasting innovations', {'ekf.ICR_CHANGE_SIGMAS': math.inf}),
    'icr_with_slip': Rule('S changes with the slips', {'ekf.ICR_CHANGE_SHARE': 0.0}),
    # force balance
    'slip_difference': Rule('the difference of slips follows contradicting wheels',
                            {'ekf.SLIP_CHANGE_SIGMAS': math.inf}),
    'iterated_balance': Rule('the balance is linearized where it is fulfilled',
                             {'force_update.ForceUpdate._longitudinal': _linearized}),
    'lateral_balance': Rule('changes of the lateral speed determine C_x',
                            {'force_update.ForceUpdate._is_plausible': _false}),
    'steady_turns': Rule('... but a steady one does not',
                         {'force_update.LATERAL_SPEED_CHANGE': 0.0}),
    'plausible_balance': Rule(
        '... and a contradicted lateral balance does not',
        {'force_update.PLAUSIBLE_SIGMAS': math.inf, 'force_update.IMPLAUSIBLE_TORQUES': 5}),
    'lateral_correlation': Rule('errors of the lateral balance are correlated',
                                {'force_update.LATERAL_CORRELATION_TIME': 0.0}),
    'significant_forces': Rule('forces within their noise do not determine C_x',
                               {'force_model.SIGNIFICANT_SIGMAS': 0.0}),
    'unknown_stiffness': Rule('torques determine an unknown C_x directly',
                              {'force_update.UNKNOWN_STIFFNESS_SIGMA': math.inf}),
    'certain_slips': Rule('... but only where the slips are certain',
                          {'force_update.CERTAIN_SLIP_SIGMAS': 0.0}),
    'wheel_acceleration': Rule('the own acceleration of the wheels adds noise to torques',
                               {'force_update.ACCELERATION_GAIN': 0.0}),
    'torque_check': Rule('contradicting and repeating torques are not used',
                         {'force_update.TorqueCheck.update': _nothing}),
    'change_by_wheels': Rule('wheels that contradict the forces change the ground',
                             {'force_update.ForceUpdate.detect_ground_change': _nothing}),
    'change_by_films': Rule('a contradicting adhesion ratio changes the ground',
                            {'force_update.RATIO_CHANGE_SIGMAS': math.inf}),
    'stiffness_limit': Rule('a C_x that no ground has is forgotten',
                            {'force_update.MAX_PRIOR_SIGMAS': math.inf}),
    'ratio_iterations': Rule('adhesion ratios are linearized repeatedly',
                             {'force_update.RATIO_ITERATIONS': 1}),
    # standstill
    'standstill': Rule('zero velocity at standstill',
                       {'wheel_correction.ZeroVelocityDetector.detect': _nothing}),
    'gyro_bias': Rule('gyro bias from standstill',
                      {'wheel_correction.WheelCorrector._correct_gyro_bias': _nothing}),
    'unwinding': Rule('tires unwind after a stop', {'zero_velocity.UNWINDING_SHARE': 0.0}),
    'trusted_standstill': Rule(
        'long standstill overrules the state', {'wheel_correction.TRUSTED_STANDSTILL': math.inf}),
    # IMU
    'spikes': Rule('spikes of the IMU are replaced', {'imu_preprocessing.is_imu_spike': _false}),
    'vibration': Rule(
        'vibration adds noise', {'imu_preprocessing.VibrationMonitor.update': _nothing}),
    'slope_vibration': Rule(
        'vibration is pitch and roll, too', {'imu_preprocessing.SLOPE_VIBRATION_SHARE': 0.0}),
    'steering_efficiency': Rule(
        'yaw rate in dropouts of the IMU from past turns',
        {'steering_efficiency.SteeringEfficiency.update': _nothing}),
})
