"""What a unit reads at rest, and that motion is not taken for rest."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest

from smart_tire.calibration.recording import ImuRecord, Recording, WheelRecord
from smart_tire.calibration.robot.static_imu import fit_rest, rests
from smart_tire.errors import EstimatorError
from smart_tire.models.vehicle.skid_steer import GRAVITY
from smart_tire.parameters import build, RobotParams
from smart_tire.rotation import matrix

ROBOT = RobotParams()
BIAS = np.array([0.01, -0.02, 0.005])  # rad/s
NOISE = (0.004, 0.03)                  # rad/s, m/s2


def standing(seed, *, tilt=(0.0, 0.0), legs=4, rest=6.0, drive=4.0, rate=100.0):
    """Return a run that stands and drives in turns; driving shakes the unit."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, legs * (rest + drive), 1.0 / rate)
    moving = (time % (rest + drive)) > rest
    shaking = np.where(moving, 20.0, 1.0)[:, None]
    gravity = matrix(*tilt, 0.0).T @ np.array([0.0, 0.0, GRAVITY])
    imu = ImuRecord(time, BIAS + shaking * NOISE[0] * rng.standard_normal((len(time), 3)),
                    gravity + shaking * NOISE[1] * rng.standard_normal((len(time), 3)))
    stamps = time[::10]
    speed = np.where(moving[::10], 5.0, 0.0)[:, None] * np.ones(4)
    return Recording(imu, WheelRecord(stamps, speed, None))


def test_bias_and_noise_are_right_within_their_errors():
    errors = []
    for seed in range(10):
        fit = fit_rest(standing(seed), ROBOT)
        errors += [(found.value - true) / found.sigma
                   for found, true in zip(fit.gyro_bias, BIAS)]
        errors += [(fit.gyro_noise.value - NOISE[0]) / fit.gyro_noise.sigma,
                   (fit.accel_noise.value - NOISE[1]) / fit.accel_noise.sigma]
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) < 1.4


def test_the_tilt_is_that_of_the_mounting_with_the_bias_in_its_error():
    fit = fit_rest(standing(1, tilt=(0.05, -0.03)), ROBOT)
    assert fit.roll.value == pytest.approx(0.05, abs=1e-3)
    assert fit.pitch.value == pytest.approx(-0.03, abs=1e-3)
    assert fit.roll.sigma >= ROBOT.imu.accel_bias / GRAVITY
    better = build(RobotParams, {'imu.accel_bias': 0.001})
    assert fit_rest(standing(1), better).roll.sigma < fit.roll.sigma


def test_what_is_felt_after_a_stop_and_before_a_start_does_not_count():
    fit = fit_rest(standing(2), ROBOT)
    assert fit.places == 4
    assert 4.0 * 3.0 <= fit.seconds <= 4.0 * 5.5


def test_a_push_at_rest_does_not_count():
    recording = standing(3)
    pushed = (recording.imu.time > 2.0) & (recording.imu.time < 2.9)
    rate = recording.imu.rate + np.where(
        pushed, 0.5 * np.sin(20.0 * recording.imu.time), 0.0)[:, None]
    fit = fit_rest(replace(recording, imu=replace(recording.imu, rate=rate)), ROBOT)
    assert fit.gyro_noise.value == pytest.approx(NOISE[0], rel=0.1)


def test_held_samples_are_counted_once():
    recording = standing(4)
    held = np.repeat(np.arange(0, len(recording.imu.time), 2), 2)[:len(recording.imu.time)]
    imu = ImuRecord(recording.imu.time, recording.imu.rate[held], recording.imu.force[held])
    fit = fit_rest(replace(recording, imu=imu), ROBOT)
    assert fit.repeated == pytest.approx(0.5, abs=0.01)
    assert fit.gyro_noise.value == pytest.approx(NOISE[0], rel=0.1)


def test_a_robot_that_never_rests_is_refused():
    with pytest.raises(EstimatorError, match='never stands still'):
        fit_rest(standing(5, rest=1.0), ROBOT)


def test_rests_end_where_a_wheel_turns():
    time = np.arange(0.0, 6.0)
    speed = np.zeros((6, 4))
    speed[3, 2] = 1.0
    assert list(rests(WheelRecord(time, speed, None), 0.1)) == [(0.0, 2.0), (4.0, 5.0)]
    assert not math.isnan(fit_rest(standing(6, legs=1), ROBOT).roll.value)
