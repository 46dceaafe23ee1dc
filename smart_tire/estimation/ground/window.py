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

What may happen are events: the ground under both sides or under one of them changes to one of
which nothing is known, in the window or before, and back again; a wheel loses its load, or has it
again; or something disturbs the robot for ``DISTURBANCE_TIME``, of which only the size of the
errors is known. An event is a hypothesis, the same window with it. All are compared by one
likelihood, that of the fit. Where the residuals suggest one, each kind is tried at a grid of times
by linearized equations, around the fit that knows nothing of that time; the likeliest one of each
kind is fitted, and the times of a change are then moved to the likeliest ones. A ground that
changes is not known any more, so what a push could explain does not count for it. Until the
evidence for one over all others suffices, the estimate is the mixture of the likeliest two.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.estimation.ground import body_model as model
from smart_tire.estimation.ground.measurements import (
    Measurements, Motion, Passage, WindowData)
from smart_tire.estimation.ground.unknowns import (
    BLOCK_TIME, CANDIDATES, CONVERGED, DECISION_TIME, DISTURBANCE_TIME, DYNAMIC, EVENT_EVIDENCE,
    FREEDOM, GROUND, Hypothesis, initial, Interval, ITERATIONS, LENGTH, Lift, MAX_LIFTS,
    MAX_LN_SIGMA, MAX_STEP, MOST_ITERATIONS, MOVED, NEAR, NEVER, OLD_GROUND, ONE_GROUND, OWN,
    Prior, priors, SIDES, SIDES_DIFFER, SIZE, TENSION, TIME_ERROR, TRIED_EVIDENCE, Unknown,
    UNMEASURED)
from smart_tire.numerics.levenberg_marquardt import gram, inverse_spd
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import WHEELS


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
    noise: tuple[Array, Array]  # covariances of blocks and passages
    leaving: tuple[Array, Array]  # information matrix and vector of what leaves the window


class Tension(NamedTuple):
    """The error of a sensor or of the robot that is largest over the sigma of its prior."""

    name: str
    size: float        # sigmas


class Event(NamedTuple):
    """Something that may have happened."""

    times: tuple[float | None, ...]  # s; None: to the other side only
    hypothesis: Hypothesis  # that it has
    unknown: slice          # of what nothing is known then

    @property
    def time(self) -> float:
        """Return the first of the times [s]."""
        return min(time for time in self.times if time is not None)

    @property
    def last(self) -> float:
        """Return the last of the times [s]."""
        return max(time for time in self.times if time is not None)

    @property
    def transitions(self) -> list[Interval]:
        """Return when [s] measurements are not used."""
        return [(time - TIME_ERROR, time + TIME_ERROR)
                for time in sorted({time for time in self.times if time is not None})]


class Rival(NamedTuple):
    """The likeliest event of a kind."""

    time: float  # s
    hypothesis: Hypothesis
    fit: Fit


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
        fit, events = self.fit, self.hypothesis.events
        runs = np.vstack([fit.x, fit.varied_x])
        values = self.measurements.at(
            [Passage(time, wheel, 0.0, 0.0, np.eye(2), False) for wheel in wheels], runs,
            np.tile(events, (len(runs), 1)),
            np.concatenate([fit.motion.states, fit.varied.states]))
        steps = np.diagonal(fit.varied_x[1:] - fit.varied_x[0])
        slopes = (values[2:] - values[1]) / steps[:, np.newaxis, np.newaxis]
        return values[0], slopes.transpose(1, 2, 0)


