"""Wheels that share their slip push together as much as they were asked to."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.models.tire.brush_tire import brush_force
from smart_tire.models.tire.shared_slip import MOST_FORCE, stiff_slip

STIFFNESS = 52.7  # N
LOADS = np.array([18.0, 18.0, 35.0, 35.0])[:, np.newaxis]  # N, of a robot that speeds up


def pushed(slip, friction, loads=LOADS):
    return brush_force(slip, 0.0, friction, loads, STIFFNESS)[0].sum(axis=0)


@pytest.mark.parametrize('friction', [0.1, 0.47, 2.0])
def test_it_undoes_the_brush_tire(friction):
    slip = np.linspace(-0.9, 0.9, 61) * 3.0 * friction * LOADS.min() / STIFFNESS
    found = stiff_slip(pushed(slip, friction), friction, LOADS)
    assert found / STIFFNESS == pytest.approx(slip, rel=1e-6)


def test_front_wheels_may_slide_while_the_rear_ones_hold():
    slip = np.array([1.05 * 3.0 * 0.3 * LOADS.min() / STIFFNESS])
    assert stiff_slip(pushed(slip, 0.3), 0.3, LOADS) / STIFFNESS == pytest.approx(slip, rel=1e-6)


def test_a_little_force_needs_no_friction_to_be_understood():
    assert stiff_slip([0.01, -0.01], 0.47, LOADS) == pytest.approx([0.0025, -0.0025], rel=1e-3)


def test_more_than_the_ground_can_hold_is_taken_for_the_most():
    most = MOST_FORCE * 0.47 * LOADS.sum()
    told = stiff_slip([most, 3.0 * most, -1e3 * most], 0.47, LOADS)
    assert told == pytest.approx(told[0] * np.array([1.0, 1.0, -1.0]))
    assert np.isfinite(told).all()


def test_a_lifted_wheel_carries_nothing():
    lifted = np.array([0.0, 0.0, 53.0, 53.0])[:, np.newaxis]
    assert stiff_slip([4.0], 0.47, lifted) == pytest.approx(stiff_slip([4.0], 0.47, lifted[2:]))


def test_no_force_is_no_slip():
    assert stiff_slip(np.zeros(3), 0.47, LOADS) == pytest.approx(np.zeros(3))
