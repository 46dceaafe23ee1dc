# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""C_x from acceleration and braking: correct within its standard error, or refused."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
import re

import numpy as np
import pytest
from smart_tire.calibration.stiffness import identify_stiffness
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, RobotParams
from support.identifying import assert_agrees, assert_consistent, errors_of, rms, simulated
from support.straight import CONCRETE, Ground, oscillation, SAND, straight_run

pytestmark = pytest.mark.slow

ROBOT = RobotParams()
LATENCY_ERROR = 0.003  # s, standard deviation of the error of the configured latency
RADIUS_ERROR = 0.02    # standard deviation of the relative error of the rolling radius
SCALE_ERROR = 0.05     # standard deviation of the relative error of accelerations: pitching


def cruise(time):
    return min(max(0.1 * (time - 1.0), 0.0), 0.7)


def random_errors(seed):
    """Return random errors with the prior's sigmas: of the latency [s], and a robot."""
    late, wrong = np.random.default_rng([seed, 5]).standard_normal(2).tolist()
    radius = ROBOT.wheel_radius * (1.0 + RADIUS_ERROR * wrong)
    return LATENCY_ERROR * late, build(RobotParams, {'wheel_radius': radius})


@lru_cache
def fitted(ground, seed):
    late, robot = random_errors(seed)
    run = straight_run(ground, seed, wheel_latency=late, robot=robot)
    scale = 1.0 + SCALE_ERROR * float(np.random.default_rng([seed, 6]).standard_normal())
    return identify_stiffness([scaled(run, scale)], ROBOT)


@pytest.mark.long
@pytest.mark.parametrize('ground', [CONCRETE, SAND])
def test_the_mean_of_many_recordings_is_unbiased(ground):
    """Ten recordings of 12 % each have a mean of 4 %: within three of its standard errors."""
    stiffness = [fitted(ground, seed).stiffness.value for seed in range(10)]
    errors = np.array(stiffness) / ground.stiffness - 1.0
    standard_error = np.std(errors, ddof=1) / np.sqrt(len(errors))
    assert abs(np.mean(errors)) < 3.0 * standard_error < 0.15


def scaled(recording, scale):
    """Return a recording with the forward acceleration multiplied by ``scale``."""
    force = recording.imu.force * np.array([scale, 1.0, 1.0])
    return replace(recording, imu=replace(recording.imu, force=force))


def test_concrete_and_sand_are_correct_within_their_standard_errors(seeds):
    grounds = [CONCRETE, SAND][:len(seeds) - 2]  # sand in "make check" only
    found = [fitted(ground, seed).stiffness for ground in grounds for seed in seeds]
    true = np.repeat([ground.stiffness for ground in grounds], len(seeds))
    assert max(one.sigma / one.value for one in found) < 0.15
    assert_consistent(found, true, 0.7, 1.4)
    assert len(grounds) < 2 or abs(np.mean(errors_of(found, true))) < 0.6


@pytest.mark.parametrize('mass', [5.0, pytest.param(25.0, marks=pytest.mark.long)])
def test_the_stiffness_is_correct_for_other_masses(mass):
    run = straight_run(CONCRETE, 1, mass=mass)
    stiffness = identify_stiffness([run], build(RobotParams, {'mass': mass})).stiffness
    assert_agrees(stiffness, CONCRETE.stiffness)
    assert stiffness.determined


@pytest.mark.parametrize('late, configured', [(0.006, 0.0), (0.2, 0.2)])
def test_an_error_of_the_wheel_latency_is_estimated(late, configured):
    robot = build(RobotParams, {'encoder.latency': configured})
    fit = identify_stiffness([straight_run(CONCRETE, 3, wheel_latency=late)], robot)
    assert_agrees(fit.latency_error, late - configured)
    assert abs(fit.latency_error.value - (late - configured)) < 0.003
    assert_agrees(fit.stiffness, CONCRETE.stiffness)


def test_drag_and_friction_are_estimated_with_the_stiffness_along_a_curve_that_bends():
    fit = identify_stiffness([straight_run(SAND, 4)], ROBOT)
    assert_agrees(fit.drag, SAND.drag * ROBOT.mass * 9.80665)
    assert_agrees(fit.friction, SAND.friction)
    slip, force = fit.curve
    assert (np.diff(slip) >= 0.0).all() and len(fit.slip) == len(fit.force) == len(slip)
    ratio = force / slip
    assert np.mean(ratio[-30:]) < 0.95 * np.mean(ratio[:30]) < SAND.stiffness
    assert np.corrcoef(fit.slip, fit.force)[0, 1] > 0.9


def test_two_recordings_of_one_tire_reduce_the_sigma():
    segments = [straight_run(CONCRETE, seed) for seed in (6, 7)]
    both = identify_stiffness(segments, ROBOT)
    assert both.stiffness.sigma < identify_stiffness(segments[:1], ROBOT).stiffness.sigma
    assert_agrees(both.stiffness, CONCRETE.stiffness)
    assert both.segments == 2 and both.duration > 30.0


