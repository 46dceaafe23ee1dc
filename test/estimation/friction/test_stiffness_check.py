"""The force balance: silent on the calibrated ground, doubtful where slips push in vain."""

from __future__ import annotations

import math

import pytest

from smart_tire.estimation.friction.stiffness_check import GROUND_SPREAD, StiffnessConsistencyCheck
from smart_tire.parameters import build, RobotParams

ROBOT = RobotParams()
TOLERANCE = ROBOT.tire.longitudinal_stiffness_sigma


@pytest.mark.parametrize('slips, acceleration', [
    ((0.11, -0.11, 0.11, -0.11), 0.0),                              # a steady turn
    ((0.05,) * 4, 0.9 * 4 * 0.05 * 52.7 / 10.9),                    # starting, hardly sliding
    ((-0.1,) * 4, -0.6 * 4 * 0.1 * 52.7 / 10.9),                    # braking, half sliding
    ((0.01,) * 4, 0.0), ((0.06, -0.05, 0.06, -0.05), 0.0),          # against a rolling drag
    ((0.0,) * 4, 0.0)])
def test_forces_that_fit_the_acceleration_raise_no_doubt(slips, acceleration):
    assert StiffnessConsistencyCheck(ROBOT).stiffness_sigma(slips, 0.01, acceleration) == TOLERANCE


def test_wheels_that_push_without_effect_raise_doubt():
    sigma = StiffnessConsistencyCheck(ROBOT).stiffness_sigma((0.32, 0.08, 0.32, 0.08), 0.01, 0.0)
    assert 0.7 * GROUND_SPREAD < sigma < 1.1 * GROUND_SPREAD


def test_braking_in_vain_raises_the_same_doubt():
    balance = StiffnessConsistencyCheck(ROBOT)
    assert balance.stiffness_sigma((-0.2,) * 4, 0.01, 0.0) == pytest.approx(
        balance.stiffness_sigma((0.2,) * 4, 0.01, 0.0))


def test_slips_that_are_not_known_well_raise_none():
    assert StiffnessConsistencyCheck(ROBOT).stiffness_sigma((0.1,) * 4, 0.1, 0.0) == TOLERANCE


def test_nothing_is_concluded_where_a_wheel_stands():
    check = StiffnessConsistencyCheck(ROBOT)
    assert check.stiffness_sigma((math.nan, 0.1, 0.1, 0.1), 0.01, 0.0) == TOLERANCE


def test_the_calibrated_tolerance_is_the_least():
    robot = build(RobotParams, {'tire.longitudinal_stiffness_sigma': 0.3})
    check = StiffnessConsistencyCheck(robot)
    assert check.stiffness_sigma((0.11, -0.11, 0.11, -0.11), 0.01, 0.0) == 0.3
