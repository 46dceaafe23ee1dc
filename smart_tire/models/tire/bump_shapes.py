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

"""
Shapes of the bumps before and after a film's contact: Fig. 11(b) of paper B.

A compliant tread bends the other way just outside the patch. There is no theory of these bumps;
the simulator and the tests generate them in several shapes, so that no estimator may rely on one.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.models import validation

# inner and outer half width at half height over the full width at half height
HALF_WIDTHS = {'raised_cosine': (0.5, 0.5), 'gaussian': (0.5, 0.5), 'asymmetric': (0.3, 0.7),
               'exponential': (0.25, 0.75)}
SHAPES = tuple(HALF_WIDTHS)
NEGLIGIBLE_HEIGHT = 1e-5  # at the end of shapes that do not vanish


def bump(offset: ArrayLike, width: ArrayLike, shape: str = 'raised_cosine') -> Array:
    """
    Return a bump of height 1 at ``offset`` [m], the distance beyond its center from the patch.

    ``width`` [m] is the full width at half height. ``shape`` is ``raised_cosine``, ``gaussian``,
    ``asymmetric`` (raised cosines, wider on the side away from the patch) or ``exponential`` (a
    raised cosine that decays exponentially away from the patch). Raises ParameterError for a width
    that is not positive and an unknown shape. Arguments broadcast.

    >>> print(bump([-0.010, -0.004, 0.0, 0.006], 0.009, 'gaussian').round(3))
    [0.033 0.578 1.    0.292]
    """
    inner, outer = HALF_WIDTHS[validation.one_of('shape', shape, SHAPES)]
    offset = np.asarray(offset, dtype=float)
    whole = 2.0 * np.where(offset < 0.0, inner, outer) * validation.positive('width', width)
    if shape == 'gaussian':
        return np.asarray(np.exp(-4.0 * math.log(2.0) * (offset / whole)**2))
    scale = math.pi / whole
    value: Array = 0.5 + 0.5 * np.cos(np.minimum(np.maximum(scale * offset, -math.pi), math.pi))
    if shape == 'exponential':
        decay = np.exp(-2.0 * math.log(2.0) * np.maximum(offset, 0.0) / whole)
        value = np.where(offset > 0.0, decay, value)
    return value


def extent(distance: float, width: float, shape: str = 'raised_cosine') -> float:
    """
    Return the distance [m] from the patch beyond which a bump is negligible.

    >>> print(f'{extent(0.010, 0.009):.3f} m')
    0.019 m
    """
    outer = HALF_WIDTHS[validation.one_of('shape', shape, SHAPES)][1] * width
    if shape == 'gaussian':
        return distance + outer * math.sqrt(-math.log2(NEGLIGIBLE_HEIGHT))
    if shape == 'exponential':
        return distance - outer * math.log2(NEGLIGIBLE_HEIGHT)
    return distance + 2.0 * outer
