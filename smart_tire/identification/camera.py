# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Places of the overhead camera and of the tags: ``smart_tire calibrate camera``."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from smart_tire.analysis.overhead import camera_topics, INFO_TYPE
from smart_tire.arrays import Array
from smart_tire.bags import Bag, Decoder
from smart_tire.calibration.results import Found
from smart_tire.errors import EstimatorError
from smart_tire.identification.identify import Identification
from smart_tire.messages import stamp_of
from smart_tire.parameters import OverheadLocalizerParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.uncertain import fused, Uncertain
from smart_tire.vision.camera import Camera, Intrinsics
from smart_tire.vision.detection import gray_image, TagDetector
from smart_tire.vision.localization import Fix, PoseFit
from smart_tire.vision.place import camera_place, marker_corners, tag_place

AXES = ('x', 'm'), ('y', 'm'), ('z', 'm'), ('roll', 'rad'), ('pitch', 'rad'), ('yaw', 'rad')
INPUTS = 'imu/data', 'wheel_states'
TURN = 'no turn in place while the tag is seen, by the wheels'
WITHOUT = {'x': TURN, 'y': TURN, 'yaw': 'no straight motion while the tag is seen'}

Corners = dict[int, list[tuple[int, Array]]]  # id -> stamps [ns] and corners (4, 2) [pixels]


def calibrate(bag: Bag, params: OverheadLocalizerParams, icr_x: Uncertain) -> Identification:
    """
    Return the places that an open bag shows; ``icr_x`` [m] is S of the robot.

    Raises EstimatorError with the reason if there is nothing to be seen.
    """
    intrinsics, seen = detections(bag, params)
    made = Identification(Found(), [], None)
    if params.overhead.floor_ids:
        found = made.found.attempt('camera', lambda: camera_place(intrinsics, marker_corners({
            one: [quad for _, quad in seen[one]] for one in params.overhead.floor_ids}),
            params.overhead))
        if found is not None:
            place, covariance, noise = found
            for (axis, unit), *value in zip(AXES, place, np.sqrt(np.diag(covariance))):
                made.found.add(f'camera {axis}', Uncertain(*map(float, value)), unit)
            made.found.notes.append(f'noise of the corners of the markers: {noise:.3f} pixels')
            made.parameters.extend(camera_parameters(place, covariance))
            params = replace(params, overhead=replace(
                params.overhead, camera_position=tuple(place[:3]),
                camera_rotation=tuple(place[3:])))
    if params.overhead.camera_position and params.overhead.camera_rotation:
        _add_tags(made, bag, params, Camera(
            intrinsics, params.overhead.camera_position, params.overhead.camera_rotation), seen,
            icr_x)
    else:
        made.found.refused['tags'] = 'the place of the camera is not known'
    return made


def detections(bag: Bag, params: OverheadLocalizerParams) -> tuple[Intrinsics, Corners]:
    """Return the intrinsics of the camera, and the corners of all tags in its images."""
    (images, infos), file = camera_topics(bag), params.overhead.camera_info_file
    if not images or not (infos or file):
        raise EstimatorError('no images and camera_info in this recording')
    intrinsics = Intrinsics.from_file(file) if file else Intrinsics.from_msg(
        Decoder(INFO_TYPE)(next(data for _, _, data in bag.raw({infos}))))
    image, detector = Decoder(bag.types[images]), TagDetector(params.overhead.tag_family)
    found: Corners = defaultdict(list)
    for _, _, data in bag.raw({images}):
        msg = image(data)
        pixels = gray_image(msg)
        if (size := pixels.shape[::-1]) != intrinsics.size:
            raise EstimatorError('images have {} x {} pixels, camera_info has {} x {}'.format(
                *size, *intrinsics.size))
        for tag, quad in detector.tags(pixels)[0].items():
            found[tag].append((stamp_of(msg), quad))
    return intrinsics, found


def camera_parameters(place: Array, covariance: Array) -> list[Identified]:
    """Return the parameters with the place (6,) of the camera and its covariance (6, 6)."""
    sigma = np.sqrt(np.diag(covariance))
    correlation = (covariance / np.outer(sigma, sigma))[np.triu_indices(6, 1)]
    found = [Identified('overhead.camera_correlation', tuple(correlation.tolist()))]
    for name, part in (('position', slice(0, 3)), ('rotation', slice(3, 6))):
        error = tuple(sigma[part].tolist())
        found += [Identified(f'overhead.camera_{name}', tuple(place[part].tolist()), error),
                  Identified(f'overhead.camera_{name}_sigma', error)]
    return found


def _add_tags(made: Identification, bag: Bag, params: OverheadLocalizerParams, camera: Camera,
              seen: Corners, icr_x: Uncertain) -> None:
    """Add the places of the tags on the robot; those that are not observable are kept."""
    inputs, overhead = bag.recording(INPUTS), params.overhead
    positions: list[Uncertain] = []
    yaws: list[Uncertain] = []
    for tag, (*place, z), angle in overhead.tags:
        own = PoseFit(camera, replace(overhead, tag_ids=(tag,), tag_position=(0.0, 0.0, z),
                                      tag_yaw=(0.0,)), params.robot.wheel_radius)
        fixes = [own.fix(stamp_ns, {tag: quad}) for stamp_ns, quad in seen[tag]]
        usable = [one for one in fixes if isinstance(one, Fix)]
        if not usable:
            made.found.refused[f'tag {tag}'] = str(fixes[0]) if fixes else 'in no image'
            continue
        found = made.found.attempt(f'tag {tag}', partial(
            tag_place, usable, inputs, params.robot, icr_x,
            Uncertain(angle, overhead.tag_yaw_sigma)))
        for axis, estimate in zip(('x', 'y', 'yaw'), found or ()):
            if estimate is None:
                made.found.refused[f'tag {tag} {axis}'] = WITHOUT[axis]
                continue
            if axis != 'yaw' and overhead.tag_position_sigma:
                estimate = fused(estimate, Uncertain(
                    place['xy'.index(axis)], overhead.tag_position_sigma))
            made.found.add(f'tag {tag} {axis}', estimate, 'rad' if axis == 'yaw' else 'm')
            (yaws if axis == 'yaw' else positions).append(estimate)
    count = len(overhead.tag_ids)
    if len(positions) == 2 * count:
        heights = (Uncertain(z, 0.0) for z in overhead.tag_position[2::3])
        made.parameters.extend(_identified('tag_position', [
            one for row in zip(positions[::2], positions[1::2], heights) for one in row]))
    if len(yaws) == count:
        made.parameters.extend(_identified('tag_yaw', yaws))


def _identified(name: str, values: Sequence[Uncertain]) -> Iterator[Identified]:
    """Yield the parameter and that of the largest standard error."""
    yield Identified(f'overhead.{name}', tuple(one.value for one in values),
                     tuple(one.sigma for one in values))
    yield Identified(f'overhead.{name}_sigma', max(one.sigma for one in values))
