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
Patch crossings of all instrumented wheels of a recording, with the slip in each.

Crossings are detected first. The slips come afterwards, from a slip estimator smoothed over the
whole recording, without films.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.estimation.contact.feed import Block, ContactFeed
from smart_tire.estimation.contact.records import CrossingSamples, PatchCrossing
from smart_tire.estimation.friction.constants import CHANGE_SIGMA
from smart_tire.estimation.friction.waveform_method import slip_variation
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S, TireSample, WHEELS, WheelSample, WheelSlip
from smart_tire.uncertain import Uncertain

MIN_CHANGE_SIGMA = 0.0005  # -, of the slip change over a contact length in steady motion
CHANGE_ERROR_SHARE = 0.5   # of an estimated change, its standard deviation
MEAN_MARGIN_NS = 50_000_000  # at least, on either side of a crossing, for the linear fit
MEAN_POINTS = 5            # in a crossing, of which the mean slip is taken
MIN_SLOPE_SAMPLES = 6


@dataclass(frozen=True, slots=True)
class CrossingWithSlip:
    """A patch crossing with waveforms of the films, and the slip in it."""

    wheel: str
    stamp_ns: int
    direction: int  # +1 forward, -1 backward
    speed: float    # m/s, r |omega|
    films: CrossingSamples
    slip: Uncertain    # -, B(3)'s lambda at the reference
    deviation: float   # -, standard deviation of slip from a straight line in this crossing
    change: Uncertain  # -, of the slip over a contact length
    origin: float      # rad, ``wheel_states.position`` at distance 0; NaN without positions


@dataclass(frozen=True, slots=True)
class _FoundCrossing:
    wheel: str
    crossing: PatchCrossing
    origin: float


class CrossingCollector:
    """Collects the crossings of ``robot`` from samples in order of reception."""

    def __init__(self, robot: RobotParams, reorder_window: float) -> None:
        self.robot = robot
        self.tire_samples = 0  # of instrumented wheels
        self._feed = ContactFeed(robot, reorder_window)
        self._origins: dict[str, float] = {}
        self._found: list[_FoundCrossing] = []

    def update(self, sample: TireSample | WheelSample) -> None:
        """Process one sample."""
        self._add(self._feed.update(sample))

    def finish(self) -> None:
        """Collect the last crossings, at the end of all samples."""
        self._add(self._feed.finish())

    def _add(self, blocks: Iterable[Block]) -> None:
        for block in blocks:
            if block.restarted:
                self._origins.clear()
            for item in block.samples:
                if isinstance(item, WheelSample):
                    self._set_origins(item)
                else:
                    self.tire_samples += 1
            self._found += [_FoundCrossing(wheel, crossing, self._origins[wheel])
                            for wheel, crossing in block.crossings
                            if crossing.samples is not None]

    def _set_origins(self, sample: WheelSample) -> None:
        """Note the wheel positions at distance 0; NaN if distances are integrated speeds."""
        for wheel in self.robot.film.wheels:
            if sample.position is None:
                self._origins[wheel] = math.nan
            else:
                self._origins.setdefault(wheel, sample.position[WHEELS.index(wheel)])

    def with_slip(self, slips: Iterable[WheelSlip]) -> Iterator[CrossingWithSlip]:
        """Yield the crossings covered by ``slips``, which must be in the order of time."""
        rows = [(one.stamp_ns, *one.ratio, *one.sigma) for one in slips]
        stamps = np.array([row[0] for row in rows], np.int64)
        values = np.array([row[1:] for row in rows], float).reshape(-1, 2, len(WHEELS))
        for found in sorted(self._found, key=lambda found: found.crossing.end_ns):
            yield from self._with_slip(found, stamps, values[:, :, WHEELS.index(found.wheel)])

    def _with_slip(self, found: _FoundCrossing, stamps: NDArray[np.int64],
                   values: Array) -> Iterator[CrossingWithSlip]:
        """Yield the crossing unless a slip near it is unknown."""
        crossing = found.crossing
        # wide enough for the entry of film 1 and the release of the last film
        around = max(MEAN_MARGIN_NS, crossing.end_ns - crossing.begin_ns)
        near = slice(*np.searchsorted(stamps, (crossing.begin_ns - around,
                                               crossing.end_ns + around + 1)))
        ratio, sigma = values[near].T
        if crossing.samples is None or not len(ratio) or not np.isfinite(ratio).all():
            return
        time = (stamps[near] - crossing.begin_ns) / NS_PER_S
        points = np.linspace(0.0, (crossing.end_ns - crossing.begin_ns) / NS_PER_S, MEAN_POINTS)
        # errors of a filter do not average out over a crossing
        slip = Uncertain(*(float(np.interp(points, time, column).mean())
                           for column in (ratio, sigma)))
        slope = residual = 0.0
        if len(ratio) >= MIN_SLOPE_SAMPLES:
            slope, offset = np.polyfit(time, ratio, 1).tolist()
            residual = float(np.std(ratio - slope * time - offset))
        length = self.robot.tire.contact_length
        change = slope * length / crossing.speed
        spread = slip_variation(crossing, length)
        change_sigma = math.hypot(MIN_CHANGE_SIGMA, CHANGE_ERROR_SHARE * change,
                                  max(spread.change.sigma - CHANGE_SIGMA, 0.0))
        yield CrossingWithSlip(
            found.wheel, crossing.stamp_ns, crossing.direction, crossing.speed, crossing.samples,
            slip, math.hypot(residual, spread.residual), Uncertain(change, change_sigma),
            found.origin)
