# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rolling radius and gyro scale against a reference: unbiased by noise, turns and gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from smart_tire.calibration.recording import PoseRecord
from smart_tire.calibration.reference import fit_gyro_scale, fit_radius, usable_reference
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, RobotParams
from support.identifying import recorded, turning_run

ROBOT = RobotParams()
WRONG = build(RobotParams, {'wheel_radius': 0.1})  # 15 % off, which must not matter


@pytest.mark.parametrize('noise', [0.001, 0.01, 0.05])
def test_the_radius_is_correct_within_its_standard_error_at_any_noise_of_the_reference(noise):
    errors, sigmas = [], []
    for seed in range(12):
        recording = recorded(turning_run(seed), noise, seed)
        radius = fit_radius(recording.wheels, recording.reference, 0.0, WRONG).radius
        errors.append((radius.value - ROBOT.wheel_radius) / radius.sigma)
        sigmas.append(radius.sigma / radius.value)
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.6
    assert np.mean(sigmas) < 0.012


def test_the_wheels_may_be_late():
    recording = recorded(turning_run(1, wheel_latency=0.2), 0.005)
    radius = fit_radius(recording.wheels, recording.reference, 0.2, ROBOT).radius
    assert radius.value == pytest.approx(ROBOT.wheel_radius, abs=3.0 * radius.sigma)


def test_gaps_in_either_stream_only_reduce_accuracy():
    recording = recorded(turning_run(2, positions=False), 0.005)
    wheels, poses = recording.wheels, recording.reference
    received = (wheels.time % 10.0) > 1.0
    seen = (poses.time % 7.0) > 2.0
    radius = fit_radius(
        replace(wheels, time=wheels.time[received], velocity=wheels.velocity[received]),
        PoseRecord(poses.time[seen], poses.position[seen], poses.yaw[seen]), 0.0, ROBOT).radius
    assert radius.value == pytest.approx(ROBOT.wheel_radius, abs=3.0 * radius.sigma)


def test_a_lateral_offset_of_the_reference_is_estimated():
    recording = recorded(turning_run(3), 0.002)
    poses = recording.reference
    offset = 0.1 * np.stack([-np.sin(poses.yaw), np.cos(poses.yaw)], axis=1)
    moved = replace(poses, position=poses.position + offset)
    radius = fit_radius(recording.wheels, moved, 0.0, ROBOT).radius
    assert radius.value == pytest.approx(ROBOT.wheel_radius, abs=3.0 * radius.sigma)


def test_a_short_recording_is_refused():
    recording = recorded(turning_run(4, seconds=12.0), 0.01)
    with pytest.raises(EstimatorError, match='intervals of 2 s'):
        fit_radius(recording.wheels, recording.reference, 0.0, ROBOT)


def test_a_reference_that_faces_backward_is_refused():
    recording = recorded(turning_run(6), 0.001)
    poses = recording.reference
    with pytest.raises(EstimatorError, match='opposite to the wheels'):
        fit_radius(recording.wheels, replace(poses, yaw=poses.yaw + np.pi), 0.0, ROBOT)


def test_scale_and_delay_are_correct_within_their_standard_errors():
    scales, delays = [], []
    for seed in range(10):
        recording = recorded(turning_run(seed), 0.01, seed)
        imu = replace(recording.imu, rate=0.97 * recording.imu.rate)
        late = replace(recording.reference, time=recording.reference.time + 0.1)
        scale, delay = fit_gyro_scale(replace(recording, imu=imu, reference=late))
        scales.append((scale.value - 0.97) / scale.sigma)
        delays.append(delay)
        assert scale.sigma < 0.01
    assert 0.4 < np.sqrt(np.mean(np.square(scales))) < 1.6
    assert delays == pytest.approx(np.full(10, 0.1), abs=0.02)


def test_it_needs_a_reference():
    with pytest.raises(EstimatorError, match='no pose reference'):
        fit_gyro_scale(recorded(turning_run(0, 20.0)))


def test_a_reference_without_yaw_is_refused():
    recording = recorded(turning_run(0), 0.01)
    poses = replace(recording.reference, yaw=0.0 * recording.reference.yaw)
    with pytest.raises(EstimatorError, match='the reference has no yaw'):
        usable_reference(replace(recording, reference=poses))


def test_it_needs_turns():
    with pytest.raises(EstimatorError):
        fit_gyro_scale(recorded(turning_run(0, turn=1e-4), 0.01))
