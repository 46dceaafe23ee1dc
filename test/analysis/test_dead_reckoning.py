# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Dead reckoning is exact if its assumptions hold."""

from dataclasses import replace
import math

import numpy as np
import pytest

from smart_tire.analysis.dead_reckoning import (
    as_inputs, baselines, gyro_odometry, GYRO_WHEELS, wheel_odometry, WHEELS_ONLY)
from smart_tire.errors import EstimatorError
from smart_tire.estimates import at
from smart_tire.parameters import RobotParams
from smart_tire.parameters.robot import EncoderParams, ImuParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample
from support.driving import drive, ramp, START_NS

# Nearly exact encoders with timestamps of whole milliseconds, to test the arithmetic.
ROBOT = RobotParams(encoder=EncoderParams(counts_per_revolution=1e7))
WINDING = ramp([(0, 0, 0), (2, 0, 0), (3, .5, .5), (6, .6, .4), (9, .3, .6), (12, .5, .5),
                (14, -.2, .2), (16, 0, 0), (17, 0, 0)])


def inputs_of(samples, robot=ROBOT):
    """Return the inputs among ``samples``."""
    return as_inputs(SampleArrays(samples), robot)


def without_slip(**options):
    """Return a run without slip and its inputs; without noise by default."""
    run = drive(WINDING, np.zeros_like(WINDING), icr=0.0,
                **{'robot': ROBOT, 'noise': 0.0, 'wheel_rate': 20.0, **options})
    return run, inputs_of(run.samples, options.get('robot', ROBOT))


def pose_errors(estimate, run):
    """Return errors of x, y, yaw (n, 3) of an estimate."""
    stamps = START_NS + np.round(run.time * NS_PER_S).astype(np.int64)
    error = estimate.pose - at(estimate.stamp_ns, stamps, run.pose)
    return error[np.isfinite(error[:, 0])]


LATE = replace(ROBOT, encoder=replace(ROBOT.encoder, latency=0.2))


@pytest.mark.parametrize('method, options', [
    (wheel_odometry, {}), (wheel_odometry, {'positions': False}), (gyro_odometry, {}),
    (gyro_odometry, {'robot': LATE, 'wheel_latency': 0.2})])
def test_poses_are_exact_without_slip(method, options):
    run, inputs = without_slip(**options)
    poses, slips = method(inputs)
    assert np.abs(pose_errors(poses, run)).max() < 1e-3
    if method is wheel_odometry:
        slips, still = slips.ratio, np.abs(inputs.rolling).max(axis=1) < 0.05
        assert np.nanmax(np.abs(slips)) < 1e-9
        assert np.isnan(slips[still]).all() and np.isfinite(slips[~still]).any()


def test_the_bias_is_estimated_from_the_initial_standstill():
    run, inputs = without_slip(robot=replace(ROBOT, imu=ImuParams(gyro_bias=0.05)), noise=1.0)
    assert 150 < inputs.stationary < 200
    assert np.abs(pose_errors(gyro_odometry(inputs)[0], run)[:, 2]).max() < 0.06


def test_the_gyroscope_shows_the_slip_difference_and_wheels_alone_show_none():
    slip = np.where(WINDING != 0.0, [0.1, 0.3], 0.0)
    run = drive(WINDING, slip * WINDING, icr=0.0, robot=ROBOT, noise=0.0)
    inputs = inputs_of(run.samples)
    rolling = ramp([(0, .5, .5), (1, .5, .5)])[0]
    ground = rolling * [0.9, 0.7]
    steady = (inputs.wheel_ns - START_NS) / NS_PER_S
    middle = np.argmin(np.abs(steady - 3.0))  # both sides at 0.5 m/s
    blind = wheel_odometry(inputs)[1].ratio[middle]
    assert blind == pytest.approx(np.zeros(4), abs=1e-6)
    _, seen = gyro_odometry(inputs)
    ratio = at(inputs.wheel_ns[[middle]], seen.stamp_ns, seen.ratio)[0]
    half_difference = 0.5 * (ground[0] - ground[1]) / 0.5
    assert ratio[:2] == pytest.approx([-half_difference, half_difference], abs=0.03)


def test_duplicates_and_reordering_change_nothing():
    run, inputs = without_slip()
    rng = np.random.default_rng(1)
    mixed = [run.samples[i] for i in rng.permutation(len(run.samples))] + run.samples[::3]
    again = inputs_of(mixed)
    for name in ('imu_ns', 'rate', 'wheel_ns', 'travel'):
        assert np.array_equal(getattr(inputs, name), getattr(again, name))


def test_imu_samples_are_rotated_into_the_axes_of_the_robot():
    turned = replace(ROBOT, imu=ImuParams(rotation=(math.pi, 0.0, 0.0)))
    stamps = range(0, NS_PER_S, NS_PER_S // 100)
    samples = [ImuSample(stamp, (1.0, 2.0, -9.8), (0.0, 0.1, -0.5)) for stamp in stamps]
    samples += [WheelSample(stamp, (0.0,) * 4, (0.0,) * 4) for stamp in stamps]
    inputs = inputs_of(samples, turned)
    assert inputs.rate == pytest.approx(np.full(100, 0.5))


def test_too_few_samples_are_rejected():
    with pytest.raises(EstimatorError, match='too few samples'):
        inputs_of([])
    assert baselines(SampleArrays(), ROBOT) == {}


def test_wheels_without_encoder_and_missing_messages_leave_the_path_of_the_others():
    run, _ = without_slip(positions=False)
    missing, exact = math.nan, baselines(SampleArrays(run.samples), ROBOT)
    samples = [one if isinstance(one, ImuSample) else replace(
        one, velocity=(missing, *one.velocity[1:3], missing)) for one in run.samples]
    samples[50] = WheelSample(samples[50].stamp_ns, (missing,) * 4)
    found = baselines(SampleArrays(samples), ROBOT)
    assert list(found) == list(exact) == [GYRO_WHEELS, WHEELS_ONLY]
    for name, poses in found.items():
        assert poses.pose[-1] == pytest.approx(exact[name].pose[-1], abs=0.01)
