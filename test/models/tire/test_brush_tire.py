# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Brush tire: invariants of any tire, and the integrals of B(18) to B(22)."""

from collections import namedtuple

import numpy as np
import pytest
from scipy.integrate import quad
from smart_tire.models.tire import brush_tire
from support.compiled import load_source

C_X, MU, LOAD, LENGTH = 52.7, 0.47, 26.7, 0.046  # N, -, N, m: paper B, Table I


def random_states(count=20_000):
    rng = np.random.default_rng(11)
    rolling, v_x, v_y = rng.normal(0.0, 1.0, (3, count)) * rng.choice([0.01, 1.0], (3, count))
    mu, load = rng.uniform(0.05, 1.2, count), rng.uniform(0.0, 60.0, count)
    return rolling, v_x, v_y, mu, load


def test_the_force_dissipates_energy_in_the_friction_circle_and_on_it_under_full_sliding():
    rolling, v_x, v_y, mu, load = random_states()
    s_x, s_y = brush_tire.slip_vector(rolling, v_x, v_y)
    force_x, force_y = brush_tire.brush_force(s_x, s_y, mu, load, C_X)
    assert np.all(force_x * (v_x - rolling) + force_y * v_y < 0.0)
    force = np.hypot(force_x, force_y)
    assert np.all(force <= mu * load * (1.0 + 1e-12))
    sliding = brush_tire.adhesion_ratio(np.hypot(s_x, s_y), mu, load, C_X) == 0.0
    assert sliding.any() and not sliding.all()
    np.testing.assert_allclose(force[sliding], (mu * load)[sliding], rtol=1e-12)
    back = brush_tire.brush_force(*brush_tire.slip_vector(-rolling, -v_x, v_y), mu, load, C_X)
    np.testing.assert_array_equal(back, (-force_x, force_y))  # reverse motion mirrors the force


@pytest.mark.parametrize('share', [0.02, 0.4, 0.99, 1.0, 1.7, 40.0])
def test_the_force_is_the_integral_of_the_stress_of_b20(share):
    critical = float(brush_tire.critical_slip(MU, LOAD, C_X))
    slip = share * critical
    stiffness = 2.0 * C_X / LENGTH**2  # k_x B of B(19)
    stress = quad(lambda z: min(slip * z, critical * z * (1.0 - z / LENGTH)), 0.0, LENGTH,
                  points=[max(0.0, 1.0 - share) * LENGTH], epsabs=1e-12)[0]
    force_x, force_y = brush_tire.brush_force(0.6 * slip, -0.8 * slip, MU, LOAD, C_X)
    assert float(force_x) == pytest.approx(0.6 * stiffness * stress, rel=1e-9)
    assert float(force_y) == pytest.approx(-0.8 * stiffness * stress, rel=1e-9)


def test_the_force_has_slope_c_x_at_zero_slip_and_is_smooth_at_the_critical_slip():
    force, _ = brush_tire.brush_force(1e-7, 0.0, MU, LOAD, C_X)
    assert float(force) == pytest.approx(C_X * 1e-7, rel=1e-6)
    critical = float(brush_tire.critical_slip(MU, LOAD, C_X))
    around, _ = brush_tire.brush_force(critical * np.array([1.0 - 1e-6, 1.0, 1.0 + 1e-6]), 0.0,
                                       MU, LOAD, C_X)
    np.testing.assert_allclose(around, MU * LOAD, rtol=1e-12)


def test_without_motion_load_or_friction_there_is_no_force_and_with_locked_wheels_full_friction():
    still = brush_tire.brush_force(*brush_tire.slip_vector(0.0, 0.0, 0.0), MU, LOAD, C_X)
    assert still == (0.0, 0.0)
    for mu, load in ((MU, 0.0), (0.0, LOAD)):
        assert brush_tire.brush_force(0.3, 0.1, mu, load, C_X) == (0.0, 0.0)
    assert brush_tire.brush_force(0.3, 0.1, np.inf, LOAD, C_X) == pytest.approx(
        (0.3 * C_X, 0.1 * C_X))
    locked = brush_tire.brush_force(*brush_tire.slip_vector(0.0, 0.3, 0.4), MU, LOAD, C_X)
    np.testing.assert_allclose(locked, (-0.6 * MU * LOAD, -0.8 * MU * LOAD), rtol=1e-9)


def test_the_least_slip_has_no_warning_and_the_slope_c_x():
    with np.errstate(all='raise', under='ignore'):
        force, _ = brush_tire.brush_force(1e-310, 0.0, MU, LOAD, C_X)
    assert force == pytest.approx(C_X * 1e-310, rel=1e-9, abs=0.0)


@pytest.mark.parametrize('slip', [(0.05, 0.0), (0.1, -0.04), (-0.3, 0.2), (0.9, 0.1)])
def test_the_force_of_numbers_and_its_derivatives_are_those_of_arrays(slip):
    load, stiffness, mu, step = 26.7, 52.7, 0.47, 1e-6

    def force(s_x, s_y, log_friction=0.0):
        return np.array(brush_tire.brush_force(
            s_x, s_y, mu * np.exp(log_friction), load, stiffness))
    by_x, by_y, by_friction = ((force(*at + change) - force(*at - change)) / (2.0 * step)
                               for at in [np.array([*slip, 0.0])] for change in step * np.eye(3))
    assert brush_tire.force_with_derivatives(*slip, stiffness, mu * load) == pytest.approx(
        (*force(*slip), by_x[0], by_x[1], by_y[1], *by_friction), rel=1e-6, abs=1e-6)


