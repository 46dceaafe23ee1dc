"""
The buckled film with its weight: the boundary value problem A(7), A(8) with ``q_e = w s``.

With Green's function of ``theta'' = h``, ``theta(0) = theta(1) = 0`` it becomes an integral
equation, ``theta = G (w s cos(theta) - f sin(theta))`` and ``int 2 sin^2(theta / 2) = delta``, on
Chebyshev points: G is exact for polynomials and well conditioned, so a few steps of Newton give
all digits, for many films at once. The weight grows in steps from the weightless solution.
Dimensionless as ``elastica``; ``weight`` is w, above zero for a film arched against gravity and
below zero for one that hangs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.models.film import elastica
from smart_tire.models.film.elastica import EULER_LOAD, Flags, Shape

POINTS = 40
BLOCK = 256            # films that are solved together, for the size of their matrices
NEWTON_STEPS = 8
CONVERGED = 1e-11    # of the shape's size: the largest last change of theta
LONGEST_STEP = 0.3   # of the shape's size: more may end on another branch of solutions
SHORTEST_STEP = 1e-3  # of the weight: below it the branch has come to its end
RESOLVED = 1e-9      # of the curvature's largest coefficient: the last ones, at most

# Chebyshev-Lobatto points on [0, 1], and integration from 0 to each of them
NODES: Array = 0.5 * (1.0 - np.cos(np.pi * np.arange(POINTS) / (POINTS - 1)))
_TO_SERIES: Array = np.linalg.inv(
    np.asarray(chebyshev.chebvander(2.0 * NODES - 1.0, POINTS - 1), dtype=np.float64))
_SUM: Array = chebyshev.chebval(
    2.0 * NODES - 1.0, chebyshev.chebint(_TO_SERIES, scl=0.5, lbnd=-1.0)).T
_TWICE: Array = _SUM @ _SUM
GREEN: Array = _TWICE - np.outer(NODES, _TWICE[-1])
GREEN_SLOPE: Array = _SUM - _TWICE[-1]
WHOLE: Array = _SUM[-1]  # weights of the integral from 0 to 1


@dataclass(frozen=True)
class HeavyFilm:
    """Solutions; arrays have the shape of stroke and weight, ``theta`` one axis more."""

    stroke: Array
    weight: Array
    load: Array   # f
    theta: Array  # (..., POINTS) rad at NODES

    @property
    def height(self) -> Array:
        """Return y(1)."""
        top: Array = np.sin(self.theta) @ WHOLE
        return top

    @property
    def charge(self) -> Array:
        """Return Q_en / K of A(9) above the Euler load: int(f cos + q sin) / pi^2 - 1."""
        thrust = self.load * (1.0 - self.stroke)
        lift = self.weight * ((NODES * np.sin(self.theta)) @ WHOLE)
        value: Array = (thrust + lift) / EULER_LOAD - 1.0
        return value

    @property
    def shape(self) -> Shape:
        """Return the shape at NODES."""
        curvature = _bending(self.theta, self.load[..., None], self.weight[..., None])
        return Shape(np.broadcast_to(NODES, self.theta.shape), np.cos(self.theta) @ _SUM.T,
                     np.sin(self.theta) @ _SUM.T, self.theta, curvature @ GREEN_SLOPE.T)

    def at(self, s: ArrayLike) -> Shape:
        """Return the shape at arc lengths ``s`` (n,) in [0, 1], arrays (..., n)."""
        s = np.asarray(s, dtype=float).reshape(-1)
        if not ((s >= 0.0) & (s <= 1.0)).all():
            raise ParameterError(f's spans {s.min()} to {s.max()}, expected 0 to 1')
        between = chebyshev.chebvander(2.0 * s - 1.0, POINTS - 1) @ _TO_SERIES
        here = self.shape
        x, y, theta, curvature = (values @ between.T for values in (
            here.x, here.y, here.theta, here.curvature))
        return Shape(np.broadcast_to(s, theta.shape), x, y, theta, curvature)


def solve(stroke: ArrayLike, weight: ArrayLike) -> HeavyFilm:
    """
    Return the films with these strokes and weights.

    A film can be arched against its weight from a stroke of about ``5.04e-4 w^2`` on only: below
    it, and where the points do not resolve the shape, ParameterError.
    """
    strokes, weights = np.broadcast_arrays(
        elastica.checked_stroke(stroke), np.asarray(weight, dtype=float))
    if not np.isfinite(weights).all():
        raise ParameterError(f'weight is {weights[~np.isfinite(weights)].flat[0]}')
    if np.any((strokes == 0.0) & (weights != 0.0)):
        raise ParameterError('stroke is 0: no finite load holds a film with weight flat')
    flat, goal = strokes.reshape(-1), weights.reshape(-1)
    theta, load = np.empty((flat.size, POINTS)), np.empty(flat.size)
    for begin in range(0, flat.size, BLOCK):
        some = slice(begin, begin + BLOCK)
        theta[some], load[some] = _continued(flat[some], goal[some])
    film = HeavyFilm(strokes, weights, load.reshape(strokes.shape),
                     theta.reshape(*strokes.shape, POINTS))
    _check_resolved(film)
    return film


def _continued(stroke: Array, weight: Array) -> tuple[Array, Array]:
    """Return theta and load, reached from the weightless films in steps as long as they may be."""
    theta = elastica.shape(stroke[:, None], NODES).theta
    load = elastica.load(stroke)
    done, step = np.where(weight == 0.0, 1.0, 0.0), np.ones(weight.size)
    while (todo := np.flatnonzero(done < 1.0)).size:
        share = np.minimum(done[todo] + step[todo], 1.0)
        fine, theta_new, load_new = _newton(stroke[todo], weight[todo] * share, theta[todo],
                                            load[todo])
        good = todo[fine]
        theta[good], load[good], done[good] = theta_new[fine], load_new[fine], share[fine]
        step[todo[~fine]] *= 0.5
        if (lost := np.flatnonzero(step < SHORTEST_STEP)).size:
            raise ParameterError(
                f'no film of weight {weight[lost[0]]} is in balance at stroke {stroke[lost[0]]}: '
                'it is too flat to be arched against its weight, or too heavy')
    return theta, load


def _newton(stroke: Array, weight: Array, theta: Array, load: Array
            ) -> tuple[Flags, Array, Array]:
    """Return which films converged, near to where they started, and their theta and load."""
    start, w = theta, weight[:, None]
    # in units of the shape's size, else a film that is almost flat has a row of almost zeros
    size = np.abs(theta).max(axis=1, keepdims=True)
    matrix = np.zeros((stroke.size, POINTS + 1, POINTS + 1))
    for _ in range(NEWTON_STEPS):
        f, sine = load[:, None], np.sin(theta)
        matrix[:, :-1, :-1] = (np.eye(POINTS) + GREEN
                               * (w * NODES * sine + f * np.cos(theta))[:, None])
        matrix[:, :-1, -1] = sine / size @ GREEN.T
        matrix[:, -1, :-1] = sine / size * WHOLE
        residual = (theta - _bending(theta, f, w) @ GREEN.T) / size
        closing = (2.0 * np.sin(0.5 * theta)**2 @ WHOLE - stroke)[:, None] / size**2
        right = np.concatenate([residual, closing], axis=1)
        correction = np.linalg.solve(matrix, right[..., None])[..., 0]
        theta, load = theta - correction[:, :-1] * size, load - correction[:, -1]
        change = np.abs(correction[:, :-1]).max(axis=1)
        if not np.isfinite(change).all() or np.all(change < CONVERGED):
            break
    near = np.abs(theta - start).max(axis=1) < LONGEST_STEP * size[:, 0]
    return (change < CONVERGED) & near, theta, load


def _bending(theta: Array, load: Array, weight: Array) -> Array:
    """Return theta'' of A(7)."""
    second: Array = weight * NODES * np.cos(theta) - load * np.sin(theta)
    return second


def _check_resolved(film: HeavyFilm) -> None:
    series = np.abs(_bending(film.theta, film.load[..., None], film.weight[..., None])
                    @ _TO_SERIES.T)
    rough = series[..., -2:].max(axis=-1) > RESOLVED * series.max(axis=-1)
    if rough.any():
        raise ParameterError(
            f'the shape for stroke {film.stroke[rough].flat[0]} and weight '
            f'{film.weight[rough].flat[0]} bends too sharply for {POINTS} points')
