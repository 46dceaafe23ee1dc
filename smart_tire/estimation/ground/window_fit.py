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
Gauss-Newton fit of the unknowns to the measurements of a window, under a hypothesis.

Errors have the weights of a Student distribution, by which hypotheses are compared, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.estimation.ground import body_model as model
from smart_tire.estimation.ground.measurements import Measurements, TORQUE, WindowMotion
from smart_tire.estimation.ground.unknowns import (
    CONVERGED, CURVE, DERIVATIVE_STEP, DYNAMIC, FREEDOM, Hypothesis, MAX_ITERATIONS, MAX_SIGMA,
    MAX_STEP, MOVED, NOISE_SIGMAS, OLD_GROUND, ONE_GROUND, OWN, Row, SIDES, SIZE, TENSION,
    Unknown, UNMEASURED, WindowPrior)
from smart_tire.numerics.levenberg_marquardt import gram, inverse_factor, inverse_spd
from smart_tire.parameters.robot import RobotParams


class WhitenedRows(NamedTuple):
    """Residuals and derivatives of the measurements, each whitened by its covariance."""

    residual: Array    # (rows,)
    jacobian: Array    # (rows, SIZE)


class WindowNoise:
    """Covariances of blocks (STREAMS, n, n) and crossings (m, m), with their factors."""

    def __init__(self, blocks: Array, films: Array) -> None:
        self.blocks, self.films = blocks, films
        self._blocks = np.array([inverse_factor(one) for one in blocks])
        self._films = inverse_factor(films)
        self.variances = _diagonals(blocks, films)  # by row, and those given the rows before
        self.ln_variances = -2.0 * np.log(_diagonals(self._blocks, self._films))

    def whitened(self, blocks: Array, crossings: Array) -> Array:
        """Return blocks (STREAMS, n, k) and crossings (m, k), whitened: (rows, k)."""
        return np.concatenate([(self._blocks @ blocks).reshape(-1, blocks.shape[-1]),
                               self._films @ crossings])


class WindowEstimate(NamedTuple):
    """Unknowns of a window with their covariance."""

    x: Array           # (SIZE,)
    covariance: Array  # (SIZE, SIZE)
    cost: float        # minus twice the logarithm of the evidence, up to a constant
    motion: WindowMotion  # of one run
    varied_x: Array    # (DYNAMIC + 1, SIZE), unknowns with small differences ...
    varied: WindowMotion  # ... the motion by them, of those that have an effect ...
    shown: NDArray[np.intp]  # (DYNAMIC + 1,), ... and the run of each of them
    start: Array       # (3,), velocity at the begin of the window, of all runs
    heading: Array     # rad, (n,), by the start of the fit
    rows: WhitenedRows
    whiten: Whitening
    noise: WindowNoise  # without weights
    information: Array  # (SIZE, SIZE), of the prior
    leaving: tuple[Array, Array]  # information matrix and vector of what leaves the window


