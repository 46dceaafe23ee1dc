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
from smart_tire.calibration.priors import LIMITS
from smart_tire.calibration.recording import ImuRecord, Recording, WheelRecord
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, RobotParams, SimulatorParams
from smart_tire.simulation.offline import simulate
from support.driving import Drive, drive, START_NS
from support.identifying import random_signal, recorded, TRACK, turning_run

pytestmark = pytest.mark.slow

ROBOT = RobotParams()
FIRM = build(RobotParams, {'tire.longitudinal_stiffness': 2000.0})  # stiff tires, little slip
SEEDS = range(8)


def fits(**options):
    """Return true latencies and fits of several recordings."""
    found = []
    for seed in SEEDS:
        late = float(np.random.default_rng(seed).uniform(-0.05, 0.25))
        run = turning_run(seed, wheel_latency=late, **options)
        found.append((late, fit_yaw_rate(recorded(run), ROBOT)))
    return found


def normalized_rms(pairs):
    return float(np.sqrt(np.mean([((found.value - true) / found.sigma) ** 2
                                  for true, found in pairs])))


@pytest.mark.parametrize('options', [
    {}, {'wheel_rate': 4.0, 'positions': False}, {'wheel_rate': 200.0, 'imu_rate': 400.0},
    {'wheel_rate': 50.0, 'imu_rate': 20.0, 'positions': False}], ids=str)
def test_latency_and_track_are_correct_within_their_standard_errors(options):
    found = fits(**options)
    assert 0.4 < normalized_rms([(late, fit.latency) for late, fit in found]) < 1.5
    assert 0.5 < normalized_rms([(TRACK / ROBOT.wheel_radius, fit.slope)
                                 for _, fit in found]) < 1.6
    assert 0.4 < normalized_rms([(0.0, fit.radius_difference) for _, fit in found]) < 1.6
    assert np.median([fit.latency.sigma for _, fit in found]) < 0.012


@pytest.mark.parametrize('seed', [1, 2])
def test_the_lag_of_soft_tires_is_not_taken_for_latency(seed):
    """On the simulated robot, whose soft tires alone would hide 10 to 25 ms of a latency."""
    params = build(SimulatorParams, {
        'seed': seed, 'ground.base': 'concrete', 'ground.patches.names': [],
        'encoder.latency': 0.05})
    legs = [(0.0, 0.0, 0.0)] + [
        (3.0 + 2.5 * k, *np.random.default_rng([seed, k]).choice(
            [40.0, 60.0, 80.0, 100.0], 2).tolist()) for k in range(14)]
    run = Drive([sample for _, topic, sample in simulate(params, legs, 40.0, start_ns=START_NS)
                 if topic in ('imu/data', 'wheel_states')], *(np.empty(0),) * 4)
    fit = fit_yaw_rate(recorded(run), ROBOT)
    assert fit.latency.value == pytest.approx(0.05, abs=2.5 * fit.latency.sigma)
    assert fit.latency.sigma < 0.015


def test_a_larger_right_wheel_does_not_change_the_track():
    recording = recorded(turning_run(3, slip=0.002))
    right = np.array([1.0, 1.02, 1.0, 1.02])  # a larger wheel rotates less over the same distance
    wheels = WheelRecord(recording.wheels.time, recording.wheels.velocity / right,
                         recording.wheels.position / right)
    fit = fit_yaw_rate(replace(recording, wheels=wheels), ROBOT)
    difference = fit.radius_difference
    assert difference.value == pytest.approx(0.02, abs=3.0 * difference.sigma)
    assert difference.sigma < 0.004


def test_outliers_do_not_matter():
    recording = recorded(turning_run(4, wheel_latency=0.08, positions=False))
    velocity = recording.wheels.velocity.copy()
    velocity[::37] += np.array([20.0, -20.0, 20.0, -20.0])
    wheels = replace(recording.wheels, velocity=velocity)
    fit = fit_yaw_rate(replace(recording, wheels=wheels), ROBOT)
    assert fit.latency.value == pytest.approx(0.08, abs=3.0 * fit.latency.sigma)
    assert fit.slope.value * ROBOT.wheel_radius == pytest.approx(TRACK, rel=0.03)


