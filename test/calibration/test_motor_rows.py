# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Means of torque, duty, motion and force over the same windows, without delays."""

from __future__ import annotations

import math

import numpy as np
import pytest
from smart_tire.calibration.motor_rows import BOARD_DELAY, motor_rows
from smart_tire.calibration.recording import (
    CalibrationRecording, DutyRecord, ImuRecord, WheelRecord)
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, RobotParams

ROBOT = build(RobotParams, {'imu.position': (0.0, 0.0, 0.0)})
RADIUS = ROBOT.wheel_radius
INERTIA = 0.01  # kg m2
MEAN, SWING, RATE = 9.0, 3.0, 4.0  # rad/s, rad/s and rad/s of the oscillation of the wheels


def angle(time):
    return MEAN * time - SWING / RATE * np.cos(RATE * time)


def speed(time):
    return MEAN + SWING * np.sin(RATE * time)


def acceleration(time):
    return SWING * RATE * np.cos(RATE * time)


def four(values):
    return np.repeat(np.asarray(values)[:, None], 4, axis=1)


def recording(*, wheel_rate=16.0, jitter=0.0, seconds=12.0, duties=None, late=0.0):
    """Return a drive with oscillating speed; torque and force are those of the acceleration."""
    rng = np.random.default_rng(1)
    time = np.arange(0.0, seconds, 1.0 / wheel_rate)
    time = time + jitter * rng.uniform(-1.0, 1.0, len(time))
    imu_time = np.arange(0.0, seconds, 0.01)
    position = four(angle(time))
    velocity = np.diff(position, axis=0) / np.diff(time)[:, None]
    force = np.zeros((len(imu_time), 3))
    force[:, 0] = RADIUS * acceleration(imu_time)
    return CalibrationRecording(
        ImuRecord(imu_time, np.zeros((len(imu_time), 3)), force),
        WheelRecord(time[1:] + late, velocity, position[1:],
                    INERTIA * four(acceleration(time[1:]))), duties=duties)


@pytest.mark.parametrize('wheel_rate', [8.0, 16.0, 50.0])
@pytest.mark.parametrize('jitter', [0.0, 0.002])
def test_torque_acceleration_and_force_have_no_delay_against_each_other(wheel_rate, jitter):
    rows = motor_rows(recording(wheel_rate=wheel_rate, jitter=jitter), ROBOT)
    assert len(rows.time) > 50 and rows.acceleration.shape[1] == 4
    assert rows.force == pytest.approx(RADIUS * rows.acceleration[:, 0], abs=2e-3)
    size = np.abs(rows.torque).max()
    share = 0.002 if jitter == 0.0 else 0.05  # irregular readings sample the torque irregularly
    assert rows.torque == pytest.approx(INERTIA * rows.acceleration, abs=share * size)
    slope = np.sum(rows.torque * rows.acceleration) / np.sum(rows.acceleration ** 2)
    assert slope == pytest.approx(INERTIA, rel=0.005)


def test_the_mean_speed_is_that_of_the_window():
    rows = motor_rows(recording(), ROBOT)
    offset = np.linspace(-0.25, 0.25, 1001)
    weight = 1.0 - np.abs(offset) / 0.25
    expected = [np.average(speed(time + offset), weights=weight) for time in rows.time]
    assert rows.speed[:, 2] == pytest.approx(expected, abs=2e-3)
    assert rows.center_speed[:, 2] == pytest.approx(speed(rows.time), abs=0.25)


def test_the_latency_of_the_wheels_is_compensated():
    late = build(RobotParams, {'imu.position': (0.0, 0.0, 0.0), 'encoder.latency': 0.2})
    rows = motor_rows(recording(late=0.2), late)
    assert rows.force == pytest.approx(RADIUS * rows.acceleration[:, 0], abs=2e-3)


def test_the_duty_is_averaged_over_the_same_windows():
    time = np.arange(0.0, 12.0, 0.05)
    duty = four(np.sin(time))
    rows = motor_rows(recording(duties=DutyRecord(time, duty)), ROBOT)
    fine = np.linspace(-0.25, 0.25, 2001)
    weight = 1.0 - np.abs(fine) / 0.25
    for row in (10, 40, 90):
        acting = rows.time[row] + fine - BOARD_DELAY
        held = duty[np.searchsorted(time, acting, side='right') - 1, 0]
        assert rows.duty[row] == pytest.approx(np.average(held, weights=weight), abs=1e-3)
        assert rows.duty_rate[row] == pytest.approx(math.cos(rows.time[row] - 0.025), abs=0.1)
    held = duty[np.searchsorted(time, rows.time - BOARD_DELAY, side='right') - 1]
    known = ~np.isnan(rows.center_duty)
    assert 0.5 < known.mean() < 1.0
    assert rows.center_duty[known] == pytest.approx(held[known])


def test_windows_with_a_standstill_a_reversal_or_a_gap_are_left_out():
    run = recording()
    wheels = run.wheels
    stopped = wheels.position.copy()
    stopped[96:] = stopped[96]
    for position in (stopped, np.abs(wheels.position - wheels.position[96])):
        changed = CalibrationRecording(run.imu, WheelRecord(
            wheels.time, wheels.velocity, position, wheels.torque))
        rows = motor_rows(changed, ROBOT)
        near = np.abs(rows.time - wheels.time[96]) < 0.25
        assert len(rows.time) and not near.any()
        assert (np.abs(rows.speed) > 1.0).all()
    kept = np.ones(len(wheels.time), bool)
    kept[96:100] = False
    gap = CalibrationRecording(run.imu, WheelRecord(
        wheels.time[kept], wheels.velocity[kept], wheels.position[kept], wheels.torque[kept]))
    rows = motor_rows(gap, ROBOT)
    assert not (np.abs(rows.time - wheels.time[98]) < 0.25).any()


def test_values_that_are_not_recorded_are_nan():
    run = recording()
    wheels = WheelRecord(run.wheels.time, run.wheels.velocity, run.wheels.position)
    rows = motor_rows(CalibrationRecording(run.imu, wheels), ROBOT)
    assert np.isnan(rows.torque).all() and np.isnan(rows.duty).all()
    assert np.isfinite(rows.force).all()


def test_torques_of_boards_that_are_read_in_turn_are_interpolated():
    run = recording(wheel_rate=100.0)
    torque = run.wheels.torque.copy()
    torque[::2, :2], torque[1::2, 2:] = np.nan, np.nan
    wheels = WheelRecord(run.wheels.time, run.wheels.velocity, run.wheels.position, torque)
    rows = motor_rows(CalibrationRecording(run.imu, wheels), ROBOT)
    assert rows.torque == pytest.approx(INERTIA * rows.acceleration, abs=1e-3)
    torque[400:420] = np.nan
    rows = motor_rows(CalibrationRecording(run.imu, wheels), ROBOT)
    gap = np.abs(rows.time - run.wheels.time[410]) < 0.2
    assert np.isnan(rows.torque[gap]).all()
    assert np.isfinite(rows.torque[np.abs(rows.time - run.wheels.time[410]) > 0.4]).all()


def test_too_few_readings_are_refused():
    run = recording()
    wheels = WheelRecord(*(getattr(run.wheels, name)[:3] for name in (
        'time', 'velocity', 'position', 'torque')))
    with pytest.raises(EstimatorError, match='3 readings of the wheels'):
        motor_rows(CalibrationRecording(run.imu, wheels), ROBOT)