TireForce = namedtuple('TireForce', 'x y xx xy yy x_by_friction y_by_friction')


def force_of(*arguments):
    return TireForce(*brush_tire.force_with_derivatives(*arguments))


@pytest.mark.parametrize(('slip', 'spread'), [(0.1, 0.03), (0.25, 0.1), (0.6, 0.1)])
def test_the_force_of_an_uncertain_slip_is_the_mean_force(slip, spread):
    stiffness, limit = 52.7, 5.0  # the tire slides above a slip of 0.285
    nodes, weights = np.polynomial.hermite_e.hermegauss(25)
    slips = slip + spread * nodes
    forces = np.array([force_of(s, 0.0, stiffness, limit).x for s in slips])
    mean = weights @ forces / weights.sum()
    slope = weights @ (nodes * forces) / weights.sum() / spread
    force = force_of(slip, 0.0, stiffness, limit, spread)
    assert force.x == pytest.approx(mean, rel=0.02)
    assert force.xx == pytest.approx(slope, abs=0.04 * stiffness)
    aside = force_of(0.0, slip, stiffness, limit, spread)
    assert (aside.y, aside.yy, aside.xx) == pytest.approx((force.x, force.xx, force.yy))


def test_the_inverse_and_the_slope_are_those_of_the_force():
    share = np.linspace(0.0, 1.0, 101)
    t = brush_tire.normalized_slip_at(share)
    assert brush_tire.force_share(t) == pytest.approx(share)
    assert brush_tire.force_share([1.5]) == 1.0
    slip = t * brush_tire.critical_slip(MU, LOAD, C_X)
    slopes = [brush_tire.force_with_derivatives(s, 0.0, C_X, MU * LOAD)[2] for s in slip]
    assert C_X * brush_tire.slope_at(share) == pytest.approx(slopes)


@pytest.mark.skipif(not brush_tire.COMPILED, reason='not compiled')
def test_the_extension_computes_what_its_source_does():
    rolling, v_x, v_y, mu, load = random_states(2000)
    s_x, s_y = brush_tire.slip_vector(rolling, v_x, v_y)
    limit, spread = mu * (load + 0.1), np.maximum(v_x, 0.0)

    def found(by):
        return np.array([
            (*by.force_with_derivatives(*one), by.force_over_slip(abs(one[0]), *one[2:4]))
            for one in zip(s_x, s_y, 900.0 * mu, limit, spread)])
    source = load_source(brush_tire)
    np.testing.assert_array_equal(found(brush_tire), found(source))
    np.testing.assert_array_equal(brush_tire.brush_force(s_x, s_y, mu, load, C_X),
                                  source.brush_force(s_x, s_y, mu, load, C_X))


def test_friction_from_the_adhesion_ratio_is_the_inverse():
    mu = np.linspace(0.1, 1.2, 23)
    ratio = brush_tire.adhesion_ratio(-0.12, mu, LOAD, C_X)
    back = brush_tire.friction_from_adhesion(ratio, -0.12, LOAD, C_X)
    np.testing.assert_allclose(back, mu, rtol=1e-12)


@pytest.mark.parametrize('ratio, slip, load', [
    (0.0, 0.5, 26.7), (1.0, 0.1, 26.7), (1.2, 0.1, 26.7), (0.8, 0.0, 26.7), (0.8, 0.1, 0.0),
    (-0.1, 0.1, 26.7), (np.nan, 0.1, 26.7)])
def test_friction_is_nan_where_the_adhesion_ratio_does_not_determine_it(ratio, slip, load):
    assert np.isnan(brush_tire.friction_from_adhesion(ratio, slip, load, C_X))


LOADS = np.array([18.0, 18.0, 35.0, 35.0])[:, np.newaxis]  # N, of an accelerating robot


@pytest.mark.parametrize('friction', [0.1, 0.47, 2.0])
def test_the_linear_force_is_the_inverse_of_the_brush_tire(friction):
    # up to front wheels that slide fully while rear wheels adhere
    slip = np.linspace(-1.05, 1.05, 61) * 3.0 * friction * LOADS.min() / C_X
    force = brush_tire.brush_force(slip, 0.0, friction, LOADS, C_X)[0].sum(axis=0)
    found, derivative = brush_tire.linear_tire_force(force, friction * LOADS)
    assert found / C_X == pytest.approx(slip, rel=1e-6)
    less, more = (brush_tire.linear_tire_force(force + step, friction * LOADS)[0]
                  for step in (-1e-6, 1e-6))
    np.testing.assert_allclose(derivative, (more - less) / 2e-6, rtol=1e-5)


def test_a_force_beyond_friction_is_limited():
    limit = brush_tire.MAX_FORCE_SHARE * 0.47 * LOADS.sum()
    found, _ = brush_tire.linear_tire_force([limit, 3.0 * limit, -1e3 * limit], 0.47 * LOADS)
    assert found == pytest.approx(found[0] * np.array([1.0, 1.0, -1.0]))
    assert np.isfinite(found).all()
    assert brush_tire.linear_tire_force(limit, 0.47 * LOADS, 0.99)[0] < found[0]


def test_a_lifted_wheel_has_no_force():
    lifted = 0.47 * np.array([0.0, 0.0, 53.0, 53.0])[:, np.newaxis]
    others, _ = brush_tire.linear_tire_force([4.0], lifted[2:])
    assert brush_tire.linear_tire_force([4.0], lifted)[0] == pytest.approx(others)