def test_a_recording_with_little_yaw_is_not_used():
    try:
        fit = fit_yaw_rate(recorded(turning_run(5, turn=0.004)), ROBOT)
    except EstimatorError as error:
        assert 'fit equally' in str(error) or 'follow' in str(error)
    else:
        assert not fit.latency.sigma < LIMITS['wheel latency'].sigma


def test_a_stationary_robot_is_refused():
    time = np.arange(0.0, 20.0, 0.01)
    rest = ImuRecord(time, np.zeros((2000, 3)), np.tile([0.0, 0.0, 9.81], (2000, 1)))
    wheels = WheelRecord(time[::6], np.zeros((len(time[::6]), 4)), None)
    with pytest.raises(EstimatorError, match='do not rotate'):
        fit_yaw_rate(Recording(rest, wheels), ROBOT)


def test_swapped_sides_are_detected():
    recording = recorded(turning_run(6))
    swapped = [1, 0, 3, 2]
    wheels = WheelRecord(recording.wheels.time, recording.wheels.velocity[:, swapped],
                         recording.wheels.position[:, swapped])
    with pytest.raises(EstimatorError, match='swapped'):
        fit_yaw_rate(replace(recording, wheels=wheels), ROBOT)


def test_the_mean_of_both_sides_is_refused():
    recording = recorded(turning_run(7, positions=False))
    mean = recording.wheels.velocity.mean(axis=1, keepdims=True) * np.ones(4)
    with pytest.raises(EstimatorError):
        fit_yaw_rate(replace(recording, wheels=replace(recording.wheels, velocity=mean)), ROBOT)


def straight_run(seed, seconds=60.0, size=0.3, **options):
    rng = np.random.default_rng([seed, 9])
    time = np.arange(round(1e3 * seconds)) * 1e-3
    gate = np.clip(np.minimum(time - 3.0, seconds - 3.0 - time), 0.0, 1.0)
    speed = gate * (0.7 + random_signal(rng, seconds, size, 0.4))
    return drive(np.stack([speed, speed], axis=1), np.zeros((len(time), 2)), seed=seed,
                 robot=FIRM, **options)


@pytest.mark.parametrize('options', [{}, {'wheel_rate': 4.0, 'positions': False}], ids=str)
def test_the_latency_by_speed_changes_is_correct_within_its_standard_error(options):
    errors, sigmas = [], []
    for seed in range(8):
        late = float(np.random.default_rng(seed).uniform(-0.05, 0.25))
        fit = fit_speed_changes(recorded(straight_run(seed, wheel_latency=late, **options)), FIRM)
        errors.append((fit.latency.value - late) / fit.latency.sigma)
        sigmas.append(fit.latency.sigma)
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 1.6
    assert np.median(sigmas) < 0.01


def test_the_radius_is_rough_and_its_sigma_shows_it():
    radius = fit_speed_changes(recorded(straight_run(1)), FIRM).radius
    assert radius.value == pytest.approx(FIRM.wheel_radius, rel=0.03)
    assert radius.sigma > 0.05 * radius.value


def test_soft_tires_leave_the_latency_uncertain():
    soft = build(RobotParams, {'tire.longitudinal_stiffness': 20.0})
    run = recorded(straight_run(2))
    assert fit_speed_changes(run, soft).latency.sigma > fit_speed_changes(
        run, FIRM).latency.sigma


def test_a_constant_speed_shows_no_latency():
    time = np.arange(60_000) * 1e-3
    steady = np.full((len(time), 2), 0.7)
    try:
        fit = fit_speed_changes(recorded(drive(steady, 0.0 * steady, robot=FIRM)), FIRM)
    except EstimatorError:
        return
    assert fit.latency.sigma > LIMITS['wheel latency'].sigma
