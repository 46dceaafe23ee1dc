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

from collections.abc import Sequence
from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.estimation.ground.events import disturbance, EventSearch, Rival
from smart_tire.estimation.ground.measurements import Measurements, WindowData
from smart_tire.estimation.ground.unknowns import (
    EVENT_EVIDENCE, Hypothesis, initial, LENGTH, OLD_GROUND, ONE_GROUND, OWN, priors, TENSION,
    Tension, WindowPrior)
from smart_tire.estimation.ground.window_fit import WindowEstimate, WindowFit
from smart_tire.numerics.levenberg_marquardt import inverse_spd
from smart_tire.parameters.robot import RobotParams


class Solution(NamedTuple):
    """Estimate at the end of a window."""

    end: float         # s
    measurements: Measurements
    hypothesis: Hypothesis
    fit: WindowEstimate  # its covariance is widened by the tension
    tension: Tension

    def values_at(self, time: float, wheels: Sequence[int]) -> tuple[Array, Array]:
        """
        Return the values of ``Measurements.at`` (wheels, 5) at ``time`` [s] for indices of wheels.

        The second array (wheels, 5, DYNAMIC) are their derivatives by the unknowns.
        """
        fit, indices = self.fit, np.array(wheels, dtype=np.intp)
        times = np.full(len(indices), time)
        values, varied = (self.measurements.at(times, indices, motion)
                          for motion in (fit.motion, fit.varied))
        steps = np.diagonal(fit.varied_x[1:] - fit.varied_x[0])
        slopes = (varied[fit.shown[1:]] - varied[0]) / steps[:, np.newaxis, np.newaxis]
        return values[0], slopes.transpose(1, 2, 0)


class GroundWindow:
    """The window of one robot; ``solve`` moves it on."""

    def __init__(self, robot: RobotParams) -> None:
        self._robot, self._rows = robot, priors(robot)
        self._fit = WindowFit(robot, self._rows)
        self._events = EventSearch(self._fit)
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
        main, fit = plain, _ = self._fit.fitted(plain, measurements, leaving, near=True)
        rivals: list[Rival] = []
        disturbed = time is not None  # a disturbance, if it is no event
        if time is None and begin < first:
            time = self._events.when(plain, fit, measurements)
        if time is not None:
            base = self._events.disturbed(plain, time, measurements, leaving)
            rivals = self._events.rivals(plain, base[1], measurements, leaving, time)
            if rivals:
                base, time = min(
                    (base, time), (self._events.disturbed(
                        plain, rivals[0].time, measurements, leaving), rivals[0].time),
                    key=lambda one: one[0][1].cost)
            if rivals or disturbed or base[1].cost < fit.cost:
                main, fit = base
        best, over = (main, fit), time is None or end > disturbance(time)[1]
        decided = time is None or main is plain or end - time >= LENGTH
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
        tension = Tension.of(fit.x, self._rows)
        excess = max(1.0, (tension.size / TENSION) ** 2)
        return Solution(end, measurements, hypothesis, fit._replace(
            covariance=excess * fit.covariance), tension)

    def change_age(self, side: int, end: float) -> float:
        """Return the time [s] at ``end`` since a side's ground changed; inf: not in the window."""
        times = [time for time in self._main.new[side] if math.isfinite(time)]
        return max(end - max(times), 0.0) if times else math.inf

    def _advanced(self, hypothesis: Hypothesis, fit: WindowEstimate, measurements: Measurements,
                  hop: float) -> Hypothesis:
        """Return the hypothesis before the next window."""
        matrix, vector = fit.leaving
        covariance = inverse_spd(fit.information + matrix)
        mean: Array = covariance @ (fit.information @ hypothesis.prior.mean + vector)
        moved = WindowPrior(mean, covariance).after(
            hop, measurements.travel * hop / (measurements.times[-1] - measurements.begin),
            self._rows)
        middle = int(np.searchsorted(measurements.times, measurements.begin + hop))
        middle = min(middle, len(measurements.times) - 1)
        kept = tuple(one for one in hypothesis.disturbances if one[1] > measurements.begin)
        lifts = tuple(one for one in hypothesis.lifts if one.end > measurements.begin)
        return replace(
            hypothesis, lifts=lifts, disturbances=kept, x=fit.x, times=measurements.times,
            prior=moved.without(OWN, self._rows),
            velocities=fit.motion.velocities,
            heading=(float(measurements.times[middle]), float(fit.heading[middle])))


def _gain(fit: WindowEstimate, other: WindowEstimate, unused: NDArray[np.bool_]) -> float:
    """Return twice the logarithm of the evidence for ``other`` without the rows ``unused``."""
    inside, others = (float((one.rows.residual ** 2 + one.whiten.penalty)[unused].sum())
                      for one in (fit, other))
    return fit.cost - other.cost - inside + others


def _mixed(fit: WindowEstimate, other: WindowEstimate) -> WindowEstimate:
    """
    Return the likelier ``fit`` with the covariance of the mixture of both.

    The old ground is that of ``fit``: the other one may have none.
    """
    difference, own = other.x - fit.x, other.covariance.copy()
    difference[OLD_GROUND], own[OLD_GROUND], own[:, OLD_GROUND] = 0.0, 0.0, 0.0
    own[OLD_GROUND, OLD_GROUND] = fit.covariance[OLD_GROUND, OLD_GROUND]
    return fit._replace(covariance=0.5 * (
        fit.covariance + own + np.outer(difference, difference)))
