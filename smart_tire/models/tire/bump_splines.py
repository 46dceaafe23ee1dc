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
Deviation of the bumps outside the contact from their nominal shape, as a cubic spline.

There is no theory of the bumps of Fig. 11(b) of paper B, so that their shape must be learned. The
knots cover the bumps and the begin and end of the contact, into which a wide bump extends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array

KNOT_SPACING = 0.002  # m; resolves a slope over 3 mm
FIRST_KNOT, LAST_KNOT = -0.008, 0.030  # m outside the patch; negative in the contact
KNOTS = np.arange(FIRST_KNOT, LAST_KNOT + 0.5 * KNOT_SPACING, KNOT_SPACING)
ORDER = 4    # number of B-splines that are not zero at a position
PADDING = 3  # B-splines beyond each end, whose coefficients are zero


class Splines(NamedTuple):
    """Cubic B-splines that are not zero at n positions, and their derivatives."""

    knot: NDArray[np.intp]  # (ORDER, n), index in ``KNOTS`` plus ``PADDING``
    value: Array            # (ORDER, n)
    by_outside: Array       # (ORDER, n), per m


def splines(outside: Array) -> Splines:
    """
    Return the B-splines at ``outside`` (n,) [m], the distance of the film from the patch.

    ``outside`` is negative while the film is in the patch. There are ``PADDING`` splines before
    the first and after the last knot, so that ``knot`` is valid everywhere.

    >>> parts = splines(np.array([0.0, 0.005]))
    >>> print(parts.value.round(3).tolist())
    [[0.167, 0.021], [0.667, 0.479], [0.167, 0.479], [0.0, 0.021]]
    >>> print((KNOTS[parts.knot[1] - PADDING] * 1e3).round(1))
    [0. 4.]
    """
    position = (outside - FIRST_KNOT) / KNOT_SPACING + (PADDING - 1.0)
    position = np.minimum(np.maximum(position, 0.0), len(KNOTS) + 2.0 * PADDING - ORDER + 1.0)
    first = position.astype(np.intp)
    first = np.minimum(first, len(KNOTS) + 2 * PADDING - ORDER)
    x = position - first
    rest = 1.0 - x
    square, rest_square = x * x, rest * rest
    cube, rest_cube = x * square, rest * rest_square
    value, slope = np.empty((2, ORDER, len(x)))
    value[0], value[3] = rest_cube, cube
    value[1], value[2] = 4.0 - 6.0 * square + 3.0 * cube, 4.0 - 6.0 * rest_square + 3.0 * rest_cube
    value /= 6.0
    slope[0], slope[3] = -rest_square, square
    slope[1], slope[2] = 3.0 * square - 4.0 * x, 4.0 * rest - 3.0 * rest_square
    slope *= 0.5 / KNOT_SPACING
    return Splines(first + np.arange(ORDER)[:, np.newaxis], value, slope)
