# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Geometry of a robot from a recording, and reasons for what is not observable."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from smart_tire.calibration.geometry import (
    add_rest, combine, Geometry, GYRO_SCALE, halves, identify_geometry, JITTER, LATENCY, RADIUS,
    ROTATION, STATIC_IMU, TRACK as TRACK_NAME)
from smart_tire.calibration.recording import CalibrationRecording, ImuRecord, WheelRecord
from smart_tire.parameters import build, RobotParams
from smart_tire.recording import SampleArrays
from smart_tire.rotation import matrix
from smart_tire.samples import GRAVITY, ImuSample
from smart_tire.uncertain import Uncertain, weighted_mean
from support.identifying import assert_agrees, assert_consistent, recorded, TRACK, turning_run

ROBOT = RobotParams()
WRONG = build(RobotParams, {'wheel_radius': 0.1, 'encoder.latency': 0.0})


@pytest.fixture(scope='module')
def recording():
    return recorded(turning_run(11, wheel_latency=0.09), 0.005)


@pytest.fixture(scope='module')
def found(recording):
    return identify_geometry(recording, WRONG)


def test_everything_is_observable_in_a_recording_with_a_reference(found):
    assert found.refused == {}
    for name, true in ((LATENCY, 0.09), (RADIUS, 0.087), (TRACK_NAME, TRACK), (JITTER, 0.001),
                       ('gyro noise', 0.01), ('accelerometer noise', 0.05)):
        assert_agrees(found.get(name), true, 3.5)


def test_the_parameters_are_those_of_the_nodes(found):
    given = {item.name: item.value for item in found.parameters(WRONG)}
    # jitter and noise are configured correctly: there is nothing to improve
    assert {'encoder.latency', 'wheel_radius', 'wheel_radius_sigma',
            'effective_track'} == set(given)
    robot = build(RobotParams, {k: v for k, v in given.items() if k != 'effective_track'})
    assert robot.wheel_radius == found.get(RADIUS).value


def test_without_a_reference_the_track_uses_the_configured_radius(recording):
    found = identify_geometry(replace(recording, reference=None), ROBOT)
    assert found.get(RADIUS) is None and 'no pose reference' in found.refused[RADIUS]
    assert_agrees(found.get(TRACK_NAME), TRACK, 3.5)
    assert 'wheel_radius' not in [item.name for item in found.parameters(ROBOT)]


def tilted(roll, yaw=0.0):
    """Return the parameters from a rest on level ground, the IMU rolled by ``roll`` [rad]."""
    recording = recorded(turning_run(1, 8.0, turn=0.0))
    recording.imu.force[:] = matrix(roll, 0.0, 0.0).T @ [0.0, 0.0, GRAVITY]
    found, robot = Geometry(), build(RobotParams, {
        'imu.accel_bias': 0.01, 'imu.rotation': [0.0, 0.0, yaw]})
    add_rest(found, [recording], [recording], robot)
    return found.parameters(robot)


def test_a_tilt_is_written_only_if_bias_and_slope_cannot_explain_it():
    for roll, written in ((0.08, False), (0.12, True)):
        assert (ROTATION in [item.name for item in tilted(roll)]) is written


def test_a_tilt_adds_to_the_configured_mounting():
    rotation = tilted(0.1, 3.0)[-1].value
    assert rotation[2] == pytest.approx(3.0, abs=0.01)
    assert rotation[0] == pytest.approx(-0.1, abs=0.002)  # the IMU faces backward


def test_a_short_recording_gives_a_reason_for_each_quantity(recording):
    imu, wheels = recording.imu, recording.wheels
    few, early = imu.time < 2.0, wheels.time < 2.0
    found = identify_geometry(CalibrationRecording(
        ImuRecord(imu.time[few], imu.rate[few], imu.force[few]),
        WheelRecord(wheels.time[early], wheels.velocity[early], wheels.position[early])), ROBOT)
    assert {LATENCY, RADIUS, TRACK_NAME, JITTER} <= set(found.refused)
    assert STATIC_IMU not in found.refused  # it was stationary
    assert found.parameters(ROBOT) == []
    assert 'expected at least 16 s' in found.kept['imu.gyro_noise']


WRONG_NOISE = build(RobotParams, {
    'imu.gyro_noise': 0.03, 'imu.accel_noise': 0.2, 'encoder.stamp_jitter': 0.004})


@pytest.mark.slow
def test_wrong_values_are_replaced_within_their_standard_errors(seeds):
    true = {'encoder.latency': 0.07, 'effective_track': TRACK, 'encoder.stamp_jitter': 0.001,
            'imu.gyro_noise': 0.01, 'imu.accel_noise': 0.05}
    written = [item for seed in seeds for item in identify_geometry(recorded(
        turning_run(seed, 80.0, wheel_latency=0.07)), WRONG_NOISE).parameters(WRONG_NOISE)]
    for name, value in true.items():
        found = [item for item in written if item.name == name]
        assert len(found) >= 0.75 * len(seeds), name
        assert_consistent(found, value, 0.0, 1.6)


