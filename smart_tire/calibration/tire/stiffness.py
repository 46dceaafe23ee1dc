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

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import Recording
from smart_tire.calibration.tire.simulated_segments import simulated
from smart_tire.calibration.tire.stiffness_model import Common, SegmentModel
from smart_tire.calibration.tire.stiffness_solver import (
    estimated_noise, Problem, Solution, solve, solved_from, starts, unambiguous)
from smart_tire.calibration.tire.straight_segments import (
    MIN_SEGMENT_INTERVALS, MIN_SPEED, straight_segments, StraightSegment)
from smart_tire.errors import EstimatorError
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import MAX_RELATIVE_SIGMA, Uncertain, weighted_mean

LATENCY_ERROR_SIGMA = 0.01  # s, of the configured latency between wheels and IMU; assumed
RADIUS_ERROR_SIGMA = 0.02   # relative, of the rolling radius; assumed
MAX_NOISE_SHARE = 0.08      # of accelerations; more noise makes a tire seem too stiff
MAX_LATENCY_ERROR = 0.04    # s, of the configured latency
IMPLAUSIBLE_SIGMAS = 4.0    # standard errors by which a drag may be negative
MAX_FORCE_ERROR_SHARE = 0.3  # of accelerations, of the force balance
REPETITIONS = 4             # of the fit, on simulated segments
REPEATED_CONVERGED = 0.1    # of a step over the standard errors, in a repetition


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


def _fit(models: Sequence[SegmentModel], robot: RobotParams, latency_sigma: float,
         debiased: bool) -> StiffnessFit:
    problem = Problem(models, robot, latency_sigma)
    # a value that is not written needs no proof that it is the only one
    initial = starts(problem) if debiased else starts(problem)[:1]
    found = unambiguous(problem, [solved_from(problem, start) for start in initial])
    error = problem.noise.force / _acceleration_spread([model.segment for model in models])
    if error > MAX_FORCE_ERROR_SHARE:
        raise EstimatorError(
            f'the force balance has an error of {error:.0%} of the accelerations, expected at '
            f'most {MAX_FORCE_ERROR_SHARE:.0%}: wheels slide, the ground changes, or the axes of '
            'the IMU are wrong')
    _check_plausible(found)
    bias = _bias(problem, found, robot) if debiased else np.zeros((2, len(Common)))
    return _result(problem, found, bias, robot)


def _bias(problem: Problem, found: Solution, robot: RobotParams) -> Array:
    """Return the mean error of the common parameters, and its standard error, (2, p)."""
    common, local = problem.split(found.values)
    rng, errors = np.random.default_rng(0), []
    for _ in range(REPETITIONS):
        models = [SegmentModel(simulated(model, common, own, problem.noise, rng), robot)
                  for model, own in zip(problem.models, local)]
        repeated = Problem(models, robot, problem.latency_sigma)
        repeated.noise = problem.noise
        fit = solve(repeated, found.values, REPEATED_CONVERGED)
        repeated.noise = estimated_noise(repeated, fit)
        fit = solve(repeated, fit.values, REPEATED_CONVERGED)
        errors.append(fit.values[:len(Common)] - common)
    return np.stack([np.mean(errors, axis=0),
                     np.std(errors, axis=0, ddof=1) / math.sqrt(REPETITIONS)])


def _check_plausible(found: Solution) -> None:
    """Raise EstimatorError if parameters with known limits contradict them."""
    latency, drag = (Uncertain(float(found.values[row]), float(found.sigma[row]))
                     for row in (Common.LATENCY_ERROR, Common.DRAG))
    if abs(latency.value) > MAX_LATENCY_ERROR:
        raise EstimatorError(f'the wheels are late by {latency.value:.3f} s in addition to '
                             'encoder.latency, or the axes of the IMU are wrong')
    if drag.value < -IMPLAUSIBLE_SIGMAS * drag.sigma:
        raise EstimatorError(f'the drag is negative, {drag.value:.2f} of the weight: the motion '
                             'is not that of a robot on level ground')


def _result(problem: Problem, found: Solution, bias: Array,
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
