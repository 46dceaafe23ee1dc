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

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
import math
from typing import Any

import numpy as np

from smart_tire.errors import MessageError, ParameterError
from smart_tire.messages import stamp_of
from smart_tire.parameters import OverheadLocalizerParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import GRAVITY, ImuSample, NS_PER_S, Odometry, WheelSample, WheelSlip
from smart_tire.uncertain import Uncertain, UNKNOWN
from smart_tire.vision.camera import Camera, Intrinsics
from smart_tire.vision.detection import gray_image, Image, other_families, TagDetector
from smart_tire.vision.localization import Fix, PoseFit
from smart_tire.vision.motion import (
    CameraMotion, MAX_GAP, motion_of, OFFSET_PRIOR, pixel_noise, row_time, slips_of, time_offset,
    unrolled, used, wheel_tracks)

NO_TAG = 'no tag'
KEPT_IMAGES = 3     # without a tag, in which other families are looked for
SIGNIFICANT_SIGMAS = 5.0  # of the time between rows, from which on a shutter is a rolling one
LOST_PERIODS = 1.5  # between two images, beyond which one is missing
SCALE = 'the camera shows a longer way than the wheels: overhead.camera_position is too high'
MIN_WAY = 0.5             # m of straight and steady motion, from which on scales are compared
STRAIGHT, STEADY = 0.1, 0.2  # rad/s, m/s2 at most
SLOPE_SIGMA = 0.02        # of the floor: downhill, wheels brake and roll less than the way
SCALE_SIGMAS = 3.0        # of a way that contradicts the wheels
WINDOW = 2.0          # s before the estimates that the smoother uses
BATCH = 0.25          # s of images between two runs of the smoother
ROUNDS = 4            # of its process noise
OFFSET_SPAN = 60.0         # s in which the time offset is looked for
OFFSET_PERIOD = 10.0  # s between two estimates of it


@dataclass
class CameraResult:
    """Motion of the robot between gaps of the images, and slip."""

    images: int                   # received
    detections: int               # images with a pose
    refused: Counter[str]         # images without an estimate, by reason
    lost: int = 0                 # images that are missing between the timestamps
    gaps: list[tuple[float, float]] = field(default_factory=list)  # begin [s], duration [s]
    motions: list[CameraMotion] = field(default_factory=list)
    slips: list[WheelSlip] = field(default_factory=list)
    offset: Uncertain = Uncertain(0.0, 0.0)  # s, by which the stamps of images are late
    offset_source: str = ''
    row_time: Uncertain = UNKNOWN  # s, between two rows of a rolling shutter
    noise: float = math.nan       # pixels, standard deviation of the coordinate of a corner
    inset: float = math.nan       # pixels, of the detected edges in the tag
    hints: list[str] = field(default_factory=list)
    frame: tuple[Camera, Image] | None = None  # the first image with a pose

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