@pytest.mark.slow
def test_a_wrong_radius_is_replaced(seeds):
    wrong = replace(ROBOT, wheel_radius=0.092)
    written = [item for seed in seeds for item in identify_geometry(
        recorded(turning_run(seed, 80.0), 0.01, seed), wrong).parameters(wrong)]
    assert_consistent([item for item in written if item.name == 'wheel_radius'],
                      ROBOT.wheel_radius, 0.0, 1.6)


@pytest.mark.slow
def test_right_values_are_not_replaced(seeds):
    for seed in seeds:
        found = identify_geometry(recorded(turning_run(seed, 80.0), 0.01, seed), ROBOT)
        assert [item.name for item in found.parameters(ROBOT)] == ['effective_track']
        assert 'no significant difference' in found.kept['encoder.latency']


def test_the_noise_at_standstill_is_not_written_if_the_robot_vibrates():
    recording = recorded(turning_run(2, 60.0))
    imu = recording.imu
    moving = (imu.time > 3.0) & (imu.time < 57.0)
    shaken = imu.force + np.where(moving, 2.0, 0.0)[:, None] * np.random.default_rng(
        2).standard_normal(imu.force.shape)
    found = identify_geometry(replace(recording, imu=replace(imu, force=shaken)), WRONG_NOISE)
    names = [item.name for item in found.parameters(WRONG_NOISE)]
    assert 'imu.accel_noise' not in names and 'imu.gyro_noise' in names
    assert 'm/s2 in motion' in found.kept['imu.accel_noise']


def test_halves_share_no_wheel_sample_and_a_value_of_one_half_is_not_written(recording):
    first, second = halves(recording)
    assert not set(first.wheels.time) & set(second.wheels.time)
    assert len(first.wheels.time) + len(second.wheels.time) == len(recording.wheels.time)
    # the wheels of one half are larger by 4 %
    larger = np.isin(recording.wheels.time, first.wheels.time)[:, None]
    angle = np.cumsum(np.diff(recording.wheels.position, axis=0, prepend=0.0) / np.where(
        larger, 1.04, 1.0), axis=0)
    mixed = replace(recording, wheels=replace(recording.wheels, position=angle))
    found = identify_geometry(mixed, ROBOT)
    radius = next(item for item in found.quantities if item.parameter == 'wheel_radius')
    assert radius.written.sigma > 0.015 * ROBOT.wheel_radius
    assert 'the halves give 0.0' in found.kept['wheel_radius']


def test_one_recording_that_contradicts_is_enough_to_refuse():
    parts = [Geometry(), Geometry(kept={'encoder.latency': 'no significant difference'})]
    for part in parts:
        part.add(LATENCY, Uncertain(0.05, 0.01), 's', parameter='encoder.latency')
    assert combine(parts[:1]).parameters(ROBOT) != []
    assert combine(parts).parameters(ROBOT) == []


def test_several_recordings_give_their_weighted_mean():
    parts = [Geometry(), Geometry(refused={'thing': 'no', 'other': 'never'})]
    for part, value in zip(parts, (1.0, 2.0)):
        part.add('thing', Uncertain(value, 0.5), 'm')
    merged = combine(parts)
    assert merged.get('thing').value == pytest.approx(1.5)
    assert merged.refused == {'other': 'never'}


def test_the_sigma_of_a_mean_grows_if_the_values_disagree():
    agreed = weighted_mean([Uncertain(1.0, 0.1), Uncertain(1.0, 0.1)])
    assert agreed.sigma == pytest.approx(0.1 / 2 ** 0.5)
    apart = weighted_mean([Uncertain(0.0, 0.1), Uncertain(2.0, 0.1)])
    assert apart.value == pytest.approx(1.0) and apart.sigma == pytest.approx(1.0)


def test_a_wrong_scale_of_the_gyroscope_is_written_once(recording):
    imu = replace(recording.imu, rate=0.97 * recording.imu.rate)
    found = identify_geometry(replace(recording, imu=imu), WRONG)
    given = {item.name: item.value for item in found.parameters(WRONG)}
    assert given['imu.gyro_scale'] == pytest.approx(0.97, abs=0.01)
    assert given['imu.gyro_scale_sigma'] < 0.005
    known = build(RobotParams, {'wheel_radius': 0.1, 'encoder.latency': 0.0,
                                'imu.gyro_scale': given['imu.gyro_scale']})
    again = identify_geometry(replace(recording, imu=replace(
        imu, rate=imu.rate / known.imu.gyro_scale)), known)
    assert again.get(GYRO_SCALE).value == pytest.approx(given['imu.gyro_scale'], rel=1e-6)
    assert 'imu.gyro_scale' in again.kept


def test_rates_of_a_recording_have_the_scale_of_the_true_ones():
    stream = SampleArrays([ImuSample(0, (0.0, 0.0, 9.8), (0.0, 0.0, 1.02))]).stream(ImuSample)
    robot = build(RobotParams, {'imu.gyro_scale': 1.02})
    found = ImuRecord.of(stream.ordered, 0, robot)
    assert found.rate[0, 2] == pytest.approx(1.0) and found.force[0, 2] == pytest.approx(9.8)
