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
Output of a film in the tread during one patch crossing: B(15), Fig. 8.

``x`` [m] is the travel of the film's trailing edge past the leading edge of the patch: the film
covers ``[x, x + film_length]``, the patch ``[0, contact_length]``, in the direction of motion. The
output above rest is ``bending_peak * bending + stretch_gain * slip * overlap - height * bumps``,
with ``overlap`` from ``strain_charge``. Everything is exact and in closed form; derivatives are in
``film_equations``.

There is no theory of recovery and bumps: their lengths are shares of the film length that fit
Fig. 11(b), and the shape of the bumps is a spline that must be learned.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.models import validation
from smart_tire.models.tire import film_equations
from smart_tire.models.tire.strain_charge import overlap_integral

# Weights of the two parts of the release: an opposite charge -n(u) for the flattened length u that
# has left, and the loss n(l - u) - 1 of the charge
RELEASE_WEIGHTS = {'fig8': (2.0, 0.0), 'state': (0.0, 1.0)}
RELEASES = tuple(RELEASE_WEIGHTS)
RECOVERY = 0.25          # film lengths of travel in which the fig8 release decays by e


def crossing_voltage(x: ArrayLike, *, slip: ArrayLike, total_slip: ArrayLike,
                     critical_slip: ArrayLike, film_length: float, contact_length: float,
                     bending_peak: ArrayLike, bending_alpha: float, stretch_gain: ArrayLike,
                     release: str = 'fig8', recovery: float | None = None,
                     reverse: npt.ArrayLike = False) -> Array:
    """
    Return the output of the amplifier above rest [V] at the positions ``x`` [m], without bumps.

    ``slip`` is the slip ratio of B(3), positive when driving, in both directions; ``total_slip``
    and ``critical_slip`` are magnitudes. ``bending_peak`` [V] is q_bm, ``stretch_gain`` [V/m] the
    output per overlap integral of B(23). ``release`` is ``fig8`` (an opposite peak that decays by
    e in ``recovery`` [m] of travel, by default ``RECOVERY``) or ``state`` (zero at release);
    ParameterError otherwise. In ``reverse`` the film enters at the other edge:
    ``x -> L - l - x``. Arguments broadcast.

    >>> volts = crossing_voltage(
    ...     [0.0, 0.02, 0.046], slip=0.1, total_slip=0.13, critical_slip=0.7143,
    ...     film_length=0.020, contact_length=0.046, bending_peak=0.83, bending_alpha=67.0,
    ...     stretch_gain=307.5)
    >>> print(volts.round(3))
    [ 0.964  1.222 -0.83 ]
    """
    x = np.asarray(x, dtype=float)
    x = np.where(reverse, contact_length - film_length - x, x)
    strained = np.asarray(stretch_gain) * overlap_integral(
        x, slip, total_slip, critical_slip, film_length, contact_length)
    bent = bending(x, film_length, contact_length, bending_alpha, release, recovery)
    volts: Array = np.asarray(bending_peak) * bent + strained
    return volts


def bending(x: Array, film_length: float, contact_length: float, alpha: float,
            release: str | tuple[float, float] = 'fig8', recovery: Array | float | None = None
            ) -> Array:
    """
    Return the bending part at the positions ``x`` (n,) [m], for a bending peak of 1, B(15).

    Where the contact flattens tread and film they are a beam under tension on two supports:
    ``d4w/dx4 - alpha^2 d2w/dx2 = p_0 / A_3``, B(11) to B(14). The charge is proportional to the
    difference of the slopes of w at both ends, hence to ``h - tanh(h)`` with ``h = alpha u / 2``
    for the flattened length u. Its size depends on unknown constants of the tread and is a fitted
    number.

    ``alpha`` [1/m] is that of B(14). ``release`` is one of ``RELEASES`` or two weights, of which
    ``RELEASE_WEIGHTS`` are examples; an output other than 0 at the end of the contact decays by e
    in ``recovery`` [m], a number or (n,), by default ``RECOVERY``. Raises ParameterError for an
    unknown release.

    >>> print(bending(np.array([-0.01, 0.01, 0.046]), 0.020, 0.046, 67.0).round(3))
    [ 0.141  1.    -1.   ]
    """
    if isinstance(release, str):
        release = RELEASE_WEIGHTS[validation.one_of('release', release, RELEASES)]
    recovery = RECOVERY * film_length if recovery is None else recovery
    return np.asarray(film_equations.over_arrays(
        film_equations.bending, 7, x, film_length, contact_length, alpha, *release, recovery)[0])


def bumps(x: Array, film_length: float, contact_length: float
          ) -> tuple[Array, npt.NDArray[np.bool_]]:
    """
    Return the bumps of Fig. 11(b) at the positions ``x`` (n,) [m], for a height of 1.

    Second: which positions are nearer to the bump after the contact.

    A compliant tread bends the other way just outside the patch. There is no theory of the bumps:
    each is one raised cosine that vanishes while any part of the film is in the patch. The bump
    after the contact moves with its end, the one before does not.

    >>> print(bumps(np.array([-0.03, 0.0, 0.052]), 0.020, 0.046)[0].round(3))
    [1.    0.    0.587]
    """
    value, _, after = film_equations.over_arrays(
        film_equations.bump, 3, x, film_length, contact_length)
    return value, after > 0.0
