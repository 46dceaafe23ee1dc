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

"""Slip estimator on hills, ramps and rough ground, for a small and for a large robot."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from benchmarks.hills import HILL_SCENARIOS, STOP, WAVELENGTHS
from benchmarks.scenarios import sequence
from benchmarks.slip.candidates import live_estimate
from benchmarks.slip.inputs import as_inputs
from benchmarks.slip.odometry import gyro_odometry
from benchmarks.slip.scoring import path_score, slip_errors, steady_sides
from benchmarks.slip.series import as_truth, side_means
import numpy as np
import pytest
from smart_tire.analysis.series import at
from smart_tire.parameters import build, SimulatorParams, SlipEstimatorParams
from smart_tire.parameters.simulation import GroundParams
from smart_tire.samples import NS_PER_S, WheelSample
from smart_tire.simulation.offline import simulate
from smart_tire.simulation.terrain import on_slopes, rolling_hills

pytestmark = pytest.mark.slow

SEEDS = range(11, 14)  # not used by a benchmark
LEARNING_ERROR = 0.1     # m, 0.1 m/s for the second in which the first slope is learned
LARGE = {  # the size of a Warthog; the tire of the estimator stays that of the small robot
    'wheel_radius': 0.3, 'track_width': 1.08, 'wheelbase': 1.05, 'mass': 470.0,
    'yaw_inertia': 120.0, 'imu.position': [0.0, 0.0, 0.0], 'imu.gyro_noise': 0.006,
    'imu.accel_noise': 0.014, 'imu.gyro_bias': 0.002, 'imu.accel_bias': 0.2,
    'encoder.stamp_jitter': 0.005, 'film.wheels': [], 'motor.inertia': 1.0,
    'motor.coulomb_friction': 1.0}
GROUND = GroundParams(base='concrete', patches=(), stiffness=(4500.0, 2600.0),
                      friction=(0.6, 0.35))
SPEEDS = ((12.0, 48.0, 48.0), (6.0, 58.0, 35.0), STOP, (12.0, 64.0, 64.0), (8.0, 32.0, 54.0),
          STOP, (5.0, -32.0, -32.0), STOP, (15.0, 58.0, 58.0), STOP)  # rpm, up to 2 m/s


@cache
def large_run(seed):
    """Return parameters and events of a large robot on hills, with 4 Hz wheel velocities."""
    legs, duration = sequence(*SPEEDS)
    params = replace(build(SimulatorParams, {
        'seed': seed, 'imu_rate': 20.0, 'drive.stall_torque': 600.0, **LARGE}), ground=GROUND)
    events = on_slopes(simulate(params, legs, duration, wheel_rate=4.0), params.robot,
                       rolling_hills(0.03, WAVELENGTHS, seed))
    return params.robot, events


@cache
def small_run(name, seed):
    scenario = HILL_SCENARIOS[name]
    return scenario.robot, scenario.events(seed)


def evaluate(robot, events):
    """Return normalized speed errors, their time, path error ratio, and slip rms over zero's."""
    truth = as_truth((sample for _, topic, sample in events
                      if topic.startswith('ground_truth/')), robot)
    samples = [replace(sample, effort=None, position=None if robot.mass > 100.0 else
                       sample.position) if isinstance(sample, WheelSample) else sample
               for _, topic, sample in events if not topic.startswith('ground_truth/')]
    estimate = live_estimate(samples, SlipEstimatorParams(robot=robot))
    gyro = gyro_odometry(as_inputs(samples, robot))
    poses, v_x = estimate.poses, truth.poses.twist[:, 0]
    error = at(truth.stamp_ns, poses.stamp_ns, poses.twist[:, :1])[:, 0] - v_x
    variance = at(truth.stamp_ns, poses.stamp_ns, poses.twist_variance[:, :1])[:, 0]
    moving = np.isfinite(error) & (np.abs(v_x) > 0.05)
    slip, _ = slip_errors(estimate, truth)
    true = side_means(truth.ratio)
    steady = steady_sides(truth) & np.isfinite(slip) & np.isfinite(true)
    return ((error / np.sqrt(variance))[moving], truth.stamp_ns[moving] / NS_PER_S,
            path_score(estimate, truth).rms_m, path_score(gyro, truth).rms_m,
            np.sqrt(np.mean(slip[steady] ** 2) / np.mean(true[steady] ** 2)))


def longest(time, outside):
    """Return the longest time [s] for which ``outside`` is true without interruption."""
    begins = np.flatnonzero(np.diff(outside.astype(int), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(outside.astype(int), append=0) == -1)
    return max((time[end] - time[begin] for begin, end in zip(begins, ends)), default=0.0)


@pytest.mark.parametrize('run', [
    pytest.param(lambda seed: small_run('hills', seed), id='hills'),
    pytest.param(lambda seed: small_run('rough_hills', seed), id='rough_hills',
                 marks=pytest.mark.long),
    pytest.param(lambda seed: small_run('ramp', seed), id='ramp', marks=pytest.mark.long),
    pytest.param(lambda seed: small_run('speed_bump', seed), id='speed_bump'),
    pytest.param(large_run, id='large_robot')])
def test_speed_path_and_slip_are_right_on_slopes(run):
    results = [evaluate(*run(seed)) for seed in SEEDS]
    normalized = np.concatenate([result[0] for result in results])
    assert np.mean(normalized ** 2) < 1.5
    assert np.mean(np.abs(normalized) > 3.0) < 0.02
    assert max(longest(time, np.abs(error) > 3.0) for error, time, *_ in results) < 2.0
    paths = np.sqrt(np.mean([[own ** 2, gyro ** 2] for _, _, own, gyro, _ in results], axis=0))
    assert paths[0] < 1.2 * paths[1] + LEARNING_ERROR
    assert all(share < 1.0 for *_, share in results)  # of the error of assuming no slip
