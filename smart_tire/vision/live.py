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
The overhead camera live: a fixed-lag smoother over the latest seconds.

An estimate is published once images of ``overhead.lag`` behind it have been received, in batches:
a smoother that ran at each image would need more time than the images have.
"""

from __future__ import annotations

from collections import Counter, deque
import math
from typing import Any

from smart_tire.parameters import OverheadLocalizerParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import ImuSample, NS_PER_S, Odometry, WheelSample, WheelSlip
from smart_tire.uncertain import Uncertain
from smart_tire.vision.localization import Fix
from smart_tire.vision.motion import (
    MAX_GAP, motion_of, OFFSET_PRIOR, pixel_noise, slips_of, time_offset, used,
    wheel_tracks)
from smart_tire.vision.overhead import OverheadLocalizer, SCALE, SCALE_SIGMAS

WINDOW = 2.0          # s before the estimates that the smoother uses
BATCH = 0.25          # s of images between two runs of the smoother
ROUNDS = 4            # of its process noise
OFFSET_SPAN = 60.0         # s in which the time offset is looked for
OFFSET_PERIOD = 10.0  # s between two estimates of it


class LiveLocalizer(OverheadLocalizer):
    """Pose, velocity and slip from images as they come; times are those of the messages."""

    def __init__(self, params: OverheadLocalizerParams) -> None:
        super().__init__(params)
        given = params.overhead.time_offset
        self.offset = Uncertain(0.0, OFFSET_PRIOR) if math.isnan(given) else Uncertain(given, 0.0)
        self._inputs: deque[ImuSample | WheelSample] = deque()
        self._published_ns = self._smoothed_ns = self._offset_ns = 0  # stamps of images

    def add_sample(self, sample: ImuSample | WheelSample) -> None:
        """Add a sample of ``imu/data`` or ``wheel_states``."""
        self._inputs.append(sample)
        while self._inputs[0].stamp_ns < sample.stamp_ns - OFFSET_SPAN * NS_PER_S:
            self._inputs.popleft()

    def estimates(self, msg: Any) -> list[Odometry | WheelSlip]:
        """Return the estimates that an image completes, in order of their stamps."""
        fix = self.add_image(msg)
        if fix is None:
            return []
        newest = fix.stamp_ns
        if newest < self._smoothed_ns - NS_PER_S:  # a clock that was set back, or a replay
            self.fixes, self._published_ns = [fix], 0
            self._offset_ns = self._smoothed_ns = newest
        self._forget(newest)
        if newest < self._smoothed_ns + BATCH * NS_PER_S:
            return []
        self._smoothed_ns = newest
        fixes = sorted(self.fixes, key=lambda one: one.stamp_ns)
        noise = pixel_noise(fixes)
        if math.isnan(self._params.overhead.time_offset) and (
                newest > self._offset_ns + OFFSET_PERIOD * NS_PER_S):
            self._offset_ns = newest
            self.offset, _ = time_offset(
                used(fixes, noise, Counter()), SampleArrays(self._inputs), self._params.robot)
        return self._new_estimates(fixes, noise, newest)

    def _forget(self, newest: int) -> None:
        self.fixes = [one for one in self.fixes if one.stamp_ns > newest - OFFSET_SPAN * NS_PER_S]
        if len(self._stamps) > 2 * len(self.fixes) + 1000:
            self._stamps = {one.stamp_ns for one in self.fixes}

    def _new_estimates(self, fixes: list[Fix], noise: float, newest: int
                       ) -> list[Odometry | WheelSlip]:
        """Return the estimates between those published before and the lag."""
        robot, last = self._params.robot, newest - round(self._params.overhead.lag * NS_PER_S)
        begin = min(max(self._published_ns, 1), last) - round(WINDOW * NS_PER_S)
        recent = [one for one in fixes if one.stamp_ns > begin]
        shift = round(self.offset.value * NS_PER_S)
        found: list[Odometry | WheelSlip] = []
        wheels = SampleArrays(one for one in self._inputs if isinstance(one, WheelSample)
                              and one.stamp_ns > begin - shift - MAX_GAP * NS_PER_S)
        tracks = wheel_tracks(wheels, robot, ROUNDS)
        for part in used(recent, noise, Counter()):
            motion = motion_of(part, noise, self.offset, robot, ROUNDS)
            found += motion.odometry(robot.wheel_radius)
            found += slips_of(motion, tracks, robot)
        due = [one for one in found
               if self._published_ns < one.stamp_ns + shift <= last]
        self._published_ns = max(self._published_ns, last)
        due.sort(key=lambda one: one.stamp_ns)
        self.scale.add(due)
        if self.scale.deviation > SCALE_SIGMAS:
            self.refused[SCALE] += len({one.stamp_ns for one in due})
            return []
        return due
