"""Geometry of a robot from a recording, and reasons for what is not observable."""

from __future__ import annotations

from dataclasses import replace

import pytest
from support.identifying import recorded, TRACK, turning_run

from smart_tire.calibration.robot.geometry import (
    combine, Geometry, identify_geometry, JITTER, LATENCY, parameters, PITCH, RADIUS, ROLL,
    STATIC_IMU, TRACK as TRACK_NAME)
from smart_tire.parameters import build, RobotParams
from smart_tire.uncertain import Uncertain, weighted_mean

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
        estimate = found.get(name)
        assert estimate.value == pytest.approx(true, abs=3.5 * estimate.sigma), name


def test_the_parameters_are_those_of_the_nodes(found):
    given = {item.name: item.value for item in parameters(found, WRONG)}
    assert {'encoder.latency', 'encoder.stamp_jitter', 'wheel_radius', 'wheel_radius_sigma',
            'effective_track', 'imu.gyro_noise', 'imu.accel_noise'} == set(given)
    robot = build(RobotParams, {k: v for k, v in given.items() if k != 'effective_track'})
    assert robot.wheel_radius == found.get(RADIUS).value


def test_without_a_reference_the_track_uses_the_configured_radius(recording):
    found = identify_geometry(replace(recording, reference=None), ROBOT)
    assert found.get(RADIUS) is None and 'no pose reference' in found.refused[RADIUS]
    track = found.get(TRACK_NAME)
    assert track.value == pytest.approx(TRACK, abs=3.5 * track.sigma)
    assert 'wheel_radius' not in [item.name for item in parameters(found, ROBOT)]


def test_a_tilt_is_written_only_if_bias_and_slope_cannot_explain_it():
    for roll, written in ((0.02, False), (0.05, True)):
        found = Geometry()
        found.add(ROLL, Uncertain(roll, 0.01), 'rad')
        found.add(PITCH, Uncertain(0.0, 0.01), 'rad')
        names = [item.name for item in parameters(found, ROBOT)]
        assert ('imu.rotation' in names) is written


def test_a_tilt_adds_to_the_configured_mounting():
    turned = build(RobotParams, {'imu.rotation': [0.0, 0.0, 3.0]})
    found = Geometry()
    found.add(ROLL, Uncertain(0.1, 0.01), 'rad')
    found.add(PITCH, Uncertain(0.0, 0.01), 'rad')
    rotation = parameters(found, turned)[-1].value
    assert rotation[2] == pytest.approx(3.0, abs=0.01)
    assert rotation[0] == pytest.approx(-0.1, abs=0.002)  # the IMU faces backward


def test_a_short_recording_gives_a_reason_for_each_quantity(recording):
    few = recording.imu.time < 2.0
    wheels = recording.wheels
    early = wheels.time < 2.0
    start = replace(
        recording, reference=None,
        imu=replace(recording.imu, time=recording.imu.time[few], rate=recording.imu.rate[few],
                    force=recording.imu.force[few]),
        wheels=replace(wheels, time=wheels.time[early], velocity=wheels.velocity[early],
                       position=wheels.position[early]))
    found = identify_geometry(start, ROBOT)
    assert {LATENCY, RADIUS, TRACK_NAME, JITTER} <= set(found.refused)
    assert STATIC_IMU not in found.refused  # it was stationary


def test_several_recordings_give_their_weighted_mean():
    parts = []
    for value in (1.0, 2.0):
        parts.append(Geometry())
        parts[-1].add('thing', Uncertain(value, 0.5), 'm')
    parts[1].refused['thing'] = 'no'
    parts[1].refused['other'] = 'never'
    merged = combine(parts)
    assert merged.get('thing').value == pytest.approx(1.5)
    assert merged.refused == {'other': 'never'}


def test_the_sigma_of_a_mean_grows_if_the_values_disagree():
    agreed = weighted_mean([Uncertain(1.0, 0.1), Uncertain(1.0, 0.1)])
    assert agreed.sigma == pytest.approx(0.1 / 2 ** 0.5)
    apart = weighted_mean([Uncertain(0.0, 0.1), Uncertain(2.0, 0.1)])
    assert apart.value == pytest.approx(1.0) and apart.sigma == pytest.approx(1.0)
