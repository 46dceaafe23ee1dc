# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Nonlinear least squares over a window of some seconds, with the past in its prior.

The unknowns (``unknowns``) are fitted to the measurements of the window (``measurements``) by
Gauss-Newton steps with weights of a Student distribution. What leaves the window is marginalized
into the prior, linearized at the estimate; the prior then walks.

A change of ground is a second hypothesis: the same window, in which the ground changes at a
candidate time to one of which nothing is known. It is tried where the evidence of the linearized
equations favors it. From then on the first hypothesis is that of a disturbance, such as a push or
a lifted wheel: it does not use ``DISTURBANCE_TIME`` from that instant on. What follows decides
between both; until then the estimate is that of their mixture.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.estimation.ground import body_model as model
from smart_tire.estimation.ground.measurements import (
    disturbed, Measurements, Motion, Passage, STREAMS, WindowData)
from smart_tire.estimation.ground.unknowns import (
    CANDIDATES, CHANGE_EVIDENCE, CONVERGED, DECISION_TIME, DISTURBANCE_TIME, DYNAMIC, FREEDOM,
    GROUND, Hypothesis, initial, ITERATIONS, LENGTH, MAX_STEP, OLD_GROUND, OWN, Prior, priors,
    SIDES, SIDES_DIFFER, SIZE, START, TENSION, TRANSITION_TIME, TRIED_EVIDENCE, Unknown)
from smart_tire.numerics.levenberg_marquardt import gram, inverse_spd
from smart_tire.parameters.robot import RobotParams


class Rows(NamedTuple):
    """Residuals and derivatives of the measurements, each whitened by its covariance."""

    residual: Array    # (rows,)
    jacobian: Array    # (rows, SIZE)


class Fit(NamedTuple):
    """Unknowns of a window with their covariance."""

    x: Array           # (SIZE,)
    covariance: Array  # (SIZE, SIZE)
    cost: float        # minus twice the logarithm of the evidence, up to a constant
    motion: Motion     # of one run
    varied_x: Array    # (DYNAMIC + 1, SIZE), unknowns with small differences ...
    varied: Motion     # ... and the motion by them
    heading: Array     # rad, (n,), by the start of the fit
    rows: Rows
    whiten: Whitening
    leaving: tuple[Array, Array]  # information matrix and vector of what leaves the window


class Tension(NamedTuple):
    """The error of a sensor or of the robot that is largest over the sigma of its prior."""

    name: str
    size: float        # sigmas


class Solution(NamedTuple):
    """Estimate at the end of a window."""

    end: float         # s
    measurements: Measurements
    hypothesis: Hypothesis
    fit: Fit           # its covariance is widened by the tension
    tension: Tension

    def values_at(self, time: float, wheels: Iterable[int]) -> tuple[Array, Array]:
        """
        Return the values of ``Measurements.at`` (wheels, 5) at ``time`` [s] for indices of wheels.

        The second array (wheels, 5, DYNAMIC) are their derivatives by the unknowns.
        """
        fit, change = self.fit, self.hypothesis.change
        runs = np.vstack([fit.x, fit.varied_x])
        values = self.measurements.at(
            [Passage(time, wheel, 0.0, 0.0, np.eye(2), False) for wheel in wheels], runs,
            np.full(len(runs), change), np.concatenate([fit.motion.states, fit.varied.states]))
        steps = np.diagonal(fit.varied_x[1:] - fit.varied_x[0])
        slopes = (values[2:] - values[1]) / steps[:, np.newaxis, np.newaxis]
        return values[0], slopes.transpose(1, 2, 0)


class Whitening:
    """Covariances of blocks (STREAMS, n, n) and passages (m, m) with weights for outliers."""

    def __init__(self, blocks: Array, films: Array, residual: Array, passages: Array,
                 weighted: bool) -> None:
        self.blocks, self.films = blocks, films
        if weighted:
            square = residual ** 2 / np.diagonal(blocks, axis1=1, axis2=2)
            scale = np.sqrt(np.maximum((FREEDOM + square) / (FREEDOM + 1.0), 1.0))
            self.blocks = blocks * scale[:, :, np.newaxis] * scale[:, np.newaxis]
            each = (passages ** 2 / np.diag(films)).reshape(-1, 2).mean(axis=1)
            film_scale = np.repeat(
                np.sqrt(np.maximum((FREEDOM + each) / (FREEDOM + 1.0), 1.0)), 2)
            self.films = films * np.outer(film_scale, film_scale)
        self._block_factor = np.linalg.cholesky(self.blocks)
        self._film_factor = np.linalg.cholesky(self.films)

    def __call__(self, blocks: Array, passages: Array) -> Array:
        """Return blocks (STREAMS, n, k) and passages (m, k), whitened: (rows, k)."""
        columns = blocks.shape[-1]
        return np.concatenate([
            np.linalg.solve(self._block_factor, blocks).reshape(-1, columns),
            np.linalg.solve(self._film_factor, passages)])

    def information(self, blocks: Array, passages: Array, leaving: NDArray[np.bool_],
                    films: NDArray[np.bool_]) -> Array:
        """Return the products (k, k) of the columns of the rows that leave the window."""
        own = self.blocks[:, leaving][:, :, leaving]
        rows = blocks[:, leaving]
        found: Array = np.einsum('sik,sil->kl', rows, np.linalg.solve(own, rows))
        part = passages[films]
        return found + part.T @ np.linalg.solve(self.films[films][:, films], part)


