# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rendered images of an overhead camera above a simulated drive, and what they show."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from smart_tire.analysis.overhead import estimates_of, INFO_TYPE
from smart_tire.bags.cdr import empty
from smart_tire.messages.header import set_header
from smart_tire.papers.tire_runs import Drive, ROBOT, STANDSTILL_TIME
from smart_tire.parameters import ImageParams, OverheadLocalizerParams
from smart_tire.parameters.overhead import OverheadParams
from smart_tire.recording import SampleArrays, seconds
from smart_tire.samples import NS_PER_S
from smart_tire.vision.detection import fill_image
from smart_tire.vision.overhead import CameraResult, OverheadLocalizer
from smart_tire.vision.renderer import between, Renderer

DURATIONS = {'concrete': 11.0, 'sand': 7.0}  # s that are rendered: a circle, steady slip
HEIGHT = 3.5  # m of the camera above the floor, so that it sees this circle
RATE = 10.0   # Hz of the images
SIZE, FOCAL_LENGTH = (960, 540), 750.0  # pixels; fewer than 1280 x 720 and 15 Hz save time


@dataclass(frozen=True)
class View:
    """What the camera has found in a drive."""

    found: CameraResult
    params: OverheadLocalizerParams

    @cached_property
    def estimates(self) -> SampleArrays:
        """Return poses and slips."""
        return SampleArrays(estimates_of(self.found, ROBOT.wheel_radius))


def camera_view(run: Drive, duration: float) -> View:
    """Return what a camera above the path finds in the first ``duration`` [s]."""
    truth = run.truth.poses()
    time = seconds(truth.stamp_ns, run.origin_ns) + STANDSTILL_TIME
    driven = truth.pose[time <= duration, :2]
    x, y = (0.5 * (driven.min(axis=0) + driven.max(axis=0))).tolist()
    image = ImageParams(size=SIZE, focal_length=FOCAL_LENGTH, position=(x, y, HEIGHT), rate=RATE)
    params = OverheadLocalizerParams(robot=ROBOT, overhead=OverheadParams(
        camera_position=image.position, camera_rotation=image.rotation))
    renderer = Renderer(image, params.overhead, ROBOT.wheel_radius)
    localizer = OverheadLocalizer(params)
    localizer.add_camera_info(renderer.camera.intrinsics.fill(empty(INFO_TYPE)))
    motion = between(time, truth.pose)
    for instant in np.arange(0.5 / RATE, min(duration, time[-1]), 1.0 / RATE).tolist():
        msg = fill_image(empty('sensor_msgs/msg/Image'), renderer.image(instant, motion))
        set_header(msg, run.origin_ns + round((instant - STANDSTILL_TIME) * NS_PER_S), '')
        localizer.add_image(msg)
    return View(localizer.result(run.inputs), params)
