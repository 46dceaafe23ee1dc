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
from smart_tire.parameters import build, RobotParams, SimulatorParams
from smart_tire.simulation.offline import simulate
from support.driving import Drive, START_NS
from support.identifying import recorded
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


@pytest.mark.parametrize('ground', [
    pytest.param(CONCRETE, id='concrete'),
    pytest.param(SAND, id='sand', marks=pytest.mark.long)])
def test_the_mean_of_many_recordings_is_within_five_percent(ground):
    stiffness = [fitted(ground, seed).stiffness.value for seed in range(10)]
    assert np.mean(stiffness) == pytest.approx(ground.stiffness, rel=0.05)


def scaled(recording, scale):
    """Return a recording with the forward acceleration multiplied by ``scale``."""
    force = recording.imu.force * np.array([scale, 1.0, 1.0])
    return replace(recording, imu=replace(recording.imu, force=force))


def test_concrete_and_sand_are_correct_within_their_standard_errors():
    fits = {ground: [fitted(ground, seed) for seed in range(10)] for ground in (CONCRETE, SAND)}
    errors = []
    for ground, found in fits.items():
        stiffness = np.array([fit.stiffness.value for fit in found])
        sigma = np.array([fit.stiffness.sigma for fit in found])
        assert np.max(sigma / stiffness) < 0.15
        errors += list((stiffness - ground.stiffness) / sigma)
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.4
    assert abs(np.mean(errors)) < 0.6


@pytest.mark.parametrize('mass', [5.0, 25.0])
def test_the_stiffness_is_correct_for_other_masses(mass):
    run = straight_run(CONCRETE, 1, mass=mass)
    stiffness = identify_stiffness([run], build(RobotParams, {'mass': mass})).stiffness
    assert stiffness.value == pytest.approx(CONCRETE.stiffness, abs=3.0 * stiffness.sigma)
    assert stiffness.determined


def test_an_error_of_the_wheel_latency_is_estimated():
    found = [identify_stiffness([straight_run(CONCRETE, seed, wheel_latency=0.006)], ROBOT)
             for seed in range(4)]
    for fit in found:
        assert fit.latency_error.value == pytest.approx(0.006, abs=3.0 * fit.latency_error.sigma)
        assert fit.stiffness.value == pytest.approx(CONCRETE.stiffness,
                                                    abs=3.0 * fit.stiffness.sigma)
    assert np.mean([fit.latency_error.value for fit in found]) > 0.003


def test_the_configured_latency_is_compensated():
    late = build(RobotParams, {'encoder.latency': 0.2})
    fit = identify_stiffness([straight_run(CONCRETE, 3, wheel_latency=0.2)], late)
    assert fit.latency_error.value == pytest.approx(0.0, abs=3.0 * fit.latency_error.sigma)
    assert fit.stiffness.value == pytest.approx(CONCRETE.stiffness, abs=3.0 * fit.stiffness.sigma)


def test_drag_and_friction_are_estimated_with_the_stiffness():
    fit = identify_stiffness([straight_run(SAND, 4)], ROBOT)
    weight = ROBOT.mass * 9.80665
    assert fit.drag.value == pytest.approx(SAND.drag * weight, abs=3.0 * fit.drag.sigma)
    assert fit.friction.value == pytest.approx(SAND.friction, abs=3.0 * fit.friction.sigma)


def test_the_curve_rises_with_the_stiffness_and_bends():
    fit = identify_stiffness([straight_run(SAND, 5)], ROBOT)
    slip, force = fit.curve
    assert (np.diff(slip) >= 0.0).all() and len(fit.slip) == len(fit.force) == len(slip)
    ratio = force / slip
    assert np.mean(ratio[-30:]) < 0.95 * np.mean(ratio[:30]) < SAND.stiffness
    assert np.corrcoef(fit.slip, fit.force)[0, 1] > 0.9


def test_two_recordings_of_one_tire_reduce_the_sigma():
    segments = [straight_run(CONCRETE, seed) for seed in (6, 7)]
    separate = [identify_stiffness([run], ROBOT).stiffness for run in segments]
    both = identify_stiffness(segments, ROBOT)
    combined = both.stiffness
    assert combined.sigma < np.mean([item.sigma for item in separate])
    assert combined.value == pytest.approx(CONCRETE.stiffness, abs=3.0 * combined.sigma)
    assert both.segments == 2 and both.duration > 30.0


def test_recordings_on_different_grounds_are_refused_with_their_values():
    segments = [straight_run(ground, 8) for ground in (Ground(80.0, 0.47, 0.015), SAND)]
    with pytest.raises(EstimatorError, match='not of one tire on one ground') as caught:
        identify_stiffness(segments, ROBOT)
    hard, soft = map(float, re.findall(r'([0-9.]+) ±', str(caught.value)))
    assert hard == pytest.approx(80.0, rel=0.3) and soft == pytest.approx(30.0, rel=0.2)