class GroundWindow:
    """The window of one robot; ``solve`` moves it on."""

    def __init__(self, robot: RobotParams) -> None:
        self._robot, self._rows = robot, priors(robot)
        self._steps = np.array([row.step for row in self._rows[:DYNAMIC]])
        prior = initial(self._rows)
        self._main = Hypothesis(prior, prior.mean)
        self._rival: Hypothesis | None = None
        self.changes = 0  # of the ground

    def solve(self, data: WindowData, begin: float, end: float, hop: float) -> Solution:
        """Return the estimate from samples of ``begin`` to ``end`` [s], ``hop`` after the last."""
        first = max(begin, end - LENGTH)
        measurements = Measurements(self._robot, data, begin, first, end)
        leaving = first + hop if begin < first else -math.inf
        main, fit = self._fitted(self._main, measurements, leaving)
        found: tuple[Hypothesis, Fit] | None = None
        if self._rival is not None:
            found = self._fitted(self._rival, measurements, leaving)
        elif main.change < end - LENGTH and begin < first:
            found = self._changed(main, fit, measurements, leaving)
            if found is not None:
                change = found[0].change
                main, fit = self._fitted(replace(main, disturbances=(
                    *main.disturbances, (change, change + DISTURBANCE_TIME))),
                    measurements, leaving)
        best = main, fit
        if found is not None:
            change = found[0].change
            gain = _gain(fit, found[1], measurements, change)
            if gain > CHANGE_EVIDENCE:
                self.changes += 1
                best = main, fit = found
                found = None
            elif end - change > DECISION_TIME:
                found = None
            else:
                likely, other = (found, (main, fit)) if gain > 0.0 else ((main, fit), found)
                best = likely[0], _mixed(likely[1], other[1])
        self._main = self._advanced(main, fit, measurements, hop)
        self._rival = None if found is None else self._advanced(*found, measurements, hop)
        hypothesis, fit = best
        tension = self._tension(fit.x)
        excess = max(1.0, (tension.size / TENSION) ** 2)
        return Solution(end, measurements, hypothesis, fit._replace(
            covariance=excess * fit.covariance), tension)

    def _tension(self, x: Array) -> Tension:
        """Return the nuisance that contradicts its prior most."""
        sizes = [abs(value - row.mean) / row.sigma for value, row in zip(x, self._rows)]
        most = max((*range(Unknown.COM_X, Unknown.SLOPE_X), Unknown.DELAY,
                    *range(Unknown.GYRO_BIAS, SIZE)), key=sizes.__getitem__)
        first = max(one for one in Unknown if one <= most)
        return Tension(f'{first.name.lower()}_{most - first}' if most > first else
                       first.name.lower(), sizes[most])

    def _fitted(self, hypothesis: Hypothesis, measurements: Measurements, leaving: float
                ) -> tuple[Hypothesis, Fit]:
        """Return the fit; if it contradicts equal sides, with a prior that lets them differ."""
        fit = self._fit(hypothesis, measurements, leaving)
        mean, covariance = hypothesis.prior
        difference = (fit.x - mean)[SIDES]
        square = difference @ np.linalg.solve(covariance[SIDES, SIDES], difference) / 3.0
        if square < SIDES_DIFFER:
            return hypothesis, fit
        covariance = covariance.copy()
        covariance[SIDES] *= math.sqrt(square)
        covariance[:, SIDES] *= math.sqrt(square)
        wider = replace(hypothesis, prior=Prior(mean, covariance), x=fit.x)
        return wider, self._fit(wider, measurements, leaving)

    def _fit(self, hypothesis: Hypothesis, measurements: Measurements, leaving: float) -> Fit:
        prior = hypothesis.prior.of_next_window(self._rows)
        information = np.linalg.inv(prior.covariance)
        x = hypothesis.x.copy()
        x[OWN] = 0.0
        start, heading = _start(hypothesis, measurements)
        change = hypothesis.change
        known = hypothesis.times is not None and change < measurements.begin  # near the solution
        blocks = films = None
        steps, covariance = self._steps.copy(), prior.covariance
        for iteration in range(ITERATIONS if known else 2 * ITERATIONS):
            steps[Unknown.FRICTION] = self._friction_step(x, covariance)
            runs = np.tile(x, (DYNAMIC + 1, 1))
            runs[range(1, DYNAMIC + 1), range(DYNAMIC)] += steps
            varied = measurements.simulate(runs, start, heading, np.full(len(runs), change))
            predicted, passages = (measurements.predict(runs, varied),
                                   measurements.passage_values(runs, varied))
            if blocks is None or films is None:
                relaxed = measurements.simulate(
                    runs[:1], start, heading, np.array([change]),
                    0.5 * self._robot.tire.contact_length)
                blocks = measurements.noise(
                    predicted[0], measurements.predict(runs[:1], relaxed)[0] - predicted[0],
                    x[Unknown.GYRO_BIAS:Unknown.ACCEL_BIAS_Y + 1], hypothesis.disturbances)
                films = measurements.passage_noise(passages[0], hypothesis.disturbances)
            residual = measurements.values - predicted[0]
            film_residual = measurements.passage_measured - passages[0]
            whiten = Whitening(blocks, films, residual, film_residual, known or iteration > 0)
            columns = self._columns(x, predicted, residual, measurements, varied, steps)
            film_columns = self._film_columns(x, passages, film_residual, measurements, steps)
            white = whiten(columns, film_columns)
            rows = Rows(white[:, -1], white[:, :-1])
            hessian = information + gram(rows.jacobian.T, np.ones(len(rows.residual)))
            covariance = inverse_spd(hessian)
            step = covariance @ (information @ (prior.mean - x) + rows.jacobian.T @ rows.residual)
            step *= min(1.0, MAX_STEP / max(float(np.abs(step[:DYNAMIC]).max()), 1e-9))
            at, x = x, x + step
            if np.max(np.abs(step) / np.sqrt(np.diag(covariance))) < CONVERGED:
                break
        motion = measurements.simulate(x[np.newaxis], start, heading, np.array([change]))
        final = rows._replace(residual=rows.residual - rows.jacobian @ (x - at))
        cost = float(final.residual @ final.residual
                     + (x - prior.mean) @ information @ (x - prior.mean)
                     + np.linalg.slogdet(hessian)[1] - np.linalg.slogdet(information)[1])
        columns[:, :, -1] += columns[:, :, :-1] @ at
        film_columns[:, -1] += film_columns[:, :-1] @ at
        left = whiten.information(
            columns, film_columns, measurements.used & (measurements.centers < leaving),
            np.repeat([one.time < leaving for one in measurements.passages], 2).astype(bool))
        return Fit(x, covariance, cost, motion, runs, varied, heading, final, whiten,
                   (left[:-1, :-1], left[:-1, -1]))

    def _friction_step(self, x: Array, covariance: Array) -> float:
        """
        Return the step of ln mu for its derivative: up to the mean of its prior, 1 to 2 sigmas.

        A tire that adheres shows less of its friction, the larger it is. The local derivative at a
        friction that is too low would claim to exclude a larger one, for all windows that follow.
        """
        sigma = math.sqrt(covariance[Unknown.FRICTION, Unknown.FRICTION])
        likely = float(self._rows[Unknown.FRICTION].mean - x[Unknown.FRICTION])
        return min(max(likely, sigma), 2.0 * sigma)

    def _columns(self, x: Array, predicted: Array, residual: Array, measurements: Measurements,
                 motion: Motion, steps: Array) -> Array:
        """Return derivatives of the block means and their residual (STREAMS, blocks, SIZE + 1)."""
        dynamic = (predicted[1:] - predicted[0]) / steps[:, np.newaxis, np.newaxis]
        return np.concatenate([
            dynamic.transpose(1, 2, 0), measurements.linear(x, predicted[0], motion),
            residual[:, :, np.newaxis]], axis=2)

    def _film_columns(self, x: Array, passages: Array, residual: Array,
                      measurements: Measurements, steps: Array) -> Array:
        """Return derivatives of the passages and their residual (2 * passages, SIZE + 1)."""
        found = np.zeros((len(residual), SIZE + 1))
        found[:, :DYNAMIC] = ((passages[1:] - passages[0]) / steps[:, np.newaxis]).T
        for i, one in enumerate(measurements.passages):
            rows = slice(2 * i, 2 * i + 2 - one.sliding)
            found[rows, Unknown.FILM_GAIN + one.wheel] = passages[0, rows]
            found[2 * i + 1, Unknown.FILM_ERROR + one.wheel] = not one.sliding
        found[:, -1] = residual
        return found

    def _changed(self, main: Hypothesis, fit: Fit, measurements: Measurements, leaving: float
                 ) -> tuple[Hypothesis, Fit] | None:
        """Return a fit with a change of ground if that is much more likely; None otherwise."""
        candidates = [measurements.times[-1] - before for before in CANDIDATES]
        runs = np.tile(fit.x, (3 * len(candidates) + 1, 1))
        runs[:, OLD_GROUND] = fit.x[GROUND]
        steps = np.tile(self._steps[GROUND], len(candidates))
        runs[range(1, len(runs)), np.tile(range(3), len(candidates))] += steps
        start, _ = _start(main, measurements)
        motion = measurements.simulate(runs, start + fit.x[START], fit.heading, np.array(
            [-math.inf, *np.repeat(candidates, 3)]))
        blocks = measurements.predict(runs, motion)
        films = measurements.passage_values(runs, motion)
        white = fit.whiten(((blocks[1:] - blocks[0]).T / steps).transpose(1, 0, 2),
                           ((films[1:] - films[0]).T / steps))
        spread = np.diag([self._rows[row].sigma ** -2 for row in range(3)])
        best, found = TRIED_EVIDENCE, None
        for i, candidate in enumerate(candidates):
            own = white[:, 3 * i:3 * i + 3]
            mixed = own.T @ fit.rows.jacobian
            matrix = own.T @ own - mixed @ fit.covariance @ mixed.T
            gradient = own.T @ fit.rows.residual
            gain = float(gradient @ np.linalg.solve(matrix + spread, gradient)
                         - np.linalg.slogdet(np.eye(3) + np.linalg.solve(spread, matrix))[1])
            if gain > best:
                best, found = gain, candidate
        if found is None:
            return None
        x = fit.x.copy()
        x[OLD_GROUND] = x[GROUND]
        rival = replace(main, prior=main.prior.with_change(self._rows), x=x, change=found,
                        disturbances=(*main.disturbances, (found, found + TRANSITION_TIME)))
        rival, changed = self._fitted(rival, measurements, leaving)
        return (rival, changed) if fit.cost - changed.cost > TRIED_EVIDENCE else None

    def _advanced(self, hypothesis: Hypothesis, fit: Fit, measurements: Measurements,
                  hop: float) -> Hypothesis:
        """Return the hypothesis before the next window."""
        prior = hypothesis.prior
        information = np.linalg.inv(prior.covariance)
        matrix, vector = fit.leaving
        covariance = np.asarray(np.linalg.inv(information + matrix), dtype=np.float64)
        mean: Array = covariance @ (information @ prior.mean + vector)
        moved = Prior(mean, covariance).after(
            hop, measurements.travel * hop / (measurements.times[-1] - measurements.begin),
            self._rows)
        middle = int(np.searchsorted(measurements.times, measurements.begin + hop))
        middle = min(middle, len(measurements.times) - 1)
        kept = tuple(one for one in hypothesis.disturbances if one[1] > measurements.begin)
        return replace(
            hypothesis, disturbances=kept, prior=moved.of_next_window(self._rows), x=fit.x,
            times=measurements.times, velocities=fit.motion.states[0, :, :model.W + 1],
            heading=(float(measurements.times[middle]), float(fit.heading[middle])))