class Whitening:
    """Whitens with ``noise`` and weights for outliers."""

    def __init__(self, noise: WindowNoise, residual: Array, crossings: Array, weighted: bool,
                 disturbances: Sequence[NDArray[np.bool_]]) -> None:
        squares = np.concatenate([residual.ravel(), crossings]) ** 2 / noise.variances
        films = squares[residual.size:].reshape(-1, 2)
        films[:] = 0.5 * (films[:, :1] + films[:, 1:])
        off = np.logical_or.reduce(disturbances)  # False without any
        growth = np.where(off if weighted else True, 1.0,
                          np.maximum((FREEDOM + squares) / (FREEDOM + 1.0), 1.0))
        scale = np.sqrt(growth)[:, np.newaxis]
        self._scale, self._film_scale = (
            scale[:residual.size].reshape(*residual.shape, 1), scale[residual.size:])
        self._noise = noise
        if off.any():
            unused = UNMEASURED ** 2 * off * noise.variances
            self._noise = WindowNoise(
                noise.blocks + np.eye(residual.shape[1]) * unused[:residual.size].reshape(
                    residual.shape)[:, np.newaxis],
                noise.films + np.diag(unused[residual.size:]))
        # by row; with the weighted squares, minus twice the logarithm of the Student distribution
        self.penalty = ((FREEDOM + 1.0) * np.log(growth) - FREEDOM * (1.0 - 1.0 / growth)
                        + self._noise.ln_variances)
        if off.any():
            sizes, index = np.ones(len(squares)), np.arange(len(squares))  # of disturbances
            parts = [*index[:residual.size].reshape(residual.shape), index[residual.size:]]
            for own in (part[rows[part]] for rows in disturbances for part in parts):
                sizes[own] = max(squares[own].sum() / max(len(own), 1), 1.0)
            self.penalty[off] = (squares / sizes + np.log(sizes) + noise.ln_variances)[off]

    def __call__(self, blocks: Array, crossings: Array) -> Array:
        """Return blocks (STREAMS, n, k) and crossings (m, k), whitened: (rows, k)."""
        return self._noise.whitened(blocks / self._scale, crossings / self._film_scale)


