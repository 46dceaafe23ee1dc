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
Pressure, traction and strain of the tread in the contact patch: B(17) to B(21).

``zeta`` [m] runs from the leading edge of the patch, ``xi = zeta / L``. There are two methods:
``exact`` uses the magnitude of the slip vector for the extent of the sliding zone and directs the
traction along the slip (as ``brush_tire``), so it holds for braking and lateral slip. ``printed``
is the formula of the paper with the signed longitudinal slip, correct for driving straight only:
a negative slip has no sliding zone, or the wrong sign where the friction limit applies.

The paper calls two quantities stress: B(20) is the traction of the ground on the tread, whereas
the stress of the film is ``c11`` times its strain. The "strain" of B(21) is a displacement over L,
not a gradient; its transfer to the film is a fitted gain. ``displacement_gradient`` is the
gradient.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array, ArrayLike
from smart_tire.models import validation
from smart_tire.models.tire import brush_tire

METHODS = ('exact', 'printed')
MIN_NORMALIZED_SLIP = 1e-300  # -, replaces zero, whose inverse is not a number


class Displacement(NamedTuple):
    """Displacement of the tread over L per unit slip, and its integral; arrays of one shape."""

    value: Array     # -
    integral: Array  # -, antiderivative over xi, up to a constant that depends on t only
    slid: Array      # -, its part in the sliding zone; the derivative by t is -slid / t


def displacement(xi: Array, normalized_slip: Array | float) -> Displacement:
    """
    Return the displacement of B(21) over L per unit slip, and its integral over xi, B(23).

    ``min(xi, xi (1 - xi) / t)``: B(17) in the adhesion zone, the friction limit behind it. ``xi``
    [-] lies in [0, 1]; ``normalized_slip`` t > 0 is a number or broadcasts to its shape.

    >>> part = displacement(np.array([0.5, 0.9]), 0.2)
    >>> print(part.value, f'{np.diff(part.integral)[0]:.4f}')
    [0.5  0.45] 0.2583
    """
    inverse, behind = 1.0 / normalized_slip, 1.0 - xi
    sticking = np.minimum(xi, np.maximum(1.0 - normalized_slip, 0.0))  # up to xi_a of B(22)
    # behind it the integral of r (1 - r) / t over r = 1 - xi
    sliding = np.minimum(behind, normalized_slip)
    slid = sliding * sliding * (sliding * (1.0 / 3.0) - 0.5) * inverse
    return Displacement(np.minimum(xi, xi * behind * inverse), 0.5 * sticking * sticking + slid,
                        slid)


def pressure(zeta: ArrayLike, load: ArrayLike, contact_length: ArrayLike,
             contact_width: ArrayLike) -> Array:
    """
    Return the contact pressure p [Pa] at ``zeta`` [m]; zero outside the patch.

    A parabola of maximum P_m = 1.5 F_z / (B L), which the paper calls "per unit length"; its
    integral over length and width is the load F_z [N]. Raises ParameterError for lengths [m] that
    are not positive, a negative load, NaN, and shapes that do not broadcast.

    >>> print(f'{pressure(0.023, 26.7, 0.046, 0.089):.0f} Pa')
    9783 Pa
    """
    length = validation.positive('contact_length', contact_length)
    width = validation.positive('contact_width', contact_width)
    load = validation.not_negative('load', load)
    zeta = validation.finite('zeta', zeta)
    validation.fitting(zeta=zeta, load=load, contact_length=length, contact_width=width)
    peak = 1.5 * load / (width * length)
    inside: Array = 4.0 * peak * _parabola(zeta / length)
    return inside


def tread_stiffness(stiffness: ArrayLike, contact_length: ArrayLike,
                    contact_width: ArrayLike) -> Array:
    """
    Return k_x [N/m3] of B(19), traction per displacement, from C_x [N].

    Raises ParameterError unless all arguments are positive and broadcast; lengths are in m.

    >>> print(f'{tread_stiffness(52.7, 0.046, 0.089) * 1e-3:.0f} Pa/mm')
    560 Pa/mm
    """
    length = validation.positive('contact_length', contact_length)
    width = validation.positive('contact_width', contact_width)
    stiffness = validation.positive('stiffness', stiffness)
    validation.fitting(stiffness=stiffness, contact_length=length, contact_width=width)
    k_x: Array = 2.0 * stiffness / (width * length**2)
    return k_x


