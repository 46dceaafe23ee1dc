"""
Bending of tread and film where the contact flattens them: B(9) to B(16).

With B(10)'s ``eps_0 = 0`` the second row of B(11) is ``A_3 (w'''' - alpha^2 w'') = p_0`` with
``alpha^2 = A_2 / (r A_3)``; with B(13) a beam on two supports over the flattened length ``l_x``.
Everything is written in ``xi = x / l_x`` and ``h = alpha l_x / 2`` so that no digits are lost
where h is small, down to the plain beam at h = 0. Arguments broadcast against each other.

Three conventions: ``exact`` counts the film's own thickness and its true distance from the axis;
``printed`` is B(12), B(15): it drops t_S from A_2 and A_3 and puts the film t_T, not t_T / 2, from
the axis, so its charge is twice the exact one. Both put the axis of no strain at the middle of
the tread, as the paper does because the film is thin; but the film is stiff, and ``neutral`` takes
the axis where no force arises: there A_2 and with it alpha are zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models import validation

CONVENTIONS = ('exact', 'printed', 'neutral')
SMALL = 1.0  # h up to which the forms without cancellation are used, above those that stay finite
ORDERS = np.arange(3, 17, 2)
# (sinh(z) / z - 1) / z^2 in powers of z^2, highest first: ..., 1 / 5!, 1 / 3!
SINH_SERIES = (1.0 / np.cumprod(np.concatenate([[6.0], (ORDERS + 1.0) * (ORDERS + 2.0)])))[::-1]
# (z - tanh(z)) / z^3 in powers of z^2, highest first
LAG_SERIES = (-21844.0 / 6081075.0, 1382.0 / 155925.0, -62.0 / 2835.0, 17.0 / 315.0, -2.0 / 15.0,
              1.0 / 3.0)
LAG_SERIES_BELOW = 0.1


class Stiffness(NamedTuple):
    """Constants of B(12), of a strip as wide as the film."""

    A_1: float  # N, stretching
    A_2: float  # N m, coupling
    A_3: float  # N m2, bending


@dataclass(frozen=True, kw_only=True)
class Laminate:
    """
    A strip of tread with the film on its inner side.

    The film's constants are the same assumed ones as of the buckling film; the paper gives
    neither them nor the tread's, which are those of a soft rubber tire.
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
        """Return how far [m] above the middle of the tread bending strains nothing."""
        A_1, A_2, _ = self.stiffness()
        return A_2 / A_1

    def stiffness(self, convention: str = 'exact') -> Stiffness:
        """Return A_1, A_2, A_3 of B(12)."""
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
        """Return the film's distance [m] from the axis: B(15) has t_T, the film is half as far."""
        validation.one_of('convention', convention, CONVENTIONS)
        if convention == 'printed':
            return self.tread_thickness
        middle = 0.5 * (self.tread_thickness + self.film_thickness)
        return middle - (self.neutral_axis if convention == 'neutral' else 0.0)

    def alpha(self, convention: str = 'exact') -> float:
        """Return alpha [1/m] of B(14)."""
        _, A_2, A_3 = self.stiffness(convention)
        return float(np.sqrt(A_2 / (self.radius * A_3)))


def deflection(x: ArrayLike, flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
               convention: str = 'exact') -> Array:
    """
    Return w(x) [m] of B(14), symmetric, largest in the middle.

    ``x`` [m] lies in the flattened length l_x; ``line_load`` is p_0 [N/m] (F_z / L).
    """
    xi, length, half, unit = _beam(x, flat_length, line_load, laminate, convention)
    shape = _where_small(half, lambda h: _arch_small(xi, h), lambda h: _arch_large(xi, h))
    w: Array = unit * length**4 / 16.0 * shape
    return w


def slope(x: ArrayLike, flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
          convention: str = 'exact') -> Array:
    """Return w'(x) of B(14), steepest at both ends; arguments as ``deflection``."""
    xi, length, half, unit = _beam(x, flat_length, line_load, laminate, convention)
    place = 2.0 * xi - 1.0
    shape = _where_small(half, lambda h: _slope_small(place, h), lambda h: _slope_large(place, h))
    tangent: Array = unit * length**3 / 8.0 * shape
    return tangent


def largest_deflection(flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
                       convention: str = 'exact') -> Array:
    """Return w(l_x / 2) [m], ``5 p_0 l_x^4 / (384 A_3)`` for a stiff tread."""
    length = validation.not_negative('flat_length', flat_length)
    return deflection(0.5 * length, length, line_load, laminate, convention)


