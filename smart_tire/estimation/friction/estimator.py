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
Friction estimator: one record for each patch crossing of an instrumented wheel.

All inputs pass one reorder buffer, so live, replayed and recorded data give identical results.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from smart_tire.estimation.contact.feed import Block, ContactFeed
from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.motion_history import MotionHistory
from smart_tire.estimation.friction.output import OutputBuilder
from smart_tire.estimation.friction.waveform_fit import WaveformFit
from smart_tire.estimation.streams import FRICTION, HOLDING, SLIP
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.samples import Friction, GroundState, Odometry, Sample, WheelSlip


@dataclass(frozen=True, slots=True)
class EvaluatedCrossing:
    """One patch crossing with the fit behind its estimates."""

    friction: Friction
    waveform: WaveformFit | None  # None if no waveform was fitted, or if it is implausible
    surface_changed: bool         # the friction coefficient differs from that before


OnCrossing = Callable[[EvaluatedCrossing], None]


class FrictionEstimator:
    """
    Friction from the films of all instrumented wheels.

    Requires tire and wheel samples. Without odometry or slip, crossings are still found, with the
    quantities that the films determine alone; without the state of the ground, its stiffness is
    the calibrated one. ``on_crossing`` is called with each record and its fit, for display.
    """

    def __init__(self, params: FrictionEstimatorParams,
                 on_crossing: OnCrossing = lambda crossing: None) -> None:
        self._params, self._on_crossing = params, on_crossing
        self._feed = ContactFeed(
            params.robot, params.reorder_window,
            {topic: HOLDING.get(topic, 0) for kind, topic in FRICTION.inputs.items()
             if kind in SLIP.outputs})
        self.crossings = 0
        self.crossings_lost = 0  # without samples of any film
        self._start()

    def _start(self) -> None:
        robot = self._params.robot
        self._motion = MotionHistory(robot, self._params.load_sigma)
        self._outputs = {wheel: OutputBuilder(wheel, self._params) for wheel in robot.film.wheels}

    @property
    def late(self) -> Counter[str]:
        """Return the samples per topic that arrived after their grid instant had closed."""
        return self._feed.late

    @property
    def dropped(self) -> Counter[str]:
        """Duplicates and impossible samples per topic."""
        return self._feed.dropped

    def reset(self) -> None:
        """Drop all samples and everything learned; keep the counters."""
        self._feed.reset()
        self._start()

    def update(self, sample: Sample) -> list[Friction]:
        """Add a sample of one of the inputs; return the records that it completes."""
        return self._process(self._feed.update(sample))

    def finish(self) -> list[Friction]:
        """Return the last records, at the end of all inputs; ``reset`` before any further one."""
        return self._process(self._feed.finish())

    def _process(self, blocks: list[Block]) -> list[Friction]:
        found: list[Friction] = []
        for block in blocks:
            if block.restarted:
                self._start()
            for item in block.samples:
                self._add_motion(item)
            found += [self._estimate(wheel, crossing) for wheel, crossing in block.crossings]
        return found

    def _add_motion(self, sample: Sample) -> None:
        if isinstance(sample, Odometry):
            self._motion.add_odometry(sample)
        elif isinstance(sample, WheelSlip):
            self._motion.add_slip(sample)
        elif isinstance(sample, GroundState):
            self._motion.add_ground(sample)

    def _estimate(self, wheel: str, crossing: PatchCrossing) -> Friction:
        self.crossings += 1
        self.crossings_lost += crossing.samples is None
        motion = self._motion.mean(wheel, crossing.begin_ns, crossing.end_ns)
        output = self._outputs[wheel]
        changes = output.filter.changes
        friction = output.build(crossing, motion)
        self._on_crossing(EvaluatedCrossing(
            friction, output.waveform, output.filter.changes > changes))
        return friction

    def status(self) -> dict[str, str | int | float]:
        """Return the values for diagnostics."""
        feed = self._feed
        shown: dict[str, str | int | float] = {
            'crossings': self.crossings, 'crossings_lost': self.crossings_lost,
            'foreign_samples': feed.foreign_samples, 'clock_resets': feed.clock_resets,
            **{f'dropped.{topic}': count for topic, count in feed.dropped.items()}}
        for wheel, output in self._outputs.items():
            mu, sigma = output.friction
            shown[f'{wheel}_friction'] = f'{mu:.3f} +- {sigma:.3f}' if mu == mu else 'unknown'
            shown[f'{wheel}_segments_undetected'] = feed.undetected(wheel)
            shown[f'{wheel}_surface_changes'] = output.filter.changes
        return shown
