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
Levenberg-Marquardt fit of one crossing, with priors, Huber weights and clipped samples.

A clipped sample is used only while the model is below the rail.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv, dpotrf, dtrtri

from smart_tire.arrays import Array
from smart_tire.estimation.contact.records import FilmSamples
from smart_tire.estimation.friction.waveform_model import (
    film_index, PerFilm, Shared, WaveformModel)
from smart_tire.numerics.robust import huber_weights, MAD_TO_SIGMA

Indices = NDArray[np.intp]

MAX_POSITION_STEP = 0.003     # m, of a film center in one iteration
SLIDING_RANGE = (-5.0, 10.0)  # -, limits far beyond observable values
MAX_ITERATIONS = 15
INITIAL_DAMPING = 1e-4                          # of the diagonal of the Hessian
DAMPING_INCREASE, DAMPING_DECREASE = 10.0, 0.1  # factors after a failed and a successful step
MAX_DAMPING = 1e6
MIN_COST_REDUCTION = 0.03   # chi-squared; a step with a smaller expected reduction is the last
HUBER_THRESHOLD = 3.0       # sigmas, beyond which a sample has lower weight
MAX_PRODUCT_SIZE = 200_000  # multiplications; OpenBLAS uses threads from 4 * 65536 on


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Prior of the parameters of a crossing; a sigma of 0 fixes a parameter."""

    value: Array
    precision: Array     # inverse covariance (free, free) of the fitted parameters
    free: Indices        # of the fitted parameters
    systematic: Indices  # of parameters with the same error in all crossings

    def without(self, fixed: slice) -> Prior:
        """Return the prior with the parameters ``fixed`` at their values."""
        kept = (self.free < fixed.start) | (self.free >= fixed.stop)
        return replace(self, precision=self.precision[kept][:, kept], free=self.free[kept])


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """Parameters with residuals and derivatives of the model."""

    p: Array
    residual: Array  # V, (n,)
    jacobian: Array  # (m, n), by all m parameters


@dataclass(frozen=True, slots=True, eq=False)
class FitResult:
    """Result of a fit: ``p`` is at most a small step from the last evaluated ``point``."""

    p: Array
    point: Point
    prior: Prior
    weight: Array   # (n,), of the samples [1/V^2]
    hessian: Array  # by the free parameters


class LevenbergMarquardt:
    """
    Minimizes the weighted residuals of all ``films`` of one crossing from a given start.

    The model is not evaluated again if the start is the point where the last fit ended.
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

    def run(self, p: Array, prior: Prior, min_reduction: float = MIN_COST_REDUCTION) -> FitResult:
        """
        Return the fit from start ``p``; fixed parameters take the value of ``prior``.

        A step whose expected reduction of the cost is below ``min_reduction`` is the last.
        """
        start = prior.value.copy()
        start[prior.free] = p[prior.free]
        point = self._last
        if point is None or point.p is not p or np.any(start != p):
            point = self._at(start)
        damping = INITIAL_DAMPING
        for _ in range(MAX_ITERATIONS):
            weight = self._weights(point)
            jacobian = point.jacobian.take(prior.free, axis=0)
            hessian = gram(jacobian, weight)
            hessian += prior.precision
            gradient = jacobian @ (weight * point.residual) + prior.precision @ (
                prior.value - point.p)[prior.free]
            parameters, moved, damping = self._step(
                point, prior, weight, hessian, gradient, damping, min_reduction)
            if moved is None:
                break
            point = moved
        self._last = point
        return FitResult(parameters, point, prior, weight, hessian)

    def _at(self, p: Array) -> Point:
        output, jacobian = self._model.linearized(p)
        return Point(p, self._volts - output, jacobian)

    def _step(self, point: Point, prior: Prior, weight: Array, hessian: Array, gradient: Array,
              damping: float, min_reduction: float) -> tuple[Array, Point | None, float]:
        """
        Return the parameters after a step, the point there, and the next damping.

        The point is None if the expected reduction of the cost is small, or no step reduces it:
        then the step is the last.
        """
        current_cost = self._cost(point, prior, weight)
        while damping < MAX_DAMPING:
            damped = hessian.copy()
            damped.reshape(-1)[::len(damped) + 1] *= 1.0 + damping
            step = solve_spd(damped, gradient)
            p = self._moved(point.p, prior, step)
            if float(gradient @ step) < min_reduction:
                return p, None, damping
            trial = self._at(p)
            if self._cost(trial, prior, weight) <= current_cost:
                return p, trial, DAMPING_DECREASE * damping
            damping *= DAMPING_INCREASE
        return point.p, None, damping

    def _moved(self, p: Array, prior: Prior, step: NDArray[np.floating]) -> Array:
        """Return ``p`` after ``step``, shortened if a film center would move too far."""
        full_step = np.zeros_like(p)
        full_step[prior.free] = step
        first, end = (film_index(i, PerFilm.CENTER) for i in (0, len(self._counts)))
        position_steps = full_step[first:end:len(PerFilm)]
        largest = max(map(abs, position_steps.tolist()))
        scale = min(1.0, MAX_POSITION_STEP / max(largest, MAX_POSITION_STEP))
        moved: Array = p + full_step * scale
        low, high = SLIDING_RANGE
        moved[Shared.NORM_SLIP] = min(max(float(moved[Shared.NORM_SLIP]), low), high)
        return moved

    def _cost(self, point: Point, prior: Prior, weight: Array) -> float:
        if self._clips:
            weight = np.where(self._rail * point.residual < 0.0, 0.0, weight)
        deviation = (point.p - prior.value)[prior.free]
        return float(weight @ (point.residual * point.residual)
                     + deviation @ prior.precision @ deviation)

    def _weights(self, point: Point) -> Array:
        """Return 1 / variance with Huber's factor, 0 for samples beyond their rail."""
        size = np.abs(point.residual)
        sigma = max(math.sqrt(self._variance), MAD_TO_SIGMA * upper_median(size))
        weight = huber_weights(size, HUBER_THRESHOLD * sigma) / self._variance
        return np.where(self._rail * point.residual < 0.0, 0.0, weight) if self._clips else weight


def solve_spd(matrix: Array, right: Array) -> NDArray[np.floating]:
    """Return matrix^-1 @ right of a positive definite matrix, with little overhead."""
    _, solution, failed = dposv(matrix, right)
    return np.linalg.solve(matrix, right) if failed else solution


def inverse_spd(matrix: Array) -> Array:
    """
    Return the inverse of a positive definite matrix.

    For the size of these matrices LAPACK's own inverses use threads, which is many times slower.
    """
    factor, failed = dpotrf(matrix)
    if failed:
        return np.asarray(np.linalg.inv(matrix), dtype=float)
    inverse, _ = dtrtri(factor)  # upper triangular: matrix = factor.T @ factor
    return gram(inverse, np.ones(len(matrix)))


def gram(jacobian: Array, weight: Array) -> Array:
    """
    Return jacobian @ diag(weight) @ jacobian.T, for a jacobian (m, n) and weights (n,).

    Computed in blocks below the size from which BLAS uses threads, which is ten times slower.
    """
    weighted, part = jacobian * weight, max(MAX_PRODUCT_SIZE // len(jacobian)**2, 1)
    total = weighted[:, :part] @ jacobian[:, :part].T
    for i in range(part, len(weight), part):
        total += weighted[:, i:i + part] @ jacobian[:, i:i + part].T
    return total


def upper_median(values: Array) -> float:
    """Return the upper median; for short arrays ten times as fast as numpy.median."""
    return float(np.sort(values)[len(values) // 2])
