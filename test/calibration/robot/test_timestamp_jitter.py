"""Jitter of stamps from positions: told where it is there, and not made of changing speeds."""

from __future__ import annotations

import numpy as np
import pytest
from support.identifying import recorded, turning_run

from smart_tire.calibration.recording import WheelRecord
from smart_tire.calibration.robot.timestamp_jitter import fit_jitter
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, RobotParams


@pytest.mark.parametrize('jitter, rate', [(0.001, 16.0), (0.003, 16.0), (0.001, 50.0)])
def test_the_jitter_is_right_within_its_error(jitter, rate):
    robot = build(RobotParams, {'encoder.stamp_jitter': jitter})
    errors = []
    for seed in range(8):
        wheels = recorded(turning_run(seed, 40.0, robot=robot, wheel_rate=rate)).wheels
        found = fit_jitter(wheels, robot)
        errors.append((found.value - jitter) / found.sigma)
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) < 1.6


def test_speeds_that_change_are_no_jitter():
    robot = build(RobotParams, {'encoder.stamp_jitter': 0.0})
    with pytest.raises(EstimatorError, match='fluctuate more than the stamps'):
        fit_jitter(recorded(turning_run(1, 40.0, robot=robot, wheel_rate=50.0)).wheels, robot)


def test_slow_readings_tell_nothing():
    with pytest.raises(EstimatorError, match='five readings last 1 s'):
        fit_jitter(recorded(turning_run(1, 40.0, wheel_rate=4.0)).wheels, RobotParams())


def test_velocities_alone_tell_nothing():
    with pytest.raises(EstimatorError, match='no positions'):
        fit_jitter(recorded(turning_run(1, 10.0, positions=False)).wheels, RobotParams())


def test_rest_tells_nothing():
    time = np.arange(0.0, 20.0, 0.06)
    still = np.zeros((len(time), 4))
    with pytest.raises(EstimatorError, match='0 readings with both sides in motion'):
        fit_jitter(WheelRecord(time, still, still), RobotParams())
