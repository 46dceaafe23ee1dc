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
Friction estimator: a record for each patch crossing of an instrumented wheel, and the ground.

All inputs pass one reorder buffer, so live, replayed and recorded data give identical results.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.film_stage import FilmStage, FittedCrossing, MotionBlock
from smart_tire.estimation.friction.output import friction_record, stamp_of
from smart_tire.estimation.friction.waveform_method import FilmResult
from smart_tire.estimation.ground.estimator import GroundEstimator, WheelState
from smart_tire.estimation.ground.unknowns import LENGTH
from smart_tire.estimation.ground.window import Solution
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.samples import Friction, GroundState, NS_PER_S, Sample
from smart_tire.uncertain import Uncertain, UNKNOWN


@dataclass(frozen=True, slots=True)
class EvaluatedCrossing:
    """One patch crossing with what its estimates come from."""

    friction: Friction
    crossing: PatchCrossing
    result: FilmResult | None  # None if no waveform was fitted, or if it is implausible
    state: WheelState


OnCrossing = Callable[[EvaluatedCrossing], None]


class FrictionEstimator:
    """
    Friction from the films of all instrumented wheels, and the state of the ground.

    Motion, slip and load are those of a window over IMU, wheels and films; without IMU, over
    odometry. Without either, crossings are still found, with the quantities that the films
    determine alone. ``on_crossing`` is called with each record and its fit, for display.
    """

    def __init__(self, params: FrictionEstimatorParams,
                 on_crossing: OnCrossing = lambda crossing: None) -> None:
        self._params, self._on_crossing = params, on_crossing
        self.films = FilmStage(params)
        self._start()

    def _start(self) -> None:
        robot = self._params.robot
        self._ground = GroundEstimator(robot, self._params.load_sigma)
        # crossings that wait for the window to reach them
        self._pending: list[FittedCrossing] = []
        self._friction: dict[str, Uncertain] = dict.fromkeys(robot.film.wheels, UNKNOWN)

    @property
    def late(self) -> Counter[str]:
        """Return the samples per topic that arrived after their grid instant had closed."""
        return self.films.feed.late

    @property
    def dropped(self) -> Counter[str]:
        """Duplicates and impossible samples per topic."""
        return self.films.feed.dropped

    def reset(self) -> None:
        """Drop all samples and everything learned; keep the counters."""
        self.films.reset()
        self._start()

    def update(self, sample: Sample) -> list[Friction | GroundState]:
        """Add a sample of one of the inputs; return the estimates that it completes."""
        return self.evaluate(self.films.add_sample(sample))

    def finish(self) -> list[Friction | GroundState]:
        """Return the last estimates, at the end of all inputs; ``reset`` before a further one."""
        return self.evaluate(self.films.finish())

    def evaluate(self, blocks: Iterable[MotionBlock]) -> list[Friction | GroundState]:
        """Return the estimates that ``blocks`` complete, those of ``films`` or of another one."""
        found: list[Friction | GroundState] = []
        for block in blocks:
            if block.restarted:
                self._start()
            for item in block.samples:
                self._ground.add_sample(item)
            self._ground.observable |= block.films
            for fitted in block.crossings:
                self._add_crossing(fitted)
            if block.end_ns is not None:
                found += self._solved(block.end_ns, last=block.last)
        return found

    def _add_crossing(self, fitted: FittedCrossing) -> None:
        wheel, crossing, result = fitted
        self._pending.append(fitted)
        if result is not None:
            slips = result.slips
            self._ground.add_crossing(stamp_of(crossing, result), wheel, slips.slip,
                                      slips.normalized_slip, slips.covariance, result.sliding)

    def _solved(self, now_ns: int, *, last: bool) -> list[Friction | GroundState]:
        """Return the estimates of a window up to ``now_ns``, if one is due."""
        solution = self._ground.advance(now_ns, last)
        if solution is None:
            # of a crossing for a window, as long as one can have it
            wait_ns = round(LENGTH * NS_PER_S) if self._ground.waits and not last else 0
            return self._released(now_ns - wait_ns, None)
        found = self._released(self._ground.end_ns, solution)
        if last:
            found += self._released(now_ns, solution)
        return [*found, self._ground.state(solution)] if self._ground.known else found

    def _released(self, until_ns: int, solution: Solution | None
                  ) -> list[Friction | GroundState]:
        """Return the records of the crossings up to an instant."""
        due = [one for one in self._pending if one.crossing.stamp_ns <= until_ns]
        self._pending = [one for one in self._pending if one.crossing.stamp_ns > until_ns]
        return [self._estimate(*one, solution) for one in due]

    def _estimate(self, wheel: str, crossing: PatchCrossing, result: FilmResult | None,
                  solution: Solution | None) -> Friction:
        state = WheelState() if solution is None else self._ground.wheel_state(
            solution, crossing.stamp_ns, wheel)
        friction = friction_record(
            wheel, self._params.robot.tire.contact_length, crossing, result, state)
        self._friction[wheel] = state.friction
        self._on_crossing(EvaluatedCrossing(friction, crossing, result, state))
        return friction

    def status(self) -> dict[str, str | int | float]:
        """Return the values for diagnostics."""
        shown: dict[str, str | int | float] = {**self.films.status(), **self._ground.status}
        for wheel, (mu, sigma) in self._friction.items():
            shown[f'{wheel}_friction'] = f'{mu:.3f} +- {sigma:.3f}' if mu == mu else 'unknown'
        return shown
