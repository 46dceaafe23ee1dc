"""
What the contact does to the tread: pressure, traction and strain, B(17) to B(22).

``zeta`` [m] runs from the patch's front edge, ``xi = zeta / L``. Methods: ``exact`` takes the
slip's magnitude for the extent of the sliding zone and directs traction along the slip vector
(that of ``brush_tire``), so it holds for braking and sideways slip; ``printed`` is the formula to
the letter, with the longitudinal slip alone: right when driving straight on, but for a negative
slip it lets nothing slide, and it stretches what it should compress where all slides.

The paper calls two things stress: B(20) is the road's traction on the tread. The film's own stress
is ``c11`` times the strain, and that "strain" B(21) is a displacement over L, not a gradient; its
transfer to the film is a gain that has to be fitted. ``displacement_gradient`` is the gradient.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, ArrayLike
from smart_tire.models import validation
from smart_tire.models.tire import brush_tire

METHODS = ('exact', 'printed')


def pressure(zeta: ArrayLike, load: ArrayLike, contact_length: ArrayLike,
             contact_width: ArrayLike) -> Array:
    """
    Return the pressure p [Pa] at ``zeta``, a parabola of peak P_m = 1.5 F_z / (B L); 0 outside.

    The paper says "per unit length", but its P_m is a pressure: over length and width it carries
    the load.
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
    """Return k_x [N/m3] of B(19), traction per displacement, from C_x [N]."""
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
    Return the traction (x, y) [Pa] of the ground on the tread, B(20).

    Its integral over the patch is ``brush_tire.brush_force``. ``printed`` ignores ``s_y``.
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
    Return the longitudinal displacement over L of B(21) at ``xi``; 0 outside [0, 1].

    ``slip`` is B(3)'s lambda, ``total_slip`` the magnitude, at least ``|slip|``. ``critical_slip``
    is ``4 P_m mu / (k_x L)``: what limits the displacement where the tread slides; infinite
    without sliding.
    """
    xi, slip, total, limit = _arguments(xi, slip, total_slip, critical_slip)
    inside = (xi >= 0.0) & (xi <= 1.0)
    extent, sign = total, _share(slip, total)
    if validation.one_of('method', method, METHODS) == 'printed':
        extent, sign = slip, np.ones_like(slip)
    sliding = np.where(np.isinf(limit), 0.0, limit) * _parabola(xi)
    displacement = np.where(_sticks(xi, extent, limit), extent * xi, sliding)
    return np.where(inside, sign * displacement, 0.0)


def displacement_gradient(xi: ArrayLike, slip: ArrayLike, total_slip: ArrayLike,
                          critical_slip: ArrayLike) -> Array:
    """
    Return d delta / d zeta of B(21)'s displacement delta, what a strain is; 0 outside [0, 1].

    It adds up to zero over the patch: were it what the film feels, a film longer than the patch
    would feel no slip. Arguments as ``strain``.
    """
    xi, slip, total, limit = _arguments(xi, slip, total_slip, critical_slip)
    sliding = np.where(np.isinf(limit), 0.0, limit) * (1.0 - 2.0 * xi)
    gradient = np.where(_sticks(xi, total, limit), total, sliding)
    return np.where((xi >= 0.0) & (xi <= 1.0), _share(slip, total) * gradient, 0.0)


def _arguments(xi: ArrayLike, slip: ArrayLike, total_slip: ArrayLike, critical_slip: ArrayLike
               ) -> tuple[Array, Array, Array, Array]:
    xi, slip = validation.finite('xi', xi), validation.finite('slip', slip)
    total = np.abs(validation.finite('total_slip', total_slip))
    limit = validation.not_negative('critical_slip', critical_slip, infinite=True)
    validation.fitting(xi=xi, slip=slip, total_slip=total, critical_slip=limit)
    return xi, slip, np.maximum(total, np.abs(slip)), limit


def _sticks(xi: Array, slip: Array, limit: Array) -> npt.NDArray[np.bool_]:
    """
    Return whether the tread sticks: before xi_a = L_a / L of B(22), to the letter.

    Above 1 for a negative slip, below 0 when all slides; without a limit nothing slides.
    """
    with np.errstate(divide='ignore', over='ignore', invalid='ignore'):
        adhesion = np.where(slip == 0.0, 1.0, 1.0 - slip / limit)
    flags: npt.NDArray[np.bool_] = (xi < adhesion) | np.isinf(limit)
    return flags


def _share(slip: Array, total: Array) -> Array:
    return np.divide(slip, total, out=np.zeros(np.broadcast(slip, total).shape),
                     where=total > 0.0)


def _parabola(xi: Array) -> Array:
    """Return xi (1 - xi) inside the patch, 0 outside."""
    return np.maximum(xi * (1.0 - xi), 0.0)
