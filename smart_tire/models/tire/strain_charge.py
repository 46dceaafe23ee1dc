# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Strain of the tread and charge of the strained film: B(17) to B(24).

The paper calls two quantities stress: B(20) is the traction of the ground on the tread, whereas
the stress of the film is ``c11`` times its strain. The "strain" of B(21) is a displacement over L,
not a gradient; its transfer to the film is a fitted gain. With a pressure that is a parabola over
the patch, that displacement depends on position and normalized slip only.

Charges are given as the overlap integral [m]: B(21)'s displacement over L, integrated over the
part of the film inside the patch. Times the stretch gain [V/m] it is a voltage. ``x`` [m] is the
travel of the film's trailing edge past the leading edge of the patch: the film covers
``[x, x + film_length]``, the patch ``[0, contact_length]``. Everything is exact and in closed form
and holds for braking and lateral slip; ``smart_tire.papers`` has the formulas of the paper.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models.tire import brush_tire, film_equations

MIN_NORMALIZED_SLIP = 1e-300  # -, replaces zero, whose inverse is not a number


class Overlap(NamedTuple):
    """Overlap integral per unit longitudinal slip and its partial derivatives; shape of ``x``."""

    value: Array               # m
    by_position: Array         # -, by x
    by_contact_length: Array   # -, by L
    by_normalized_slip: Array  # m


def overlap(x: Array, normalized_slip: Array | float, film_length: float,
            contact_length: float) -> Overlap:
    """
    Return the overlap integral of B(23) per unit longitudinal slip, with its derivatives.

    ``normalized_slip`` t > 0 (total slip over critical slip) is a number or broadcasts to the
    shape of the positions ``x`` [m]. From t = 1 on the whole patch slides and the integral
    falls as 1 / t, so that only slip / t is observable. The derivative by ``x`` is B(24).

    >>> part = overlap(np.array([0.01]), 0.2, 0.020, 0.046)
    >>> print(f'{part.value[0] * 1e3:.2f} mm, {part.by_position[0]:.3f}')
    8.70 mm, 0.435
    """
    return Overlap(*film_equations.over_arrays(
        film_equations.overlap, 4, x, normalized_slip, film_length, contact_length))


def overlap_integral(x: ArrayLike, slip: ArrayLike, total_slip: ArrayLike,
                     critical_slip: ArrayLike, film_length: float,
                     contact_length: float) -> Array:
    """
    Return the overlap integral of B(23) [m] at the positions ``x`` [m]; arguments broadcast.

    The film responds to the longitudinal part of the displacement: ``slip`` is the slip ratio of
    B(3), positive when driving, ``total_slip`` the magnitude of the slip vector, taken as at least
    ``|slip|``. ``critical_slip`` may be infinite (no sliding). Lengths are in m.

    >>> print(f'{overlap_integral(0.01, 0.1, 0.13, 0.7143, 0.020, 0.046) * 1e3:.3f} mm')
    0.870 mm
    """
    slip = np.asarray(slip, dtype=float)
    magnitude = np.maximum(np.abs(np.asarray(total_slip, dtype=float)), np.abs(slip))
    t = np.maximum(brush_tire.normalized_slip(magnitude, critical_slip), MIN_NORMALIZED_SLIP)
    x, slip, t = np.broadcast_arrays(np.asarray(x, dtype=float), slip, t)
    integral: Array = slip * overlap(x, t, film_length, contact_length).value
    return integral


def peak_position(adhesion_length: ArrayLike, film_length: float, contact_length: float) -> Array:
    """
    Return x_m [m], the position of the largest strain charge: the exact root of B(24).

    Below an adhesion length [m] of ``(L - l) / 2`` the film lies in the sliding zone at its peak;
    x_m then stays at ``(L - l) / 2``. Raises ParameterError unless the film is shorter than the
    patch.

    >>> print(f'{peak_position(0.037, 0.020, 0.046) * 1e3:.2f} mm')
    21.35 mm
    """
    _check_shorter(film_length, contact_length)
    plateau = 0.5 * (contact_length - film_length)
    stuck = np.asarray(adhesion_length, dtype=float)
    root = np.sqrt(stuck**2 + 4.0 * film_length * (contact_length - stuck))
    return np.where(stuck <= plateau, plateau, 0.5 * (stuck + root) - film_length)


def adhesion_length(x_m: ArrayLike, film_length: float, contact_length: float) -> Array:
    """
    Return the adhesion length L_a [m] from the peak position x_m = L - r w dt_a [m] of B(24).

    The inverse of ``peak_position``: NaN up to its plateau at ``(L - l) / 2``. Above ``L - l``,
    which only measurement errors of x_m reach, it continues beyond L, since clipping would bias
    a mean. Raises ParameterError for a film longer than the patch.

    >>> print(f'{adhesion_length(0.0208, 0.020, 0.046) * 1e3:.1f} mm')
    35.8 mm
    """
    _check_shorter(film_length, contact_length)
    x = np.asarray(x_m, dtype=float)
    x = np.where(x > 0.5 * (contact_length - film_length), x, np.nan)
    return ((x + film_length)**2 - film_length * contact_length) / x


def _check_shorter(film_length: float, contact_length: float) -> None:
    if not 0.0 < film_length < contact_length:
        raise ParameterError(
            f'film of {film_length} m has no peak in a patch of {contact_length} m')
