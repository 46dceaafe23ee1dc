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

"""Solution of the nonlinear least squares problem behind C_x, by Gauss-Newton steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from smart_tire.arrays import Array
from smart_tire.calibration.tire.stiffness_model import Block, Common, Noise, SegmentModel
from smart_tire.errors import EstimatorError
from smart_tire.numerics.robust import huber_weights
from smart_tire.parameters import RobotParams

FRICTION_PRIOR, FRICTION_FACTOR = 0.45, 2.0   # median and factor per sigma of grounds; assumed
DRAG_PRIOR, DRAG_SIGMA = 0.015, 0.15          # of the weight: firm ground, and up to deep sand
STIFFNESS_FACTOR = 10.0     # per sigma, uninformative
ACCEL_SCALE_SIGMA = 0.05    # of accelerations; the body pitches by 0.3 degrees at 1 m/s2; assumed
BIAS_SIGMA = 0.15           # m/s2, turn-on bias and mounting
# starts of the fit, friction and C_x over the configured one: slippery ground mimics a soft tire
INITIAL_VALUES = ((0.6, 1.0), (0.2, 2.0))
INITIAL_FORCE_NOISE = 0.03  # m/s2, of the force balance of a step; 0.1 leads to wrong minima
MIN_FORCE_NOISE = 0.03      # m/s2, of a step; assumed
MIN_JITTER = 1e-4           # s
ROUNDS = 3                  # of the noise, then fit
MAX_ITERATIONS = 40         # of Gauss-Newton
MAX_STEP = np.array([0.3, 0.05, 0.3, 5e-3, 0.05, 0.1])  # of ``Common`` in one iteration
MIN_SCALE = 1e-3            # of a damped step
CONVERGED = 0.01            # of a step over the standard errors
NOT_ROBUST = 1e6            # sigmas, in place of the next one
HUBER_THRESHOLD = 3.0       # sigmas, beyond which a row has lower weight
MIN_FREEDOM = 0.1           # degrees of freedom per row of a group; its estimate is random
AMBIGUITY_CHI_SQUARE = 9.0  # by which all other solutions must be worse: three sigmas
DISTINCT_SIGMAS = 3.0       # standard errors of C_x beyond which solutions differ
PROBES = 8                  # random vectors for the degrees of freedom of a group

Factor = Callable[[Array], Array]  # solves the normal equations


class Problem:
    """All segments and the priors of the common parameters; unknowns: common, then local."""

    def __init__(self, models: Sequence[SegmentModel], robot: RobotParams,
                 latency_sigma: float) -> None:
        self.models, self.latency_sigma, self.threshold = models, latency_sigma, HUBER_THRESHOLD
        self.noise = self.initial_noise = Noise(
            max(robot.encoder.stamp_jitter, MIN_JITTER), INITIAL_FORCE_NOISE)
        self.mean = np.array([math.log(robot.tire.longitudinal_stiffness), DRAG_PRIOR,
                              math.log(FRICTION_PRIOR), 0.0, 0.0, 0.0])
        self._prior = 1.0 / np.array([
            math.log(STIFFNESS_FACTOR), DRAG_SIGMA, math.log(FRICTION_FACTOR),
            latency_sigma, ACCEL_SCALE_SIGMA, BIAS_SIGMA])
        sizes = [len(Common), *(model.size for model in models)]
        self._first = np.cumsum(sizes)[:-1].tolist()
        self.size = sum(sizes)
        orders = [first + np.argsort(model.order(), kind='stable')
                  for model, first in zip(models, self._first)]
        self._order = np.concatenate([*orders, np.arange(len(Common))])

    def split(self, values: Array) -> tuple[Array, list[Array]]:
        """Return the common and the local unknowns of each segment."""
        return values[:len(Common)], [values[first:first + model.size]
                                      for model, first in zip(self.models, self._first)]

    def blocks(self, values: Array) -> list[tuple[int, Block]]:
        """Return the residuals of all segments, with the index of their first local unknown."""
        common, local = self.split(values)
        return [(first, block) for model, first, own in zip(self.models, self._first, local)
                for block in model.blocks(common, own, self.noise)]

    def prior_gradient(self, values: Array) -> Array:
        """Return the derivatives of half the cost of the priors by the common parameters."""
        return np.asarray(self._prior ** 2 * (values[:len(Common)] - self.mean))

    def cost(self, values: Array) -> float:
        """Return the sum of Huber's losses and of the priors, times two."""
        cost = float(np.sum((self._prior * (values[:len(Common)] - self.mean)) ** 2))
        for _, block in self.blocks(values):
            size = np.abs(block.residual)
            inner = np.minimum(size, self.threshold)
            cost += float(np.sum(inner * (2.0 * size - inner)))
        return cost

    def jacobian(self, first: int, block: Block) -> sparse.csr_array:
        """Return the derivatives of a block by all unknowns."""
        local = block.by_local.tocoo()
        common = sparse.coo_array(block.by_common)
        return sparse.csr_array((
            np.concatenate([common.data, local.data]),
            (np.concatenate([common.row, local.row]),
             np.concatenate([common.col, local.col + first]))),
            shape=(len(block.residual), self.size))

    def factor(self, matrix: sparse.csr_array) -> Factor:
        """Return the factorized normal equations, banded with a border of common unknowns."""
        order, inverse = self._order, np.argsort(self._order)
        ordered = matrix[order][:, order].tocsc()
        solver = splu(ordered, permc_spec='NATURAL', diag_pivot_thresh=0.0,
                      options={'SymmetricMode': True})
        return lambda target: solver.solve(target[order])[inverse]

    def prior_matrix(self) -> sparse.csr_array:
        """Return the inverse covariance of the priors."""
        diagonal = np.zeros(self.size)
        diagonal[:len(Common)] = self._prior ** 2
        diagonal[len(Common):] = 1e-9
        return sparse.diags_array(diagonal).tocsr()


