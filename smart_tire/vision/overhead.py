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
Messages of the overhead camera to poses; what is not used is counted by its reason.

Each image is judged by itself, so that no image is refused for one before it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
import math
from typing import Any

import numpy as np

from smart_tire.errors import MessageError, ParameterError
from smart_tire.messages import stamp_of
from smart_tire.parameters import OverheadLocalizerParams
from smart_tire.recording import Recording
from smart_tire.samples import NS_PER_S, WheelSlip
from smart_tire.uncertain import Uncertain, UNKNOWN
from smart_tire.vision.camera import Camera, Intrinsics
from smart_tire.vision.detection import gray_image, Image, other_families, TagDetector
from smart_tire.vision.localization import Fix, PoseFit
from smart_tire.vision.motion import (
    Motion, motion_of, pixel_noise, row_time, slips_of, time_offset, unrolled, used,
    wheel_tracks)

NO_TAG = 'no tag'
KEPT_IMAGES = 3     # without a tag, in which other families are looked for
SIGNIFICANT_SIGMAS = 5.0  # of the time between rows, from which on a shutter is a rolling one
LOST_PERIODS = 1.5  # between two images, beyond which one is missing


@dataclass
class Result:
    """Motion of the robot between gaps of the images, and slip."""

    images: int                   # received
    detections: int               # images with a pose
    refused: Counter[str]         # images without an estimate, by reason
    lost: int = 0                 # images that are missing between the timestamps
    gaps: list[tuple[float, float]] = field(default_factory=list)  # begin [s], duration [s]
    motions: list[Motion] = field(default_factory=list)
    slips: list[WheelSlip] = field(default_factory=list)
    offset: Uncertain = Uncertain(0.0, 0.0)  # s, by which the stamps of images are late
    offset_source: str = ''
    row_time: Uncertain = UNKNOWN  # s, between two rows of a rolling shutter
    noise: float = math.nan       # pixels, standard deviation of the coordinate of a corner
    inset: float = math.nan       # pixels, of the detected edges in the tag
    hints: list[str] = field(default_factory=list)

    @property
    def published(self) -> int:
        """Return the number of images with an estimate."""
        return sum(len(motion.stamp_ns) for motion in self.motions)

    def line(self) -> str:
        """Return in one line how many images are used, and why the others are not."""
        reasons = ', '.join(f'{count} {reason}' for reason, count in self.refused.most_common())
        text = f'{self.published} of {self.images} images used'
        if self.lost:
            text += f', {self.lost} missing between timestamps'
        return '; '.join((text + (f': {reasons}' if reasons else ''), *self.hints))