class Whitening:
    """Covariances of blocks (STREAMS, n, n) and passages (m, m) with weights for outliers."""

    def __init__(self, blocks: Array, films: Array, residual: Array, passages: Array,
                 weighted: bool, disturbances: Sequence[NDArray[np.bool_]]) -> None:
        variance, film_variance = np.diagonal(blocks, axis1=1, axis2=2).copy(), np.diag(films)
        square = residual ** 2 / variance
        each = np.repeat((passages ** 2 / film_variance).reshape(-1, 2).mean(axis=1), 2)
        more, film_more = np.zeros_like(square), np.zeros_like(each)  # noise of disturbances
        for rows in disturbances:
            inside, films_inside = rows[:square.shape[1]], rows[square.size:]
            if inside.any():
                more[:, inside] = np.maximum(
                    square[:, inside].mean(axis=1, keepdims=True) - 1.0, 0.0)
            if films_inside.any():
                film_more[films_inside] = max(each[films_inside].mean() - 1.0, 0.0)
        off = np.zeros(residual.size + len(passages), dtype=bool)
        nominal: Array = np.zeros(len(off))
        for rows in disturbances:
            off |= rows
        if off.any():
            nominal = _ln_variances(np.linalg.cholesky(blocks), np.linalg.cholesky(films))
        blocks = blocks.copy()
        blocks[:, range(square.shape[1]), range(square.shape[1])] += UNMEASURED ** 2 * (
            off[:residual.size].reshape(residual.shape) * variance)
        films = films + UNMEASURED ** 2 * np.diag(off[residual.size:] * film_variance)
        all_square = np.concatenate([square.ravel(), each])
        all_growth = 1.0 + np.concatenate([more.ravel(), film_more])
        growth = np.ones(residual.size + len(passages))
        if weighted:
            growth = np.where(off, 1.0, np.maximum(
                (FREEDOM + all_square) / (FREEDOM + 1.0), 1.0))
        scale, film_scale = np.split(np.sqrt(growth), [residual.size])
        scale = scale.reshape(residual.shape)
        self.blocks = blocks * scale[:, :, np.newaxis] * scale[:, np.newaxis]
        self.films = films * np.outer(film_scale, film_scale)
        self._block_factor = np.linalg.cholesky(self.blocks)
        self._film_factor = np.linalg.cholesky(self.films)
        # by row; with the weighted squares, minus twice the logarithm of the Student distribution
        self.penalty = np.where(
            off, all_square / all_growth + np.log(all_growth) + nominal,
            FREEDOM * (np.log(growth) - 1.0 + 1.0 / growth)
            + _ln_variances(self._block_factor, self._film_factor))

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
        self._undecided: float | None = None  # s, when something has happened, or a disturbance
        self.changes = 0  # of the ground
        self.lifts = 0    # of wheels

    def solve(self, data: WindowData, begin: float, end: float, hop: float) -> Solution:
        """Return the estimate from samples of ``begin`` to ``end`` [s], ``hop`` after the last."""
        first = max(begin, end - LENGTH)
        measurements = Measurements(self._robot, data, begin, first, end)
        leaving = first + hop if begin < first else -math.inf
        self._main = self._main.settled(measurements.begin, self._rows)
        time, self._undecided = self._undecided, None
        plain = self._main if time is None else replace(
            self._main, disturbances=self._main.disturbances[:-1])
        main, fit = plain, _ = self._fitted(plain, measurements, leaving, near=True)
        rivals: list[Rival] = []
        disturbed = time is not None  # a disturbance, if it is no event
        if time is None and begin < first:
            time = self._when(plain, fit, measurements)
        if time is not None:
            base = self._disturbed(plain, time, measurements, leaving)
            rivals = self._rivals(plain, base[1], measurements, leaving, time)
            if rivals:
                base, time = min(
                    (base, time), (self._disturbed(
                        plain, rivals[0].time, measurements, leaving), rivals[0].time),
                    key=lambda one: one[0][1].cost)
            if rivals or disturbed or base[1].cost < fit.cost:
                main, fit = base
        best, over = (main, fit), time is None or end > _disturbance(time)[1]
        decided = time is None or main is plain or end - time >= DECISION_TIME
        if rivals:
            _, rival, other = rivals[0]
            to_unknown = main.new == ONE_GROUND != rival.new
            gain = _gain(fit, other, measurements.within(main.disturbances[-1]) & to_unknown)
            margin, less = min([(gain, fit), *(
                (one.fit.cost - other.cost, one.fit) for one in rivals[1:])],
                key=lambda one: one[0])
            if margin > EVENT_EVIDENCE or decided and gain > EVENT_EVIDENCE:
                self.changes += rival.new != main.new
                self.lifts += len(rival.lifts) > len(main.lifts)
                best = main, fit = rival, other
                decided = True
            elif max(gain, fit.cost - other.cost) > -EVENT_EVIDENCE:
                best = (rival, _mixed(other, less)) if gain > 0.0 else (main, _mixed(fit, other))
            else:  # what follows the disturbance excludes the event
                decided |= over
        if not (decided or over and not rivals):
            self._undecided = time
        self._main = self._advanced(main, fit, measurements, hop)
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

    def _fitted(self, hypothesis: Hypothesis, measurements: Measurements, leaving: float,
                near: bool = False) -> tuple[Hypothesis, Fit]:
        """
        Return the fit; if it contradicts equal sides, with a prior that lets them differ.

        ``near``: it begins near the solution, unless its ground is unknown.
        """
        fit = self._fit(hypothesis, measurements, leaving, near)
        mean, covariance = hypothesis.prior
        difference = (fit.x - mean)[SIDES]
        square = difference @ np.linalg.solve(covariance[SIDES, SIDES], difference) / 3.0
        if square < SIDES_DIFFER:
            return hypothesis, fit
        covariance = covariance.copy()
        covariance[SIDES] *= math.sqrt(square)
        covariance[:, SIDES] *= math.sqrt(square)
        wider = replace(hypothesis, prior=Prior(mean, covariance), x=fit.x)
        return wider, self._fit(wider, measurements, leaving, near)

    def _fit(self, hypothesis: Hypothesis, measurements: Measurements, leaving: float,
             near: bool) -> Fit:
        prior = hypothesis.prior.of_next_window(self._rows)
        information = np.linalg.inv(prior.covariance)
        start, heading = _start(hypothesis, measurements)
        events = hypothesis.events[np.newaxis]
        unchanged = hypothesis.new == ONE_GROUND and not hypothesis.lifts
        unknown = prior.covariance[Unknown.FRICTION, Unknown.FRICTION] > MAX_LN_SIGMA ** 2
        known = near and hypothesis.times is not None and not unknown and not (
            np.isfinite(events) & (events > measurements.begin)).any()
        # the solution before, on an unknown ground, may be another minimum
        x = (prior.mean if unchanged and unknown else hypothesis.x).copy()
        x[OWN] = 0.0
        inside = [measurements.within(one) for one in hypothesis.disturbances]
        steps, covariance = np.append(self._steps, 0.0), prior.covariance
        acting = np.ones(DYNAMIC + 1, dtype=bool)  # the others have no effect
        acting[OLD_GROUND] = hypothesis.new != ONE_GROUND
        acting[MOVED] = bool(hypothesis.lifts)
        shown = np.concatenate([[0], acting * np.cumsum(acting)])  # runs by unknown
        for iteration in range(ITERATIONS if known else MOST_ITERATIONS):
            steps[-1] = self._friction_step(x, covariance)
            runs = np.tile(x, (DYNAMIC + 2, 1))
            runs[range(1, DYNAMIC + 2), (*range(DYNAMIC), Unknown.FRICTION)] += steps
            used = runs[np.concatenate([[True], acting])]
            varied = measurements.simulate(
                used, start, heading, np.repeat(events, len(used), axis=0))
            predicted, passages = (measurements.predict(used, varied)[shown],
                                   measurements.passage_values(used, varied)[shown])
            if iteration == 0 or not known:
                relaxed = measurements.simulate(
                    runs[:1], start, heading, events, 0.5 * self._robot.tire.contact_length)
                blocks = measurements.noise(
                    predicted[0], measurements.predict(runs[:1], relaxed)[0] - predicted[0],
                    x[Unknown.GYRO_BIAS:Unknown.ACCEL_BIAS_Y + 1])
                films = measurements.passage_noise(passages[0], varied.passages[0, :, model.LOAD])
            residual = measurements.values - predicted[0]
            film_residual = measurements.passage_measured - passages[0]
            whiten = Whitening(blocks, films, residual, film_residual, known or iteration > 0,
                               inside)
            columns = self._columns(x, predicted, residual, measurements, varied, steps)
            film_columns = self._film_columns(x, passages, film_residual, measurements, steps)
            white = whiten(columns, film_columns)
            rows = Rows(white[:, -1], white[:, :SIZE])
            hessian = information + gram(rows.jacobian.T, np.ones(len(rows.residual)))
            covariance = inverse_spd(hessian)
            step = covariance @ (information @ (prior.mean - x) + rows.jacobian.T @ rows.residual)
            step *= min(1.0, MAX_STEP / max(float(np.abs(step[:DYNAMIC]).max()), 1e-9))
            at, x = x, x + step
            if step @ hessian @ step < CONVERGED:
                break
        final = white[:, -1] - rows.jacobian @ (x - at)
        # what is known of the friction: by its derivative or its secant, whichever shows less
        other, row = white[:, :SIZE].copy(), Unknown.FRICTION
        other[:, row] = white[:, SIZE]
        by_secant = information + gram(other.T, np.ones(len(final)))
        if (wider := inverse_spd(by_secant))[row, row] > covariance[row, row]:
            hessian, covariance, rows = by_secant, wider, Rows(final, other)
            for part in (columns, film_columns):
                part[..., row] = part[..., SIZE]
            runs[1 + row], shown[1 + row] = runs[-1], shown[-1]
        rows = rows._replace(residual=final)
        motion = measurements.simulate(x[np.newaxis], start, heading, events)
        varied = Motion(varied.states[shown[:-1]], varied.passages[shown[:-1]])
        cost = float(final @ final + whiten.penalty.sum()
                     + (x - prior.mean) @ information @ (x - prior.mean)
                     + np.linalg.slogdet(hessian)[1] - np.linalg.slogdet(information)[1])
        columns[:, :, -1] += columns[:, :, :SIZE] @ at
        film_columns[:, -1] += film_columns[:, :SIZE] @ at
        left = whiten.information(
            columns, film_columns, measurements.used & (measurements.centers < leaving),
            np.repeat([one.time < leaving for one in measurements.passages], 2).astype(bool))
        return Fit(x, covariance, cost, motion, runs[:-1], varied, heading, rows, whiten,
                   (blocks, films), (left[:SIZE, :SIZE], left[:SIZE, -1]))

    def _friction_step(self, x: Array, covariance: Array) -> float:
        """
        Return the step of ln mu for its secant: up to the mean of its prior, 1 to 2 sigmas.

        A tire that adheres shows less of its friction, the larger it is. The local derivative at a
        friction that is too low would claim to exclude a larger one, for all windows that follow.
        Tires that slide are the other way round: there friction and rolling resistance have the
        same local derivative, and the secant would claim to distinguish them.
        """
        sigma = math.sqrt(covariance[Unknown.FRICTION, Unknown.FRICTION])
        likely = float(self._rows[Unknown.FRICTION].mean - x[Unknown.FRICTION])
        return min(max(likely, sigma), 2.0 * sigma)

    def _columns(self, x: Array, predicted: Array, residual: Array, measurements: Measurements,
                 motion: Motion, steps: Array) -> Array:
        """
        Return derivatives of the block means and their residual (STREAMS, blocks, SIZE + 2).

        The last derivative is that by the friction over the last of the ``steps``.
        """
        dynamic = ((predicted[1:] - predicted[0]) / steps[:, np.newaxis, np.newaxis]).transpose(
            1, 2, 0)
        return np.concatenate([
            dynamic[:, :, :DYNAMIC], measurements.linear(x, predicted[0], motion),
            dynamic[:, :, DYNAMIC:], residual[:, :, np.newaxis]], axis=2)

    def _film_columns(self, x: Array, passages: Array, residual: Array,
                      measurements: Measurements, steps: Array) -> Array:
        """Return derivatives of the passages and their residual (2 * passages, SIZE + 2)."""
        found = np.zeros((len(residual), SIZE + 2))
        dynamic = ((passages[1:] - passages[0]) / steps[:, np.newaxis]).T
        found[:, :DYNAMIC], found[:, SIZE] = dynamic[:, :-1], dynamic[:, -1]
        for i, one in enumerate(measurements.passages):
            rows = slice(2 * i, 2 * i + 2 - one.sliding)
            found[rows, Unknown.FILM_GAIN + one.wheel] = passages[0, rows]
            found[2 * i + 1, Unknown.FILM_ERROR + one.wheel] = not one.sliding
        found[:, -1] = residual
        return found

    def _disturbed(self, plain: Hypothesis, time: float, measurements: Measurements,
                   leaving: float) -> tuple[Hypothesis, Fit]:
        """Return the fit if the robot is disturbed from ``time`` [s] on."""
        return self._fitted(replace(plain, disturbances=(
            *plain.disturbances, _disturbance(time))), measurements, leaving)

    def _when(self, main: Hypothesis, fit: Fit, measurements: Measurements) -> float | None:
        """Return when [s] something seems to have happened: an event, or a disturbance."""
        times = [measurements.begin, *(measurements.times[-1] - one for one in CANDIDATES)]
        events = self._changes(main, fit.x, [(time, time) for time in times])
        if main.lifts and main.lifts[-1].end == math.inf:
            events += self._lifts(main, fit.x, times)
        residual, found = self._evidence(main, fit, measurements, events)
        likely = [(gain, event.time) for event, (gain, _) in zip(events, found)]
        square = residual[:measurements.values.size].reshape(measurements.values.shape) ** 2
        for time in times[1:]:
            own = square[:, measurements.centers > time]
            growth = np.maximum(own.mean(axis=1, keepdims=True), 1.0)
            gain = (_student(own) - own / growth - np.log(growth)).sum()
            likely.append((float(gain), time))
        gain, time = max(likely)
        return time if gain > TRIED_EVIDENCE else None

    def _rivals(self, plain: Hypothesis, fit: Fit, measurements: Measurements, leaving: float,
                time: float) -> list[Rival]:
        """
        Return the likeliest event of each kind, the likeliest first.

        Kinds are lifts, changes of ground of both sides, and of one of them. They are tried with
        ``fit``, which does not know what was measured since ``time`` [s].
        """
        end = measurements.times[-1]
        times = [measurements.begin, *np.arange(
            max(time - NEAR, end - LENGTH), end - 2.0 * BLOCK_TIME, BLOCK_TIME)]

        def likeliest(events: Callable[[list[float]], list[Event]]
                      ) -> list[tuple[float, Array, Event]]:
            """Return the likeliest one at ``times``: at each second one, then next to the best."""
            found: list[tuple[float, Array, Event]] = []
            near = [i for i in range(len(times)) if i == 0 or i % 2]
            for _ in range(2):
                tried = events([times[i] for i in near])
                if tried:
                    _, gains = self._evidence(plain, fit, measurements, tried)
                    found += [(*gain, event) for gain, event in zip(gains, tried)]
                    found = [max(found, key=lambda one: one[0])]
                    best = int(np.argmin(np.abs(np.array(times) - found[0][2].last)))
                    near = [i for i in (best - 1, best + 1) if 0 < i < len(times)]
            return found

        one = likeliest(lambda at: self._changes(plain, fit.x, [
            (time, None) for time in at] + [(None, time) for time in at]))
        both = likeliest(lambda at: self._changes(plain, fit.x, [(time, time) for time in at]))
        if one:  # the other side later
            first = one[0][2]
            both += likeliest(lambda at: self._changes(plain, fit.x, [
                tuple(later if own is None else own for own in first.times)
                for later in at if later > first.time]))
        both = sorted(both, key=lambda one: one[0])[-1:]
        found = []
        for gain, start, event in (*likeliest(
                lambda at: self._lifts(plain, fit.x, at)), *both, *one):
            if gain < TRIED_EVIDENCE:
                continue
            rival = self._rival(plain, event, start, measurements, leaving)
            for _ in range(2 * ITERATIONS if len(event.times) == 2 else 0):
                before, x = event.times, rival.fit.x
                moved = [one._replace(hypothesis=replace(one.hypothesis, x=x))
                         for one in self._changes(plain, x, [
                             tuple(time if i == side else own for i, own in enumerate(before))
                             for side in range(2) if before[side] is not None
                             for time in times[1:]])]
                _, gains = self._evidence(plain, rival.fit, measurements, moved)
                (_, start), event = max(zip(gains, moved), key=lambda one: one[0][0])
                if event.times == before:
                    break
                better = self._rival(plain, event, start, measurements, leaving)
                if better.fit.cost >= rival.fit.cost:
                    break
                rival = better
            found.append(rival)
        return sorted(found, key=lambda one: one.fit.cost)

    def _rival(self, plain: Hypothesis, event: Event, start: Array, measurements: Measurements,
               leaving: float) -> Rival:
        """Return the fit with ``event``; ``start`` are its unknowns, less those before."""
        x = event.hypothesis.x.copy()
        x[event.unknown] += np.clip(start, -MAX_STEP, MAX_STEP)
        return Rival(event.time, *self._fitted(replace(event.hypothesis, x=x, disturbances=(
            *plain.disturbances, *event.transitions)), measurements, leaving))

    def _changes(self, main: Hypothesis, x: Array,
                 times: Sequence[tuple[float | None, ...]]) -> list[Event]:
        """
        Return changes of ground at each of ``times`` [s] of the left and the right side, or None.

        To one of which nothing is known; while the window has two, from one to the other.
        """
        now, prior, unknown = main.new, main.prior, slice(0, 0)
        if now == ONE_GROUND:
            x, now, unknown = x.copy(), (NEVER, NEVER), GROUND
            x[OLD_GROUND] = x[GROUND]
            prior = prior.with_change(self._rows)
            x[GROUND] = prior.mean[GROUND]
        found = []
        for own in times:
            left, right = map(_changed, now, own)
            if left is not None and right is not None:
                found.append(Event(own, replace(
                    main, prior=prior, x=x, new=(left, right)), unknown))
        return found

    def _lifts(self, main: Hypothesis, x: Array, times: Sequence[float]) -> list[Event]:
        """Return that a wheel loses its load, or has it again, at each of ``times`` [s]."""
        *before, last = main.lifts or [Lift(end=-math.inf)]
        if last.end == math.inf:
            return [Event((time,), replace(
                main, x=x, lifts=(*before, last._replace(end=time))), slice(0, 0))
                for time in times if last.begin < time]
        x, prior, unknown = x.copy(), main.prior, slice(0, 0)
        if not main.lifts:
            x[MOVED] = self._rows[Unknown.MOVED_LOAD].mean
            prior, unknown = prior.without(MOVED, self._rows), MOVED
        return [Event((time,), replace(
            main, prior=prior, x=x, lifts=(*main.lifts, Lift(wheel, time))), unknown)
            for time in times if last.end < time and len(main.lifts) < MAX_LIFTS
            for wheel in range(len(WHEELS))]

    def _evidence(self, main: Hypothesis, fit: Fit, measurements: Measurements,
                  events: Sequence[Event]) -> tuple[Array, list[tuple[float, Array]]]:
        """
        Return the whitened residual (rows,), and for each event its evidence and its unknowns.

        The evidence is twice the logarithm of its likelihood ratio, all other unknowns as in
        ``fit``; the unknowns of the event are those after the start, by linearized equations.
        """
        runs, at = [fit.x], [main.events]
        for event in events:
            x, rows = event.hypothesis.x, np.arange(SIZE)[event.unknown]
            runs += [x, *(x + self._steps[row] * np.eye(SIZE)[row] for row in rows)]
            at += [event.hypothesis.events] * (len(rows) + 1)
        x = np.array(runs)
        start, _ = _start(main, measurements)
        motion = measurements.simulate(x, start, fit.heading, np.array(at))
        blocks, films = measurements.predict(x, motion), measurements.passage_values(x, motion)
        residual = measurements.values - blocks, measurements.passage_measured - films
        whiten = Whitening(*fit.noise, residual[0][0], residual[1][0], False, ())
        white = whiten(residual[0].transpose(1, 2, 0), residual[1].T)
        for one in main.disturbances:
            white[measurements.within(one)] = 0.0
        found, i = [], 1
        for event in events:
            rows = np.arange(SIZE)[event.unknown]
            own, i = slice(i, i + 1 + len(rows)), i + 1 + len(rows)
            unused = [measurements.within(one) for one in event.transitions]
            found.append(self._one_evidence(
                white[:, own], rows, event.hypothesis.x, unused, measurements.values.shape))
        likely = _student(white[:, 0] ** 2).sum()
        return white[:, 0], [(likely - cost, value) for cost, value in found]

    def _one_evidence(self, others: Array, rows: NDArray[np.intp], x: Array,
                      unused: Sequence[NDArray[np.bool_]], shape: tuple[int, ...]
                      ) -> tuple[float, Array]:
        """Return cost and unknowns; ``others``: with the event, and by each unknown moved."""
        used = ~np.any(unused, axis=0)
        rest, step = others[:, 0], self._steps[rows]
        slopes = (rest[:, np.newaxis] - others[:, 1:]) / step
        spread = np.diag([self._rows[row].sigma ** -2 for row in rows])
        off = np.array([self._rows[row].mean for row in rows]) - x[rows]
        value, left, matrix = np.zeros(len(rows)), rest, spread
        for _ in range(ITERATIONS if len(rows) else 0):
            weights = used / np.maximum((FREEDOM + left ** 2) / (FREEDOM + 1.0), 1.0)
            matrix = (slopes.T * weights) @ slopes + spread
            value = np.linalg.solve(matrix, (slopes.T * weights) @ rest + spread @ off)
            left = rest - slopes @ value
        cost = (value - off) @ spread @ (value - off) + np.linalg.slogdet(
            matrix)[1] - np.linalg.slogdet(spread)[1]
        cost += _student(left[used] ** 2).sum() + sum(
            _of_size(left ** 2, one, shape) for one in unused)
        return float(cost), value

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
        lifts = tuple(one for one in hypothesis.lifts if one.end > measurements.begin)
        return replace(
            hypothesis, lifts=lifts, disturbances=kept, x=fit.x, times=measurements.times,
            prior=moved.of_next_window(self._rows),
            velocities=fit.motion.states[0, :, :model.W + 1],
            heading=(float(measurements.times[middle]), float(fit.heading[middle])))