def _gain(fit: Fit, other: Fit, measurements: Measurements, change: float) -> float:
    """
    Return twice the logarithm of the evidence for ``other``, in which the ground changes.

    What was measured in the disturbance of ``fit`` does not count.
    """
    own = change, change + DISTURBANCE_TIME
    times = np.array([one.time for one in measurements.passages])
    unused = np.concatenate([np.tile(disturbed(measurements.centers, [own]), STREAMS),
                             np.repeat(disturbed(times, [own]), 2)])
    residual = other.rows.residual[unused]
    return fit.cost - other.cost + float(residual @ residual)


def _mixed(fit: Fit, other: Fit) -> Fit:
    """
    Return the likelier ``fit`` with the covariance of the mixture of both.

    The old ground is that of ``fit``: the other one may have none.
    """
    difference, own = other.x - fit.x, other.covariance.copy()
    difference[OLD_GROUND], own[OLD_GROUND], own[:, OLD_GROUND] = 0.0, 0.0, 0.0
    own[OLD_GROUND, OLD_GROUND] = fit.covariance[OLD_GROUND, OLD_GROUND]
    return fit._replace(covariance=0.5 * (
        fit.covariance + own + np.outer(difference, difference)))


def _start(hypothesis: Hypothesis, measurements: Measurements) -> tuple[Array, Array]:
    """Return the velocity (3,) at the begin of the window, and the heading (n,) [rad]."""
    bias = float(hypothesis.x[Unknown.GYRO_BIAS])
    heading = measurements.heading(bias, hypothesis.heading)
    times, velocities = hypothesis.times, hypothesis.velocities
    if times is None or velocities is None or not times[0] <= measurements.begin <= times[-1]:
        return np.array([measurements.rolling[0].mean(), 0.0,
                         measurements.values[0, 0] - bias]), heading
    return np.array([np.interp(measurements.begin, times, column)
                     for column in velocities.T]), heading
