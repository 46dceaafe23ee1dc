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
Perturbation solution of the heavy film, A(12) to A(16), as printed in the paper.

Valid for small strokes and weights; its errors are those of the paper. With ``w = eps^3`` and
``delta = C^2 eps^2 / 4`` the result depends on the amplitude ``C eps = 2 sqrt(delta)`` only.
Names, units, signs and errors as in ``elastica``; ``weight`` is w, positive for a film arched
against gravity and negative for a hanging one.
"""

from __future__ import annotations

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.models.film.elastica import checked_stroke, EULER_LOAD, Shape


def load(stroke: ArrayLike, weight: ArrayLike = 0.0) -> Array:
    """
    Return the load f of A(13); infinite for a flat film with weight.

    >>> print(f'{load(0.05):.3f} {load(0.05, 0.02):.3f}')
    10.116 10.145
    """
    stroke, weight = checked_stroke(stroke), np.asarray(weight, dtype=float)
    with np.errstate(divide='ignore', invalid='ignore'):
        thrust = np.where(weight == 0.0, 0.0, weight / (np.pi * np.sqrt(stroke)))
    return EULER_LOAD * (1.0 + 0.5 * stroke) + thrust


def height(stroke: ArrayLike) -> Array:
    """
    Return the height h_max of A(12) to first order, which does not contain the weight.

    >>> print(f'{height(0.05):.4f}')
    0.2847
    """
    top: Array = 4.0 / np.pi * np.sqrt(checked_stroke(stroke))
    return top


def shape(stroke: ArrayLike, s: ArrayLike, weight: ArrayLike = 0.0) -> Shape:
    """
    Return the shape of A(12) at the arc lengths ``s``.

    Orders as printed: theta to third order in the amplitude, x to second, y to first.

    >>> print(shape(0.05, [0.25, 0.5]).theta.round(4))
    [0.3166 0.4467]
    """
    stroke, s, weight = np.broadcast_arrays(
        checked_stroke(stroke), np.asarray(s, dtype=float), np.asarray(weight, dtype=float))
    amplitude, phase = 2.0 * np.sqrt(stroke), np.pi * s
    third, sag = amplitude**3 / 192.0, weight / EULER_LOAD
    return Shape(
        s, s + stroke * (np.sin(2.0 * phase) / (2.0 * np.pi) - s),
        amplitude / np.pi * (1.0 - np.cos(phase)),
        amplitude * np.sin(phase) + third * np.sin(3.0 * phase) + sag * s * (1.0 + np.cos(phase)),
        np.pi * (amplitude * np.cos(phase) + 3.0 * third * np.cos(3.0 * phase))
        + sag * (1.0 + np.cos(phase) - phase * np.sin(phase)))


def charge(stroke: ArrayLike) -> Array:
    """
    Return Q_en / K of A(15), from the flat film: ``(1 + delta / 2) (1 - delta) - 1``.

    >>> print(f'{charge(0.05):.5f}')
    -0.02625
    """
    stroke = checked_stroke(stroke)
    value: Array = -0.5 * stroke * (1.0 + stroke)
    return value


def linear_charge(stroke: ArrayLike) -> Array:
    """
    Return Q_en / K of A(16): ``-delta / 2``.

    >>> print(f'{linear_charge(0.05):.5f}')
    -0.02500
    """
    value: Array = -0.5 * checked_stroke(stroke)
    return value