class WindowFit:
    """Fits windows of one robot."""

    def __init__(self, robot: RobotParams, rows: list[Row]) -> None:
        """``rows`` are the priors of the unknowns."""
        self._robot, self.rows = robot, rows
        self.steps = DERIVATIVE_STEP * np.array([row.sigma for row in rows[:DYNAMIC]])
        self._moves = np.zeros((DYNAMIC + 3, SIZE))  # of the unknowns, by run of a fit
        np.fill_diagonal(self._moves[1:-2], self.steps)

    def fitted(self, hypothesis: Hypothesis, measurements: Measurements, leaving: float,
               near: bool = False) -> tuple[Hypothesis, WindowEstimate]:
        """
        Return the fit; if it contradicts equal sides, with a prior that lets them differ.

        ``near``: it begins near the solution, unless its ground is unknown.
        """
        fit = self.fit(hypothesis, measurements, leaving, near)
        mean, covariance = hypothesis.prior
        difference = (fit.x - mean)[SIDES]
        square = difference @ np.linalg.solve(covariance[SIDES, SIDES], difference) / 3.0
        if square < TENSION ** 2:
            return hypothesis, fit
        covariance = covariance.copy()
        covariance[SIDES] *= math.sqrt(square)
        covariance[:, SIDES] *= math.sqrt(square)
        wider = replace(hypothesis, prior=WindowPrior(mean, covariance), x=fit.x)
        return wider, self.fit(wider, measurements, leaving, near)

    def fit(self, hypothesis: Hypothesis, measurements: Measurements, leaving: float,
            near: bool) -> WindowEstimate:
        """
        Return the fit under ``hypothesis``; measurements before ``leaving`` [s] leave the window.

        Steps are by the derivative of the friction; the covariance is by it or by the secant.
        """
        prior = hypothesis.prior
        information = inverse_spd(prior.covariance)
        start, heading = start_of(hypothesis, measurements)
        events = hypothesis.events[np.newaxis]
        unchanged = hypothesis.new == ONE_GROUND and not hypothesis.lifts
        unknown = prior.covariance[Unknown.FRICTION, Unknown.FRICTION] > MAX_SIGMA ** 2
        known = near and hypothesis.times is not None and not unknown and not (
            np.isfinite(events) & (events > measurements.begin)).any()
        # the solution before, on an unknown ground, may be another minimum
        x = (prior.mean if unchanged and unknown else hypothesis.x).copy()
        x[OWN] = 0.0
        inside = [measurements.within(one) for one in hypothesis.disturbances]
        steps, moves = np.append(self.steps, 0.0), self._moves.copy()
        acting = np.ones(DYNAMIC + 3, dtype=bool)  # runs; the other unknowns have no effect
        acting[1:-2][OLD_GROUND] = hypothesis.new != ONE_GROUND
        acting[1:-2][MOVED] = bool(hypothesis.lifts)
        shown = acting[:-1] * (np.cumsum(acting[:-1]) - 1)  # used runs, by unknown
        relaxation = np.zeros(np.count_nonzero(acting))
        relaxation[-1] = 0.5 * self._robot.tire.contact_length  # the last run shows its effect
        for iteration in range(MAX_ITERATIONS):
            steps[-1] = self._friction_step(x, prior.covariance)
            moves[-2, Unknown.FRICTION] = steps[-1]
            runs = x + moves
            used = runs[acting]
            varied = measurements.simulate(
                used, start, heading, events.repeat(len(used), axis=0), relaxation[:len(used)])
            predicted = measurements.predict(used, varied)
            at_crossings = measurements.at_crossings(varied)
            crossings = measurements.crossing_values(used, at_crossings)
            if acting[-1]:
                slip_noise = measurements.slip_noise(x, predicted[0])
                noise = WindowNoise(
                    measurements.noise(
                        predicted[0], predicted[-1] - predicted[0],
                        x[Unknown.GYRO_BIAS:Unknown.ACCEL_BIAS_Y + 1], slip_noise),
                    measurements.crossing_noise(crossings[0], crossings[-1] - crossings[0],
                                                at_crossings[0, :, model.LOAD]))
                acting[-1] = not known  # near the solution, the noise hardly changes
            residual = measurements.values - predicted[0]
            film_residual = measurements.crossing_measured - crossings[0]
            whiten = Whitening(noise, residual, film_residual, known or iteration > 0, inside)
            columns = self._columns(
                x, predicted[shown], residual, measurements, varied, steps, slip_noise)
            film_columns = self.film_columns(
                x, crossings[shown], film_residual, measurements, steps)
            white = whiten(columns, film_columns)
            products = gram(white.T)
            hessian = information + products[:SIZE, :SIZE]
            covariance = inverse_spd(hessian)
            step = covariance @ (information @ (prior.mean - x) + products[:SIZE, -1])
            step *= min(1.0, MAX_STEP / max(float(np.abs(step[:DYNAMIC]).max()), 1e-9))
            at, x = x, x + step
            if step @ hessian @ step < CONVERGED:
                break
        final = white[:, -1] - white[:, :SIZE] @ (x - at)
        # what is known of the friction: by its derivative or its secant, whichever shows less
        shows, row = np.arange(SIZE), Unknown.FRICTION
        shows[row] = SIZE
        by_secant = hessian.copy()
        by_secant[row] = by_secant[:, row] = information[row] + products[SIZE, shows]
        if (wider := inverse_spd(by_secant))[row, row] > covariance[row, row]:
            hessian, covariance = by_secant, wider
            white[:, row] = white[:, SIZE]
            runs[1 + row], shown[1 + row] = runs[-2], shown[-1]
        motion = measurements.simulate(x[np.newaxis], start, heading, events)
        cost = float(final @ final + whiten.penalty.sum()
                     + (x - prior.mean) @ information @ (x - prior.mean)
                     + np.linalg.slogdet(hessian @ prior.covariance)[1])
        # what leaves are the first rows of each stream, or follows rows that are not used: its
        # factor is a part of that of all
        left = white[measurements.row_times < leaving]
        derivatives = left[:, :SIZE]
        return WindowEstimate(
            x, covariance, cost, motion, runs[:-2], varied, shown[:-1], start, heading,
            WhitenedRows(final, white[:, :SIZE]), whiten, noise, information,
            (gram(derivatives.T), derivatives.T @ (left[:, -1] + derivatives @ at)))

    def _friction_step(self, x: Array, covariance: Array) -> float:
        """
        Return the step of ln mu for its secant: up to the mean of its prior, 1 to 2 sigmas.

        ``covariance`` is that before the window: a fit at a friction that is too low has a small
        one of its own. A tire that adheres shows less of its friction, the larger it is. The local
        derivative at a friction that is too low would claim to exclude a larger one, for all
        windows that follow.
        Tires that slide are the other way round: there friction and rolling resistance have the
        same local derivative, and the secant would claim to distinguish them.
        """
        sigma = math.sqrt(covariance[Unknown.FRICTION, Unknown.FRICTION])
        likely = float(self.rows[Unknown.FRICTION].mean - x[Unknown.FRICTION])
        return min(max(likely, sigma), 2.0 * sigma)

    def _columns(self, x: Array, predicted: Array, residual: Array, measurements: Measurements,
                 motion: WindowMotion, steps: Array, slip_noise: Array) -> Array:
        """
        Return derivatives of the block means and their residual (STREAMS, blocks, SIZE + 2).

        The last derivative is that by the friction over the last of the ``steps``. Errors of the
        wheel speeds are errors of the slip, in the derivatives as in the residual: their product
        would pull the stiffness to zero (regression dilution). Of a derivative of a torque counts
        what exceeds the effect of such errors, ``slip_noise`` (4, blocks) [(N m)^2].
        """
        dynamic = ((predicted[1:] - predicted[0]) / steps[:, np.newaxis, np.newaxis]).transpose(
            1, 2, 0)
        limit = NOISE_SIGMAS ** 2 * slip_noise[:, :, np.newaxis]
        curve = [*CURVE, DYNAMIC]
        torques = dynamic[TORQUE:, :, curve]
        dynamic[TORQUE:, :, curve] = torques * (
            1.0 - limit / np.maximum(np.maximum(torques ** 2, limit), np.finfo(float).tiny))
        return np.concatenate([
            dynamic[:, :, :DYNAMIC], measurements.linear(x, predicted[0], motion),
            dynamic[:, :, DYNAMIC:], residual[:, :, np.newaxis]], axis=2)

    def film_columns(self, x: Array, crossings: Array, residual: Array,
                     measurements: Measurements, steps: Array) -> Array:
        """Return derivatives of the crossings and their residual (2 * crossings, SIZE + 2)."""
        found = np.zeros((len(residual), SIZE + 2))
        dynamic = ((crossings[1:] - crossings[0]) / steps[:, np.newaxis]).T
        found[:, :DYNAMIC], found[:, SIZE] = dynamic[:, :-1], dynamic[:, -1]
        for i, one in enumerate(measurements.crossings):
            rows = slice(2 * i, 2 * i + 2 - one.sliding)
            found[rows, Unknown.FILM_GAIN + one.wheel] = crossings[0, rows]
            found[2 * i + 1, Unknown.FILM_ERROR + one.wheel] = not one.sliding
        found[:, -1] = residual
        return found


def _diagonals(blocks: Array, films: Array) -> Array:
    """Return the diagonals (rows,) of matrices of blocks (STREAMS, n, n) and crossings (m, m)."""
    return np.append(np.diagonal(blocks, axis1=1, axis2=2), np.diagonal(films))


def student(square: Array) -> Array:
    """Return minus twice the logarithm of the likelihood of normalized squared errors."""
    found: Array = np.minimum(square, 1.0) + (FREEDOM + 1.0) * np.log(
        np.maximum((FREEDOM + square) / (FREEDOM + 1.0), 1.0))
    return found


def start_of(hypothesis: Hypothesis, measurements: Measurements) -> tuple[Array, Array]:
    """Return the velocity (3,) at the begin of the window, and the heading (n,) [rad]."""
    bias = float(hypothesis.x[Unknown.GYRO_BIAS])
    heading = measurements.heading(bias, hypothesis.heading)
    times, velocities = hypothesis.times, hypothesis.velocities
    if times is None or velocities is None or not times[0] <= measurements.begin <= times[-1]:
        return np.array([measurements.rolling[0].mean(), 0.0,
                         measurements.values[0, 0] - bias]), heading
    return np.array([np.interp(measurements.begin, times, column)
                     for column in velocities.T]), heading
