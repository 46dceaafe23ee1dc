"""
Gauss-Newton with Levenberg's damping, from a start to the least misfit of one passage.

Samples far off count less, clipped ones only where the fit stays short of the rail.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

from smart_tire.arrays import Array
from smart_tire.estimation.contact.records import FilmSamples
from smart_tire.estimation.friction.motion_history import ValueSigma
from smart_tire.estimation.friction.waveform_model import Own, own, Shared, WaveformModel
from smart_tire.numerics.robust import MAD_TO_SIGMA

Indices = NDArray[np.intp]

LARGEST_STEP = 0.003     # m, of a place in one iteration
SLIDING_RANGE = (-5.0, 10.0)  # -, far beyond all that can be told
ITERATIONS = 15
DAMPED, GROWS, SHRINKS = 1e-4, 10.0, 0.1  # Levenberg's damping: first, after failure and success
MOST_DAMPED = 1e6
CONVERGED = 0.03         # of the misfit, chi-squared: a step that saves less is the last
OUTLIER = 3.0            # sigmas, beyond which a sample counts less
AT_ONCE = 200_000        # multiplications in a product; OpenBLAS uses threads from 4 * 65536 on


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """What is known before a passage is seen; a sigma of 0 fixes a parameter."""

    value: Array
    precision: Array  # inverse covariance (free, free) of those that are fitted
    free: Indices     # of the parameters that are fitted
    lasting: Indices  # of those whose error is the same in other passages


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """Parameters and what the model makes of them."""

    p: Array
    residual: Array  # V, (n,)
    slopes: Array    # (m, n), by all parameters


@dataclass(frozen=True, slots=True, eq=False)
class FitResult:
    """Where a way ended: ``p`` is at most a small step from the ``point`` that was evaluated."""

    p: Array
    point: Point
    prior: Prior
    weight: Array   # (n,), of the samples [1/V^2]
    hessian: Array  # by the free parameters


class LevenbergMarquardt:
    """
    Ways from a start to the least misfit of the samples of ``films`` in one passage.

    The model is not evaluated again for a start that is the point where the last way ended.
    ``variance`` [V^2] is that of a sample's noise.
    """

    def __init__(self, model: WaveformModel, films: Sequence[FilmSamples],
                 variance: float) -> None:
        self._model, self._variance = model, variance
        self._counts = [len(one.distance) for one in films]
        self._volts = np.concatenate([one.volts for one in films])
        self._rail = np.concatenate([one.rail for one in films])
        self._clips = bool(self._rail.any())
        self._last: Point | None = None

    def run(self, p: Array, prior: Prior) -> FitResult:
        """Return the end of the way from ``p``; what is fixed takes the value of ``prior``."""
        start = prior.value.copy()
        start[prior.free] = p[prior.free]
        point = self._last
        if point is None or point.p is not p or np.any(start != p):
            point = self._at(start)
        damping = DAMPED
        for _ in range(ITERATIONS):
            weight = self._weights(point)
            slopes = point.slopes.take(prior.free, axis=0)
            hessian = gram(slopes, weight)
            hessian += prior.precision
            gradient = slopes @ (weight * point.residual) + prior.precision @ (
                prior.value - point.p)[prior.free]
            last, moved, damping = self._step(point, prior, weight, hessian, gradient, damping)
            if moved is None:
                break
            point = moved
        self._last = point
        return FitResult(last, point, prior, weight, hessian)

    def apart(self, end: FitResult) -> list[ValueSigma]:
        """Return the sliding share by one step from ``end`` with each film's samples only."""
        prior, point = end.prior, end.point
        weight, slopes = self._weights(point), point.slopes.take(prior.free, axis=0)
        sliding = int(np.searchsorted(prior.free, Shared.SLIDING))
        pull = prior.precision @ (prior.value - point.p)[prior.free]
        right = np.zeros((len(prior.free), 2))
        right[sliding, 1] = 1.0
        found, begin = [], 0
        for count in self._counts:
            own_part = slice(begin, begin + count)
            begin = own_part.stop
            hessian = gram(slopes[:, own_part], weight[own_part])
            hessian += prior.precision
            right[:, 0] = slopes[:, own_part] @ (
                weight[own_part] * point.residual[own_part]) + pull
            step, inverse = solve_spd(hessian, right)[sliding].tolist()
            found.append((float(point.p[Shared.SLIDING]) + step, math.sqrt(inverse)))
        return found

    def _at(self, p: Array) -> Point:
        output, slopes = self._model.linearised(p)
        return Point(p, self._volts - output, slopes)

    def _step(self, point: Point, prior: Prior, weight: Array, hessian: Array, gradient: Array,
              damping: float) -> tuple[Array, Point | None, float]:
        """
        Return the parameters after a step, the point there, and the damping after it.

        No point where the step saves little or none saves anything: then it is the last.
        """
        before = self._misfit(point, prior, weight)
        while damping < MOST_DAMPED:
            damped = hessian.copy()
            damped.reshape(-1)[::len(damped) + 1] *= 1.0 + damping
            step = solve_spd(damped, gradient)
            p = self._moved(point.p, prior, step)
            if float(gradient @ step) < CONVERGED:
                return p, None, damping
            trial = self._at(p)
            if self._misfit(trial, prior, weight) <= before:
                return p, trial, SHRINKS * damping
            damping *= GROWS
        return point.p, None, damping

    def _moved(self, p: Array, prior: Prior, step: NDArray[np.floating]) -> Array:
        """Return ``p`` after ``step``, shortened where a place would jump."""
        whole = np.zeros_like(p)
        whole[prior.free] = step
        places = whole[own(0, Own.PLACE):own(len(self._counts), Own.PLACE):len(Own)]
        farthest = max(map(abs, places.tolist()))
        moved: Array = p + whole * min(1.0, LARGEST_STEP / max(farthest, LARGEST_STEP))
        low, high = SLIDING_RANGE
        moved[Shared.SLIDING] = min(max(float(moved[Shared.SLIDING]), low), high)
        return moved

    def _misfit(self, point: Point, prior: Prior, weight: Array) -> float:
        if self._clips:
            weight = np.where(self._rail * point.residual < 0.0, 0.0, weight)
        off = (point.p - prior.value)[prior.free]
        return float(weight @ (point.residual * point.residual) + off @ prior.precision @ off)

    def _weights(self, point: Point) -> Array:
        """Return 1 / variance, less for outliers (Huber), none for what is beyond its rail."""
        size = np.abs(point.residual)
        spread = max(math.sqrt(self._variance), MAD_TO_SIGMA * middle(size))
        edge = OUTLIER * spread
        weight: Array = (edge / self._variance) / np.maximum(size, edge)
        return np.where(self._rail * point.residual < 0.0, 0.0, weight) if self._clips else weight


def solve_spd(matrix: Array, right: Array) -> NDArray[np.floating]:
    """Return matrix^-1 @ right of a positive definite matrix; without the detours of NumPy."""
    _, found, failed = dposv(matrix, right)
    return np.linalg.solve(matrix, right) if failed else found


def gram(slopes: Array, weight: Array) -> Array:
    """
    Return slopes @ diag(weight) @ slopes.T, for (m, n) slopes.

    In parts so small that no library spreads them over threads, which takes ten times as long.
    """
    weighted, part = slopes * weight, max(AT_ONCE // len(slopes)**2, 1)
    total = weighted[:, :part] @ slopes[:, :part].T
    for i in range(part, len(weight), part):
        total += weighted[:, i:i + part] @ slopes[:, i:i + part].T
    return total


def middle(values: Array) -> float:
    """Return the median, the upper one of two: sorted by hand, which is ten times as fast."""
    return float(np.sort(values)[len(values) // 2])
