"""Wheel speeds from accelerations: the brush model, and derivatives by the parameters."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.straight import CONCRETE, SAND, straight_run

from smart_tire.calibration.tire.stiffness_model import Common, StiffnessModel
from smart_tire.calibration.tire.straight_segments import straight_segments
from smart_tire.parameters import build, RobotParams

ROBOT = RobotParams()
FINE = build(RobotParams, {'encoder.counts_per_revolution': 1_000_000})


def common(ground, latency_error=0.0, rolling=0.0):
    """Return the common parameters of a ground."""
    return np.array([ROBOT.tire.longitudinal_stiffness / ground.stiffness, ground.drag,
                     math.log(ground.friction), latency_error, rolling])


def model_of(ground, **options):
    run = straight_run(ground, 0, noise=0.0, robot=FINE, wheel_rate=20.0, **options)
    return StiffnessModel(straight_segments(run, ROBOT), ROBOT)


def residuals(model, parameters):
    """Return the residuals [m/s] of the wheel speeds, with the best initial speed."""
    none, start = np.zeros(model.segments.count), model.segments.speed[:1].copy()
    for _ in range(5):
        left = model.segments.speed - model.speeds(parameters, start, none)
        start = start + left.mean()
    return left


@pytest.mark.parametrize('ground', [CONCRETE, SAND])
def test_the_true_parameters_reproduce_the_wheel_speeds(ground):
    left = residuals(model_of(ground), common(ground))
    assert np.sqrt(np.mean(left ** 2)) < 0.002


def test_a_wrong_stiffness_increases_the_residuals():
    model = model_of(CONCRETE)
    right, wrong = (np.std(residuals(model, common(ground))) for ground in (
        CONCRETE, type(CONCRETE)(30.0, CONCRETE.friction, CONCRETE.drag)))
    assert wrong > 3.0 * right


def test_a_latency_is_compensated_by_the_latency_error():
    model = model_of(CONCRETE, wheel_latency=0.05)
    right, wrong = (np.std(residuals(model, common(CONCRETE, late))) for late in (0.05, 0.0))
    assert wrong > 3.0 * right


def test_slip_and_force_are_positive_when_accelerating_and_negative_when_braking():
    model = model_of(CONCRETE)
    moved = model.motion(common(CONCRETE), model.segments.speed[:1], np.zeros(1))
    up, down = model.segments.force > 0.3, model.segments.force < -0.3
    assert (moved.slip[up] > 0.0).all() and (moved.force[up] > 0.0).all()
    assert (moved.slip[down] < 0.0).all() and (moved.force[down] < 0.0).all()


def test_derivatives_agree_with_finite_differences():
    model = model_of(SAND)
    parameters, initial = common(SAND, 0.002, 0.01), model.segments.speed[:1].copy()
    biases, step = np.array([0.005]), 1e-4
    by_common, by_speed, by_bias = model.derivatives(parameters, initial, biases)
    base = model.speeds(parameters, initial, biases)
    for which in Common:
        moved = parameters + step * np.eye(len(Common))[which]
        assert (model.speeds(moved, initial, biases) - base) / step == pytest.approx(
            by_common[:, which], abs=0.02 * np.abs(by_common[:, which]).max())
    assert (model.speeds(parameters, initial + step, biases) - base) / step == pytest.approx(
        by_speed, rel=0.01)
    assert (model.speeds(parameters, initial, biases + step) - base) / step == pytest.approx(
        by_bias, abs=0.02 * np.abs(by_bias).max())