def test_recordings_on_different_grounds_are_refused_with_their_values():
    segments = [straight_run(ground, 8, seconds=12.0)
                for ground in (Ground(80.0, 0.47, 0.015), SAND)]
    with pytest.raises(EstimatorError, match='not of one tire on one ground') as caught:
        identify_stiffness(segments, ROBOT)
    hard, soft = map(float, re.findall(r'([0-9.]+) ±', str(caught.value)))
    assert hard == pytest.approx(80.0, rel=0.3) and soft == pytest.approx(30.0, rel=0.2)


@pytest.mark.parametrize('ground, pace, reason', [
    (CONCRETE, cruise, 'speed changes too little'),
    (CONCRETE, lambda time: 0.0, 'no straight segment of 6 wheel samples'),
    (Ground(CONCRETE.stiffness, 0.03, 0.0), oscillation,
     'wheels slide|below critical slip|speed changes too little')])
def test_a_constant_speed_standstill_and_sliding_wheels_are_refused(ground, pace, reason):
    with pytest.raises(EstimatorError, match=reason):
        identify_stiffness([straight_run(ground, 9, pace=pace, seconds=10.0)], ROBOT)


def test_sliding_wheels_determine_the_friction_and_do_not_bias_the_stiffness():
    """Gentle starts and stops, followed by some beyond the friction limit."""
    def mixed(time):
        return oscillation(time) if time < 14.0 else 0.75 + 0.5 * np.sign(np.sin(2.0 * time))
    slippery = Ground(CONCRETE.stiffness, 0.25, 0.015)
    fit = identify_stiffness([straight_run(slippery, 11, pace=mixed, seconds=24.0)], ROBOT)
    assert_agrees(fit.stiffness, CONCRETE.stiffness)
    assert_agrees(fit.friction, 0.25)


def vibrating(recording, size, seed):
    """Return a recording with white vibration [m/s2] while the wheels rotate."""
    imu, wheels = recording.imu, recording.wheels
    speed = np.interp(imu.time, wheels.time, np.abs(wheels.velocity).mean(axis=1))
    noise = size * np.random.default_rng([seed, 3]).standard_normal(imu.force.shape)
    return replace(recording, imu=replace(imu, force=imu.force + (speed > 1.0)[:, None] * noise))


def test_moderate_vibration_increases_the_sigma_and_strong_vibration_is_refused():
    recording = straight_run(CONCRETE, 13)
    quiet, shaken = (identify_stiffness([run], ROBOT).stiffness
                     for run in (recording, vibrating(recording, 0.07, 13)))
    assert shaken.sigma > quiet.sigma
    assert_agrees(shaken, CONCRETE.stiffness)
    with pytest.raises(EstimatorError, match='or the robot vibrates'):
        identify_stiffness([vibrating(recording, 0.5, 13)], ROBOT)


@pytest.mark.parametrize('jitter', [0.0, 0.002])
def test_the_timestamp_jitter_need_not_be_configured_correctly(jitter):
    robot = build(RobotParams, {'encoder.stamp_jitter': jitter})
    assert_agrees(identify_stiffness([straight_run(CONCRETE, 0, robot=robot)], ROBOT).stiffness,
                  CONCRETE.stiffness, 1.5)


def legs(*parts):
    """Return legs from (duration [s], rpm) after 3 s of standstill, and their end."""
    times = np.cumsum([3.0, *(length for length, _ in parts)])
    return [(time, rpm, rpm) for time, (_, rpm) in zip(times, parts)], float(times[-1])


STARTS = legs(*((1.0, 140.0), (0.6, 0.0)) * 4, *((0.9, 140.0), (0.9, 20.0)) * 4, (0.6, 0.0))
STOPS = legs(*((4.0, 90.0), (2.0, 0.0)) * 5)
STEPS = legs(*((1.5, rpm) for rpm in (60.0, 120.0, 40.0, 100.0, 140.0, 60.0, 90.0, 30.0) * 2))
SURFACES = {'concrete': (0.47, 52.7, 0.015), 'gravel': (0.55, 38.0, 0.045),
            'sand': (0.25, 25.0, 0.11)}


@pytest.mark.parametrize('surface', [
    'concrete', *(pytest.param(name, marks=pytest.mark.long) for name in ('gravel', 'sand'))])
@pytest.mark.parametrize('seed', [1, pytest.param(2, marks=pytest.mark.long)])
def test_the_simulated_robot_on_all_surfaces_and_schedules(surface, seed):
    """Starts from standstill, stops, drag, transients beyond critical slip, IMU bias and tilt."""
    friction, stiffness, drag = SURFACES[surface]
    errors = errors_of([identify_stiffness([simulated(*schedule, seed, **{
        'ground.names': ['ground'], 'ground.friction': [friction],
        'ground.stiffness': [stiffness], 'ground.drag': [drag], 'ground.base': 'ground'})],
        ROBOT).stiffness for schedule in (STARTS, STOPS, STEPS)], stiffness)
    assert rms(errors) < 1.5 and np.max(np.abs(errors)) < 3.5


def test_an_imu_mounted_backward_is_refused():
    run = straight_run(CONCRETE, 12, seconds=10.0)
    turned = replace(run, imu=replace(run.imu, force=run.imu.force * np.array([-1.0, -1.0, 1.0])))
    with pytest.raises(EstimatorError, match='axes of the IMU are wrong|not that of a robot'):
        identify_stiffness([turned], ROBOT)
