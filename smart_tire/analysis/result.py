# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The result of an analysis, from which all figures and tables are made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
import math

import numpy as np

from smart_tire.analysis.figure import CAMERA, Curve, Segments, segments, TRUTH
from smart_tire.analysis.friction_metrics import match, Matches, stamps_of
from smart_tire.analysis.metrics import (
    carried, Compared, compared_poses, compared_slips, compared_twist, ComparedPoses, Intervals,
    START, UNALIGNED)
from smart_tire.arrays import Array
from smart_tire.estimates import at, PoseEstimate
from smart_tire.recording import SampleArrays, seconds
from smart_tire.samples import ImuSample, NS_PER_S, TireSample, WheelSample

FILTERED, SMOOTHED = 'filtered', 'smoothed'
MAX_START_NS = 10 * NS_PER_S  # ns, from the first input to the first estimate


@dataclass(frozen=True)
class Comparison:
    """Estimates of a recording compared with a reference, which may be empty."""

    estimates: SampleArrays
    reference: SampleArrays
    name: str = TRUTH  # of the reference: TRUTH or CAMERA
    origin_ns: int = 0  # timestamp at which the time axes are zero
    dead_reckoning: Mapping[str, PoseEstimate] = field(default_factory=dict)  # by method
    align: str = START  # one of ``ALIGNMENTS``

    @cached_property
    def poses(self) -> ComparedPoses:
        """Return x, y and yaw."""
        return compared_poses(self.estimates.poses(), self.reference.poses(), self.align)

    @cached_property
    def baselines(self) -> Mapping[str, ComparedPoses]:
        """Return x, y and yaw of dead reckoning by method, at the times of the estimates."""
        stamps, reference = self.estimates.poses().stamp_ns, self.reference.poses()
        unknown = np.full((len(stamps), 3, 3), math.nan)
        resampled = {name: PoseEstimate(
            stamps, at(stamps, one.stamp_ns, one.pose), at(stamps, one.stamp_ns, one.twist),
            unknown, unknown[:, 0]) for name, one in self.dead_reckoning.items()}
        compared = {name: compared_poses(one, reference, self.align)
                    for name, one in resampled.items()}
        return {name: one for name, one in compared.items() if len(one.stamp_ns)}

    @property
    def raw_reference(self) -> ComparedPoses:
        """Return the poses of the reference in its own frame, at the times of ``poses``."""
        return compared_poses(self.estimates.poses(), self.reference.poses(), UNALIGNED)

    @cached_property
    def path(self) -> tuple[Array, ComparedPoses]:
        """
        Return the poses (n, 3) of the estimates and those of the reference in one frame.

        This is that of the estimates if they are aligned at the start, else that of the reference.
        """
        own, raw = self.estimates.poses().pose, self.raw_reference
        if self.align == START or not len(raw.stamp_ns):
            return own, self.poses
        return carried(own, self.poses.true[0], raw.true[0]), raw

    @cached_property
    def twist(self) -> Compared:
        """Return v_x, v_y and yaw rate."""
        return compared_twist(self.estimates.poses(), self.reference.poses())

    @cached_property
    def slips(self) -> Compared:
        """Return the slips of the four wheels."""
        return compared_slips(self.estimates.slips(), self.reference.slips())

    @cached_property
    def matches(self) -> Matches:
        """Return the true crossings with their estimates."""
        return match(self.estimates.crossings, self.reference.crossings)


@dataclass(frozen=True)
class Result:
    """Estimates of a recording and what they are compared with, which may be empty."""

    estimates: SampleArrays
    inputs: SampleArrays = field(default_factory=SampleArrays)
    truth: SampleArrays = field(default_factory=SampleArrays)
    camera: SampleArrays = field(default_factory=SampleArrays)  # of the overhead camera
    smoothed: SampleArrays | None = None
    dead_reckoning: Mapping[str, PoseEstimate] = field(default_factory=dict)  # by method
    wanted: Sequence[Array] = ()  # paths (n, 2) m that were to be followed
    intervals: Intervals = field(default_factory=dict)  # evaluated separately
    align: str = START  # one of ``ALIGNMENTS``, of the reference with the estimates

    @cached_property
    def span_ns(self) -> tuple[int, int]:
        """Return the first and the last timestamp of the estimates."""
        stamps = np.concatenate([
            self.estimates.slips().stamp_ns, self.estimates.poses().stamp_ns,
            stamps_of(self.estimates.crossings)])
        return (int(stamps.min()), int(stamps.max())) if len(stamps) else (0, 0)

    @cached_property
    def origin_ns(self) -> int:
        """
        Return the timestamp at which the times of tables, figures and findings are zero.

        That is the first one of the inputs; those long before the estimates are wrong.
        """
        first_ns = self.span_ns[0]
        stamps = np.concatenate([stream.stamp_ns for kind in (ImuSample, WheelSample, TireSample)
                                 for stream in self.inputs.of(kind)] or [np.array([first_ns])])
        return int(min(stamps[stamps >= first_ns - MAX_START_NS], default=first_ns))

    @cached_property
    def segments(self) -> Segments:
        """Return the segments [s] in which the wheel speeds change most; none if not long."""
        stamps, speeds = self.inputs.speeds()
        time = seconds(stamps, self.origin_ns)
        return segments([Curve(time, speed) for speed in speeds.T])

    @cached_property
    def references(self) -> Mapping[str, SampleArrays]:
        """Return ground truth and overhead camera by name, if known; errors are by the first."""
        return {name: one for name, one in ((TRUTH, self.truth), (CAMERA, self.camera))
                if len(one)}

    @cached_property
    def comparisons(self) -> Mapping[str, Comparison]:
        """Return the estimates and their reference by label, those of the filter first."""
        labeled = {'estimate': self.estimates} if self.smoothed is None else {
            FILTERED: self.estimates, SMOOTHED: self.smoothed}
        name, reference = next(iter(self.references.items()), (TRUTH, self.truth))
        return {label: Comparison(
            one, reference, name, self.origin_ns, self.dead_reckoning, self.align)
            for label, one in labeled.items()}

    @property
    def filtered(self) -> Comparison:
        """Return the estimates of the filter and their reference."""
        return next(iter(self.comparisons.values()))
