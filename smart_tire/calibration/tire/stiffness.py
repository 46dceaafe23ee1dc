"""
Longitudinal stiffness C_x of the tires from acceleration and braking on straight lines.

The regression explains wheel speeds by the acceleration (``stiffness_model``), not forces by
slips: slips are noisy, and a regression on them underestimates the stiffness. Slips of the slip
estimator, whose prior is free rolling, would bias it even more. The model is nearly linear in the
inverse of C_x.

Parameters with similar effects are estimated as well: friction, which bends the curve at larger
slips; drag; an error of the rolling radius; an error of the wheel latency (one millisecond
corresponds to 2.4 % of C_x for the paper's robot at 0.8 m/s, with another share at other speeds);
and for each segment its initial speed, and accelerometer bias plus slope of the ground.

The stiffness is proportional to the configured mass; it is that of the tire-ground pair.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, OptimizeResult

from smart_tire.arrays import Array
from smart_tire.calibration.recording import Recording, Signal
from smart_tire.calibration.tire.stiffness_model import Common, StiffnessModel
from smart_tire.calibration.tire.straight_segments import (
    MIN_SEGMENT_INTERVALS, MIN_SPEED, straight_segments)
from smart_tire.errors import EstimatorError
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import MAX_RELATIVE_SIGMA, Uncertain, weighted_mean

FRICTION_PRIOR, FRICTION_FACTOR = 0.45, 2.0   # median and factor per sigma of grounds; assumed
DRAG_PRIOR, DRAG_SIGMA = 0.015, 0.15          # of the weight: firm ground, and up to deep sand
LATENCY_ERROR_SIGMA = 0.003  # s, of the configured latency between wheels and IMU; assumed
RADIUS_ERROR_SIGMA = 0.02  # relative, of rolling radius and accelerometer scale; assumed
COMPLIANCE_SIGMA = 100.0                      # -, uninformative
INITIAL_SPEED_SIGMA = 1.0                     # m/s, of a segment; uninformative
BIAS_SIGMA = 0.15  # m/s2, of a segment: turn-on bias, mounting, slope of the ground
INITIAL_FRICTIONS = (0.9, 0.3)  # starts of the fit: a slippery ground may mimic a soft tire
COMMON_SCALES = (0.3, 0.02, 0.3, 1e-3, 0.01)  # of the step, in the order of ``Common``
SEGMENT_SCALE = 0.02                          # m/s and m/s2, of the step
MAX_ADHESION_SHARE = 0.85  # of the friction limit, beyond which front or rear wheels may slide
POOR_EXCESS = 2.0                             # excess of a fit that includes sliding,
HARD_FORCE_SHARE = 0.7  # ... for which intervals above this share of the largest force are dropped
RESTART_EXCESS = 1.5                          # above which another start is tried
HUBER_THRESHOLD = 3.0                         # sigmas, beyond which an interval has lower weight
MAX_EVALUATIONS = 60                          # of the residuals in a fit


@dataclass(frozen=True)
class StiffnessFit:
    """Stiffness and the parameters estimated with it, with the data for figures."""

    stiffness: Uncertain      # N, C_x of one wheel
    friction: Uncertain       # -, mu, from the bend of the curve
    drag: Uncertain           # N, of all wheels
    latency_error: Uncertain  # s, of the wheel timestamps in addition to the configured latency
    segments: int
    duration: float             # s, of all segments
    slip: Array                 # (n,) -, of each interval between wheel samples, as measured
    force: Array                # (n,) N, of one wheel, positive when driving
    excess: float               # mean squared normalized residual, at least 1
    curve: tuple[Array, Array]  # slip [-] and force [N] of one wheel as fitted


def identify_stiffness(recordings: Sequence[Recording], robot: RobotParams) -> StiffnessFit:
    """
    Return the stiffness from recordings on the same ground.

    If recordings differ by more than their standard errors, those are scaled up. Raises
    EstimatorError with the reason if the stiffness is not observable.
    """
    fits = [_fit_below_sliding(recording, robot) for recording in recordings]
    fit = fits[0][0] if len(fits) == 1 else _fit([model for _, model in fits], robot)
    combined, separate = fit.stiffness, [part.stiffness for part, _ in fits]
    fit = replace(fit, stiffness=_scaled_by_scatter(combined, separate))
    if not (fit.stiffness.value > 0.0 and fit.stiffness.determined):
        raise EstimatorError(_refusal(fit.stiffness, separate if combined.determined else ()))
    return fit


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


def _fit_below_sliding(recording: Recording, robot: RobotParams) -> tuple[StiffnessFit,
                                                                          StiffnessModel]:
    """Return the fit of the intervals below critical slip, and its model."""
    left_out = np.empty(0, np.intp)
    while True:
        segments = straight_segments(recording, robot, left_out)
        if segments is None:
            excluded = (f'; {len(left_out)} more are excluded because wheels slide or the ground '
                        'changes' if len(left_out) else '')
            raise EstimatorError(f'no straight segment of {MIN_SEGMENT_INTERVALS} wheel samples '
                                 f'above {MIN_SPEED:g} m/s{excluded}')
        model = StiffnessModel(segments, robot)
        fit = _fit([model], robot)
        sliding = _sliding(fit, robot)
        if not sliding.any():
            return fit, model
        left_out = np.concatenate([left_out, segments.row[sliding]])


def _sliding(fit: StiffnessFit, robot: RobotParams) -> NDArray[np.bool_]:
    """Return a mask of intervals in which wheels slide or nearly so."""
    limit = MAX_ADHESION_SHARE * fit.friction.value * 0.25 * robot.mass * GRAVITY
    if fit.excess > POOR_EXCESS:  # friction is unreliable: begin with the largest forces
        limit = min(limit, HARD_FORCE_SHARE * float(np.max(np.abs(fit.force))))
    return np.abs(fit.force) > limit


class _LeastSquares:
    """Residuals of all recordings and priors, for parameters of ``Common`` and of segments."""

    def __init__(self, models: Sequence[StiffnessModel]) -> None:
        self._models = models
        self.segments = sum(model.segments.count for model in models)
        ones = np.ones(self.segments)
        self.mean = np.concatenate([
            [1.0, DRAG_PRIOR, math.log(FRICTION_PRIOR), 0.0, 0.0],
            [model.segments.speed[model.segments.segment == i][0]
             for model in models for i in range(model.segments.count)], 0.0 * ones])
        self._precision = 1.0 / np.concatenate([
            [COMPLIANCE_SIGMA, DRAG_SIGMA, math.log(FRICTION_FACTOR), LATENCY_ERROR_SIGMA,
             RADIUS_ERROR_SIGMA], INITIAL_SPEED_SIGMA * ones, BIAS_SIGMA * ones])
        self.scale = np.concatenate([COMMON_SCALES, SEGMENT_SCALE * ones, SEGMENT_SCALE * ones])

    def split(self, values: Array) -> list[tuple[StiffnessModel, int, Array, Array]]:
        """Return each model, the index of its first segment, its initial speeds and biases."""
        parts, segment = [], 0
        for model in self._models:
            own = slice(len(Common) + segment, len(Common) + segment + model.segments.count)
            biases = values[own.start + self.segments:own.stop + self.segments]
            parts.append((model, segment, values[own], biases))
            segment += model.segments.count
        return parts

    def residuals(self, values: Array) -> Array:
        """Return normalized residuals of wheel speeds and priors."""
        common = values[:len(Common)]
        rows = [model.segments.whitened(
                    model.segments.speed - model.speeds(common, initial_speeds, biases))
                for model, _, initial_speeds, biases in self.split(values)]
        return np.concatenate([*rows, self._precision * (self.mean - values)])

    def jacobian(self, values: Array) -> Array:
        """Return the derivatives of ``residuals``."""
        common, blocks = values[:len(Common)], []
        for model, segment, initial_speeds, biases in self.split(values):
            by_common, by_speed, by_bias = model.derivatives(common, initial_speeds, biases)
            rows = np.arange(len(by_speed))
            block = np.zeros((len(rows), len(values)))
            block[:, :len(Common)] = by_common
            column = len(Common) + segment + model.segments.segment
            block[rows, column], block[rows, column + self.segments] = by_speed, by_bias
            blocks.append(-model.segments.whitened(block))
        return np.vstack([*blocks, -np.diag(self._precision)])


def _fit(models: Sequence[StiffnessModel], robot: RobotParams) -> StiffnessFit:
    problem = _LeastSquares(models)
    rows = sum(len(model.segments.speed) for model in models)
    freedom = max(rows - 2 * problem.segments - len(Common), 1)
    results: list[OptimizeResult] = []
    for friction in INITIAL_FRICTIONS:
        if results and 2.0 * results[0].cost < RESTART_EXCESS * freedom:
            break
        start = problem.mean.copy()
        start[Common.FRICTION] = math.log(friction)
        results.append(least_squares(
            problem.residuals, start, problem.jacobian, x_scale=problem.scale, loss='huber',
            f_scale=HUBER_THRESHOLD, max_nfev=MAX_EVALUATIONS))
    best = min(results, key=lambda result: float(result.cost))
    excess = max(1.0, 2.0 * float(best.cost) / freedom)
    covariance = excess * np.linalg.inv(best.jac.T @ best.jac)
    return _result(problem, best.x, np.sqrt(np.diag(covariance)), excess, robot)


def _result(problem: _LeastSquares, values: Array, sigma: Array, excess: float,
            robot: RobotParams) -> StiffnessFit:
    def uncertain(parameter: Common, value: float, derivative: float) -> Uncertain:
        return Uncertain(value, abs(derivative) * float(sigma[parameter]))

    common = values[:len(Common)]
    compliance, drag, friction, latency_error, _ = common.tolist()
    stiffness, weight = robot.tire.longitudinal_stiffness / compliance, robot.mass * GRAVITY
    friction = math.exp(friction)
    parts = problem.split(values)
    slip, force, fitted = (np.concatenate(column) for column in zip(*(
        _measured(model, common, initial_speeds, biases)
        for model, _, initial_speeds, biases in parts)))
    duration = sum(float(np.sum(model.segments.end - model.segments.begin))
                   for model, *_ in parts)
    order = np.argsort(fitted)
    return StiffnessFit(
        uncertain(Common.COMPLIANCE, stiffness, stiffness / compliance),
        uncertain(Common.FRICTION, friction, friction),
        uncertain(Common.DRAG, weight * drag, weight),
        uncertain(Common.LATENCY_ERROR, latency_error, 1.0),
        problem.segments, duration, slip, force, excess, (fitted[order], force[order]))


def _measured(model: StiffnessModel, common: Array, initial_speeds: Array,
              biases: Array) -> tuple[Array, Array, Array]:
    """Return measured slip, force [N] of one wheel and fitted slip of each interval."""
    segments, motion = model.segments, model.motion(common, initial_speeds, biases)
    ground, force, slip = (Signal(segments.time, values).mean(segments.begin, segments.end)
                           for values in (motion.ground, 0.25 * motion.force, motion.slip))
    return 1.0 - ground / segments.speed, force, slip