@pytest.mark.parametrize('pace, reason', [
    (cruise, 'speed changes too little'),
    (lambda time: 0.0, 'no straight segment of 6 wheel samples')])
def test_a_constant_speed_and_standstill_are_refused(pace, reason):
    with pytest.raises(EstimatorError, match=reason):
        identify_stiffness([straight_run(CONCRETE, 9, pace=pace)], ROBOT)


def test_wheels_that_only_slide_are_refused():
    ice = Ground(CONCRETE.stiffness, 0.03, 0.0)
    expected = 'wheels slide|below critical slip|speed changes too little'
    with pytest.raises(EstimatorError, match=expected):
        identify_stiffness([straight_run(ice, 10, seconds=10.0)], ROBOT)


def test_sliding_wheels_determine_the_friction_and_do_not_bias_the_stiffness():
    """Gentle starts and stops, followed by some beyond the friction limit."""
    def mixed(time):
        return oscillation(time) if time < 14.0 else 0.75 + 0.5 * np.sign(np.sin(2.0 * time))
    slippery = Ground(CONCRETE.stiffness, 0.25, 0.015)
    fit = identify_stiffness([straight_run(slippery, 11, pace=mixed, seconds=24.0)], ROBOT)
    assert fit.stiffness.value == pytest.approx(CONCRETE.stiffness, abs=3.0 * fit.stiffness.sigma)
    assert fit.friction.value == pytest.approx(0.25, abs=3.0 * fit.friction.sigma)


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
    assert shaken.value == pytest.approx(CONCRETE.stiffness, abs=3.0 * shaken.sigma)
    with pytest.raises(EstimatorError, match='or the robot vibrates'):
        identify_stiffness([vibrating(recording, 0.5, 13)], ROBOT)


@pytest.mark.parametrize('jitter', [0.0, 0.002])
def test_the_timestamp_jitter_need_not_be_configured_correctly(jitter):
    errors = []
    for seed in range(4):
        robot = build(RobotParams, {'encoder.stamp_jitter': jitter})
        run = straight_run(CONCRETE, seed, seconds=40.0, robot=robot)
        fit = identify_stiffness([run], ROBOT).stiffness
        errors.append((fit.value - CONCRETE.stiffness) / fit.sigma)
    assert np.sqrt(np.mean(np.square(errors))) < 1.5


def legs(*parts):
    """Return legs from (duration [s], rpm) after 3 s of standstill, and their end."""
    times = np.cumsum([3.0, *(length for length, _ in parts)])
    return [(time, rpm, rpm) for time, (_, rpm) in zip(times, parts)], float(times[-1])


STARTS = legs(*((1.0, 140.0), (0.6, 0.0)) * 4, *((0.9, 140.0), (0.9, 20.0)) * 4, (0.6, 0.0))
STOPS = legs(*((4.0, 90.0), (2.0, 0.0)) * 5)
STEPS = legs(*((1.5, rpm) for rpm in (60.0, 120.0, 40.0, 100.0, 140.0, 60.0, 90.0, 30.0) * 2))
SURFACES = {'concrete': (0.47, 52.7, 0.015), 'gravel': (0.55, 38.0, 0.045),
            'sand': (0.25, 25.0, 0.11)}


def simulated(schedule, surface, seed):
    """Return a recording of the simulated robot."""
    friction, stiffness, drag = SURFACES[surface]
    params = build(SimulatorParams, {
        'seed': seed, 'ground.names': ['ground'], 'ground.friction': [friction],
        'ground.stiffness': [stiffness], 'ground.drag': [drag], 'ground.base': 'ground',
        'ground.patches.names': [], 'film.wheels': []})
    samples = [sample for _, topic, sample in simulate(params, *schedule, start_ns=START_NS)
               if topic in ('imu/data', 'wheel_states')]
    return recorded(Drive(samples, *(np.empty(0),) * 4))


@pytest.mark.parametrize('surface', [
    'concrete', *(pytest.param(name, marks=pytest.mark.long) for name in ('gravel', 'sand'))])
def test_the_simulated_robot_on_all_surfaces_and_schedules(surface):
    """Starts from standstill, stops, drag, transients beyond critical slip, IMU bias and tilt."""
    errors, true = [], SURFACES[surface][1]
    for schedule in (STARTS, STOPS, STEPS):
        for seed in (1, 2):
            fit = identify_stiffness([simulated(schedule, surface, seed)], ROBOT).stiffness
            errors.append((fit.value - true) / fit.sigma)
    assert np.sqrt(np.mean(np.square(errors))) < 1.5
    assert np.max(np.abs(errors)) < 3.5


def test_an_imu_mounted_backward_is_refused():
    run = straight_run(CONCRETE, 12, seconds=10.0)
    turned = replace(run, imu=replace(run.imu, force=run.imu.force * np.array([-1.0, -1.0, 1.0])))
    with pytest.raises(EstimatorError, match='axes of the IMU are wrong|not that of a robot'):
        identify_stiffness([turned], ROBOT)
