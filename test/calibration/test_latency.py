# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Latency and effective track from turns and speed changes, within their standard errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from smart_tire.calibration.latency import fit_speed_changes, fit_yaw_rate
from smart_tire.calibration.recording import WheelRecord
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, RobotParams
from support.driving import drive
from support.identifying import (
    assert_agrees, assert_consistent, random_signal, recorded, simulated, TRACK, turning_run)

pytestmark = pytest.mark.slow

ROBOT = RobotParams()
FIRM = build(RobotParams, {'tire.longitudinal_stiffness': 2000.0})  # stiff tires, little slip


def latency_of(seed):
    return float(np.random.default_rng(seed).uniform(-0.05, 0.25))


@pytest.mark.parametrize('options', [
    {}, {'wheel_rate': 4.0, 'positions': False},
    pytest.param({'wheel_rate': 200.0, 'imu_rate': 400.0}, marks=pytest.mark.long),
    {'wheel_rate': 50.0, 'imu_rate': 20.0, 'positions': False}], ids=str)
def test_latency_and_track_are_correct_within_their_standard_errors(options, seeds):
    late = list(map(latency_of, seeds))
    found = [fit_yaw_rate(recorded(turning_run(seed, wheel_latency=latency_of(seed), **options)),
                          ROBOT) for seed in seeds]
    assert_consistent([fit.latency for fit in found], late, 0.4, 1.5)
    assert_consistent([fit.slope for fit in found], TRACK / ROBOT.wheel_radius, 0.5, 1.6)
    assert_consistent([fit.radius_difference for fit in found], 0.0, 0.4, 1.6)
    assert np.median([fit.latency.sigma for fit in found]) < 0.012


@pytest.mark.parametrize('seed', [1, pytest.param(2, marks=pytest.mark.long)])
def test_the_lag_of_soft_tires_is_not_taken_for_latency(seed):
    """On the simulated robot, whose soft tires alone would hide 10 to 25 ms of a latency."""
    legs = [(0.0, 0.0, 0.0)] + [
        (3.0 + 2.5 * k, *np.random.default_rng([seed, k]).choice(
            [40.0, 60.0, 80.0, 100.0], 2).tolist()) for k in range(14)]
    fit = fit_yaw_rate(simulated(legs, 40.0, seed, **{'encoder.latency': 0.05}), ROBOT)
    assert_agrees(fit.latency, 0.05, 2.5)
    assert fit.latency.sigma < 0.015


def test_a_larger_right_wheel_does_not_change_the_track():
    recording = recorded(turning_run(3, slip=0.002))
    right = np.array([1.0, 1.02, 1.0, 1.02])  # a larger wheel rotates less over the same distance
    wheels = WheelRecord(recording.wheels.time, recording.wheels.velocity / right,
                         recording.wheels.position / right)
    fit = fit_yaw_rate(replace(recording, wheels=wheels), ROBOT)
    assert_agrees(fit.radius_difference, 0.02)
    assert fit.radius_difference.sigma < 0.004


def test_outliers_do_not_matter():
    recording = recorded(turning_run(4, wheel_latency=0.08, positions=False))
    velocity = recording.wheels.velocity.copy()
    velocity[::37] += np.array([20.0, -20.0, 20.0, -20.0])
    wheels = replace(recording.wheels, velocity=velocity)
    fit = fit_yaw_rate(replace(recording, wheels=wheels), ROBOT)
    assert_agrees(fit.latency, 0.08)
    assert fit.slope.value * ROBOT.wheel_radius == pytest.approx(TRACK, rel=0.03)


def test_a_recording_with_little_yaw_is_not_used():
    with pytest.raises(EstimatorError, match='fit equally|follow'):
        fit_yaw_rate(recorded(turning_run(5, turn=0.004)), ROBOT)


@pytest.mark.parametrize('change, reason', [
    (lambda speed: 0.0 * speed, 'do not rotate'),
    (lambda speed: speed[:, [1, 0, 3, 2]], 'swapped'),
    (lambda speed: speed.mean(axis=1, keepdims=True) * np.ones(4), None)])
def test_standstill_swapped_sides_and_the_mean_of_both_sides_are_refused(change, reason):
    recording = recorded(turning_run(4, wheel_latency=0.08, positions=False))
    velocity = change(recording.wheels.velocity)
    with pytest.raises(EstimatorError, match=reason):
        fit_yaw_rate(replace(recording, wheels=replace(recording.wheels, velocity=velocity)),
                     ROBOT)


def straight_run(seed, seconds=60.0, size=0.3, **options):
    rng = np.random.default_rng([seed, 9])
    time = np.arange(round(1e3 * seconds)) * 1e-3
    gate = np.clip(np.minimum(time - 3.0, seconds - 3.0 - time), 0.0, 1.0)
    speed = gate * (0.7 + random_signal(rng, seconds, size, 0.4))
    return drive(np.stack([speed, speed], axis=1), np.zeros((len(time), 2)), seed=seed,
                 robot=FIRM, **options)


@pytest.mark.parametrize('options', [{}, {'wheel_rate': 4.0, 'positions': False}], ids=str)
def test_the_latency_by_speed_changes_is_correct_within_its_standard_error(options, seeds):
    found = [fit_speed_changes(recorded(straight_run(
        seed, wheel_latency=latency_of(seed), **options)), FIRM).latency for seed in seeds]
    assert_consistent(found, list(map(latency_of, seeds)), 0.3, 1.6)
    assert np.median([latency.sigma for latency in found]) < 0.01


def test_the_radius_is_rough_and_soft_tires_leave_the_latency_uncertain():
    run = recorded(straight_run(1))
    firm, soft = (fit_speed_changes(run, robot) for robot in (
        FIRM, build(RobotParams, {'tire.longitudinal_stiffness': 20.0})))
    assert firm.radius.value == pytest.approx(FIRM.wheel_radius, rel=0.03)
    assert firm.radius.sigma > 0.05 * firm.radius.value
    assert soft.latency.sigma > firm.latency.sigma


def test_a_constant_speed_shows_no_latency():
    steady = np.full((60_000, 2), 0.7)
    with pytest.raises(EstimatorError):
        fit_speed_changes(recorded(drive(steady, 0.0 * steady, robot=FIRM)), FIRM)
