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
Feed of the contact trackers: samples in order of reception in, patch crossings out.

Samples pass a reorder buffer and are checked, so live, replayed and recorded data give identical
crossings. The friction estimator and the calibration of the films use this feed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import chain
from math import inf
from operator import attrgetter

from smart_tire.errors import EstimatorError
from smart_tire.estimation.contact.constants import BLOCK_NS
from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.contact.tracker import ContactTracker
from smart_tire.estimation.plausibility import is_possible
from smart_tire.estimation.reorder_buffer import ClosedInstant, ReorderBuffer
from smart_tire.estimation.streams import FRICTION
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import ImuSample, NS_PER_S, Odometry, Sample, TireSample, WheelSample

Input = TireSample | WheelSample | ImuSample | Odometry


@dataclass
class SampleBlock:
    """Accepted samples in order of time, and the crossings (wheel, crossing) at their end."""

    restarted: bool = False  # the clock was reset: earlier samples are invalid
    samples: list[Input] = field(default_factory=list)
    crossings: list[tuple[str, PatchCrossing]] = field(default_factory=list)
    end_ns: int | None = None  # instant up to which the samples are complete; None at the end


class ContactFeed:
    """Contact trackers of all instrumented wheels, fed in order of time."""

    def __init__(self, robot: RobotParams, reorder_window: float) -> None:
        self._robot = robot
        self._buffer = ReorderBuffer(round(reorder_window * NS_PER_S))
        self._resets = 0
        self.foreign_samples = 0   # of wheels that are not instrumented
        self.dropped: Counter[str] = Counter()  # topic -> duplicates and impossible samples
        self._start()

    def _start(self) -> None:
        robot = self._robot
        self.closed_ns: int | None = None  # latest grid instant
        self._block = SampleBlock()        # the next one
        self._newest: dict[type | str, int] = {}  # kind of sample, or wheel of films -> timestamp
        self._trackers = {wheel: [ContactTracker(wheel, robot, films)
                                  for films in robot.film_groups]
                          for wheel in robot.film.wheels}

    @property
    def late(self) -> Counter[str]:
        """Return the samples per topic that arrived after their grid instant had closed."""
        return self._buffer.late

    @property
    def clock_resets(self) -> int:
        """Return the number of times that the clock of all inputs was reset."""
        return self._buffer.resets

    def undetected(self, wheel: str) -> int:
        """Return the number of segments of ``wheel`` without detected crossing."""
        return sum(tracker.undetected for tracker in self._trackers[wheel])

    def reset(self) -> None:
        """Drop all samples; keep the counters."""
        self._buffer.reset()
        self._start()

    def add_sample(self, sample: Sample) -> list[SampleBlock]:
        """
        Add a sample; return the blocks that it completes.

        Raises EstimatorError if it is not from one of the input streams of ``streams.FRICTION``.
        """
        topic = FRICTION.inputs.get(type(sample))
        if topic is None:
            raise EstimatorError(f'friction estimator received {type(sample).__name__}, expected '
                                 + ', '.join(kind.__name__ for kind in FRICTION.inputs))
        closed = self._buffer.push(topic, sample.stamp_ns, sample)
        if self._buffer.resets != self._resets:
            self._resets = self._buffer.resets
            self._start()
            self._block.restarted = True
        return self._blocks(closed) if closed else []

    def finish(self) -> list[SampleBlock]:
        """
        Return the last blocks, with the crossings for which no further samples were awaited.

        Call this at the end of all inputs, then ``reset`` before any further sample.
        """
        blocks = self._blocks(self._buffer.finish())
        if self.closed_ns is not None:
            self._block.crossings = self._sorted(ContactTracker.finish, self.closed_ns)
        last, self._block = self._block, SampleBlock()
        return [*blocks, last]

    def _blocks(self, closed: list[ClosedInstant]) -> list[SampleBlock]:
        blocks = []
        for instant, samples in closed:
            self.closed_ns = instant
            self._block.samples += filter(self._accept, samples)
            if instant % BLOCK_NS == 0:  # a fixed phase, independent of the first sample
                self._block.crossings = self._sorted(ContactTracker.advance, instant)
                self._block.end_ns = instant
                blocks.append(self._block)
                self._block = SampleBlock()
        return blocks

    def _accept(self, sample: Input) -> bool:
        """Pass a possible sample, newer than its stream, to its trackers; return whether it is."""
        stream: type | str = type(sample)
        if isinstance(sample, TireSample):
            stream = sample.wheel
            if stream not in self._trackers:
                self.foreign_samples += 1
                return False
        if sample.stamp_ns <= self._newest.get(stream, -inf) or not is_possible(sample):
            self.dropped[FRICTION.inputs[type(sample)]] += 1
            return False
        self._newest[stream] = sample.stamp_ns
        if isinstance(sample, TireSample):
            for tracker in self._trackers[sample.wheel]:
                tracker.films.add(sample)
        elif isinstance(sample, WheelSample):
            for tracker in chain(*self._trackers.values()):
                tracker.add_wheels(sample)
        return True

    def _sorted(self, find: Callable[[ContactTracker, int], list[PatchCrossing]], now_ns: int
                ) -> list[tuple[str, PatchCrossing]]:
        """Return the crossings that the trackers ``find``, by wheel and time."""
        return [(wheel, crossing) for wheel, trackers in self._trackers.items()
                for crossing in sorted((one for tracker in trackers for one in find(
                    tracker, now_ns)), key=attrgetter('stamp_ns'))]