class OverheadLocalizer:
    """
    Collects the poses in the images of one camera.

    Raises ParameterError if the place of the camera is not given.
    """

    def __init__(self, params: OverheadLocalizerParams) -> None:
        self._params, overhead = params, params.overhead
        for name in ('camera_position', 'camera_rotation'):
            if not getattr(overhead, name):
                raise ParameterError(f'parameter overhead.{name} is not given: measure it, or '
                                     'calibrate with "smart_tire calibrate camera"')
        self._detector = TagDetector(overhead.tag_family)
        self._fit: PoseFit | None = None
        self._intrinsics: Intrinsics | None = None
        self._problem = 'no camera_info'  # why there are no intrinsics
        self._without_tag: list[Image] = []
        self._stamps: set[int] = set()
        self.images = 0
        self.refused: Counter[str] = Counter()
        self.fixes: list[Fix] = []
        if overhead.camera_info_file:
            self._use(Intrinsics.from_file(overhead.camera_info_file))

    @property
    def family(self) -> str:
        """Return the family of the tags."""
        return self._params.overhead.tag_family

    def add_camera_info(self, msg: Any) -> None:
        """Use a CameraInfo for the images that follow, unless a file is given."""
        try:
            if not self._params.overhead.camera_info_file:
                self._use(Intrinsics.from_msg(msg))
        except MessageError as error:
            self.refuse_camera_info(error)

    def _use(self, found: Intrinsics) -> None:
        if self._intrinsics is None or found.differs(self._intrinsics):
            overhead = self._params.overhead
            self._intrinsics = found
            self._fit = PoseFit(
                Camera(found, overhead.camera_position, overhead.camera_rotation), overhead,
                self._params.robot.wheel_radius)

    def refuse_camera_info(self, error: MessageError) -> None:
        """Refuse the images that follow, because the CameraInfo before them is invalid."""
        if not self._params.overhead.camera_info_file:
            self._fit, self._intrinsics, self._problem = None, None, str(error)

    def add_image(self, msg: Any) -> Fix | None:
        """Return the pose in an Image or CompressedImage; None, counted, if there is none."""
        self.images += 1
        try:
            found = self._pose(stamp_of(msg), msg)
        except MessageError as error:
            found = str(error)
        if isinstance(found, str):
            self.refused[found] += 1
            return None
        self.fixes.append(found)
        return found

    def _pose(self, stamp_ns: int, msg: Any) -> Fix | str:
        if not stamp_ns:
            return 'timestamp is zero'
        if stamp_ns in self._stamps:
            return 'timestamp repeated'
        self._stamps.add(stamp_ns)
        if self._fit is None or self._intrinsics is None:
            return self._problem
        image = gray_image(msg)
        if (size := image.shape[::-1]) != self._intrinsics.size:
            return 'size {} x {}, camera_info has {} x {}'.format(*size, *self._intrinsics.size)
        tags, repeated = self._detector.tags(image)
        wanted = self._params.overhead.tag_ids
        own = {tag: tags[tag] for tag in wanted if tag in tags}
        if own:
            return self._fit.fix(stamp_ns, own)
        if twice := sorted(set(repeated) & set(wanted)):
            return f'tag {twice[0]} more than once'
        if tags:
            return f'other tags only ({min(tags)})'
        if len(self._without_tag) < KEPT_IMAGES:
            self._without_tag.append(image)
        return NO_TAG

    def result(self, inputs: Recording) -> Result:
        """Return motion and slip; ``inputs`` are ``imu/data`` and ``wheel_states``."""
        robot = self._params.robot
        found = Result(self.images, len(self.fixes), Counter(self.refused))
        if not self.fixes:
            found.hints += other_families(self.family, self._without_tag)
            return found
        found.noise = pixel_noise(self.fixes)
        found.inset = float(np.median([fix.inset for fix in self.fixes]))
        parts = used(sorted(self.fixes, key=lambda fix: fix.stamp_ns), found.noise, found.refused)
        if not parts:
            return found
        self._count_lost(found, parts)
        self._smooth(found, parts, inputs)
        found.row_time = row_time(parts, found.motions, found.noise)
        if abs(found.row_time.value) > SIGNIFICANT_SIGMAS * found.row_time.sigma:
            found.hints.append(f'rolling shutter of {1e6 * found.row_time.value:.1f} us per row: '
                               'corrected')
            parts = [unrolled(part, motion, found.row_time.value)
                     for part, motion in zip(parts, found.motions)]
            found.noise = pixel_noise([fix for part in parts for fix in part])
            self._smooth(found, parts, inputs)
        tracks = wheel_tracks(inputs, robot)
        found.slips = [slip for motion in found.motions for slip in slips_of(
            motion, tracks, robot)]
        return found

    def _smooth(self, found: Result, parts: list[list[Fix]], inputs: Recording) -> None:
        """Estimate time offset and motions from ``parts``."""
        given, robot = self._params.overhead.time_offset, self._params.robot
        found.offset, found.offset_source = (
            time_offset(parts, inputs, robot) if math.isnan(given)
            else (Uncertain(given, 0.0), 'given'))
        found.motions = [motion_of(part, found.noise, found.offset, robot) for part in parts]

    def _count_lost(self, found: Result, parts: list[list[Fix]]) -> None:
        """Count images that are missing between the others, and note the gaps."""
        stamps = np.array(sorted(self._stamps))
        kept = np.array([fix.stamp_ns for part in parts for fix in part])
        period = float(np.median(np.diff(stamps)))
        steps = np.diff(stamps[(stamps >= kept[0]) & (stamps <= kept[-1])]) / period
        found.lost = int(np.sum(np.round(steps[steps > LOST_PERIODS]) - 1.0))
        for begin, step in zip(kept, np.diff(kept)):
            if step > LOST_PERIODS * period:
                found.gaps.append(((begin - kept[0]) / NS_PER_S, step / NS_PER_S))
