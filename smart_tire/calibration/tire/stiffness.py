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
Longitudinal stiffness C_x of the tires from acceleration and braking on straight lines.

All measurements have errors: accelerations, timestamps of the wheels, the force balance itself.
A regression of one on another is biased by the errors of the regressor, so the motion of body and
wheels is estimated together with the parameters (``stiffness_model``), by a Gauss-Newton fit.
Slips of the slip estimator, whose prior is free rolling, would bias the stiffness even more.

Parameters with similar effects are estimated as well: friction, which bends the curve at larger
slips; drag; errors of the rolling radius, of the wheel latency (one millisecond corresponds to
2.4 % of C_x for the paper's robot at 0.8 m/s, with another share at other speeds), and of the
accelerometer (bias and scale); and the slope of the ground. The standard deviations of timestamp
jitter and force balance are estimated from their residuals (variance components).

The stiffness is proportional to the configured mass; it is that of the tire-ground pair.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from smart_tire.arrays import Array
from smart_tire.calibration.recording import Recording
from smart_tire.calibration.tire.simulated_segments import simulated
from smart_tire.calibration.tire.stiffness_model import Block, Common, Noise, SegmentModel
from smart_tire.calibration.tire.straight_segments import (
    MIN_SEGMENT_INTERVALS, MIN_SPEED, straight_segments, StraightSegment)
from smart_tire.errors import EstimatorError
from smart_tire.models.constants import GRAVITY
from smart_tire.numerics.robust import huber_weights
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import MAX_RELATIVE_SIGMA, Uncertain, weighted_mean

FRICTION_PRIOR, FRICTION_FACTOR = 0.45, 2.0   # median and factor per sigma of grounds; assumed
DRAG_PRIOR, DRAG_SIGMA = 0.015, 0.15          # of the weight: firm ground, and up to deep sand
STIFFNESS_FACTOR = 10.0     # per sigma, uninformative
LATENCY_ERROR_SIGMA = 0.01  # s, of the configured latency between wheels and IMU; assumed
RADIUS_ERROR_SIGMA = 0.02   # relative, of the rolling radius; assumed
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
MAX_NOISE_SHARE = 0.08      # of accelerations; more noise makes a tire seem too stiff
MAX_LATENCY_ERROR = 0.04    # s, of the configured latency
IMPLAUSIBLE_SIGMAS = 4.0    # standard errors by which a drag may be negative
MAX_FORCE_ERROR_SHARE = 0.3  # of accelerations, of the force balance
MIN_FREEDOM = 0.1           # degrees of freedom per row of a group; its estimate is random
REPETITIONS = 4             # of the fit, on simulated segments
REPEATED_CONVERGED = 0.1    # of a step over the standard errors, in a repetition
AMBIGUITY_CHI_SQUARE = 9.0  # by which all other solutions must be worse: three sigmas
DISTINCT_SIGMAS = 3.0       # standard errors of C_x beyond which solutions differ
PROBES = 8                  # random vectors for the degrees of freedom of a group


Factor = Callable[[Array], Array]  # solves the normal equations


@dataclass(frozen=True)
class StiffnessFit:
    """Stiffness and the parameters estimated with it, with the data for figures."""

    stiffness: Uncertain      # N, C_x of one wheel
    friction: Uncertain       # -, mu, from the bend of the curve
    drag: Uncertain           # N, of all wheels
    latency_error: Uncertain  # s, of the wheel timestamps in addition to the configured latency
    segments: int
    duration: float             # s, of all segments
    slip: Array                 # (n,) -, of steps of the grid, as smoothed
    force: Array                # (n,) N, of one wheel, positive when driving, as measured
    excess: float               # mean squared normalized residual, at least 1
    curve: tuple[Array, Array]  # slip [-] and force [N] of one wheel as fitted


def identify_stiffness(recordings: Sequence[Recording], robot: RobotParams,
                       latency_sigma: float = LATENCY_ERROR_SIGMA, *,
                       debiased: bool = True) -> StiffnessFit:
    """
    Return the stiffness from recordings on the same ground.

    ``latency_sigma`` [s] is the standard deviation of the error of ``encoder.latency``; without
    ``debiased`` the bias of the fit is not measured, which takes most of the time. If recordings
    differ by more than their standard errors, those are scaled up. Raises EstimatorError with the
    reason if the stiffness is not observable.
    """
    models = [_models(recording, robot) for recording in recordings]
    several = len(models) > 1  # then only the bias of the fit of all is of interest
    fits = [_fit(segments, robot, latency_sigma, debiased and not several)
            for segments in models]
    separate = [part.stiffness for part in fits]
    fit = fits[0] if len(fits) == 1 else _combined(
        models, separate, robot, latency_sigma, debiased)
    combined = fit.stiffness
    fit = replace(fit, stiffness=_scaled_by_scatter(combined, separate))
    if not (fit.stiffness.value > 0.0 and fit.stiffness.determined):
        raise EstimatorError(_refusal(fit.stiffness, separate if combined.determined else ()))
    return fit


def _combined(models: Sequence[Sequence[SegmentModel]], separate: Sequence[Uncertain],
              robot: RobotParams, latency_sigma: float, debiased: bool) -> StiffnessFit:
    """Return the fit of all recordings; EstimatorError with their values if there is none."""
    try:
        return _fit([one for part in models for one in part], robot, latency_sigma,
                    debiased)
    except EstimatorError as error:
        raise EstimatorError(_refusal(separate[0], separate)) from error


def _scaled_by_scatter(combined: Uncertain, separate: Sequence[Uncertain]) -> Uncertain:
    """Return ``combined`` with its sigma scaled by the scatter of ``separate``."""
    determined = [item for item in separate if item.determined]
    if len(determined) < 2:
        return combined
    expected = sum(item.sigma ** -2 for item in determined) ** -0.5
    return Uncertain(combined.value,
                     combined.sigma * weighted_mean(determined).sigma / expected)


def _refusal(stiffness: Uncertain, separate: Sequence[Uncertain]) -> str:
    """Return the reason why a stiffness is refused; ``separate`` are those that differ."""
    if len(separate) > 1:
        values = ', '.join(f'{item.value:.3g} ± {item.sigma:.2g}' for item in separate)
        return f'the recordings give {values} N: they are not of one tire on one ground'
    return (f'standard error of {stiffness.sigma / abs(stiffness.value):.0%}, expected at most '
            f'{MAX_RELATIVE_SIGMA:.0%}: speed changes too little on straight lines, below '
            'critical slip')


def _models(recording: Recording, robot: RobotParams) -> list[SegmentModel]:
    """Return the models of the straight segments; EstimatorError if there are none."""
    segments = straight_segments(recording, robot)
    if not segments:
        raise EstimatorError(f'no straight segment of {MIN_SEGMENT_INTERVALS} wheel samples '
                             f'above {MIN_SPEED:g} m/s')
    share = math.sqrt(float(np.mean([segment.noise ** 2 for segment in segments]))) / (
        _acceleration_spread(segments))
    if share > MAX_NOISE_SHARE:
        raise EstimatorError(
            f'the accelerometer noise in motion is {share:.0%} of the accelerations, expected at '
            f'most {MAX_NOISE_SHARE:.0%}: speed changes too little, or the robot vibrates')
    return [SegmentModel(segment, robot) for segment in segments]


def _acceleration_spread(segments: Sequence[StraightSegment]) -> float:
    """Return the standard deviation [m/s2] of the accelerations in motion."""
    moving = np.concatenate([segment.force[~segment.stationary[1:]] for segment in segments])
    return max(float(np.std(moving)), 1e-9)


class _Problem:
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
class _Solution:
    values: Array
    total: float     # sum of Huber's losses, times two
    cost: float      # the same per degree of freedom
    factor: Factor  # of the normal equations
    sigma: Array     # of the common parameters


def _solve(problem: _Problem, values: Array, tolerance: float = CONVERGED) -> _Solution:
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
    return _Solution(values, total, total / max(len(residual) - problem.size, 1), factor, sigma)


def _sigmas(factor: Factor, size: int) -> Array:
    """Return the standard errors of the common parameters."""
    columns = factor(np.eye(size, len(Common)))
    return np.sqrt(np.maximum(np.diag(columns[:len(Common)]), 1e-300))


def _estimated_noise(problem: _Problem, found: _Solution) -> Noise:
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


def _fit(models: Sequence[SegmentModel], robot: RobotParams, latency_sigma: float,
         debiased: bool) -> StiffnessFit:
    problem = _Problem(models, robot, latency_sigma)
    # a value that is not written needs no proof that it is the only one
    starts = _starts(problem) if debiased else _starts(problem)[:1]
    found = _unambiguous(problem, [_solved_from(problem, start) for start in starts])
    error = problem.noise.force / _acceleration_spread([model.segment for model in models])
    if error > MAX_FORCE_ERROR_SHARE:
        raise EstimatorError(
            f'the force balance has an error of {error:.0%} of the accelerations, expected at '
            f'most {MAX_FORCE_ERROR_SHARE:.0%}: wheels slide, the ground changes, or the axes of '
            'the IMU are wrong')
    _check_plausible(found)
    bias = _bias(problem, found, robot) if debiased else np.zeros((2, len(Common)))
    return _result(problem, found, bias, robot)


def _bias(problem: _Problem, found: _Solution, robot: RobotParams) -> Array:
    """Return the mean error of the common parameters, and its standard error, (2, p)."""
    common, local = problem.split(found.values)
    rng, errors = np.random.default_rng(0), []
    for _ in range(REPETITIONS):
        repeated = _Problem([SegmentModel(simulated(model, common, own, problem.noise, rng), robot)
                             for model, own in zip(problem.models, local)], robot,
                            problem.latency_sigma)
        repeated.noise = problem.noise
        fit = _solve(repeated, found.values, REPEATED_CONVERGED)
        repeated.noise = _estimated_noise(repeated, fit)
        fit = _solve(repeated, fit.values, REPEATED_CONVERGED)
        errors.append(fit.values[:len(Common)] - common)
    return np.stack([np.mean(errors, axis=0),
                     np.std(errors, axis=0, ddof=1) / math.sqrt(REPETITIONS)])


def _solved_from(problem: _Problem, values: Array) -> tuple[_Solution, Noise]:
    """
    Return the solution near ``values``, and its noise.

    The first solution is not robust: at the start all rows of a step may be outliers, and with low
    weights they would remain so.
    """
    problem.noise, problem.threshold = problem.initial_noise, NOT_ROBUST
    found = _solve(problem, values)
    problem.threshold = HUBER_THRESHOLD
    for _ in range(ROUNDS):
        problem.noise = _estimated_noise(problem, found)
        found = _solve(problem, found.values)
    return found, problem.noise


def _unambiguous(problem: _Problem, solved: Sequence[tuple[_Solution, Noise]]) -> _Solution:
    """Return the best solution, all with its noise; EstimatorError if another fits as well."""
    _, problem.noise = min(solved, key=lambda pair: pair[1].force)
    solutions = [_solve(problem, solution.values) for solution, _ in solved]
    best = min(solutions, key=lambda solution: solution.total)
    for other in solutions:
        shift = abs(other.values[Common.STIFFNESS] - best.values[Common.STIFFNESS])
        if shift > DISTINCT_SIGMAS * best.sigma[Common.STIFFNESS] and (
                other.total - best.total < AMBIGUITY_CHI_SQUARE * max(best.cost, 1.0)):
            first, second = (math.exp(one.values[Common.STIFFNESS]) for one in (best, other))
            raise EstimatorError(f'{first:.3g} N and {second:.3g} N fit equally well: requires '
                                 'speed changes of several sizes')
    return best


def _check_plausible(found: _Solution) -> None:
    """Raise EstimatorError if parameters with known limits contradict them."""
    latency, drag = (Uncertain(float(found.values[row]), float(found.sigma[row]))
                     for row in (Common.LATENCY_ERROR, Common.DRAG))
    if abs(latency.value) > MAX_LATENCY_ERROR:
        raise EstimatorError(f'the wheels are late by {latency.value:.3f} s in addition to '
                             'encoder.latency, or the axes of the IMU are wrong')
    if drag.value < -IMPLAUSIBLE_SIGMAS * drag.sigma:
        raise EstimatorError(f'the drag is negative, {drag.value:.2f} of the weight: the motion '
                             'is not that of a robot on level ground')


def _starts(problem: _Problem) -> list[Array]:
    starts = []
    for friction, factor in INITIAL_VALUES:
        common = problem.mean.copy()
        common[Common.FRICTION] = math.log(friction)
        common[Common.STIFFNESS] += math.log(factor)
        starts.append(np.concatenate([common, *(model.start() for model in problem.models)]))
    return starts


def _result(problem: _Problem, found: _Solution, bias: Array,
            robot: RobotParams) -> StiffnessFit:
    excess = max(1.0, found.cost)
    common, local = problem.split(found.values)
    sigma = np.hypot(math.sqrt(excess) * found.sigma, bias[1])
    common = common - bias[0]
    stiffness, friction = (math.exp(common[row]) for row in (Common.STIFFNESS, Common.FRICTION))
    weight = robot.mass * GRAVITY
    slip, fitted = (np.concatenate(column) for column in zip(*(
        model.motion(common, own) for model, own in zip(problem.models, local))))
    order = np.argsort(slip)
    return StiffnessFit(
        # a wrong radius scales all speeds, and thereby the forces
        Uncertain(stiffness, stiffness * math.hypot(
            RADIUS_ERROR_SIGMA, float(sigma[Common.STIFFNESS]))),
        Uncertain(friction, friction * float(sigma[Common.FRICTION])),
        Uncertain(weight * float(common[Common.DRAG]), weight * float(sigma[Common.DRAG])),
        Uncertain(float(common[Common.LATENCY_ERROR]), float(sigma[Common.LATENCY_ERROR])),
        len(problem.models), sum(float(np.ptp(model.segment.stamps)) for model in problem.models),
        slip, fitted, excess, (slip[order], fitted[order]))
