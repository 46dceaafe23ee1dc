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

"""Printed perturbation solution: correct to its order, with the known errors."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.models.film import elastica, elastica_with_weight, printed_elastica


def order(errors, small):
    """Return the power of ``small`` with which ``errors`` vanish."""
    return np.polyfit(np.log(small), np.log(np.abs(errors)), 1)[0]


STROKES = np.geomspace(1e-4, 1e-2, 9)


def test_errors_vanish_with_the_first_neglected_order():
    assert order(printed_elastica.load(STROKES) - elastica.load(STROKES),
                 STROKES) == pytest.approx(2.0, abs=0.05)
    assert order(printed_elastica.height(STROKES) - elastica.height(STROKES),
                 STROKES) == pytest.approx(1.5, abs=0.05)
    s = np.array([0.3, 0.7])
    exact = elastica.shape(STROKES[:, None], s)
    printed = printed_elastica.shape(STROKES[:, None], s)
    for name, expected in (('x', 2.0), ('y', 1.5), ('theta', 1.5)):
        error = getattr(printed, name) - getattr(exact, name)
        assert order(error[:, 0], STROKES) == pytest.approx(expected, abs=0.1), name


def test_only_the_second_order_of_a15_is_wrong():
    wrong = (printed_elastica.charge(STROKES) - elastica.charge(STROKES)) / STROKES**2
    np.testing.assert_allclose(wrong, 7.0 / 32.0 - 1.0 / 2.0, rtol=0.01)
    np.testing.assert_allclose(printed_elastica.linear_charge(STROKES), -0.5 * STROKES)


def test_the_weight_enters_load_and_angle_to_first_order():
    stroke, weight, s = 1e-4, 1e-5, np.linspace(0.0, 1.0, 11)
    film, bare = elastica_with_weight.solve(stroke, weight), elastica.shape(stroke, s)
    sag = film.at(s).theta - bare.theta
    load = printed_elastica.load(stroke, weight) - printed_elastica.load(stroke)
    assert load == pytest.approx(float(film.load - elastica.load(stroke)), rel=0.01)
    printed = printed_elastica.shape(stroke, s, weight)
    assert np.abs(printed.theta - printed_elastica.shape(stroke, s).theta).max() > 1e-7
    # A(12b) holds up to a multiple of sin(pi s), which changes the amplitude C only
    difference = printed.theta - printed_elastica.shape(stroke, s).theta - sag
    sine = np.sin(np.pi * s)
    difference -= sine * (difference @ sine) / (sine @ sine)
    assert np.abs(difference).max() < 0.01 * np.abs(sag).max()


def test_curvature_is_the_derivative_of_the_angle():
    s = np.linspace(0.0, 1.0, 2001)
    shape = printed_elastica.shape(0.2, s, 0.3)
    np.testing.assert_allclose(np.gradient(shape.theta, s, edge_order=2), shape.curvature,
                               atol=1e-5)
