"""Brush tires that share one slip: wheels of a robot that drives straight ahead."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array


MOST_FORCE = 0.995  # of what the wheels can hold; closer, slip says nothing of the force
ITERATIONS = 30     # at most, of Newton's method, which comes from below
PRECISION = 1e-9    # relative


def stiff_slip(force: npt.ArrayLike, friction: float, loads: npt.ArrayLike) -> Array:
    """
    Return C_x times the slip [N] at which wheels push with ``force`` [N] in all.

    The inverse of the sum of ``brush_tire.brush_force`` over wheels with the ``loads`` [N],
    shape (wheels, ...) against that of ``force``; C_x itself is not needed. Longitudinal slip
    only; a force beyond ``MOST_FORCE`` of friction times load is taken for that.
    """
    force = np.asarray(force, dtype=float)
    limits = friction * np.maximum(np.asarray(loads, dtype=float), 0.0)
    wanted = np.minimum(np.abs(force), MOST_FORCE * limits.sum(axis=0))
    # mu F_z (1 - xi^3) with xi = 1 - C_x s / (3 mu F_z): concave, so Newton never overshoots
    slip = wanted / len(limits)
    for _ in range(ITERATIONS):
        xi = _sticking(slip, limits)
        square = xi * xi  # many times faster than a power of three
        missing = wanted - (limits * (1.0 - square * xi)).sum(axis=0)
        slip = slip + missing / np.maximum(square.sum(axis=0), 1e-12)
        if np.all(missing <= PRECISION * np.maximum(wanted, PRECISION)):
            break
    return np.asarray(np.copysign(slip, force))


def _sticking(slip: Array, limits: Array) -> Array:
    """Return the adhering share xi of each patch, shape (wheels, ...)."""
    with np.errstate(divide='ignore', invalid='ignore'):
        share = np.where(limits > 0.0, slip / (3.0 * limits), 1.0)
    return np.asarray(np.maximum(1.0 - share, 0.0))
