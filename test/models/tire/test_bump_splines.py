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

"""Cubic B-splines for the shape of the bumps."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.models.tire import bump_shapes, bump_splines
from smart_tire.models.tire.bump_splines import FIRST_KNOT, KNOTS, LAST_KNOT, PADDING, splines


def evaluated(coefficients, outside):
    """Return the spline with ``coefficients`` (knots,) and its derivative."""
    padded = np.pad(coefficients, PADDING)
    parts = splines(outside)
    return tuple((padded[parts.knot] * part).sum(axis=0)
                 for part in (parts.value, parts.by_outside))


def test_the_splines_add_up_to_1_between_the_knots_and_vanish_far_outside():
    between = np.linspace(FIRST_KNOT + bump_splines.KNOT_SPACING,
                          LAST_KNOT - bump_splines.KNOT_SPACING, 333)
    value, slope = evaluated(np.ones(len(KNOTS)), between)
    np.testing.assert_allclose(value, 1.0, atol=1e-12)
    np.testing.assert_allclose(slope, 0.0, atol=1e-9)
    far = np.array([-10.0, FIRST_KNOT - 0.0041, LAST_KNOT + 0.0041, 10.0])
    assert np.all(evaluated(np.ones(len(KNOTS)), far)[0] == 0.0)


def test_the_derivatives_agree_with_finite_differences():
    coefficients, outside = np.sin(np.arange(len(KNOTS))), np.linspace(-0.015, 0.04, 1001)
    (high, _), (low, _) = (evaluated(coefficients, outside + step) for step in (1e-7, -1e-7))
    np.testing.assert_allclose(
        evaluated(coefficients, outside)[1], (high - low) / 2e-7, atol=1e-2)


@pytest.mark.parametrize('shape', bump_shapes.SHAPES)
@pytest.mark.parametrize('width, error', [(0.0055, 0.07), (0.009, 0.03), (0.0145, 0.01)])
def test_bumps_of_all_shapes_are_represented(shape, width, error):
    outside = np.linspace(FIRST_KNOT, LAST_KNOT, 500)
    bump = bump_shapes.bump(outside - 0.012, width, shape)
    basis = np.array([evaluated(row, outside)[0] for row in np.eye(len(KNOTS))])
    coefficients = np.linalg.lstsq(basis.T, bump, rcond=None)[0]
    # no spline is exact at the cusp of the exponential shape, and at the last knot
    smooth = (np.abs(outside - 0.012) > 0.003) | (shape != 'exponential')
    inner = outside < LAST_KNOT - 2.0 * bump_splines.KNOT_SPACING
    difference = np.abs(evaluated(coefficients, outside)[0] - bump)
    assert difference[smooth & inner].max() < error
