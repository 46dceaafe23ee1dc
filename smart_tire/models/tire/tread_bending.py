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
Bending of tread and film where the contact flattens them: B(9) to B(16).

With B(10)'s ``eps_0 = 0`` the second row of B(11) is ``A_3 (w'''' - alpha^2 w'') = p_0`` with
``alpha^2 = A_2 / (r A_3)``; with B(13) it is a beam on two supports over the flattened length
``l_x``. All formulas are in ``xi = x / l_x`` and ``h = alpha l_x / 2``, so that no digits are lost
for small h, down to the beam without tension at h = 0. Arguments broadcast against each other.

There are three conventions. ``exact`` includes the thickness of the film and its true distance
from the axis. ``printed`` is B(12), B(15): it drops t_S from A_2 and A_3 and puts the film t_T,
not t_T / 2, from the axis, so its charge is twice the exact one. Both put the axis of zero strain
at the center of the tread, as the paper does because the film is thin. The film is stiff, however:
``neutral`` uses the axis of zero force, where A_2 and therefore alpha are zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models import validation

CONVENTIONS = ('exact', 'printed', 'neutral')
MAX_SERIES_H = 1.0  # -, h up to which deflections use the forms without cancellation
ORDERS = np.arange(3, 17, 2)
# (sinh(z) / z - 1) / z^2 in powers of z^2, highest first: ..., 1 / 5!, 1 / 3!
SINH_SERIES = (1.0 / np.cumprod(np.concatenate([[6.0], (ORDERS + 1.0) * (ORDERS + 2.0)])))[::-1]
# (z - tanh(z)) / z^3 in powers of z^2, highest first
LAG_SERIES = (-21844.0 / 6081075.0, 1382.0 / 155925.0, -62.0 / 2835.0, 17.0 / 315.0, -2.0 / 15.0,
              1.0 / 3.0)
MAX_LAG_SERIES_H = 0.1  # -, h up to which the series is exact to rounding
MIN_H = 1e-100          # -, replaces h = 0; its cube is not zero


class Stiffness(NamedTuple):
    """Stiffnesses of B(12), for a strip as wide as the film."""

    A_1: float  # N, extension
    A_2: float  # N m, coupling
    A_3: float  # N m2, bending


@dataclass(frozen=True, kw_only=True)
class Laminate:
    """
    Strip of tread with the film on its inner side.

    The paper gives no material constants. Those of the film are the assumed ones of the buckling
    film; those of the tread are typical of a soft rubber tire. Raises ParameterError unless all
    fields are single positive numbers.

    >>> print(f'{Laminate().alpha():.1f} 1/m')
    64.5 1/m
    """

    width: float = 0.003            # m, b, Table I
    film_thickness: float = 28e-6   # m, t_S, the thinner film of paper A: assumed
    tread_thickness: float = 0.005  # m, t_T, assumed
    film_modulus: float = 3e9       # Pa, c_211, assumed
    tread_modulus: float = 5e6      # Pa, c_111, assumed
    d31: float = 23e-12             # C/N, assumed
    radius: float = 0.087           # m, r of the wheel, Table I

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if validation.positive(field.name, value).ndim:
                raise ParameterError(f'{field.name} is {value}, expected one number')

    @property
    def neutral_axis(self) -> float:
        """Distance [m] of the neutral axis from the center of the tread."""
        A_1, A_2, _ = self.stiffness()
        return A_2 / A_1

    def stiffness(self, convention: str = 'exact') -> Stiffness:
        """Return A_1, A_2, A_3 of B(12) in one of ``CONVENTIONS``."""
        validation.one_of('convention', convention, CONVENTIONS)
        b, t_T, t_S = self.width, self.tread_thickness, self.film_thickness
        tread, film = self.tread_modulus * t_T, self.film_modulus * t_S
        A_1, A_2 = b * (tread + film), 0.5 * b * film * t_T
        A_3 = b * (tread + 3.0 * film) * t_T**2 / 12.0
        if convention == 'printed':
            return Stiffness(A_1, A_2, A_3)
        A_2 += 0.5 * b * film * t_S
        A_3 += b * film * t_S * (3.0 * t_T + 2.0 * t_S) / 6.0
        if convention == 'exact':
            return Stiffness(A_1, A_2, A_3)
        return Stiffness(A_1, 0.0, A_3 - A_2**2 / A_1)

    def lever(self, convention: str = 'exact') -> float:
        """Return the distance [m] of the film from the axis; B(15) has t_T, twice of it."""
        validation.one_of('convention', convention, CONVENTIONS)
        if convention == 'printed':
            return self.tread_thickness
        center = 0.5 * (self.tread_thickness + self.film_thickness)
        return center - (self.neutral_axis if convention == 'neutral' else 0.0)

    def alpha(self, convention: str = 'exact') -> float:
        """Return alpha [1/m] of B(14)."""
        _, A_2, A_3 = self.stiffness(convention)
        return float(np.sqrt(A_2 / (self.radius * A_3)))


class BendingShape(NamedTuple):
    """Normalized bending charge n(u) = q_b(u) / q_b(l) and its derivatives; shape of ``u``."""

    value: Array           # -, 0 to 1
    by_flat_length: Array  # per m of u
    by_alpha: Array        # per 1/m of alpha


def bending_shape(flat_length: Array, film_length: float, alpha: float) -> BendingShape:
    """
    Return the normalized charge of B(15) and its derivatives; that by u is B(16).

    ``flat_length`` u [m] is the flattened length of a film of length ``film_length`` [m], clipped
    to [0, l]; ``alpha`` > 0 [1/m] is that of B(14).

    >>> print(bending_shape(np.array([0.005, 0.010, 0.020]), 0.020, 67.0).value.round(3))
    [0.018 0.141 1.   ]
    """
    u = np.minimum(np.maximum(flat_length, 0.0), film_length)
    h = 0.5 * alpha * film_length
    small = h < MAX_LAG_SERIES_H
    lag, growth = _charge_terms(0.5 * alpha * u, small)
    full_lag, full_growth = (float(term) for term in _charge_terms(h, small))
    scale, shape = 0.5 / full_lag, lag / full_lag
    by_alpha = scale * (u * growth - (film_length * full_growth) * shape)
    return BendingShape(shape, (scale * alpha) * growth * (u == flat_length), by_alpha)


def charge(flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
           convention: str = 'exact') -> Array:
    """
    Return the charge q_b(l_x) [C] of B(15).

    It is ``b d31 c_211 lever (w'(0) - w'(l_x))``, which is ``d31 p_0 r / t_S (l_x - 2 / alpha
    tanh(alpha l_x / 2))``; twice of it is printed. ``flat_length`` is l_x [m], ``line_load`` p_0
    [N/m], which is F_z / L. Raises ParameterError for a negative length, values that are not
    finite, shapes that do not broadcast and an unknown convention.

    >>> print(f'{charge(0.020, 580.0, Laminate()) * 1e9:.0f} nC')
    99 nC
    """
    length, h, sensitivity = _electrode(flat_length, line_load, laminate, convention)
    h = np.maximum(h, MIN_H)
    q: Array = sensitivity * length**3 / 4.0 * (
        _charge_terms(h, h < MAX_LAG_SERIES_H)[0] / h**3)
    return q


def charge_slope(flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
                 convention: str = 'exact') -> Array:
    """
    Return q_b'(l_x) [C/m] of B(16). Arguments and errors as for ``charge``.

    It is never negative: the charge is largest where the whole film is flat.

    >>> print(f'{charge_slope(0.020, 580.0, Laminate()) * 1e6:.1f} nC/mm')
    13.4 nC/mm
    """
    length, h, sensitivity = _electrode(flat_length, line_load, laminate, convention)
    h = np.maximum(h, MIN_H)
    growth: Array = sensitivity * length**2 / 4.0 * (_charge_terms(h, False)[1] / h**2)
    return growth


def _charge_terms(h: Array | float, small: npt.NDArray[np.bool_] | bool) -> tuple[Array, Array]:
    """
    Return ``h - tanh(h)`` of B(15) and its derivative ``tanh(h)^2`` of B(16).

    Where ``small`` the difference is summed from its series, which loses no digits.
    """
    tanh = np.tanh(h)
    lag = h - tanh
    if small is not False:
        square = h * h
        lag = np.where(small, h * square * np.polyval(LAG_SERIES, square), lag)
    return lag, tanh * tanh


def deflection(x: ArrayLike, flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
               convention: str = 'exact') -> Array:
    """
    Return the deflection w(x) [m] of B(14), symmetric about the center of the flattened length.

    ``x`` [m] lies in [0, l_x], ``flat_length`` is l_x [m], ``line_load`` p_0 [N/m], which is
    F_z / L; w is positive along the load. Raises ParameterError for a position outside, a negative
    length, values that are not finite, shapes that do not broadcast and an unknown convention.

    >>> print(f'{deflection(0.005, 0.020, 580.0, Laminate()) * 1e6:.1f} um')
    421.4 um
    """
    xi, length, h, unit = _beam(x, flat_length, line_load, laminate, convention)
    shape = _where_small(h, lambda h: _arch_small(xi, h), lambda h: _arch_large(xi, h))
    w: Array = unit * length**4 / 16.0 * shape
    return w


def slope(x: ArrayLike, flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
          convention: str = 'exact') -> Array:
    """
    Return the slope w'(x) [-] of B(14), largest in magnitude at both ends.

    Arguments and errors as for ``deflection``.

    >>> print(f'{slope(0.0, 0.020, 580.0, Laminate()):.4f}')
    0.0948
    """
    xi, length, h, unit = _beam(x, flat_length, line_load, laminate, convention)
    eta = 2.0 * xi - 1.0
    shape = _where_small(h, lambda h: _slope_small(eta, h), lambda h: _slope_large(eta, h))
    tangent: Array = unit * length**3 / 8.0 * shape
    return tangent


def largest_deflection(flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
                       convention: str = 'exact') -> Array:
    """
    Return the deflection w(l_x / 2) [m] of B(14) at the center, where it is largest.

    For a stiff tread it is ``5 p_0 l_x^4 / (384 A_3)``. Arguments and errors as for
    ``deflection``.

    >>> print(f'{largest_deflection(0.020, 580.0, Laminate()) * 1e6:.1f} um')
    590.8 um
    """
    length = validation.not_negative('flat_length', flat_length)
    return deflection(0.5 * length, length, line_load, laminate, convention)


def _beam(x: ArrayLike, flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
          convention: str) -> tuple[Array, Array, Array, Array]:
    """Return xi, l_x, h and p_0 / A_3."""
    length = validation.not_negative('flat_length', flat_length)
    load = validation.finite('line_load', line_load)
    x = validation.within('x', x, 0.0, length, 'expected within the flattened length')
    validation.fitting(x=x, flat_length=length, line_load=load)
    xi = x / np.where(length > 0.0, length, 1.0)
    h = 0.5 * laminate.alpha(convention) * length
    return xi, length, h, load / laminate.stiffness(convention).A_3


def _electrode(flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
               convention: str) -> tuple[Array, Array, Array]:
    """Return l_x, h and b d31 c_211 lever p_0 / A_3."""
    length = validation.not_negative('flat_length', flat_length)
    load = validation.finite('line_load', line_load)
    validation.fitting(flat_length=length, line_load=load)
    sensitivity = (laminate.width * laminate.d31 * laminate.film_modulus
                   * laminate.lever(convention) / laminate.stiffness(convention).A_3)
    return length, 0.5 * laminate.alpha(convention) * length, sensitivity * load


def _where_small(h: Array, small: Callable[[Array], Array],
                 large: Callable[[Array], Array]) -> Array:
    return np.where(h < MAX_SERIES_H, small(np.minimum(h, MAX_SERIES_H)),
                    large(np.maximum(h, MAX_SERIES_H)))


def _arch_small(xi: Array, h: Array) -> Array:
    """Return (cosh(h eta) / cosh(h) - 1 + (h^2 - (h eta)^2) / 2) / h^4 for eta = 2 xi - 1."""
    behind = 1.0 - xi
    left, right = xi**2 * _sinh_excess(xi * h), behind**2 * _sinh_excess(behind * h)
    return 2.0 * xi * behind * (_cosh_excess(h) - left - right - h**2 * left * right) / np.cosh(h)


def _arch_large(xi: Array, h: Array) -> Array:
    behind = 1.0 - xi
    decayed = np.expm1(-2.0 * xi * h) * np.expm1(-2.0 * behind * h) / (1.0 + np.exp(-2.0 * h))
    arch: Array = (2.0 * xi * behind - decayed / h**2) / h**2
    return arch


def _slope_small(eta: Array, h: Array) -> Array:
    """Return (sinh(h eta) / cosh(h) - h eta) / h^3."""
    return eta * (eta**2 * _sinh_excess(eta * h) - _cosh_excess(h)) / np.cosh(h)


def _slope_large(eta: Array, h: Array) -> Array:
    decayed = (np.exp(h * (eta - 1.0)) - np.exp(-h * (eta + 1.0))) / (1.0 + np.exp(-2.0 * h))
    tangent: Array = (decayed / h - eta) / h**2
    return tangent


def _sinh_excess(z: Array) -> Array:
    """Return (sinh(z) / z - 1) / z^2 for |z| up to 1, where the series is exact to rounding."""
    return np.asarray(np.polyval(SINH_SERIES, z * z))


def _cosh_excess(h: Array) -> Array:
    """Return (cosh(h) - 1) / h^2."""
    half = 0.5 * h
    return 0.5 * (1.0 + half**2 * _sinh_excess(half))**2