def charge(flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
           convention: str = 'exact') -> Array:
    """
    Return q_b(l_x) [C] of B(15).

    It is ``b d31 c_211 lever (w'(0) - w'(l_x))``, which is ``d31 p_0 r / t_S (l_x - 2 / alpha
    tanh(alpha l_x / 2))``; printed twice of it. ``tread_film.bending_shape`` is its shape.
    """
    length, half, sensitivity = _electrode(flat_length, line_load, laminate, convention)
    q: Array = sensitivity * length**3 / 4.0 * _lag(half)
    return q


def charge_slope(flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
                 convention: str = 'exact') -> Array:
    """Return q_b'(l_x) [C/m] of B(16), never negative: a film all flat shows the most."""
    length, half, sensitivity = _electrode(flat_length, line_load, laminate, convention)
    safe = np.where(half > 0.0, half, 1.0)
    share = np.where(half > 0.0, np.tanh(safe) / safe, 1.0)
    growth: Array = sensitivity * length**2 / 4.0 * share**2
    return growth


def _beam(x: ArrayLike, flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
          convention: str) -> tuple[Array, Array, Array, Array]:
    """Return xi, l_x, h and p_0 / A_3."""
    length = validation.not_negative('flat_length', flat_length)
    load = validation.finite('line_load', line_load)
    x = validation.within('x', x, 0.0, length, 'expected within the flattened length')
    validation.fitting(x=x, flat_length=length, line_load=load)
    xi = x / np.where(length > 0.0, length, 1.0)
    half = 0.5 * laminate.alpha(convention) * length
    return xi, length, half, load / laminate.stiffness(convention).A_3


def _electrode(flat_length: ArrayLike, line_load: ArrayLike, laminate: Laminate,
               convention: str) -> tuple[Array, Array, Array]:
    """Return l_x, h and b d31 c_211 lever p_0 / A_3."""
    length = validation.not_negative('flat_length', flat_length)
    load = validation.finite('line_load', line_load)
    validation.fitting(flat_length=length, line_load=load)
    sensitivity = (laminate.width * laminate.d31 * laminate.film_modulus
                   * laminate.lever(convention) / laminate.stiffness(convention).A_3)
    return length, 0.5 * laminate.alpha(convention) * length, sensitivity * load


def _where_small(half: Array, small: Callable[[Array], Array],
                 large: Callable[[Array], Array]) -> Array:
    return np.where(half < SMALL, small(np.minimum(half, SMALL)), large(np.maximum(half, SMALL)))


def _arch_small(xi: Array, h: Array) -> Array:
    """Return (cosh(eta) / cosh(h) - 1 + (h^2 - eta^2) / 2) / h^4, with eta = h (2 xi - 1)."""
    rest = 1.0 - xi
    left, right = xi**2 * _sinh_excess(xi * h), rest**2 * _sinh_excess(rest * h)
    return 2.0 * xi * rest * (_cosh_excess(h) - left - right - h**2 * left * right) / np.cosh(h)


def _arch_large(xi: Array, h: Array) -> Array:
    rest = 1.0 - xi
    decayed = np.expm1(-2.0 * xi * h) * np.expm1(-2.0 * rest * h) / (1.0 + np.exp(-2.0 * h))
    arch: Array = (2.0 * xi * rest - decayed / h**2) / h**2
    return arch


def _slope_small(place: Array, h: Array) -> Array:
    """Return (sinh(eta) / cosh(h) - eta) / h^3, with eta = h place."""
    return place * (place**2 * _sinh_excess(place * h) - _cosh_excess(h)) / np.cosh(h)


def _slope_large(place: Array, h: Array) -> Array:
    decayed = (np.exp(h * (place - 1.0)) - np.exp(-h * (place + 1.0))) / (1.0 + np.exp(-2.0 * h))
    tangent: Array = (decayed / h - place) / h**2
    return tangent


def _sinh_excess(z: Array) -> Array:
    """Return (sinh(z) / z - 1) / z^2 for |z| up to 1; the series has all digits there."""
    return np.asarray(np.polyval(SINH_SERIES, z * z))


def _cosh_excess(h: Array) -> Array:
    """Return (cosh(h) - 1) / h^2."""
    half = 0.5 * h
    return 0.5 * (1.0 + half**2 * _sinh_excess(half))**2


def _lag(h: Array) -> Array:
    """Return (h - tanh(h)) / h^3."""
    safe = np.maximum(h, LAG_SERIES_BELOW)
    return np.where(h < LAG_SERIES_BELOW, np.polyval(LAG_SERIES, h * h),
                    (safe - np.tanh(safe)) / safe**3)
