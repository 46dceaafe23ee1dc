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
Charge of the strained film, B(23) and B(24), its maximum, and what the maximum determines.

Charges are given as the overlap integral [m]: B(21)'s displacement over L, integrated over the
part of the film inside the patch. Times ``transfer`` [C/m] it is a charge, times the stretch gain
[V/m] a voltage. ``x`` [m] is the travel of the film's trailing edge past the leading edge of the
patch: the film covers ``[x, x + film_length]``, the patch ``[0, contact_length]``. Everything is
exact and in closed form; ``printed_strain_charge`` has the formulas of the paper.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models import validation
from smart_tire.models.tire import brush_tire
from smart_tire.models.tire.contact_strain import displacement, METHODS, MIN_NORMALIZED_SLIP

Flags = npt.NDArray[np.bool_]


class Overlap(NamedTuple):
    """Overlap integral per unit longitudinal slip and its partial derivatives; shape of ``x``."""

    value: Array               # m
    by_position: Array         # -, by x
    by_contact_length: Array   # -, by L
    by_normalized_slip: Array  # m


class StrainPeak(NamedTuple):
    """Maximum of the strain charge of a film over its position; arrays of one shape."""

    position: Array    # m, x_m
    integral: Array    # m, q_sm over the transfer; negative when braking
    observable: Flags  # whether x_m depends on the adhesion length, hence determines it


def transfer(width: ArrayLike, d31: ArrayLike, c11: ArrayLike) -> Array:
    """
    Return ``d31 c11 b`` [C/m], charge per overlap integral, from m, C/N and Pa.

    With constants of PVDF and the paper's amplifier of 0.5 mV/pC the range of 3.3 V would be
    exceeded a hundredfold: only a small part of B(21) reaches a film, so its gain is fitted.
    Raises ParameterError unless all arguments are positive.

    >>> print(f'{transfer(0.003, 23e-12, 3e9) * 1e6:.0f} uC/m')
    207 uC/m
    """
    product: Array = (validation.positive('width', width) * validation.positive('d31', d31)
                      * validation.positive('c11', c11))
    return product


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
    edges = np.empty((2, *np.shape(x)))  # of the film, over L
    edges[0] = x / contact_length
    edges[1] = edges[0] + film_length / contact_length
    xi = np.minimum(np.maximum(edges, 0.0), 1.0)
    part = displacement(xi, normalized_slip)
    area = part.integral[1] - part.integral[0]
    moment = xi * part.value
    return Overlap(contact_length * area, part.value[1] - part.value[0],
                   area - moment[1] + moment[0],
                   (-contact_length / normalized_slip) * (part.slid[1] - part.slid[0]))


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


def adhesion_length(x_m: ArrayLike, film_length: float, contact_length: float,
                    method: str = 'exact') -> Array:
    """
    Return the adhesion length L_a [m] from the peak position x_m = L - r w dt_a [m] of B(24).

    ``exact`` inverts ``peak_position``: NaN up to its plateau at ``(L - l) / 2``. Above ``L - l``,
    which only measurement errors of x_m reach, it continues beyond L, since clipping would bias
    a mean. ``printed`` is the paper's ``L_a = x_m + l``, far too short where much of the patch
    slides. Raises ParameterError for another method or a film longer than the patch.

    >>> for method in ('exact', 'printed'):
    ...     print(f'{adhesion_length(0.0208, 0.020, 0.046, method) * 1e3:.1f} mm')
    35.8 mm
    40.8 mm
    """
    _check_shorter(film_length, contact_length)
    x = np.asarray(x_m, dtype=float)
    if validation.one_of('method', method, METHODS) == 'printed':
        return x + film_length
    x = np.where(x > 0.5 * (contact_length - film_length), x, np.nan)
    return ((x + film_length)**2 - film_length * contact_length) / x


def peak(slip: ArrayLike, total_slip: ArrayLike, critical_slip: ArrayLike, film_length: float,
         contact_length: float) -> StrainPeak:
    """
    Return position x_m [m] and overlap integral q_sm [m] of the largest strain charge, B(25).

    Slips as for ``overlap_integral``, both evaluated exactly. The peak does not determine the
    adhesion length where that is at most ``(L - l) / 2``, nor without slip. A film longer than
    the patch has its maximum over an interval of positions, whose center is returned; it responds
    to the whole patch, ``L F_x / (2 C_x)``. Raises ParameterError for arguments out of range.

    >>> print(f'{peak(0.1, 0.13, 0.7143, 0.020, 0.046).integral * 1e3:.3f} mm')
    1.291 mm
    """
    check_lengths(film_length, contact_length)
    slip = validation.finite('slip', slip)
    total = np.abs(validation.finite('total_slip', total_slip))
    limit = validation.not_negative('critical_slip', critical_slip, infinite=True)
    validation.fitting(slip=slip, total_slip=total, critical_slip=limit)
    slip, total, limit = np.broadcast_arrays(slip, np.maximum(total, np.abs(slip)), limit)
    stuck = contact_length * np.maximum(1.0 - brush_tire.normalized_slip(total, limit), 0.0)
    center = 0.5 * (contact_length - film_length)
    shorter = film_length < contact_length
    position = (peak_position(stuck, film_length, contact_length) if shorter
                else np.full(stuck.shape, center))
    integral = overlap_integral(position, slip, total, limit, film_length, contact_length)
    return StrainPeak(position, integral, shorter & (stuck > center) & (slip != 0.0))


def check_lengths(film_length: float, contact_length: float) -> None:
    """
    Raise ParameterError unless both lengths [m] are single positive numbers.

    >>> check_lengths(-0.020, 0.046)
    Traceback (most recent call last):
    ...
    smart_tire.errors.ParameterError: film_length is -0.02, expected above zero
    """
    for name, value in (('film_length', film_length), ('contact_length', contact_length)):
        if validation.positive(name, value).ndim:
            raise ParameterError(f'{name} has shape {np.shape(value)}, expected one number')


def _check_shorter(film_length: float, contact_length: float) -> None:
    if not 0.0 < film_length < contact_length:
        raise ParameterError(
            f'film of {film_length} m has no peak in a patch of {contact_length} m')
