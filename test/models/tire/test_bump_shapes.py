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

"""Shapes of the bumps before and after the contact."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.models.tire import bump_shapes, tread_film

L, FILM = 0.046, 0.020  # m


@pytest.mark.parametrize('shape', bump_shapes.SHAPES)
@pytest.mark.parametrize('width', [0.005, 0.015])
def test_a_bump_has_height_1_at_its_center_and_the_configured_width_at_half_height(shape, width):
    offset = np.linspace(-0.05, 0.1, 150_001)
    value = bump_shapes.bump(offset, width, shape)
    assert offset[value.argmax()] == pytest.approx(0.0, abs=2e-6)
    assert value.max() == pytest.approx(1.0)
    assert np.ptp(offset[value > 0.5]) == pytest.approx(width, abs=5e-6)
    assert np.abs(np.diff(value)).max() < 1e-3


@pytest.mark.parametrize('shape', bump_shapes.SHAPES)
def test_a_bump_is_negligible_beyond_its_extent(shape):
    beyond = bump_shapes.extent(0.012, 0.009, shape) - 0.012
    assert bump_shapes.bump(beyond, 0.009, shape) <= 1.0001 * bump_shapes.NEGLIGIBLE_HEIGHT
    assert bump_shapes.bump(0.9 * beyond, 0.009, shape) > bump_shapes.NEGLIGIBLE_HEIGHT


@pytest.mark.parametrize('shape', ['asymmetric', 'exponential'])
def test_skewed_bumps_are_wider_on_the_side_away_from_the_patch(shape):
    offset = np.linspace(-0.03, 0.03, 6001)
    wide = offset[bump_shapes.bump(offset, 0.01, shape) > 0.5]
    assert wide.max() > 2.0 * -wide.min() > 0.004


def test_the_raised_cosine_is_the_shape_of_the_film_model():
    x = np.linspace(-0.06, 0.09, 1501)
    offset = np.abs(x - 0.5 * (L - FILM)) - 0.5 * (L + FILM) - tread_film.BUMP_DISTANCE
    np.testing.assert_allclose(bump_shapes.bump(offset, 0.009),
                               tread_film.bumps(x, FILM, L).value, atol=1e-14)


def test_an_unknown_shape_and_a_width_of_zero_are_rejected():
    with pytest.raises(ValueError, match='square'):
        bump_shapes.bump(0.0, 0.009, 'square')
    with pytest.raises(ValueError, match='width'):
        bump_shapes.bump(0.0, 0.0)
