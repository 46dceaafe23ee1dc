# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Noise, bias and tilt of the IMU at standstill, and the jitter of the wheel timestamps."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest
from smart_tire.calibration.recording import CalibrationRecording, ImuRecord, WheelRecord
from smart_tire.calibration.sensor_noise import (
    fit_jitter, fit_rest, motion_noise, stationary_intervals)
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, RobotParams
from smart_tire.rotation import matrix
from smart_tire.samples import GRAVITY
from support.identifying import assert_consistent, errors_of, recorded, rms, turning_run

ROBOT = RobotParams()
BIAS = np.array([0.01, -0.02, 0.005])  # rad/s
NOISE = (0.004, 0.03)                  # rad/s, m/s2


def stop_and_go(seed, *, tilt=(0.0, 0.0), legs=4, rest=6.0, drive=4.0, rate=100.0):
    """Return a recording that alternates between standstill and driving, which vibrates."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, legs * (rest + drive), 1.0 / rate)
    moving = (time % (rest + drive)) > rest
    shaking = np.where(moving, 20.0, 1.0)[:, None]
    gravity = matrix(*tilt, 0.0).T @ np.array([0.0, 0.0, GRAVITY])
    imu = ImuRecord(time, BIAS + shaking * NOISE[0] * rng.standard_normal((len(time), 3)),
                    gravity + shaking * NOISE[1] * rng.standard_normal((len(time), 3)))
    stamps = time[::10]
    speed = np.where(moving[::10], 5.0, 0.0)[:, None] * np.ones(4)
    return CalibrationRecording(imu, WheelRecord(stamps, speed, None))


def test_bias_and_noise_are_correct_within_their_standard_errors(seeds):
    fits = [fit_rest(stop_and_go(seed), ROBOT) for seed in seeds]
    assert 0.6 < rms([errors_of([*fit.gyro_bias, fit.gyro_noise, fit.accel_noise],
                                [*BIAS, *NOISE]) for fit in fits]) < 1.4


def test_the_standard_error_of_the_tilt_includes_the_accelerometer_bias():
    fit = fit_rest(stop_and_go(1, tilt=(0.05, -0.03)), ROBOT)
    assert fit.roll.value == pytest.approx(0.05, abs=1e-3)
    assert fit.pitch.value == pytest.approx(-0.03, abs=1e-3)
    assert fit.roll.sigma >= ROBOT.imu.accel_bias / GRAVITY
    better = build(RobotParams, {'imu.accel_bias': 0.001})
    assert fit_rest(stop_and_go(1), better).roll.sigma < fit.roll.sigma


def test_noise_that_varies_has_a_larger_standard_error_than_white_noise():
    recording = stop_and_go(1)
    time, rate = recording.imu.time, recording.imu.rate
    factor = np.where(time % 2.0 < 1.0, 0.6, 1.3)[:, None]
    varying = replace(recording, imu=replace(recording.imu, rate=BIAS + factor * (rate - BIAS)))
    white, noise = (fit_rest(one, ROBOT).gyro_noise for one in (recording, varying))
    assert noise.sigma > 2.0 * white.sigma
    assert noise.value == pytest.approx(NOISE[0], abs=2.0 * noise.sigma)


def test_samples_after_a_stop_and_before_a_start_do_not_count():
    fit = fit_rest(stop_and_go(2), ROBOT)
    assert fit.intervals == 4
    assert 4.0 * 3.0 <= fit.seconds <= 4.0 * 5.5


def test_a_push_at_standstill_does_not_count():
    recording = stop_and_go(3)
    pushed = (recording.imu.time > 2.0) & (recording.imu.time < 2.9)
    rate = recording.imu.rate + np.where(
        pushed, 0.5 * np.sin(20.0 * recording.imu.time), 0.0)[:, None]
    fit = fit_rest(replace(recording, imu=replace(recording.imu, rate=rate)), ROBOT)
    assert fit.gyro_noise.value == pytest.approx(NOISE[0], rel=0.1)


def test_repeated_samples_are_counted_once():
    recording = stop_and_go(4)
    held = np.repeat(np.arange(0, len(recording.imu.time), 2), 2)[:len(recording.imu.time)]
    imu = ImuRecord(recording.imu.time, recording.imu.rate[held], recording.imu.force[held])
    fit = fit_rest(replace(recording, imu=imu), ROBOT)
    assert fit.repeated_share == pytest.approx(0.5, abs=0.01)
    assert fit.gyro_noise.value == pytest.approx(NOISE[0], rel=0.1)


def test_a_robot_that_is_never_stationary_is_refused():
    with pytest.raises(EstimatorError, match='never stationary'):
        fit_rest(stop_and_go(5, rest=1.0), ROBOT)


def test_standstill_ends_when_a_wheel_rotates():
    time = np.arange(0.0, 6.0)
    speed = np.zeros((6, 4))
    speed[3, 2] = 1.0
    found = stationary_intervals(WheelRecord(time, speed, None), ROBOT)
    assert found == [(0.0, 2.0), (4.0, 5.0)]
    assert not math.isnan(fit_rest(stop_and_go(6, legs=1), ROBOT).roll.value)


def test_the_noise_in_motion_is_that_of_vibration():
    gyro, accel = motion_noise([stop_and_go(7)])
    assert gyro.value == pytest.approx(20.0 * NOISE[0], rel=0.2)
    assert accel.value == pytest.approx(20.0 * NOISE[1], rel=0.2)
    assert gyro.sigma < 0.1 * gyro.value
    assert motion_noise([stop_and_go(7, drive=0.5)])[0].sigma == np.inf


@pytest.mark.parametrize('jitter, rate', [(0.001, 16.0), (0.003, 16.0), (0.001, 50.0)])
def test_the_jitter_is_correct_within_its_standard_error(jitter, rate, seeds):
    robot = build(RobotParams, {'encoder.stamp_jitter': jitter})
    found = [fit_jitter(recorded(turning_run(
        seed, 40.0, robot=robot, wheel_rate=rate)).wheels, robot) for seed in seeds]
    assert_consistent(found, jitter, 0.4, 1.6)


def rolled(speed, jitter, *, rate=16.0, seconds=60.0, seed=1):
    """Return wheels whose sides roll at ``speed`` [rad/s] (n, 2), a function of time [s]."""
    time = np.arange(0.0, seconds, 1e-3)
    angle = np.cumsum(speed(time), axis=0) * 1e-3
    step = round(1e3 / rate)
    stamps = time[::step] + jitter * np.random.default_rng(seed).standard_normal(
        len(time[::step]))
    return WheelRecord(stamps, speed(time)[::step][:, [0, 1, 0, 1]],
                       angle[::step][:, [0, 1, 0, 1]])


def test_the_standard_error_of_the_jitter_is_that_of_correlated_differences():
    found = [fit_jitter(rolled(lambda time: np.full((len(time), 2), 9.0), 0.001, seed=seed), ROBOT)
             for seed in range(60)]
    assert_consistent(found, 0.001, 0.85, 1.15)


def starts_and_stops(time):
    """Return speeds that change by 9 rad/s within half a second, at any time in turn."""
    phase = 2.0 * (time % 2.05)
    mean = 6.0 + 9.0 * np.clip(phase - 0.7, 0.0, 1.0) - 9.0 * np.clip(phase - 2.9, 0.0, 1.0)
    return np.column_stack([mean, 1.1 * mean])


def test_common_changes_of_speed_are_no_jitter():
    found = fit_jitter(rolled(starts_and_stops, 0.0003, seconds=120.0, seed=3), ROBOT)
    assert found.value == pytest.approx(0.0003, abs=3.0 * found.sigma)


def test_messages_that_the_reader_merges_show_no_jitter():
    wheels = rolled(lambda time: np.full((len(time), 2), 9.0), 0.0013, rate=100.0)
    early = np.append(False, np.diff(wheels.time) < 0.009)
    with pytest.raises(EstimatorError, match='merged or lost'):
        fit_jitter(wheels.where(~early), ROBOT)


EXACT = build(RobotParams, {'encoder.stamp_jitter': 0.0})


@pytest.mark.parametrize('options, reason', [
    ({'wheel_rate': 4.0}, 'five samples last 1 s'), ({'positions': False}, 'no positions'),
    ({'robot': EXACT, 'wheel_rate': 50.0}, 'speed fluctuations exceed the jitter')], ids=str)
def test_low_rates_velocities_alone_and_speed_changes_show_no_jitter(options, reason):
    with pytest.raises(EstimatorError, match=reason):
        fit_jitter(recorded(turning_run(1, 40.0, **options)).wheels, options.get('robot', ROBOT))


def test_standstill_is_refused():
    time = np.arange(0.0, 20.0, 0.06)
    still = np.zeros((len(time), 4))
    with pytest.raises(EstimatorError, match='0 samples with both sides in motion'):
        fit_jitter(WheelRecord(time, still, still), RobotParams())
