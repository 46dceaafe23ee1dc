"""
The stiffness C_x of a robot's tires from how it speeds up and brakes on a straight line.

Wheel speeds are explained by the acceleration (``stiffness_model``), not forces by slips: slips
are noisy, and a regression on them tells too small a stiffness; slips of the slip estimator,
which expects wheels to roll unless it sees otherwise, tell a yet smaller one. The inverse of C_x
is nearly linear in this model.

What else shows in the same way is estimated beside it: friction, which bends the curve at larger
slips; drag; an error of the rolling radius; a lateness of the wheels' stamps (one millisecond
looks like 2.4 % of C_x for the paper's robot at 0.8 m/s, but like another share at another
speed); of each run its first speed, and the bias and slope that the accelerometer feels.

The stiffness is in proportion to the mass that is given, and is that of tire and ground.
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
from smart_tire.calibration.tire.straight_segments import FEWEST, LEAST_SPEED, straight_runs
from smart_tire.errors import EstimatorError
from smart_tire.models.vehicle.skid_steer import GRAVITY
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain, UNDETERMINED, weighted_mean


TYPICAL_FRICTION, FRICTION_FACTOR = 0.45, 2.0  # of the grounds that there are; assumed
TYPICAL_DRAG, DRAG_SIGMA = 0.015, 0.15  # of the weight: firm ground, and up to deep sand
LATENESS_SIGMA = 0.003  # s, of what is known of the latency between wheels and unit; assumed
ROLLING_SIGMA = 0.02    # relative, of rolling radius and accelerometer scale; assumed
COMPLIANCE_SIGMA = 100.0  # -, nothing is known of it
FIRST_SIGMA = 1.0       # m/s, of a run's first speed, which the wheels soon tell
BIAS_SIGMA = 0.15       # m/s2, of a run: turn-on bias, mounting, slope of a street
FRICTIONS = (0.9, 0.3)  # from which fits start: a slippery ground may feign a soft tire
SIZES = (0.3, 0.02, 0.3, 1e-3, 0.01)  # of steps, in the order of ``Common``
RUN_SIZE = 0.02         # m/s and m/s2, likewise
SLIDES = 0.85           # of the force that wheels can hold, from which front or rear ones slide
MISFIT, HARD = 2.0, 0.7  # excess of a fit that sliding explains, and share of the force to drop
SUSPECT = 1.5           # excess, from which another start is tried
OUTLIER = 3.0           # sigmas, beyond which a reading counts less
MOST_STEPS = 60         # of the fit


@dataclass(frozen=True)
class StiffnessFit:
    """What straight runs tell."""

    stiffness: Uncertain  # N, C_x of one wheel
    friction: Uncertain   # -, mu, as far as it bends the curve
    drag: Uncertain       # N, of all wheels
    lateness: Uncertain   # s, by which the wheels' stamps seem later than known
    runs: int
    duration: float      # s, of all runs
    slip: Array          # (n,) -, of each stretch between wheel readings, as seen
    force: Array         # (n,) N, of one wheel, positive when driving
    excess: float        # mean square of residuals over that of their errors, at least 1
    curve: tuple[Array, Array]  # slip [-] and force [N] of one wheel as fitted


def identify_stiffness(recordings: Sequence[Recording], robot: RobotParams) -> StiffnessFit:
    """
    Return the stiffness that recordings on the same ground tell together.

    Where they differ by more than their errors, those grow. Raises EstimatorError with the reason
    where they do not tell it.
    """
    parts = [_below_sliding(recording, robot) for recording in recordings]
    fit = parts[0][0] if len(parts) == 1 else _fit([model for _, model in parts], robot)
    together, alone = fit.stiffness, [part.stiffness for part, _ in parts]
    fit = replace(fit, stiffness=_widened(together, alone))
    if not (fit.stiffness.value > 0.0 and fit.stiffness.determined):
        raise EstimatorError(_reason(fit.stiffness, alone if together.determined else ()))
    return fit


def _widened(together: Uncertain, alone: Sequence[Uncertain]) -> Uncertain:
    """Return ``together`` with a sigma that explains how ``alone`` scatter."""
    told = [item for item in alone if item.determined]
    if len(told) < 2:
        return together
    expected = sum(item.sigma ** -2 for item in told) ** -0.5
    return replace(together, sigma=together.sigma * weighted_mean(told).sigma / expected)


def _reason(told: Uncertain, alone: Sequence[Uncertain]) -> str:
    """Return why a stiffness is refused; of recordings that differ, what they tell ``alone``."""
    if len(alone) > 1:
        values = ', '.join(f'{item.value:.3g} ± {item.sigma:.2g}' for item in alone)
        return f'the recordings tell {values} N: they are not of one tire on one ground'
    return (f'standard error of {told.sigma / abs(told.value):.0%}, expected at most '
            f'{UNDETERMINED:.0%}: speed changes too little on straight lines, below critical slip')


def _below_sliding(recording: Recording, robot: RobotParams) -> tuple[StiffnessFit,
                                                                      StiffnessModel]:
    """Return the fit of what is below critical slip, and its model."""
    left_out = np.empty(0, np.intp)
    while True:
        runs = straight_runs(recording, robot, left_out)
        if runs is None:
            raise EstimatorError(
                f'no straight run of {FEWEST} wheel readings at more than {LEAST_SPEED:g} m/s' + (
                    f'; {len(left_out)} more are left out for wheels slide in them, or the ground '
                    'changes' if len(left_out) else ''))
        model = StiffnessModel(runs, robot)
        fit = _fit([model], robot)
        slides = _slides(fit, robot)
        if not slides.any():
            return fit, model
        left_out = np.concatenate([left_out, runs.row[slides]])


def _slides(fit: StiffnessFit, robot: RobotParams) -> NDArray[np.bool_]:
    """Return which stretches tell nothing, for the wheels slide or nearly so."""
    most = SLIDES * fit.friction.value * 0.25 * robot.mass * GRAVITY
    if fit.excess > MISFIT:  # friction is as wrong as all the rest: begin with the hardest
        most = min(most, HARD * float(np.max(np.abs(fit.force))))
    return np.abs(fit.force) > most


class _Problem:
    """Rows of all recordings, and priors, over the parameters of ``Common`` and of each run."""

    def __init__(self, models: Sequence[StiffnessModel]) -> None:
        self._models = models
        self.runs = sum(model.runs.count for model in models)
        each = np.ones(self.runs)
        self.mean = np.concatenate([
            [1.0, TYPICAL_DRAG, math.log(TYPICAL_FRICTION), 0.0, 0.0],
            [model.runs.speed[model.runs.run == i][0]
             for model in models for i in range(model.runs.count)], 0.0 * each])
        self._precision = 1.0 / np.concatenate([
            [COMPLIANCE_SIGMA, DRAG_SIGMA, math.log(FRICTION_FACTOR),
             LATENESS_SIGMA, ROLLING_SIGMA], FIRST_SIGMA * each, BIAS_SIGMA * each])
        self.size = np.concatenate([SIZES, RUN_SIZE * each, RUN_SIZE * each])

    def split(self, values: Array) -> list[tuple[StiffnessModel, int, Array, Array]]:
        """Return each model, the number of its first run, and its first speeds and biases."""
        parts, run = [], 0
        for model in self._models:
            own = slice(len(Common) + run, len(Common) + run + model.runs.count)
            parts.append((model, run, values[own], values[own.start + self.runs:
                                                          own.stop + self.runs]))
            run += model.runs.count
        return parts

    def residuals(self, values: Array) -> Array:
        """Return what the fit makes small: errors of wheel speeds and of priors, over sigmas."""
        common = values[:len(Common)]
        rows = [model.runs.whitened(model.runs.speed - model.speeds(common, first, biases))
                for model, _, first, biases in self.split(values)]
        return np.concatenate([*rows, self._precision * (self.mean - values)])

    def jacobian(self, values: Array) -> Array:
        """Return the derivatives of ``residuals``."""
        common, blocks = values[:len(Common)], []
        for model, run, first, biases in self.split(values):
            by_common, by_first, by_bias = model.slopes(common, first, biases)
            rows = np.arange(len(by_first))
            block = np.zeros((len(rows), len(values)))
            block[:, :len(Common)] = by_common
            column = len(Common) + run + model.runs.run
            block[rows, column], block[rows, column + self.runs] = by_first, by_bias
            blocks.append(-model.runs.whitened(block))
        return np.vstack([*blocks, -np.diag(self._precision)])


def _fit(models: Sequence[StiffnessModel], robot: RobotParams) -> StiffnessFit:
    problem = _Problem(models)
    rows = sum(len(model.runs.speed) for model in models)
    free = max(rows - 2 * problem.runs - len(Common), 1)
    results: list[OptimizeResult] = []
    for friction in FRICTIONS:
        if results and 2.0 * results[0].cost < SUSPECT * free:
            break
        start = problem.mean.copy()
        start[Common.FRICTION] = math.log(friction)
        results.append(least_squares(
            problem.residuals, start, problem.jacobian, x_scale=problem.size, loss='huber',
            f_scale=OUTLIER, max_nfev=MOST_STEPS))
    best = min(results, key=lambda result: float(result.cost))
    excess = max(1.0, 2.0 * float(best.cost) / free)
    covariance = excess * np.linalg.inv(best.jac.T @ best.jac)
    return _told(problem, best.x, np.sqrt(np.diag(covariance)), excess, robot)


def _told(problem: _Problem, values: Array, sigma: Array, excess: float,
          robot: RobotParams) -> StiffnessFit:
    def told(which: Common, value: float, by: float) -> Uncertain:
        """Return an estimate that changes so much ``by`` a parameter."""
        return Uncertain(value, abs(by) * float(sigma[which]))

    compliance, drag, friction, lateness, _ = values[:len(Common)].tolist()
    stiffness, weight = robot.tire.longitudinal_stiffness / compliance, robot.mass * GRAVITY
    friction = math.exp(friction)
    parts = problem.split(values)
    slip, force, fitted = (np.concatenate(column) for column in zip(*(
        _seen(model, values[:len(Common)], first, biases) for model, _, first, biases in parts)))
    order = np.argsort(fitted)
    return StiffnessFit(
        told(Common.COMPLIANCE, stiffness, stiffness / compliance),
        told(Common.FRICTION, friction, friction), told(Common.DRAG, weight * drag, weight),
        told(Common.LATENESS, lateness, 1.0),
        problem.runs, sum(float(np.sum(model.runs.end - model.runs.begin)) for model, *_ in parts),
        slip, force, excess, (fitted[order], force[order]))


def _seen(model: StiffnessModel, common: Array, first: Array,
          biases: Array) -> tuple[Array, Array, Array]:
    """Return slips as seen, forces [N] of one wheel and slips as fitted, of each stretch."""
    runs, motion = model.runs, model.motion(common, first, biases)
    ground, force, slip = (Signal(runs.time, values).mean(runs.begin, runs.end)
                           for values in (motion.ground, 0.25 * motion.force, motion.slip))
    return 1.0 - ground / runs.speed, force, slip
