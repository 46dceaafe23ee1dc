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
First stage of the friction estimator: crossings of all films, and the fits of their waveforms.

It needs nothing of the ground, so both stages can run in processes of their own.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from smart_tire.estimation.contact.feed import ContactFeed, SampleBlock
from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.waveform_method import FilmResult, WaveformMethod
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.samples import ImuSample, Odometry, Sample, TireSample, WheelSample


class FittedCrossing(NamedTuple):
    """One patch crossing with what its films show."""

    wheel: str
    crossing: PatchCrossing
    result: FilmResult | None  # None if no waveform was fitted, or if it is implausible


class MotionBlock(NamedTuple):
    """Samples of the motion in order of time, and the crossings at their end."""

    restarted: bool          # the clock was reset: earlier samples are invalid
    samples: list[ImuSample | WheelSample | Odometry]
    films: bool              # there were samples of films, too
    crossings: list[FittedCrossing]
    end_ns: int | None       # up to which the samples are complete; None: there are none
    last: bool = False       # no further samples follow


class FilmStage:
    """
    Crossings of all instrumented wheels with their fits, from samples in reception order.

    Without ``waveforms``, crossings come without the samples and fits that displays need.
    """

    def __init__(self, params: FrictionEstimatorParams, *, waveforms: bool = True) -> None:
        self._robot, self._waveforms = params.robot, waveforms
        self.crossings = 0
        self.crossings_lost = 0  # without samples of any film
        self.feed = ContactFeed(params.robot, params.reorder_window)
        self._start()

    def _start(self) -> None:
        self._methods = {wheel: WaveformMethod(wheel, self._robot)
                         for wheel in self._robot.film.wheels}

    def reset(self) -> None:
        """Drop all samples and everything learned; keep the counters."""
        self.feed.reset()
        self._start()

    def add_sample(self, sample: Sample) -> list[MotionBlock]:
        """
        Add a sample; return the blocks that it completes.

        Raises EstimatorError if it is not from one of the input streams of ``streams.FRICTION``.
        """
        return [self._fitted(block) for block in self.feed.add_sample(sample)]

    def finish(self) -> list[MotionBlock]:
        """Return the last blocks, at the end of all inputs; ``reset`` before a further sample."""
        *blocks, last = map(self._fitted, self.feed.finish())
        return [*blocks, last._replace(end_ns=self.feed.closed_ns, last=True)]

    def _fitted(self, block: SampleBlock) -> MotionBlock:
        if block.restarted:
            self._start()
        motion = [one for one in block.samples if not isinstance(one, TireSample)]
        return MotionBlock(
            block.restarted, motion, len(motion) < len(block.samples),
            [self._measured(*one) for one in block.crossings], block.end_ns)

    def _measured(self, wheel: str, crossing: PatchCrossing) -> FittedCrossing:
        self.crossings += 1
        self.crossings_lost += crossing.samples is None
        result = self._methods[wheel].measure(crossing)
        if not self._waveforms:
            crossing = replace(crossing, samples=None)
            result = result and replace(result, waveform=None)
        return FittedCrossing(wheel, crossing, result)

    def status(self) -> dict[str, int]:
        """Return the values for diagnostics."""
        feed = self.feed
        return {'crossings': self.crossings, 'crossings_lost': self.crossings_lost,
                'foreign_samples': feed.foreign_samples, 'clock_resets': feed.clock_resets,
                **{f'dropped.{topic}': count for topic, count in feed.dropped.items()},
                **{f'{wheel}_segments_undetected': feed.undetected(wheel)
                   for wheel in self._robot.film.wheels}}
