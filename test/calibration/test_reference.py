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
from support.identifying import assert_agrees, assert_consistent, recorded, turning_run

ROBOT = RobotParams()
WRONG = build(RobotParams, {'wheel_radius': 0.1})  # 15 % off, which must not matter


def radius_of(recording, latency=0.0, robot=ROBOT):
    return fit_radius(recording.wheels, recording.reference, latency, robot).radius


@pytest.mark.parametrize('noise', [0.001, 0.01, 0.05])
def test_the_radius_is_correct_within_its_standard_error_at_any_noise(noise, seeds):
    found = [radius_of(recorded(turning_run(seed), noise, seed), robot=WRONG) for seed in seeds]
    assert_consistent(found, ROBOT.wheel_radius, 0.5, 1.6)
    assert np.mean([radius.sigma / radius.value for radius in found]) < 0.012


def test_the_wheels_may_be_late():
    assert_agrees(radius_of(recorded(turning_run(1, wheel_latency=0.2), 0.005), 0.2),
                  ROBOT.wheel_radius)


def test_gaps_in_either_stream_only_reduce_accuracy():
    recording = recorded(turning_run(2, positions=False), 0.005)
    wheels, poses = recording.wheels, recording.reference
    received = (wheels.time % 10.0) > 1.0
    seen = (poses.time % 7.0) > 2.0
    assert_agrees(radius_of(replace(
        recording,
        wheels=replace(wheels, time=wheels.time[received], velocity=wheels.velocity[received]),
        reference=PoseRecord(poses.time[seen], poses.position[seen], poses.yaw[seen]))),
        ROBOT.wheel_radius)


def test_a_lateral_offset_of_the_reference_is_estimated():
    recording = recorded(turning_run(3), 0.002)
    poses = recording.reference
    offset = 0.1 * np.stack([-np.sin(poses.yaw), np.cos(poses.yaw)], axis=1)
    moved = replace(poses, position=poses.position + offset)
    assert_agrees(radius_of(replace(recording, reference=moved)), ROBOT.wheel_radius)


def test_scale_and_delay_are_correct_within_their_standard_errors(seeds):
    scales, delays = [], []
    for seed in seeds:
        recording = recorded(turning_run(seed), 0.01, seed)
        imu = replace(recording.imu, rate=0.97 * recording.imu.rate)
        late = replace(recording.reference, time=recording.reference.time + 0.1)
        scale, delay = fit_gyro_scale(replace(recording, imu=imu, reference=late))
        scales.append(scale)
        delays.append(delay)
        assert scale.sigma < 0.01
    assert_consistent(scales, 0.97, 0.4, 1.6)
    assert delays == pytest.approx(np.full(len(seeds), 0.1), abs=0.02)


def with_yaw(recording, change):
    poses = recording.reference
    return replace(recording, reference=replace(poses, yaw=change(poses.yaw)))


@pytest.mark.parametrize('use, recording, reason', [
    (radius_of, lambda: recorded(turning_run(4, seconds=12.0), 0.01), 'intervals of 2 s'),
    (radius_of, lambda: with_yaw(recorded(turning_run(0), 0.001), lambda yaw: yaw + np.pi),
     'opposite to the wheels'),
    (fit_gyro_scale, lambda: recorded(turning_run(0)), 'no pose reference'),
    (fit_gyro_scale, lambda: recorded(turning_run(0, turn=1e-4), 0.01), None),
    (usable_reference, lambda: with_yaw(recorded(turning_run(0), 0.01), lambda yaw: 0.0 * yaw),
     'the reference has no yaw')])
def test_what_is_not_observable_is_refused_with_the_reason(use, recording, reason):
    with pytest.raises(EstimatorError, match=reason):
        use(recording())
