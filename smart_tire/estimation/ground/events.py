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
Events that may have happened in a window: their times by linearized equations, their fits.

Where the residuals suggest one, each kind is tried at a grid of times around the fit that knows
nothing of that time; the likeliest one of each kind is fitted, and the times of a change are then
moved to the likeliest ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.ground.measurements import Measurements
from smart_tire.estimation.ground.unknowns import (
    BLOCK_TIME, CANDIDATES, DISTURBANCE_TIME, EVENT_EVIDENCE, FREEDOM, GROUND, HOP, Hypothesis,
    Interval, LENGTH, Lift, MAX_ITERATIONS, MAX_LIFTS, MAX_STEP, MOVED, NEVER, OLD_GROUND,
    ONE_GROUND, REWEIGHTINGS, SIZE, TIME_ERROR, Unknown)
from smart_tire.estimation.ground.window_fit import student, WindowEstimate, WindowFit
from smart_tire.samples import WHEELS


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
    fit: WindowEstimate


class EventSearch:
    """Finds the likeliest events in windows of one robot."""

    def __init__(self, fit: WindowFit) -> None:
        self._fit, self._rows, self._steps = fit, fit.rows, fit.steps
        self._moves = np.diag(fit.steps) @ np.eye(len(fit.steps), SIZE)
        self._priors = np.array([row[:2] for row in fit.rows])

    def disturbed(self, plain: Hypothesis, time: float, measurements: Measurements,
                  leaving: float) -> tuple[Hypothesis, WindowEstimate]:
        """Return the fit if the robot is disturbed from ``time`` [s] on."""
        return self._fit.fitted(replace(plain, disturbances=(
            *plain.disturbances, disturbance(time))), measurements, leaving)

    def when(self, main: Hypothesis, fit: WindowEstimate, measurements: Measurements
             ) -> float | None:
        """Return when [s] something seems to have happened: an event, or a disturbance."""
        times = [measurements.begin, *(
            measurements.times[-1] - HOP * one for one in range(CANDIDATES, 0, -1))]
        events = self._changes(main, fit.x, [(time, time) for time in times])
        if main.lifts and main.lifts[-1].end == math.inf:
            events += self._lifts(main, fit.x, times)
        residual, found = self._evidence(main, fit, measurements, events)
        likely = [(gain, event.time) for event, (gain, _) in zip(events, found)]
        square = residual[:measurements.values.size].reshape(measurements.values.shape) ** 2
        late = (measurements.centers[:, np.newaxis] > times[1:]).astype(float)
        total, count = square @ late, late.sum(axis=0)
        growth = np.maximum(total / count, 1.0)
        gains = (student(square) @ late - total / growth - count * np.log(growth)).sum(axis=0)
        gain, time = max(likely + list(zip(gains.tolist(), times[1:])))
        return time if gain > EVENT_EVIDENCE else None

    def rivals(self, plain: Hypothesis, fit: WindowEstimate, measurements: Measurements,
               leaving: float, time: float) -> list[Rival]:
        """
        Return the likeliest event of each kind, the likeliest first.

        Kinds are lifts, changes of ground of both sides, and of one of them. They are tried with
        ``fit``, which does not know what was measured since ``time`` [s].
        """
        end = measurements.times[-1]
        times = [measurements.begin, *np.arange(
            max(time - HOP, end - LENGTH), end - 2.0 * BLOCK_TIME, BLOCK_TIME)]

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
            if gain < EVENT_EVIDENCE:
                continue
            rival = self._rival(plain, event, start, measurements, leaving)
            for _ in range(MAX_ITERATIONS if len(event.times) == 2 else 0):
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
        return Rival(event.time, *self._fit.fitted(replace(event.hypothesis, x=x, disturbances=(
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

    def _evidence(self, main: Hypothesis, fit: WindowEstimate, measurements: Measurements,
                  events: Sequence[Event]) -> tuple[Array, list[tuple[float, Array]]]:
        """
        Return the whitened residual (rows,), and for each event its evidence and its unknowns.

        The evidence is twice the logarithm of its likelihood ratio, all other unknowns as in
        ``fit``; the unknowns of the event are those after the start, by linearized equations.
        """
        runs, at = [fit.x], [main.events]
        for event in events:
            runs += [event.hypothesis.x, *(event.hypothesis.x + self._moves[event.unknown])]
            at += [event.hypothesis.events] * (1 + _count(event))
        x = np.array(runs)
        motion = measurements.simulate(x, fit.start, fit.heading, np.array(at))
        blocks = measurements.predict(x, motion)
        films = measurements.crossing_values(x, measurements.at_crossings(motion))
        residual = measurements.values - blocks, measurements.crossing_measured - films
        white = fit.noise.whitened(residual[0].transpose(1, 2, 0), residual[1].T)
        for one in main.disturbances:
            white[measurements.within(one)] = 0.0
        likely = student(white[:, 0] ** 2).sum()
        found = [(0.0, np.zeros(0))] * len(events)
        first = np.cumsum([1, *(1 + _count(event) for event in events)])  # runs of each
        for count in {_count(event) for event in events}:
            own = [i for i, event in enumerate(events) if _count(event) == count]
            others = white.T[first[own, np.newaxis] + np.arange(1 + count)]
            costs, values = self._costs([events[i] for i in own], others, measurements)
            for i, cost, value in zip(own, costs, values):
                found[i] = float(likely - cost), value
        return white[:, 0], found

    def _costs(self, events: Sequence[Event], others: Array, measurements: Measurements
               ) -> tuple[Array, Array]:
        """
        Return costs (events,) and unknowns (events, k) of events with k unknowns each.

        ``others`` (events, 1 + k, rows): the whitened residual with the event, and by each unknown
        moved.
        """
        rows = np.array([np.arange(SIZE)[event.unknown] for event in events])
        slopes = (others[:, :1] - others[:, 1:]) / self._steps[rows][:, :, np.newaxis]
        mean, sigma = self._priors[rows].transpose(2, 0, 1)
        spread = sigma[:, :, np.newaxis] ** -2 * np.eye(rows.shape[1])
        off = mean - np.array([event.hypothesis.x for event in events])[
            np.arange(len(events))[:, np.newaxis], rows]
        transitions = [event.transitions for event in events]
        first = np.cumsum([0, *map(len, transitions[:-1])])  # of each event
        inside = np.array([measurements.within(one) for part in transitions for one in part],
                          dtype=float)
        used = 1.0 - np.maximum.reduceat(inside, first)
        value, left, matrix = np.zeros(rows.shape), others[:, 0], spread
        columns = np.concatenate([slopes, others[:, :1]], axis=1).transpose(0, 2, 1)
        known = spread @ off[:, :, np.newaxis]
        for _ in range(REWEIGHTINGS if rows.size else 0):
            weighted = slopes * (used / np.maximum(
                (FREEDOM + left ** 2) / (FREEDOM + 1.0), 1.0))[:, np.newaxis]
            products = weighted @ columns
            matrix = products[:, :, :-1] + spread
            value = np.linalg.solve(matrix, products[:, :, -1:] + known)[:, :, 0]
            left = others[:, 0] - (value[:, np.newaxis] @ slopes)[:, 0]
        square = left ** 2
        cost = (used * student(square)).sum(axis=1) + (
            (value - off) ** 2 / sigma ** 2 + 2.0 * np.log(sigma)).sum(axis=1) + np.linalg.slogdet(
                matrix)[1]
        square = np.repeat(square, [*map(len, transitions)], axis=0)
        return cost + np.add.reduceat(
            _of_size(square, inside, measurements.values.shape), first), value


def _count(event: Event) -> int:
    """Return the number of unknowns of ``event``."""
    return event.unknown.stop - event.unknown.start


def _of_size(square: Array, inside: Array, shape: tuple[int, ...]) -> Array:
    """Return costs (k,) of squares (k, rows) ``inside``, with errors of the size that is seen."""
    blocks, found = math.prod(shape), np.zeros(len(square))
    for own, part in ((square[:, :blocks].reshape(-1, *shape), inside[:, np.newaxis, :shape[1]]),
                      (square[:, np.newaxis, blocks:], inside[:, np.newaxis, blocks:])):
        total, count = (own * part).sum(axis=2), part.sum(axis=2)
        growth = np.maximum(total / np.maximum(count, 1.0), 1.0)
        found += (total / growth + count * np.log(growth)).sum(axis=1)
    return found


def _changed(new: Interval, time: float | None) -> Interval | None:
    """Return the time on the new ground after a change at ``time``; None: no other one is kept."""
    begin, end = new
    if time is None:
        return new
    if begin == math.inf:
        return time, math.inf
    return (begin, time) if begin < time < end == math.inf else None


def disturbance(time: float) -> Interval:
    """Return when [s] a disturbance is assumed to last that begins at ``time``."""
    return time - TIME_ERROR, time + DISTURBANCE_TIME
