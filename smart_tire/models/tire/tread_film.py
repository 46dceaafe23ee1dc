"""
PVDF film in the tread: bending and stretching during a passage, B(15) to B(25) and Fig. 8.

``x`` [m] is the travel of the film's trailing edge past the patch's front edge: the film covers
``[x, x + length]``, the patch ``[0, contact_length]``. Everything is exact and in closed form;
what the paper prints instead is available by name. Arguments broadcast against each other.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike


RECOVERY = 0.005        # m, travel in which the fig8 release decays by e; seen in Fig. 11(b)
BUMP_DISTANCE = 0.01    # m, from the contact's begin or end to the middle of a bump; Fig. 11(b)
BUMP_HALF_WIDTH = 0.009  # m, below the distance: a bump ends before the contact begins
SERIES_BELOW = 0.02     # where z - tanh(z) loses more digits than its series is wrong


def bending_shape(u: ArrayLike, length: float, alpha: float) -> Array:
    """Return n(u) = q_b(u) / q_b(length) of B(15) for a flattened length ``u`` [m], 0 to 1."""
    flat = np.clip(np.asarray(u, dtype=float), 0.0, length)
    return _lag(0.5 * alpha * flat) / _lag(np.asarray(0.5 * alpha * length))


def _lag(z: Array) -> Array:
    series = z**3 * (1.0 / 3.0 - z**2 * (2.0 / 15.0 - z**2 * 17.0 / 315.0))
    return np.where(z < SERIES_BELOW, series, z - np.tanh(z))


def peak_position(adhesion_length: ArrayLike, film_length: float, contact_length: float) -> Array:
    """
    Return x_m [m], where the stretch charge of a film is largest: the exact root of B(24).

    Below an adhesion length of ``(L - l) / 2`` the film lies in the sliding zone at its peak:
    x_m is ``(L - l) / 2`` and tells nothing more. The film must be shorter than the patch.
    """
    _check_shorter(film_length, contact_length)
    plateau = 0.5 * (contact_length - film_length)
    stuck = np.asarray(adhesion_length, dtype=float)
    root = np.sqrt(stuck**2 + 4.0 * film_length * (contact_length - stuck))
    return np.where(stuck <= plateau, plateau, 0.5 * (stuck + root) - film_length)


def adhesion_length(x_m: ArrayLike, film_length: float, contact_length: float,
                    method: str = 'exact') -> Array:
    """
    Return the adhesion length L_a [m] from the position x_m = L - r w dt_a of the peak.

    ``exact`` inverts ``peak_position``; NaN up to its plateau at ``(L - l) / 2``. Above
    ``L - l``, which only errors of x_m reach, it goes on above L: clipping would bias a mean.
    ``printed`` is the paper's ``L_a = x_m + l``, far too short where much of the patch slides.
    """
    _check_shorter(film_length, contact_length)
    x = np.asarray(x_m, dtype=float)
    if method == 'printed':
        return x + film_length
    if method != 'exact':
        raise ValueError(f'method is {method!r}, expected exact or printed')
    tells = x > 0.5 * (contact_length - film_length)
    safe = np.where(tells, x, np.nan)
    return ((safe + film_length)**2 - film_length * contact_length) / safe


def _check_shorter(film_length: float, contact_length: float) -> None:
    if not 0.0 < film_length < contact_length:
        raise ValueError(f'film of {film_length} m has no peak in a patch of {contact_length} m')


def stretch_integral(x: ArrayLike, slip: ArrayLike, total_slip: ArrayLike,
                     critical_slip: ArrayLike, film_length: float,
                     contact_length: float) -> Array:
    """
    Return the integral [m] of displacement / L over the part of the film in the patch.

    The displacement of the tread along the slip grows as ``|s| zeta`` in the adhesion zone and is
    ``lambda_cr zeta (1 - zeta / L)`` in the sliding zone, B(21); the film feels its longitudinal
    part, whose sign and share is ``slip / total_slip``: B(3)'s lambda over the magnitude, which
    is taken as at least ``|slip|``.
    """
    x = np.asarray(x, dtype=float)
    slip = np.asarray(slip, dtype=float)
    magnitude = np.maximum(np.abs(np.asarray(total_slip, dtype=float)), np.abs(slip))
    limit = np.asarray(critical_slip, dtype=float)
    begin = np.clip(x / contact_length, 0.0, 1.0)
    end = np.clip((x + film_length) / contact_length, 0.0, 1.0)
    area = (_displacement_area(end, magnitude, limit)
            - _displacement_area(begin, magnitude, limit))
    with np.errstate(divide='ignore', invalid='ignore'):
        share = np.where(magnitude > 0.0, slip / magnitude, 0.0)
    return contact_length * share * area


def _displacement_area(xi: Array, magnitude: Array, limit: Array) -> Array:
    """Return the integral of min(magnitude z, limit z (1 - z)) over z from 0 to xi."""
    with np.errstate(divide='ignore', invalid='ignore'):
        xi_a = np.where(magnitude < limit, 1.0 - magnitude / limit, 0.0)
    stuck = np.minimum(xi, xi_a)
    slid = np.maximum(xi, xi_a)
    # an infinite limit (no sliding at all) has xi_a = 1 and an empty sliding zone
    sliding = np.where(slid > xi_a, limit, 0.0) * (
        0.5 * (slid**2 - xi_a**2) - (slid**3 - xi_a**3) / 3.0)
    area: Array = 0.5 * magnitude * stuck**2 + sliding
    return area


def passage(x: ArrayLike, *, slip: ArrayLike, total_slip: ArrayLike, critical_slip: ArrayLike,
            film_length: float, contact_length: float, bending_peak: ArrayLike,
            bending_alpha: float, stretch_gain: ArrayLike, release: str = 'fig8',
            recovery: float = RECOVERY, reverse: npt.ArrayLike = False) -> Array:
    """
    Return the amplifier's output above rest [V] at the positions ``x`` of a film.

    ``slip`` is B(3)'s lambda (positive when driving, in both directions), ``total_slip`` and
    ``critical_slip`` are magnitudes; ``bending_peak`` [V] is q_bm, ``stretch_gain`` [V/m] turns
    ``stretch_integral`` into volts. ``release`` is ``fig8`` (an opposite peak that recovers within
    ``recovery`` [m] of travel) or ``state`` (back to zero at release). In ``reverse`` the film
    enters at the other edge: ``x -> L - l - x``.
    """
    x = np.asarray(x, dtype=float)
    x = np.where(reverse, contact_length - film_length - x, x)
    stretch = np.asarray(stretch_gain) * stretch_integral(
        x, slip, total_slip, critical_slip, film_length, contact_length)
    bending = bending_passage(x, film_length, contact_length, bending_alpha, release, recovery)
    volts: Array = np.asarray(bending_peak) * bending + stretch
    return volts


def bending_passage(x: ArrayLike, film_length: float, contact_length: float, alpha: float,
                    release: str = 'fig8', recovery: float = RECOVERY) -> Array:
    """Return the bending part of a forward ``passage`` for a bending peak of 1."""
    x = np.asarray(x, dtype=float)
    entered = bending_shape(x + film_length, film_length, alpha)
    left = x + film_length - contact_length
    if release == 'state':
        return entered - 1.0 + bending_shape(film_length - left, film_length, alpha)
    if release != 'fig8':
        raise ValueError(f'release is {release!r}, expected fig8 or state')
    past = np.maximum(x - contact_length, 0.0)
    return (entered - 2.0 * bending_shape(left, film_length, alpha)
            + np.where(past > 0.0, -np.expm1(-past / recovery), 0.0))


def contact_bumps(x: ArrayLike, film_length: float, contact_length: float) -> Array:
    """
    Return the shape, 0 to 1, of the bumps of Fig. 11(b) before and after the contact.

    A compliant tread bends the other way just outside the patch. No theory gives them: each is
    one raised cosine that vanishes while any part of the film is in the patch.
    """
    x = np.asarray(x, dtype=float)
    middle = 0.5 * (contact_length - film_length)
    distance = np.abs(x - middle) - 0.5 * (contact_length + film_length) - BUMP_DISTANCE
    phase = np.clip(distance / BUMP_HALF_WIDTH, -1.0, 1.0)
    return 0.5 * (1.0 + np.cos(np.pi * phase))