class Scale:
    """
    The way by the camera over that by the wheels, in straight and steady motion.

    Wheels that drive slip, so that they show a longer way: only a longer one by the camera, beyond
    the standard deviations of both and what a slope explains, contradicts them.
    """

    def __init__(self, params: OverheadLocalizerParams) -> None:
        robot, overhead = params.robot, params.overhead
        height = overhead.camera_position[2] - robot.wheel_radius - overhead.tag_position[2]
        slope = SLOPE_SIGMA * robot.mass * GRAVITY / (4.0 * robot.tire.longitudinal_stiffness)
        self._sigma = math.hypot(robot.wheel_radius_sigma, slope,
                                 overhead.camera_position_sigma[2] / height)
        self.ways = np.zeros(2)  # m, by the camera and by the wheels
        self._error = 0.0        # m, standard deviation of that by the camera
        self._before: Odometry | None = None

    def add(self, samples: Iterable[Odometry | WheelSlip]) -> None:
        """Add estimates in the order of their stamps."""
        slips = {one.stamp_ns: one for one in samples if isinstance(one, WheelSlip)}
        for one in (one for one in samples if isinstance(one, Odometry)):
            before, self._before = self._before, one
            if before is None or one.stamp_ns not in slips:
                continue
            step = (one.stamp_ns - before.stamp_ns) / NS_PER_S
            if (abs(one.angular[2]) < STRAIGHT and 0.0 < step < MAX_GAP
                    and abs(one.linear[0] - before.linear[0]) < STEADY * step):
                speed = abs(one.linear[0])
                slip = math.copysign(1.0, one.linear[0]) * np.nanmean(
                    slips[one.stamp_ns].slip_velocity)
                self.ways += step * speed, step * (speed + slip)
                self._error = math.sqrt(2.0 * one.pose_covariance[0])

    @property
    def deviation(self) -> float:
        """Return how many standard deviations the way by the camera is longer."""
        camera, wheels = self.ways
        if not wheels > MIN_WAY:
            return 0.0
        return float((camera - wheels) / math.hypot(self._sigma * wheels, self._error))


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
        self._frame: tuple[Camera, Image] | None = None
        self.scale = Scale(params)
        if overhead.camera_info_file:
            self._use(Intrinsics.from_file(overhead.camera_info_file))

    def add_camera_info(self, msg: Any) -> None:
        """Use a CameraInfo for the images that follow, unless a file is given."""
        try:
            if not self._params.overhead.camera_info_file:
                self._use(Intrinsics.from_msg(msg))
        except MessageError as error:
            self.refuse(error, is_image=False)

    def _use(self, found: Intrinsics) -> None:
        if self._intrinsics is None or found.differs(self._intrinsics):
            overhead = self._params.overhead
            self._intrinsics = found
            self._camera = Camera(found, overhead.camera_position, overhead.camera_rotation)
            self._fit = PoseFit(self._camera, overhead, self._params.robot.wheel_radius)

    def refuse(self, error: MessageError, *, is_image: bool) -> None:
        """Refuse an image that cannot be decoded, or the images after an invalid CameraInfo."""
        if is_image:
            self.images += 1
            self.refused['message cannot be decoded'] += 1
        elif not self._params.overhead.camera_info_file:
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
        wanted = self._params.overhead.tag_ids
        tags, repeated = self._detector.tags(image, wanted)
        own = {tag: tags[tag] for tag in wanted if tag in tags}
        if own:
            fix = self._fit.fix(stamp_ns, own)
            if self._frame is None and isinstance(fix, Fix):
                self._frame = self._camera, image
            return fix
        if twice := sorted(set(repeated) & set(wanted)):
            return f'tag {twice[0]} more than once'
        if tags:
            return f'other tags only ({min(tags)})'
        if len(self._without_tag) < KEPT_IMAGES:
            self._without_tag.append(image)
        return NO_TAG

    def result(self, inputs: SampleArrays) -> CameraResult:
        """Return motion and slip; ``inputs`` are ``imu/data`` and ``wheel_states``."""
        robot = self._params.robot
        found = CameraResult(self.images, len(self.fixes), Counter(self.refused),
                             frame=self._frame)
        if not self.fixes:
            found.hints += other_families(self._params.overhead.tag_family, self._without_tag)
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
        self._check_scale(found)
        return found

    def _check_scale(self, found: CameraResult) -> None:
        """Refuse all estimates if their scale contradicts the wheels."""
        self.scale.add([*(one for motion in found.motions for one in motion.odometry(0.0)),
                        *found.slips])
        if abs(self.scale.deviation) > SCALE_SIGMAS:
            camera, wheels = self.scale.ways
            found.hints.append(f'{camera:.2f} m by the camera, {wheels:.2f} m by the wheels in '
                               'straight and steady motion' + (
                                   '' if camera > wheels else ': slip, or overhead.'
                                   'camera_position is too low'))
        if self.scale.deviation > SCALE_SIGMAS:
            found.refused[SCALE] += found.published
            found.motions, found.slips = [], []

    def _smooth(self, found: CameraResult, parts: list[list[Fix]], inputs: SampleArrays) -> None:
        """Estimate time offset and motions from ``parts``."""
        given, robot = self._params.overhead.time_offset, self._params.robot
        found.offset, found.offset_source = (
            time_offset(parts, inputs, robot) if math.isnan(given)
            else (Uncertain(given, 0.0), 'given'))
        found.motions = [motion_of(part, found.noise, found.offset, robot) for part in parts]

    def _count_lost(self, found: CameraResult, parts: list[list[Fix]]) -> None:
        """Count images that are missing between the others, and note the gaps."""
        stamps = np.array(sorted(self._stamps))
        kept = np.array([fix.stamp_ns for part in parts for fix in part])
        period = float(np.median(np.diff(stamps)))
        steps = np.diff(stamps[(stamps >= kept[0]) & (stamps <= kept[-1])]) / period
        found.lost = int(np.sum(np.round(steps[steps > LOST_PERIODS]) - 1.0))
        for begin, step in zip(kept, np.diff(kept)):
            if step > LOST_PERIODS * period:
                found.gaps.append(((begin - kept[0]) / NS_PER_S, step / NS_PER_S))


class LiveLocalizer(OverheadLocalizer):
    """
    Pose, velocity and slip from images as they come, by a fixed-lag smoother.

    An estimate is published once images of ``overhead.lag`` behind it have been received, in
    batches: a smoother that ran at each image would need more time than the images have. Times are
    those of the messages.
    """

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
