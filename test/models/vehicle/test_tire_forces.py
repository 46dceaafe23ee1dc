# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Tire forces of the filter: equal to the brush model, derivatives, energy, limits."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.models.tire.brush_tire import brush_force
from smart_tire.models.vehicle.tire_forces import wheel_forces

C_X, MU = 52.7, 0.47
RATIO = MU / C_X
FLOOR = 0.05  # m/s
COUNT = 400


def motions(seed=1, lowest=0.2):
    """Return r w, v_x, v_y [m/s] and loads [N]: slips from rolling freely to full sliding."""
    rng = np.random.default_rng(seed)
    rolling = rng.uniform(lowest, 1.5, COUNT) * rng.choice([-1.0, 1.0], COUNT)
    total = 10.0 ** rng.uniform(-3.0, 0.3, COUNT)  # slip
    angle = rng.uniform(-np.pi, np.pi, COUNT)
    v_x = rolling - np.abs(rolling) * total * np.cos(angle)
    return rolling, v_x, -np.abs(rolling) * total * np.sin(angle), rng.uniform(5.0, 60.0, COUNT)


def forces(rolling, v_x, v_y, load, ratio=RATIO, stiffness=C_X):
    return wheel_forces(rolling, v_x, v_y, load, stiffness, ratio, floor=FLOOR)


def test_forces_are_those_of_the_brush_model_in_both_directions():
    rolling, v_x, v_y, load = motions()
    expected = brush_force((rolling - v_x) / np.abs(rolling), -v_y / np.abs(rolling), MU, load,
                           C_X)
    found = forces(rolling, v_x, v_y, load)
    np.testing.assert_allclose(found.x, expected[0], rtol=1e-9)
    np.testing.assert_allclose(found.y, expected[1], rtol=1e-9)


def test_forces_never_exceed_friction_and_reach_it_in_full_sliding():
    rolling, v_x, v_y, load = motions()
    found = forces(rolling, v_x, v_y, load)
    used = np.hypot(found.x, found.y) / (MU * load)
    assert used.max() <= 1.0 + 1e-12
    critical = 3.0 * RATIO * load
    sliding = np.hypot(rolling - v_x, v_y) >= critical * np.abs(rolling)
    assert 20 < sliding.sum() < COUNT - 20
    np.testing.assert_allclose(used[sliding], 1.0)
    assert np.all(used[~sliding] < 1.0)


def test_forces_oppose_the_sliding_velocity_so_they_never_create_energy():
    rng = np.random.default_rng(2)
    rolling, v_x, v_y = rng.normal(0.0, 0.5, (3, 2000))  # locked, reversing and sliding wheels
    rolling[:200] = 0.0
    found = forces(rolling, v_x, v_y, rng.uniform(0.0, 60.0, 2000))
    # of the contact patch over ground: force times its velocity is taken from the robot
    assert np.all(found.x * (v_x - rolling) + found.y * v_y <= 1e-12)


DERIVATIVES = {'rolling': 0, 'v_x': 1, 'v_y': 2}


@pytest.mark.parametrize('name', DERIVATIVES)
@pytest.mark.parametrize('lowest', [0.2, 0.0])
def test_derivatives_by_velocities_equal_finite_differences(name, lowest):
    inputs = list(motions(3, lowest))
    near_floor = np.abs(np.abs(inputs[0]) - FLOOR) < 1e-4
    step, found = 1e-7, forces(*inputs)
    ends = []
    for sign in (1.0, -1.0):
        moved = list(inputs)
        moved[DERIVATIVES[name]] = moved[DERIVATIVES[name]] + sign * step
        ends.append(forces(*moved))
    for axis in ('x', 'y'):
        derivative = (getattr(ends[0], axis) - getattr(ends[1], axis)) / (2.0 * step)
        analytic = getattr(found, f'{axis}_by_{name}')
        scale = 1e-5 * C_X / np.maximum(np.abs(inputs[0]), FLOOR)  # the slope is C_x over r w
        assert np.all(np.abs(derivative - analytic)[~near_floor] < 20.0 * scale[~near_floor])
        assert np.abs(analytic).max() > 10.0


def test_derivatives_by_the_ratio_equal_finite_differences_and_scale_with_the_load():
    inputs, step = motions(4), 1e-6
    found = forces(*inputs)
    more, less = (forces(*inputs, ratio=RATIO * np.exp(sign * step)) for sign in (1.0, -1.0))
    loaded = forces(*inputs[:3], inputs[3] * np.exp(step))
    for axis in ('x', 'y'):
        derivative = (getattr(more, axis) - getattr(less, axis)) / (2.0 * step)
        analytic = getattr(found, f'{axis}_by_log_ratio')
        np.testing.assert_allclose(derivative, analytic, atol=1e-4)
        by_load = (getattr(loaded, axis) - getattr(found, axis)) / step
        np.testing.assert_allclose(by_load, analytic, atol=1e-2)
        assert np.abs(analytic).max() > 1.0


def test_a_wheel_without_slip_or_without_load_has_no_force_but_finite_derivatives():
    one = np.ones(2)
    found = forces(one, one, 0.0 * one, np.array([26.7, 0.0]))
    assert np.all(np.isfinite(found))
    assert found.x == pytest.approx([0.0, 0.0]) and found.y == pytest.approx([0.0, 0.0])
    assert found.x_by_rolling[0] == pytest.approx(C_X)
    slipping = forces(one, 0.5 * one, 0.2 * one, np.array([26.7, 0.0]))
    assert np.all(np.isfinite(slipping)) and np.hypot(slipping.x, slipping.y)[1] < 1e-5


def test_a_locked_wheel_brakes_with_full_friction_forward_and_in_reverse():
    zero, v_x, load = np.zeros(2), np.array([0.8, -0.8]), np.full(2, 26.7)
    found = forces(zero, v_x, zero, load)
    assert found.x == pytest.approx([-MU * 26.7, MU * 26.7])
    assert np.all(np.isfinite(found))


def test_motion_in_reverse_reverses_forces_and_keeps_derivatives_by_velocities():
    rolling, v_x, v_y, load = motions(5)
    found, back = forces(rolling, v_x, v_y, load), forces(-rolling, -v_x, -v_y, load)
    np.testing.assert_allclose(back.x, -found.x)
    np.testing.assert_allclose(back.y, -found.y)
    for name in ('x_by_rolling', 'x_by_v_x', 'x_by_v_y', 'y_by_v_y'):
        np.testing.assert_allclose(getattr(back, name), getattr(found, name))
    # a faster wheel drives more, in both directions
    assert found.x_by_rolling[np.abs(v_y) < 0.01 * np.abs(rolling)].min() > 0.0


def test_forces_are_proportional_to_stiffness_at_constant_ratio():
    inputs = motions(6)
    soft, hard = forces(*inputs, stiffness=25.0), forces(*inputs, stiffness=50.0)
    for one, two in zip(soft, hard):
        np.testing.assert_allclose(2.0 * one, two)