@dataclass(frozen=True)
class Solution:
    """A minimum of the cost."""

    values: Array    # common parameters, then the local ones of each segment
    total: float     # sum of Huber's losses, times two
    cost: float      # the same per degree of freedom
    factor: Factor  # of the normal equations
    sigma: Array     # of the common parameters


def solve(problem: Problem, values: Array, tolerance: float = CONVERGED) -> Solution:
    """Return the best fit near ``values`` by damped Gauss-Newton steps."""
    for _ in range(MAX_ITERATIONS):
        blocks = problem.blocks(values)
        weights = [huber_weights(block.residual, problem.threshold) for _, block in blocks]
        jacobian = sparse.vstack([
            sparse.diags_array(np.sqrt(weight)) @ problem.jacobian(first, block)
            for weight, (first, block) in zip(weights, blocks)]).tocsr()
        residual = np.concatenate([np.sqrt(weight) * block.residual
                                   for weight, (_, block) in zip(weights, blocks)])
        gradient = jacobian.T @ residual
        gradient[:len(Common)] += problem.prior_gradient(values)
        factor = problem.factor((jacobian.T @ jacobian + problem.prior_matrix()).tocsr())
        step = factor(-gradient)
        scale = min(1.0, float(np.min(MAX_STEP / np.maximum(np.abs(step[:len(Common)]), 1e-12))))
        sigma = _sigmas(factor, problem.size)
        converged = np.max(np.abs(step[:len(Common)]) / sigma) < tolerance
        before = problem.cost(values)
        while problem.cost(values + scale * step) > before and scale > MIN_SCALE:
            scale *= 0.5
        values = values + scale * step
        if converged or scale <= MIN_SCALE:
            break
    total = problem.cost(values)
    return Solution(values, total, total / max(len(residual) - problem.size, 1), factor, sigma)


def _sigmas(factor: Factor, size: int) -> Array:
    """Return the standard errors of the common parameters."""
    columns = factor(np.eye(size, len(Common)))
    return np.sqrt(np.maximum(np.diag(columns[:len(Common)]), 1e-300))


def estimated_noise(problem: Problem, found: Solution) -> Noise:
    """Return the noise with which the residuals of its groups have the expected variance."""
    blocks = problem.blocks(found.values)
    scale = {}
    for group in ('stamp', 'force'):
        squares = freedom = 0.0
        rng = np.random.default_rng(0)
        for first, block in blocks:
            if block.group != group:
                continue
            weight = huber_weights(block.residual, HUBER_THRESHOLD)
            counted = slice(None) if block.counted is None else np.flatnonzero(block.counted)
            weight, residual = weight[counted], block.residual[counted]
            jacobian = problem.jacobian(first, block)[counted]
            probes = rng.choice([-1.0, 1.0], (len(residual), PROBES))
            back = jacobian.T @ probes
            used = float(np.sum(back * found.factor(back))) / PROBES
            squares += float(np.sum(weight * residual ** 2))
            freedom += max(len(residual) - used, MIN_FREEDOM * len(residual))
        scale[group] = math.sqrt(max(squares, 1e-6) / max(freedom, 1.0))
    return Noise(max(problem.noise.stamp * scale['stamp'], MIN_JITTER),
                 max(problem.noise.force * scale['force'], MIN_FORCE_NOISE))


def solved_from(problem: Problem, values: Array) -> tuple[Solution, Noise]:
    """
    Return the solution near ``values``, and its noise.

    The first solution is not robust: at the start all rows of a step may be outliers, and with low
    weights they would remain so.
    """
    problem.noise, problem.threshold = problem.initial_noise, NOT_ROBUST
    found = solve(problem, values)
    problem.threshold = HUBER_THRESHOLD
    for _ in range(ROUNDS):
        problem.noise = estimated_noise(problem, found)
        found = solve(problem, found.values)
    return found, problem.noise


def unambiguous(problem: Problem, solved: Sequence[tuple[Solution, Noise]]) -> Solution:
    """Return the best solution, all with its noise; EstimatorError if another fits as well."""
    _, problem.noise = min(solved, key=lambda pair: pair[1].force)
    solutions = [solve(problem, solution.values) for solution, _ in solved]
    best = min(solutions, key=lambda solution: solution.total)
    for other in solutions:
        shift = abs(other.values[Common.STIFFNESS] - best.values[Common.STIFFNESS])
        if shift > DISTINCT_SIGMAS * best.sigma[Common.STIFFNESS] and (
                other.total - best.total < AMBIGUITY_CHI_SQUARE * max(best.cost, 1.0)):
            first, second = (math.exp(one.values[Common.STIFFNESS]) for one in (best, other))
            raise EstimatorError(f'{first:.3g} N and {second:.3g} N fit equally well: requires '
                                 'speed changes of several sizes')
    return best


def starts(problem: Problem) -> list[Array]:
    """Return initial values of the fit."""
    found = []
    for friction, factor in INITIAL_VALUES:
        common = problem.mean.copy()
        common[Common.FRICTION] = math.log(friction)
        common[Common.STIFFNESS] += math.log(factor)
        found.append(np.concatenate([common, *(model.start() for model in problem.models)]))
    return found
