"""Wheel speeds from accelerations: those of the brush model, and how parameters move them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.straight import CONCRETE, SAND, straight_run

from smart_tire.calibration.tire.stiffness_model import Common, StiffnessModel
from smart_tire.calibration.tire.straight_segments import straight_runs
from smart_tire.parameters import build, RobotParams

ROBOT = RobotParams()
FINE = build(RobotParams, {'encoder.counts_per_revolution': 1_000_000})


def common(ground, lateness=0.0, rolling=0.0):
    """Return the parameters that describe a ground."""
    return np.array([ROBOT.tire.longitudinal_stiffness / ground.stiffness, ground.drag,
                     math.log(ground.friction), lateness, rolling])


def model_of(ground, **options):
    run = straight_run(ground, 0, noise=0.0, robot=FINE, wheel_rate=20.0, **options)
    return StiffnessModel(straight_runs(run, ROBOT), ROBOT)


def residuals(model, parameters):
    """Return by how much [m/s] wheels turn faster, with the first speed that fits best."""
    none, start = np.zeros(model.runs.count), model.runs.speed[:1].copy()
    for _ in range(5):
        left = model.runs.speed - model.speeds(parameters, start, none)
        start = start + left.mean()
    return left


@pytest.mark.parametrize('ground', [CONCRETE, SAND])
def test_with_the_true_parameters_the_wheels_turn_as_they_did(ground):
    left = residuals(model_of(ground), common(ground))
    assert np.sqrt(np.mean(left ** 2)) < 0.002


def test_a_wrong_stiffness_shows():
    model = model_of(CONCRETE)
    right, wrong = (np.std(residuals(model, common(ground))) for ground in (
        CONCRETE, type(CONCRETE)(30.0, CONCRETE.friction, CONCRETE.drag)))
    assert wrong > 3.0 * right


def test_late_stamps_are_undone_by_the_lateness():
    model = model_of(CONCRETE, wheel_latency=0.05)
    right, wrong = (np.std(residuals(model, common(CONCRETE, late))) for late in (0.05, 0.0))
    assert wrong > 3.0 * right


def test_motion_pushes_where_it_speeds_up_and_holds_where_it_brakes():
    model = model_of(CONCRETE)
    moved = model.motion(common(CONCRETE), model.runs.speed[:1], np.zeros(1))
    up, down = model.runs.force > 0.3, model.runs.force < -0.3
    assert (moved.slip[up] > 0.0).all() and (moved.force[up] > 0.0).all()
    assert (moved.slip[down] < 0.0).all() and (moved.force[down] < 0.0).all()


def test_slopes_are_those_of_the_speeds():
    model = model_of(SAND)
    parameters, first = common(SAND, 0.002, 0.01), model.runs.speed[:1].copy()
    biases, nudge = np.array([0.005]), 1e-4
    by_common, by_first, by_bias = model.slopes(parameters, first, biases)
    at = model.speeds(parameters, first, biases)
    for which in Common:
        moved = parameters + nudge * np.eye(len(Common))[which]
        assert (model.speeds(moved, first, biases) - at) / nudge == pytest.approx(
            by_common[:, which], abs=0.02 * np.abs(by_common[:, which]).max())
    assert (model.speeds(parameters, first + nudge, biases) - at) / nudge == pytest.approx(
        by_first, rel=0.01)
    assert (model.speeds(parameters, first, biases + nudge) - at) / nudge == pytest.approx(
        by_bias, abs=0.02 * np.abs(by_bias).max())
