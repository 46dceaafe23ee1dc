# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Overhead camera: errors of single images, over distance, light and motion; images per second."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from functools import partial
import math
import sys
import time
from typing import Any

from benchmarks.harness import markdown, new_table, number, positive
import numpy as np

from smart_tire.arrays import Array
from smart_tire.bags.cdr import empty
from smart_tire.messages.header import set_header
from smart_tire.parameters.overhead import ImageParams, OverheadLocalizerParams, OverheadParams
from smart_tire.samples import four, ImuSample, NS_PER_S, WheelSample
from smart_tire.vision.detection import fill_image, TagDetector
from smart_tire.vision.localization import PoseFit, START_NOISE
from smart_tire.vision.overhead import LiveLocalizer
from smart_tire.vision.renderer import Renderer

DESCRIPTION = 'measure the error of the pose in rendered images'
RADIUS = 0.087             # m, wheel of paper B
VELOCITY = 0.4, 0.1, 0.5   # m/s, m/s, rad/s: standard deviations of the motion
ROTATION = math.pi - 0.08, 0.05, 0.3  # rad, of the camera
SIZES = (1280, 720), (1920, 1080)     # pixels, with the same field of view
RATE, DURATION = 30.0, 3.0  # Hz and s, of the images whose processor time is measured
COLUMNS = 'condition', 'used', 'wrong', 'position rms [mm]', 'yaw rms [deg]', 'tag [pixels]'
WRONG_SIGMAS = 5.0         # of its standard deviation, error from which a pose counts as wrong
CONDITIONS: dict[str, dict[str, Any]] = {
    'height 3 m, tag 0.16 m, exposure 5 ms': {},
    **{f'height {z:g} m': {'position': (0.0, 0.0, z)} for z in (1.0, 2.0, 4.0, 5.0, 6.0)},
    **{f'tag {size:g} m': {'tag_size': size} for size in (0.08, 0.12, 0.20)},
    'dark: white at 0.15': {'brightness': 0.15}, 'overexposed: white at 1.5': {'brightness': 1.5},
    'shadow of 80 %': {'shadow': 0.8}, 'noise of 8': {'noise': 8.0},
    'exposure 20 ms': {'exposure': 0.02}, 'lens blur of 1.5 pixels': {'lens_blur': 1.5},
    '10 % of the tag hidden': {'occlusion': 0.1}, '30 % of the tag hidden': {'occlusion': 0.3}}


def main(argv: Sequence[str] | None = None) -> int:
    """Print a table with a row for each condition; return the exit status."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.overhead', description=DESCRIPTION)
    parser.add_argument('--images', type=positive, default=40, metavar='N',
                        help='images of each condition (default: %(default)s)')
    args = parser.parse_args(argv)
    table = new_table('Pose in single images of 1280 x 720 pixels', *COLUMNS)
    for row in rows(args.images):
        table.add_row(*row)
    print(markdown(table))
    table = new_table('overhead_localizer on one core', 'pixels', 'ms per image', 'images/s')
    for size in SIZES:
        spent = process_time(size)
        table.add_row('{} x {}'.format(*size), number(1e3 * spent, 1), number(1.0 / spent, 0))
    print(markdown(table))
    return 0


def rows(images: int, seed: int = 7) -> Iterator[list[str]]:
    """Yield the cells of each condition, from ``images`` at random poses."""
    for name, changes in CONDITIONS.items():
        own = {key: changes[key] for key in changes if key == 'tag_size'}
        camera = ImageParams(rotation=ROTATION, **{
            key: value for key, value in changes.items() if key not in own})
        yield [name, *cells(camera, OverheadParams(
            camera_position=camera.position, camera_rotation=camera.rotation, **own), images,
            np.random.default_rng(seed))]


def process_time(size: tuple[int, int]) -> float:
    """Return the mean processor time [s] of an image with IMU and wheels, of all threads."""
    images = round(DURATION * RATE)
    params = ImageParams(size=size, focal_length=ImageParams.focal_length * size[0] / SIZES[0][0])
    localizer = LiveLocalizer(OverheadLocalizerParams(overhead=OverheadParams(
        camera_position=params.position, camera_rotation=params.rotation)))
    renderer = Renderer(params, OverheadParams(), RADIUS)
    localizer.add_camera_info(renderer.camera.intrinsics.fill(empty('sensor_msgs/msg/CameraInfo')))
    for stamp_ns in range(1, round((DURATION + 1.0) * NS_PER_S), NS_PER_S // 100):
        localizer.add_sample(ImuSample(stamp_ns, (0.0, 0.0, 9.81), (0.0, 0.0, 0.5)))
        if stamp_ns % (NS_PER_S // 20) < NS_PER_S // 100:
            localizer.add_sample(WheelSample(stamp_ns, four([3.0] * 4)))
    messages = []
    for k in range(images):
        msg = fill_image(empty('sensor_msgs/msg/Image'), renderer.image(k / RATE, partial(
            moving, np.array([-0.4, 0.1, 0.0]), np.array([0.3, 0.0, 0.5]))))
        set_header(msg, NS_PER_S + round(k / RATE * NS_PER_S), '')
        messages.append(msg)
    localizer.estimates(messages[0])
    begin = time.process_time()
    for msg in messages[1:]:
        localizer.estimates(msg)
    return (time.process_time() - begin) / (images - 1)


def moving(pose: Array, velocity: Array, times: Array) -> Array:
    """Return poses (n, 3) at ``times`` (n,) [s]."""
    return pose + np.outer(times, velocity)


def cells(params: ImageParams, overhead: OverheadParams, images: int, rng: Any) -> list[str]:
    """Return counts, errors and the size of the tag as text."""
    renderer, detector = Renderer(params, overhead, RADIUS), TagDetector(overhead.tag_family)
    fit = PoseFit(renderer.camera, overhead, RADIUS)
    height = params.position[2] - RADIUS - overhead.tag_position[2]
    reach = np.array([0.35 * params.size[0], 0.3 * params.size[1], 0.0]) * (
        height / params.focal_length)
    reach[2] = math.pi
    errors, wrong = [], 0
    for _ in range(images):
        pose, velocity = rng.uniform(-reach, reach), rng.normal(0.0, VELOCITY)
        found, _ = detector.tags(
            renderer.image(0.0, partial(moving, pose, velocity)), overhead.tag_ids)
        fix = fit.fix(0, found) if found else ''
        if isinstance(fix, str) or not fix.fits(START_NOISE):
            continue
        error = fix.pose - pose
        error[2] = math.remainder(error[2], math.tau)
        sigma = np.sqrt(fix.variance(START_NOISE) * np.diag(fix.shape))
        wrong += bool((np.abs(error) > WRONG_SIGMAS * sigma).any())
        errors.append(error)
    rms = np.sqrt(np.mean(np.square(errors), axis=0)) if errors else np.full(3, math.nan)
    return [f'{len(errors)} of {images}', str(wrong), number(1e3 * math.hypot(*rms[:2]), 2),
            number(math.degrees(rms[2]), 3),
            number(overhead.tag_size * params.focal_length / height, 0)]


if __name__ == '__main__':
    sys.exit(main())
