# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The methods for comparison are exact if their assumptions hold."""

from dataclasses import replace
import math

from benchmarks.events import has_efforts
from benchmarks.slip import methods
from benchmarks.slip.methods import compare_methods, LIVE, METHODS
from benchmarks.slip.odometry import as_inputs, gyro_odometry, wheel_odometry
import numpy as np
import pytest
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams, SlipEstimatorParams
from smart_tire.parameters.robot import EncoderParams, ImuParams
from smart_tire.recording import at
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample
from support.driving import drive, ramp, START_NS

# Nearly exact encoders with timestamps of whole milliseconds, to test the arithmetic.
ROBOT = RobotParams(encoder=EncoderParams(counts_per_revolution=1e7))
WINDING = ramp([(0, 0, 0), (2, 0, 0), (3, .5, .5), (6, .6, .4), (9, .3, .6), (12, .5, .5),
                (14, -.2, .2), (16, 0, 0), (17, 0, 0)])


def without_slip(**options):
    """Return a run without slip and its inputs; without noise by default."""
    run = drive(WINDING, np.zeros_like(WINDING), icr=0.0,
                **{'robot': ROBOT, 'noise': 0.0, 'wheel_rate': 20.0, **options})
    return run, as_inputs(run.samples, options.get('robot', ROBOT))


def pose_errors(estimate, run):
    """Return errors of x, y, yaw (n, 3) of an estimate."""
    stamps = START_NS + np.round(run.time * NS_PER_S).astype(np.int64)
    error = estimate.poses.pose - at(estimate.poses.stamp_ns, stamps, run.pose)
    return error[np.isfinite(error[:, 0])]


LATE = replace(ROBOT, encoder=replace(ROBOT.encoder, latency=0.2))


@pytest.mark.parametrize('method, options', [
    (wheel_odometry, {}), (wheel_odometry, {'positions': False}), (gyro_odometry, {}),
    (gyro_odometry, {'robot': LATE, 'wheel_latency': 0.2})])
def test_poses_are_exact_without_slip(method, options):
    run, inputs = without_slip(**options)
    estimate = method(inputs)
    assert np.abs(pose_errors(estimate, run)).max() < 1e-3
    if method is wheel_odometry:
        slips, still = estimate.slips.ratio, np.abs(inputs.rolling).max(axis=1) < 0.05
        assert np.nanmax(np.abs(slips)) < 1e-9
        assert np.isnan(slips[still]).all() and np.isfinite(slips[~still]).any()


def test_the_bias_is_estimated_from_the_initial_standstill():
    run, inputs = without_slip(robot=replace(ROBOT, imu=ImuParams(gyro_bias=0.05)), noise=1.0)
    assert 150 < inputs.stationary < 200
    assert np.abs(pose_errors(gyro_odometry(inputs), run)[:, 2]).max() < 0.06


def test_the_gyroscope_shows_the_slip_difference_and_wheels_alone_show_none():
    slip = np.where(WINDING != 0.0, [0.1, 0.3], 0.0)
    run = drive(WINDING, slip * WINDING, icr=0.0, robot=ROBOT, noise=0.0)
    inputs = as_inputs(run.samples, ROBOT)
    rolling = ramp([(0, .5, .5), (1, .5, .5)])[0]
    ground = rolling * [0.9, 0.7]
    steady = (inputs.wheel_ns - START_NS) / NS_PER_S
    middle = np.argmin(np.abs(steady - 3.0))  # both sides at 0.5 m/s
    blind = wheel_odometry(inputs).slips.ratio[middle]
    assert blind == pytest.approx(np.zeros(4), abs=1e-6)
    seen = gyro_odometry(inputs)
    ratio = at(inputs.wheel_ns[[middle]], seen.slips.stamp_ns, seen.slips.ratio)[0]
    half_difference = 0.5 * (ground[0] - ground[1]) / 0.5
    assert ratio[:2] == pytest.approx([-half_difference, half_difference], abs=0.03)


def test_duplicates_and_reordering_change_nothing():
    run, inputs = without_slip()
    rng = np.random.default_rng(1)
    mixed = [run.samples[i] for i in rng.permutation(len(run.samples))] + run.samples[::3]
    again = as_inputs(mixed, ROBOT)
    for name in ('imu_ns', 'rate', 'wheel_ns', 'travel'):
        assert np.array_equal(getattr(inputs, name), getattr(again, name))


def test_imu_samples_are_rotated_into_the_axes_of_the_robot():
    turned = replace(ROBOT, imu=ImuParams(rotation=(math.pi, 0.0, 0.0)))
    stamps = range(0, NS_PER_S, NS_PER_S // 100)
    samples = [ImuSample(stamp, (1.0, 2.0, -9.8), (0.0, 0.1, -0.5)) for stamp in stamps]
    samples += [WheelSample(stamp, (0.0,) * 4, (0.0,) * 4) for stamp in stamps]
    inputs = as_inputs(samples, turned)
    assert inputs.rate == pytest.approx(np.full(100, 0.5))


def test_too_few_samples_are_rejected():
    with pytest.raises(EstimatorError, match='too few samples'):
        as_inputs([], ROBOT)


def test_every_method_gives_estimates():
    run, _ = without_slip(noise=1.0)
    estimates = compare_methods(run.samples, SlipEstimatorParams(robot=ROBOT))
    assert list(estimates) == [name for name in METHODS if 'torque' not in name]
    assert all(len(estimate.poses.stamp_ns) > 200 for estimate in estimates.values())
    assert 0.0 < estimates[LIVE].step_us < math.inf
    assert math.isfinite(estimates[LIVE].nis)


def test_torques_are_used_by_their_own_methods_only(monkeypatch):
    run, _ = without_slip(noise=1.0)
    samples = [replace(sample, effort=(0.1,) * 4) if isinstance(sample, WheelSample) else sample
               for sample in run.samples]
    efforts = {}

    def candidate(name):
        def estimate(inputs, params):
            efforts[name] = efforts.get(name, []) + [has_efforts(inputs)]
            return gyro_odometry(as_inputs(inputs, params.robot))
        return estimate
    for name in ('live_estimate', 'smoothed_estimate'):
        monkeypatch.setattr(methods, name, candidate(name))
    estimates = compare_methods(samples, SlipEstimatorParams(robot=ROBOT))
    assert list(estimates) == list(METHODS)
    assert efforts == {'live_estimate': [False, True], 'smoothed_estimate': [False, True]}
