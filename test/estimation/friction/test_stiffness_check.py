"""Consistency of the stiffness with the acceleration, on the calibrated and on other surfaces."""

from __future__ import annotations

import math

import pytest

from smart_tire.estimation.friction.stiffness_check import (
    StiffnessConsistencyCheck, SURFACE_STIFFNESS_SIGMA)
from smart_tire.parameters import build, RobotParams

ROBOT = RobotParams()
CALIBRATED = ROBOT.tire.longitudinal_stiffness_sigma


@pytest.mark.parametrize('slips, acceleration', [
    ((0.11, -0.11, 0.11, -0.11), 0.0),                              # a steady turn
    ((0.05,) * 4, 0.9 * 4 * 0.05 * 52.7 / 10.9),                    # starting, hardly sliding
    ((-0.1,) * 4, -0.6 * 4 * 0.1 * 52.7 / 10.9),                    # braking, half sliding
    ((0.01,) * 4, 0.0), ((0.06, -0.05, 0.06, -0.05), 0.0),          # against a rolling drag
    ((0.0,) * 4, 0.0)])
def test_forces_that_match_the_acceleration_keep_the_calibrated_sigma(slips, acceleration):
    check = StiffnessConsistencyCheck(ROBOT)
    assert check.stiffness_sigma(slips, 0.01, acceleration) == CALIBRATED


def test_drive_forces_without_acceleration_increase_the_sigma():
    sigma = StiffnessConsistencyCheck(ROBOT).stiffness_sigma((0.32, 0.08, 0.32, 0.08), 0.01, 0.0)
    assert 0.7 * SURFACE_STIFFNESS_SIGMA < sigma < 1.1 * SURFACE_STIFFNESS_SIGMA


def test_brake_forces_without_deceleration_increase_the_sigma_as_much():
    check = StiffnessConsistencyCheck(ROBOT)
    assert check.stiffness_sigma((-0.2,) * 4, 0.01, 0.0) == pytest.approx(
        check.stiffness_sigma((0.2,) * 4, 0.01, 0.0))


def test_uncertain_slips_keep_the_calibrated_sigma():
    check = StiffnessConsistencyCheck(ROBOT)
    assert check.stiffness_sigma((0.1,) * 4, 0.1, 0.0) == CALIBRATED


def test_a_stationary_wheel_keeps_the_calibrated_sigma():
    check = StiffnessConsistencyCheck(ROBOT)
    assert check.stiffness_sigma((math.nan, 0.1, 0.1, 0.1), 0.01, 0.0) == CALIBRATED


def test_the_calibrated_sigma_is_the_minimum():
    robot = build(RobotParams, {'tire.longitudinal_stiffness_sigma': 0.3})
    check = StiffnessConsistencyCheck(robot)
    assert check.stiffness_sigma((0.11, -0.11, 0.11, -0.11), 0.01, 0.0) == 0.3
