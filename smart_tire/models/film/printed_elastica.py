"""
The paper's perturbation solution of the heavy film, A(12) to A(16), as it is printed.

Good for small strokes and weights; its errors are part of the paper. With ``w = eps^3`` and
``delta = C^2 eps^2 / 4`` all that shows is the amplitude ``C eps = 2 sqrt(delta)``. Names, units
and signs as in ``elastica``; ``weight`` is w, above zero for a film arched against gravity and
below zero for one that hangs.
"""

from __future__ import annotations

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.models.film.elastica import checked_stroke, EULER_LOAD, Shape


def load(stroke: ArrayLike, weight: ArrayLike = 0.0) -> Array:
    """Return f of A(13); a film with weight has none when it is flat (infinite)."""
    stroke, weight = checked_stroke(stroke), np.asarray(weight, dtype=float)
    with np.errstate(divide='ignore', invalid='ignore'):
        thrust = np.where(weight == 0.0, 0.0, weight / (np.pi * np.sqrt(stroke)))
    return EULER_LOAD * (1.0 + 0.5 * stroke) + thrust


def height(stroke: ArrayLike) -> Array:
    """Return h_max, to first order and so without the weight."""
    top: Array = 4.0 / np.pi * np.sqrt(checked_stroke(stroke))
    return top


def shape(stroke: ArrayLike, s: ArrayLike, weight: ArrayLike = 0.0) -> Shape:
    """Return theta of A(12) to third order, x to second and y to first, as far as printed."""
    stroke, s, weight = np.broadcast_arrays(
        checked_stroke(stroke), np.asarray(s, dtype=float), np.asarray(weight, dtype=float))
    amplitude, turn = 2.0 * np.sqrt(stroke), np.pi * s
    third, sag = amplitude**3 / 192.0, weight / EULER_LOAD
    return Shape(
        s, s + stroke * (np.sin(2.0 * turn) / (2.0 * np.pi) - s),
        amplitude / np.pi * (1.0 - np.cos(turn)),
        amplitude * np.sin(turn) + third * np.sin(3.0 * turn) + sag * s * (1.0 + np.cos(turn)),
        np.pi * (amplitude * np.cos(turn) + 3.0 * third * np.cos(3.0 * turn))
        + sag * (1.0 + np.cos(turn) - turn * np.sin(turn)))


def charge(stroke: ArrayLike) -> Array:
    """Return Q_en / K of A(15) from the flat film: ``(1 + delta / 2) (1 - delta) - 1``."""
    stroke = checked_stroke(stroke)
    value: Array = -0.5 * stroke * (1.0 + stroke)
    return value


def linear_charge(stroke: ArrayLike) -> Array:
    """Return Q_en / K of A(16): ``-delta / 2``."""
    value: Array = -0.5 * checked_stroke(stroke)
    return value
