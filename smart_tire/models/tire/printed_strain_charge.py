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
Strain charge as the paper prints it, B(23) to B(26).

It holds for driving straight, a film inside the patch and an adhesion zone that ends under the
film. Charges are overlap integrals [m] as in ``strain_charge``, which has the exact solution.
"""

from __future__ import annotations

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models import validation
from smart_tire.models.tire.strain_charge import check_lengths, StrainPeak


def gain(adhesion_length: ArrayLike, film_length: ArrayLike, contact_length: ArrayLike) -> Array:
    """
    Return K of B(26) over the transfer [m]: ``q_sm = K lambda``, B(25); lengths in m.

    It depends on the slip through L_a, so Fig. 12 is not a straight line. It is too low, by 5 % at
    a slip of 0.1 and by 25 % at 0.3 with the constants of Table I. Raises ParameterError for
    lengths that are not positive or do not broadcast.

    >>> print(f'{gain(0.0396, 0.020, 0.046) * 1e3:.2f} mm')
    12.87 mm
    """
    stuck, film, length = _lengths(adhesion_length, film_length, contact_length)
    return _gain(stuck, film, length)


def peak(slip: ArrayLike, critical_slip: ArrayLike, film_length: float,
         contact_length: float) -> StrainPeak:
    """
    Return x_m = L_a - l [m] and q_sm [m] of B(25), for signed longitudinal slip.

    ``observable`` where this x_m lies inside the patch. Raises ParameterError for arguments out
    of range and for a slip at a critical slip of zero.

    >>> print(f'{peak(0.1, 0.7143, 0.020, 0.046).integral * 1e3:.3f} mm')
    1.285 mm
    """
    check_lengths(film_length, contact_length)
    slip = validation.finite('slip', slip)
    limit = validation.not_negative('critical_slip', critical_slip, infinite=True)
    validation.fitting(slip=slip, critical_slip=limit)
    slip, limit = np.broadcast_arrays(slip, limit)
    with np.errstate(divide='ignore', over='ignore', invalid='ignore'):
        ratio = np.where(slip == 0.0, 1.0, 1.0 - slip / limit)
    if np.isneginf(ratio).any():
        raise ParameterError('critical_slip is 0, where B(25) has no adhesion length')
    stuck = contact_length * ratio
    position = stuck - film_length
    # L_a <= L and the film inside the patch: the paper's 0 <= lambda and l <= L_a
    inside = (slip > 0.0) & (position >= 0.0) & (film_length <= contact_length)
    return StrainPeak(position, _gain(stuck, film_length, contact_length) * slip, inside)


def integral(x: ArrayLike, slip: ArrayLike, adhesion_length: ArrayLike, film_length: ArrayLike,
             contact_length: ArrayLike) -> Array:
    """
    Return the overlap integral [m] of B(23) at the positions ``x`` [m].

    The adhesion zone must end inside the patch and under the film, and the film must lie inside
    the patch: ``max(L_a - l, 0) <= x <= min(L_a, L - l)``; ParameterError otherwise. There it is
    exact for a slip above zero.

    >>> print(f'{integral(0.022, 0.1, 0.0396, 0.020, 0.046) * 1e3:.3f} mm')
    1.351 mm
    """
    stuck, film, length = _arguments(x, slip, adhesion_length, film_length, contact_length)
    x, end = np.asarray(x, dtype=float), np.asarray(x, dtype=float) + film
    bracket = (3.0 * (stuck**2 - x**2)
               + (3.0 * length * (end**2 - stuck**2) - 2.0 * (end**3 - stuck**3))
               / (length - stuck))
    result: Array = bracket * np.asarray(slip, dtype=float) / (6.0 * length)
    return result


def slope(x: ArrayLike, slip: ArrayLike, adhesion_length: ArrayLike, film_length: ArrayLike,
          contact_length: ArrayLike) -> Array:
    """
    Return B(24) [-], the derivative of ``integral`` by x; its root is x_m. Errors as there.

    >>> print(f'{slope(0.022, 0.1, 0.0396, 0.020, 0.046):.4f}')
    0.0092
    """
    stuck, film, length = _arguments(x, slip, adhesion_length, film_length, contact_length)
    x = np.asarray(x, dtype=float)
    f = x**2 + (2.0 * film - stuck) * x + film * (film - length)
    result: Array = -f * np.asarray(slip, dtype=float) / (length * (length - stuck))
    return result


def _gain(stuck: ArrayLike, film: ArrayLike, length: ArrayLike) -> Array:
    K: Array = (np.asarray(film) * (2.0 * np.asarray(stuck) - np.asarray(film))
                / (2.0 * np.asarray(length)))
    return K


def _arguments(x: ArrayLike, slip: ArrayLike, adhesion_length: ArrayLike, film_length: ArrayLike,
               contact_length: ArrayLike) -> tuple[Array, Array, Array]:
    """Return L_a, l and L; raise ParameterError outside the domain of B(23)."""
    stuck, film, length = _lengths(adhesion_length, film_length, contact_length)
    x, slip = validation.finite('x', x), validation.finite('slip', slip)
    validation.fitting(x=x, slip=slip, adhesion_length=stuck, film_length=film,
                       contact_length=length)
    if np.any(stuck >= length):
        raise ParameterError(f'adhesion_length is {stuck.max()}, expected below the contact '
                             'length: B(23) divides by the length of the sliding zone')
    low, high = np.maximum(stuck - film, 0.0), np.minimum(stuck, length - film)
    position, low, high = np.broadcast_arrays(x, low, high)
    outside = ~((position >= low) & (position <= high))
    if outside.any():
        raise ParameterError(
            f'x is {position[outside].flat[0]}, where B(23) is not valid: expected '
            f'{low[outside].flat[0]} to {high[outside].flat[0]}, the adhesion zone ending under '
            'a film inside the patch')
    return stuck, film, length


def _lengths(adhesion_length: ArrayLike, film_length: ArrayLike, contact_length: ArrayLike
             ) -> tuple[Array, Array, Array]:
    stuck = validation.not_negative('adhesion_length', adhesion_length)
    film = validation.positive('film_length', film_length)
    length = validation.positive('contact_length', contact_length)
    validation.fitting(adhesion_length=stuck, film_length=film, contact_length=length)
    return stuck, film, length
