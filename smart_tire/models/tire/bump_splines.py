"""
Deviation of the bumps outside the contact from their nominal shape, as cubic B-splines.

There is no theory of the bumps of Fig. 11(b) of paper B, so that their shape must be learned. The
splines cover the bumps and the begin and end of the contact, into which a wide bump extends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array

KNOT_SPACING = 0.003  # m, resolves a bump with a width at half height of 5 mm to about 1 %
FIRST_KNOT, LAST_KNOT = -0.012, 0.033  # m, centers of the splines; negative in the contact
KNOTS = np.arange(FIRST_KNOT, LAST_KNOT + 0.5 * KNOT_SPACING, KNOT_SPACING)


class Splines(NamedTuple):
    """All splines, and their derivatives; (knots, n) each."""

    value: Array
    by_outside: Array  # per m


def splines(outside: Array) -> Splines:
    """
    Return the splines at ``outside`` (n,) [m], the distance of the film from the patch.

    ``outside`` is negative while the film is in the patch.

    >>> values = splines(np.array([0.0, 0.0045])).value
    >>> print(KNOTS[values[:, 1] > 0.4], values.sum(axis=0).round(3))
    [0.003 0.006] [1. 1.]
    """
    offset = (outside - KNOTS[:, np.newaxis]) / KNOT_SPACING
    size = np.abs(offset)
    wide, narrow = np.maximum(2.0 - size, 0.0), np.maximum(1.0 - size, 0.0)
    wide_square, narrow_square = wide * wide, narrow * narrow
    return Splines(
        (wide * wide_square - 4.0 * narrow * narrow_square) / 6.0,
        np.sign(offset) * (2.0 * narrow_square - 0.5 * wide_square) / KNOT_SPACING)