def traction(zeta: ArrayLike, s_x: ArrayLike, s_y: ArrayLike, mu: ArrayLike, load: ArrayLike,
             stiffness: ArrayLike, contact_length: ArrayLike, contact_width: ArrayLike, *,
             method: str = 'exact') -> tuple[Array, Array]:
    """
    Return x and y of the traction [Pa] of the ground on the tread at ``zeta`` [m], B(20).

    Positive along the slip vector (``s_x``, ``s_y``) [-]; its integral over the patch is
    ``brush_tire.brush_force``. ``load`` and ``stiffness`` are in N. The method ``printed`` ignores
    ``s_y``. Raises ParameterError for arguments out of range, NaN and an unknown method.

    >>> along, across = traction(0.02, 0.1, -0.05, 0.47, 26.7, 52.7, 0.046, 0.089)
    >>> print(f'{along:.0f} {across:.0f} Pa')
    1119 -560 Pa
    """
    k_x = tread_stiffness(stiffness, contact_length, contact_width)
    grip = pressure(zeta, load, contact_length, contact_width)
    limit = brush_tire.critical_slip(validation.not_negative('mu', mu), load, stiffness)
    s_x, s_y = validation.finite('s_x', s_x), validation.finite('s_y', s_y)
    validation.fitting(zeta=zeta, s_x=s_x, s_y=s_y, mu=mu, load=load, stiffness=stiffness,
                       contact_length=contact_length, contact_width=contact_width)
    scale = k_x * np.asarray(contact_length, dtype=float)
    xi = np.asarray(zeta, dtype=float) / np.asarray(contact_length)
    if validation.one_of('method', method, METHODS) == 'printed':
        along = scale * strain(xi, s_x, s_x, limit, method='printed')
        return along, np.zeros_like(along)
    total = np.hypot(s_x, s_y)
    return (scale * strain(xi, s_x, total, limit) + 0.0 * grip,
            scale * strain(xi, s_y, total, limit) + 0.0 * grip)


def strain(xi: ArrayLike, slip: ArrayLike, total_slip: ArrayLike, critical_slip: ArrayLike, *,
           method: str = 'exact') -> Array:
    """
    Return the "strain" of B(21): longitudinal displacement over L [-]; zero outside [0, 1].

    ``slip`` is the slip ratio of B(3), ``total_slip`` the magnitude of the slip vector, taken as
    at least ``|slip|``. ``critical_slip`` is ``4 P_m mu / (k_x L)``, infinite where nothing
    slides. Raises ParameterError for a negative limit, values that are not finite, shapes that
    do not broadcast and an unknown method.

    >>> print(strain([0.5, 0.95], 0.1, 0.13, 0.65))
    [0.05    0.02375]
    """
    xi, slip, total, limit = _arguments(xi, slip, total_slip, critical_slip)
    inside = (xi >= 0.0) & (xi <= 1.0)
    if validation.one_of('method', method, METHODS) == 'printed':
        return np.where(inside, _printed_strain(xi, slip, limit), 0.0)
    t = brush_tire.normalized_slip(total, limit)
    xi = np.clip(xi, 0.0, 1.0)
    per_slip = np.where(
        t > 0.0, displacement(xi, np.maximum(t, MIN_NORMALIZED_SLIP)).value, xi)
    return np.where(inside, slip * per_slip, 0.0)


def displacement_gradient(xi: ArrayLike, slip: ArrayLike, total_slip: ArrayLike,
                          critical_slip: ArrayLike) -> Array:
    """
    Return the strain in the proper sense, d delta / d zeta [-] of B(21); zero outside [0, 1].

    Its integral over the patch is zero: if the film responded to it, a film longer than the
    patch would show no slip. Arguments and errors as for ``strain``.

    >>> print(displacement_gradient([0.5, 0.95], 0.1, 0.13, 0.65))
    [ 0.1  -0.45]
    """
    xi, slip, total, limit = _arguments(xi, slip, total_slip, critical_slip)
    t = np.maximum(brush_tire.normalized_slip(total, limit), MIN_NORMALIZED_SLIP)
    sticks = (xi < 1.0 - t) | np.isinf(limit)
    gradient = slip * np.where(sticks, 1.0, (1.0 - 2.0 * xi) / t)
    return np.where((xi >= 0.0) & (xi <= 1.0), gradient, 0.0)


def _arguments(xi: ArrayLike, slip: ArrayLike, total_slip: ArrayLike, critical_slip: ArrayLike
               ) -> tuple[Array, Array, Array, Array]:
    xi, slip = validation.finite('xi', xi), validation.finite('slip', slip)
    total = np.abs(validation.finite('total_slip', total_slip))
    limit = validation.not_negative('critical_slip', critical_slip, infinite=True)
    validation.fitting(xi=xi, slip=slip, total_slip=total, critical_slip=limit)
    return xi, slip, np.maximum(total, np.abs(slip)), limit


def _printed_strain(xi: Array, slip: Array, limit: Array) -> Array:
    """Return B(21) as printed: xi_a = 1 - lambda / lambda_cr exceeds 1 for a negative slip."""
    with np.errstate(divide='ignore', over='ignore', invalid='ignore'):
        adhesion = np.where(slip == 0.0, 1.0, 1.0 - slip / limit)
    unlimited = np.isinf(limit)
    return np.where((xi < adhesion) | unlimited, slip * xi,
                    np.where(unlimited, 0.0, limit) * _parabola(xi))


def _parabola(xi: Array) -> Array:
    """Return xi (1 - xi) inside the patch, 0 outside."""
    return np.maximum(xi * (1.0 - xi), 0.0)