def _ln_variances(blocks: NDArray[np.floating[Any]], films: NDArray[np.floating[Any]]) -> Array:
    """Return the logarithms of the variances by row, each given the rows before it."""
    diagonal = np.concatenate([np.diagonal(blocks, axis1=1, axis2=2).ravel(), np.diag(films)])
    return 2.0 * np.log(diagonal.astype(np.float64))


def _student(square: Array) -> Array:
    """Return minus twice the logarithm of the likelihood of normalized squared errors."""
    return np.where(square < 1.0, square, 1.0 + (FREEDOM + 1.0) * np.log(
        np.maximum((FREEDOM + square) / (FREEDOM + 1.0), 1.0)))


def _of_size(square: Array, rows: NDArray[np.bool_], shape: tuple[int, ...]) -> float:
    """Return the cost of ``rows`` of normalized squares with errors of the size that is seen."""
    blocks, found = math.prod(shape), 0.0
    for own in (square[:blocks].reshape(shape)[:, rows[:shape[1]]],
                square[blocks:][np.newaxis, rows[blocks:]]):
        if own.size:
            growth = np.maximum(own.mean(axis=1), 1.0)
            found += float((own.sum(axis=1) / growth + own.shape[1] * np.log(growth)).sum())
    return found


def _changed(new: Interval, time: float | None) -> Interval | None:
    """Return the time on the new ground after a change at ``time``; None: no other one is kept."""
    begin, end = new
    if time is None:
        return new
    if begin == math.inf:
        return time, math.inf
    return (begin, time) if begin < time < end == math.inf else None


def _disturbance(time: float) -> Interval:
    """Return when [s] a disturbance is assumed to last that begins at ``time``."""
    return time - TIME_ERROR, time + DISTURBANCE_TIME


def _gain(fit: Fit, other: Fit, unused: NDArray[np.bool_]) -> float:
    """Return twice the logarithm of the evidence for ``other`` without the rows ``unused``."""
    inside, others = (float((one.rows.residual ** 2 + one.whiten.penalty)[unused].sum())
                      for one in (fit, other))
    return fit.cost - other.cost - inside + others


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
