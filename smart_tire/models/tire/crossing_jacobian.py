"""
Parts of a film's passage, and the slopes of each: what a fit of the whole waveform needs.

The same model as ``tread_film.passage`` and ``tread_film.contact_bumps``, taken apart: the output
above rest is ``bending peak * bending + gain * slip * stretch - bump height * bump``.
A passage is seen in the direction of motion: in reverse ``x -> L - l - x`` has been done.
Everything is exact; slopes of clipped parts are those on the inner side of the clip.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array
from smart_tire.models.tire import tread_film


SERIES_BELOW = 0.02  # of alpha l / 2, where 1 - tanh(z) / z loses more than its series leaves out
LARGEST_PAST = 700.0  # lengths of recovery, whose exponential is still a number


@dataclass(frozen=True, slots=True)
class Part:
    """Values of one part at the places of the samples, and its slopes there; shape (n,) each."""

    value: Array
    by_place: Array   # per metre of x, the film's place
    by_length: Array  # per metre of L, the contact's length


@dataclass(frozen=True, slots=True)
class Bending(Part):
    """Bending of a peak of 1."""

    by_alpha: Array     # per 1/m of B(15)'s alpha
    by_recovery: Array  # per metre of travel in which the release dies away by e


@dataclass(frozen=True, slots=True)
class Stretch(Part):
    """Stretch integral [m] per unit of longitudinal slip."""

    by_sliding: Array  # per unit of total slip / critical slip


def bending(x: Array, film_length: float, contact_length: float, alpha: float,
            release: str = 'fig8', recovery: Array | float = tread_film.RECOVERY) -> Bending:
    """
    Return the bending part at the places ``x`` (n,) [m]: ``tread_film.bending_passage``.

    ``recovery`` [m] may differ from sample to sample; without meaning for the release ``state``.
    """
    flat = np.empty((2, len(x)))
    flat[0] = x + film_length
    left = flat[0] - contact_length
    if release == 'state':
        flat[1] = film_length - left
        shape, by_flat, by_alpha = _shape(flat, film_length, alpha)
        return Bending(shape[0] - 1.0 + shape[1], by_flat[0] - by_flat[1], by_flat[1],
                       by_alpha[0] + by_alpha[1], np.zeros_like(x))
    if release != 'fig8':
        raise ValueError(f'release is {release!r}, expected fig8 or state')
    flat[1] = left
    shape, by_flat, by_alpha = _shape(flat, film_length, alpha)
    past = (x - contact_length) / recovery
    gone = past > 0.0
    dying = gone * np.exp(-np.minimum(np.maximum(past, 0.0), LARGEST_PAST))
    by_end = 2.0 * by_flat[1] - dying / recovery
    return Bending(shape[0] - 2.0 * shape[1] + gone - dying, by_flat[0] - by_end, by_end,
                   by_alpha[0] - 2.0 * by_alpha[1], -past * dying / recovery)


def _shape(flat: Array, length: float, alpha: float) -> tuple[Array, Array, Array]:
    """Return n(u) of B(15) at the flattened lengths u, and its slopes by u and by alpha."""
    u = np.minimum(np.maximum(flat, 0.0), length)
    z, whole = 0.5 * alpha * u, 0.5 * alpha * length
    if whole < SERIES_BELOW:  # a stiff tread: n is a cube, but for digits
        shape = tread_film.bending_shape(u, length, alpha)
        rise, full, scale = z**2, whole**2, 1.5 / whole**3
    else:
        tanh = np.tanh(z)
        rise, full = tanh * tanh, math.tanh(whole)**2
        scale = 0.5 / (whole - math.tanh(whole))
        shape = (2.0 * scale) * (z - tanh)
    by_alpha = scale * (u * rise - (length * full) * shape)
    return shape, (scale * alpha) * rise * (u == flat), by_alpha


def stretch(x: Array, sliding: Array | float, film_length: float,
            contact_length: float) -> Stretch:
    """
    Return ``tread_film.stretch_integral`` [m] per unit slip at the places ``x`` (n,) [m].

    ``sliding`` > 0 is total slip / critical slip. From 1 on the whole patch slides and the
    integral per unit slip falls as its inverse: then the two show in their ratio only.
    """
    edges = np.empty((2, len(x)))
    np.divide(x, contact_length, out=edges[0])
    np.add(edges[0], film_length / contact_length, out=edges[1])
    xi = np.minimum(np.maximum(edges, 0.0), 1.0)
    inverse, left = 1.0 / sliding, 1.0 - xi
    # the displacement per slip is z where the tread sticks, z (1 - z) / w behind; its integrals
    # up to xi, each but for a constant that the two edges share
    slides, sticks = np.minimum(left, sliding), 1.0 - np.maximum(left, sliding)
    slid = slides * slides * (slides * (1.0 / 3.0) - 0.5) * inverse
    whole = 0.5 * sticks * sticks + slid
    displaced = np.minimum(xi, xi * left * inverse)  # 0 at both ends of the patch
    area = whole[1] - whole[0]
    moment = xi * displaced
    return Stretch(contact_length * area, displaced[1] - displaced[0],
                   area - moment[1] + moment[0], (-contact_length * inverse) * (slid[1] - slid[0]))


def bumps(x: Array, film_length: float,
          contact_length: float) -> tuple[Part, npt.NDArray[np.bool_]]:
    """
    Return the bumps of ``tread_film.contact_bumps``, of height 1, and which places are behind.

    The bump behind the contact moves with its end, the one before does not.
    """
    past = x - 0.5 * (contact_length - film_length)
    behind = past > 0.0
    edge = 0.5 * (contact_length + film_length) + tread_film.BUMP_DISTANCE
    scale = math.pi / tread_film.BUMP_HALF_WIDTH
    phase = np.minimum(np.maximum(scale * (np.abs(past) - edge), -math.pi), math.pi)
    slope = np.copysign(0.5 * scale, -past) * np.sin(phase)
    return Part(0.5 + 0.5 * np.cos(phase), slope, -slope * behind), behind
