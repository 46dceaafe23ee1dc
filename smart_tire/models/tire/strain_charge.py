"""
Charge of the stretched film, B(23) to B(26), and what its peak tells.

Charges are given as the integral [m] of B(21)'s displacement over L under the film; times
``transfer`` [C/m] they are coulombs. ``tread_film.stretch_integral`` is exact for any film at any
place; here are its largest value, and what the paper prints instead, which is for driving
straight on, a film inside the patch and an adhesion zone that ends under it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models import validation
from smart_tire.models.tire import tread_film

Flags = npt.NDArray[np.bool_]
METHODS = ('exact', 'printed')


class StretchPeak(NamedTuple):
    """Where the stretch charge of a film is largest; arrays of one shape."""

    position: Array  # m, x_m
    integral: Array  # m, q_sm over the transfer, negative when braking
    tells: Flags     # whether x_m depends on the adhesion length, so tells it


def transfer(width: ArrayLike, d31: ArrayLike, c11: ArrayLike) -> Array:
    """
    Return ``d31 c11 b`` [C/m].

    With constants of PVDF and the paper's amplifier of 0.5 mV/pC the range of 3.3 V would be
    clipped a hundred times over: what reaches a film is little of B(21), so its gain is fitted.
    """
    product: Array = (validation.positive('width', width) * validation.positive('d31', d31)
                      * validation.positive('c11', c11))
    return product


def peak(slip: ArrayLike, total_slip: ArrayLike, critical_slip: ArrayLike, film_length: float,
         contact_length: float, *, method: str = 'exact') -> StretchPeak:
    """
    Return x_m and q_sm for B(3)'s lambda, the slip's magnitude and ``critical_slip``.

    ``exact`` is the integral at the exact root of B(24). It tells nothing on the adhesion length
    up to ``(L - l) / 2``, where the film slides as a whole at its peak, and without slip. A film
    longer than the patch has no single x_m, the middle of the places with the same charge stands
    for them: it feels the whole patch, ``L F_x / (2 C_x)``. ``printed`` is B(25) with
    ``x_m = L_a - l``, tells where it is inside the patch, and takes the slip with its sign.
    """
    validation.one_of('method', method, METHODS)
    _check_lengths(film_length, contact_length)
    slip = validation.finite('slip', slip)
    total = np.abs(validation.finite('total_slip', total_slip))
    limit = validation.not_negative('critical_slip', critical_slip, infinite=True)
    validation.fitting(slip=slip, total_slip=total, critical_slip=limit)
    slip, total, limit = np.broadcast_arrays(slip, np.maximum(total, np.abs(slip)), limit)
    if method == 'printed':
        return _printed_peak(slip, limit, film_length, contact_length)
    stuck = contact_length * _adhesion_ratio(total, limit)
    middle = 0.5 * (contact_length - film_length)
    inside = film_length < contact_length
    position = (tread_film.peak_position(stuck, film_length, contact_length) if inside
                else np.full(stuck.shape, middle))
    integral = tread_film.stretch_integral(position, slip, total, limit, film_length,
                                           contact_length)
    return StretchPeak(position, integral, inside & (stuck > middle) & (slip != 0.0))


def gain(adhesion_length: ArrayLike, film_length: ArrayLike, contact_length: ArrayLike) -> Array:
    """
    Return the printed K of B(26) over the transfer [m]: ``q_sm = K lambda``, B(25).

    It depends on the slip through L_a, so Fig. 12 is no straight line even so; and it is too low,
    by 5 % at a slip of 0.1 and 25 % at 0.3 with the constants of Table I.
    """
    stuck, film, length = _lengths(adhesion_length, film_length, contact_length)
    K: Array = film * (2.0 * stuck - film) / (2.0 * length)
    return K


def printed_integral(x: ArrayLike, slip: ArrayLike, adhesion_length: ArrayLike,
                     film_length: ArrayLike, contact_length: ArrayLike) -> Array:
    """
    Return B(23) over the transfer [m].

    The adhesion zone must end inside the patch and under the film, and the film lie inside the
    patch: ``max(L_a - l, 0) <= x <= min(L_a, L - l)``. There it is exact for a slip above zero.
    """
    stuck, film, length = _printed_arguments(x, slip, adhesion_length, film_length,
                                             contact_length)
    x, end = np.asarray(x, dtype=float), np.asarray(x, dtype=float) + film
    bracket = (3.0 * (stuck**2 - x**2)
               + (3.0 * length * (end**2 - stuck**2) - 2.0 * (end**3 - stuck**3))
               / (length - stuck))
    integral: Array = bracket * np.asarray(slip, dtype=float) / (6.0 * length)
    return integral


def printed_slope(x: ArrayLike, slip: ArrayLike, adhesion_length: ArrayLike,
                  film_length: ArrayLike, contact_length: ArrayLike) -> Array:
    """Return B(24), the derivative of ``printed_integral`` by x; its root is x_m."""
    stuck, film, length = _printed_arguments(x, slip, adhesion_length, film_length,
                                             contact_length)
    x = np.asarray(x, dtype=float)
    f = x**2 + (2.0 * film - stuck) * x + film * (film - length)
    slope: Array = -f * np.asarray(slip, dtype=float) / (length * (length - stuck))
    return slope


def _printed_peak(slip: Array, limit: Array, film_length: float,
                  contact_length: float) -> StretchPeak:
    with np.errstate(divide='ignore', over='ignore', invalid='ignore'):
        ratio = np.where(slip == 0.0, 1.0, 1.0 - slip / limit)
    if np.isneginf(ratio).any():
        raise ParameterError('critical_slip is 0, where B(25) has no adhesion length')
    stuck = contact_length * ratio
    integral = film_length * (2.0 * stuck - film_length) / (2.0 * contact_length) * slip
    position = stuck - film_length
    # L_a <= L and the film inside the patch: the paper's 0 <= lambda and l <= L_a
    tells = (slip > 0.0) & (position >= 0.0) & (film_length <= contact_length)
    return StretchPeak(position, integral, tells)


def _adhesion_ratio(total: Array, limit: Array) -> Array:
    with np.errstate(divide='ignore', over='ignore', invalid='ignore'):
        return np.where(total == 0.0, 1.0, np.maximum(1.0 - total / limit, 0.0))


def _printed_arguments(x: ArrayLike, slip: ArrayLike, adhesion_length: ArrayLike,
                       film_length: ArrayLike, contact_length: ArrayLike
                       ) -> tuple[Array, Array, Array]:
    """Return L_a, l and L; raise ParameterError where B(23) was not derived."""
    stuck, film, length = _lengths(adhesion_length, film_length, contact_length)
    x, slip = validation.finite('x', x), validation.finite('slip', slip)
    validation.fitting(x=x, slip=slip, adhesion_length=stuck, film_length=film,
                    contact_length=length)
    if np.any(stuck >= length):
        raise ParameterError(f'adhesion_length is {stuck.max()}, expected below the contact '
                             'length: B(23) divides by what slides')
    low, high = np.maximum(stuck - film, 0.0), np.minimum(stuck, length - film)
    place, low, high = np.broadcast_arrays(x, low, high)
    wrong = ~((place >= low) & (place <= high))
    if wrong.any():
        raise ParameterError(
            f'x is {place[wrong].flat[0]}, where B(23) is not valid: expected '
            f'{low[wrong].flat[0]} to {high[wrong].flat[0]}, the adhesion zone ending under a '
            'film inside the patch')
    return stuck, film, length


def _lengths(adhesion_length: ArrayLike, film_length: ArrayLike, contact_length: ArrayLike
             ) -> tuple[Array, Array, Array]:
    stuck = validation.not_negative('adhesion_length', adhesion_length)
    film = validation.positive('film_length', film_length)
    length = validation.positive('contact_length', contact_length)
    validation.fitting(adhesion_length=stuck, film_length=film, contact_length=length)
    return stuck, film, length


def _check_lengths(film_length: float, contact_length: float) -> None:
    for name, value in (('film_length', film_length), ('contact_length', contact_length)):
        if validation.positive(name, value).ndim:
            raise ParameterError(f'{name} has shape {np.shape(value)}, expected one number')
