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
Renders what a camera above the floor sees of a robot with tags.

Each pixel of the robot is the mean over ``SAMPLES`` x ``SAMPLES`` rays and several instants of the
exposure; each row has its own instants if the shutter is a rolling one. The floor stands still: it
is rendered once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.parameters.overhead import ImageParams, TagParams
from smart_tire.vision.camera import Camera, Intrinsics
from smart_tire.vision.detection import dictionary_of, Image
from smart_tire.vision.localization import square, turn

Fine = NDArray[np.float32]
Motion = Callable[[Array], Array]  # times (n,) [s] -> x, y, yaw (n, 3) of base_link in map

SAMPLES = 3               # rays per pixel and axis
INSTANTS = 2              # of an exposure, per pixel that the robot moves in it
MARGIN_MODULES = 1        # of white around a tag, as AprilTag and ArUco require
MODULE_PIXELS = 24        # of the texture of a tag: its pixels are smaller than the rays are apart
PLATE = (0.34, 0.30)      # m, length and width of the top of the robot; assumed
FLOOR, TOP, BLACK, WHITE = 0.55, 0.30, 0.06, 1.0  # reflectances; assumed: concrete, painted, ink
NOISE_SHIFT = 500         # pixels, between the noise of two images at most; a multiple of tags
GRAIN = 0.15              # relative standard deviation of the floor
TILE = 0.5                # m, distance of the joints in the floor


def camera_of(params: ImageParams) -> Camera:
    """Return the camera that takes the images."""
    width, height = params.size
    f = params.focal_length
    K = np.array([[f, 0.0, 0.5 * (width - 1)], [0.0, f, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    return Camera(Intrinsics((width, height), K, np.array(params.distortion)), params.position,
                  params.rotation)


def between(times: Array, poses: Array) -> Motion:
    """Return the motion along straight lines between ``poses`` (n, 3) at ``times`` (n,) [s]."""
    unwrapped = np.column_stack([poses[:, :2], np.unwrap(poses[:, 2])])
    return lambda wanted: np.column_stack([
        np.interp(wanted, times, one) for one in unwrapped.T])


class Renderer:
    """Renders gray images of a robot with the tags of ``overhead`` (their top at ``height``)."""

    def __init__(self, params: ImageParams, overhead: TagParams, wheel_radius: float,
                 seed: int = 0) -> None:
        self._params, self._radius = params, wheel_radius
        self.camera = camera_of(params)
        self._rng = np.random.default_rng(seed)
        # a part of it for each image: drawing new numbers takes longer than all the rest
        self._noise = params.noise * self._rng.standard_normal(
            np.add(params.size[::-1], NOISE_SHIFT), dtype=np.float32)
        self._height = wheel_radius + overhead.tag_position[2]  # m, of the plate
        width, height = params.size
        columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
        self._plane = self.camera.floor(np.stack([columns, rows], -1), 0.0).astype(np.float32)
        self._robot = _Plate(PLATE, overhead.tags, overhead.tag_size, overhead, params.occlusion)
        radius = np.hypot(columns - 0.5 * width, rows - 0.5 * height) / math.hypot(
            0.5 * width, 0.5 * height)
        self._light = (params.brightness * (1.0 - params.vignette * radius ** 2)).astype(
            np.float32)
        self._floor = self._light * self._floor_image()
        side = overhead.floor_size * (1.0 + 2.0 * MARGIN_MODULES / _modules(overhead))
        for one, place in zip(overhead.floor_ids, np.reshape(overhead.floor_position, (-1, 2))):
            self._paste(self._floor, _Plate(
                (side, side), [(one, (0.0, 0.0), 0.0)], overhead.floor_size, overhead), 0.0, 0.0,
                between(np.zeros(1), np.array([[*place, 0.0]])))

    def image(self, time: float, motion: Motion) -> Image:
        """Return the image stamped ``time`` [s], the middle of the exposure of the first row."""
        image = self._floor.copy()
        self._paste(image, self._robot, self._height, time, motion)
        return self._exposed(image)

    def _exposed(self, image: Fine) -> Image:
        """Return ``image`` through lens and sensor: blurred, noisy, clipped and quantized."""
        if self._params.lens_blur:
            image = cv2.GaussianBlur(image, (0, 0), self._params.lens_blur)
        row, column = self._rng.integers(NOISE_SHIFT, size=2).tolist()
        noise = self._noise[row:row + len(image), column:column + image.shape[1]]
        return np.asarray(cv2.addWeighted(
            image, 255.0, noise * cv2.sqrt(image + np.float32(0.5)), 1.0, 0.0, dtype=cv2.CV_8U))

    def _paste(self, image: Fine, plate: _Plate, height: float, time: float,
               motion: Motion) -> None:
        """Draw a plate at ``height`` [m] above the floor into ``image``: the mean of its rays."""
        params = self._params
        ends = plate.corners(motion(time + np.array(
            [-0.5 * params.exposure, 0.5 * params.exposure + params.readout])))
        corners = self.camera.pixels(np.dstack([ends, np.full(ends.shape[:2], height)]))
        left, top = np.maximum(np.floor(corners.min((0, 1))) - 2, 0).astype(int).tolist()
        right, bottom = np.minimum(
            np.ceil(corners.max((0, 1))) + 3, params.size).astype(int).tolist()
        if right <= left or bottom <= top:
            return
        window = np.s_[top:bottom, left:right]
        count = 1 + int(INSTANTS * np.abs(corners[1] - corners[0]).max())
        row = top - 0.5 + (np.arange(SAMPLES * (bottom - top)) + 0.5) / SAMPLES
        row_times = time + params.readout / params.size[1] * row
        place = self.camera.position.tolist()
        share = 1.0 - height / place[2]
        floor = cv2.split(cv2.resize(self._plane[window], None, fx=SAMPLES, fy=SAMPLES))  # linear
        x, y = plane = [share * one + (1.0 - share) * own for one, own in zip(floor, place)]
        # a sheared grid: edges along it meet the rays at 9 places, not 3
        rows, columns = (((np.arange(n) % SAMPLES - 0.5 * (SAMPLES - 1)) / SAMPLES).astype(
            np.float32) for n in x.shape)
        for one in plane:
            along, down = (one[0, -1] - one[0, 0]) / x.shape[1], (one[-1, 0] - one[0, 0]) / len(x)
            one += along * rows[:, None] + down * columns
        fine = sum(plate.rays(x, y, motion(row_times + share * params.exposure))
                   for share in (np.arange(count) + 0.5) / count - 0.5) / np.float32(count)
        fine[..., 0] *= self._shadow(x, y)
        light, cover = cv2.split(cv2.resize(
            fine, image[window].shape[::-1], interpolation=cv2.INTER_AREA))
        image[window] += light * self._light[window] - cover * image[window]

    def _floor_image(self) -> Fine:
        """Return the light of the floor: grain of two sizes, joints of tiles, a shadow."""
        rng = np.random.default_rng(1)
        light = np.full(self._plane.shape[:2], FLOOR, np.float32)
        for cell in (0.01, 0.15):  # m
            pattern = rng.standard_normal((256, 256)).astype(np.float32)
            place = np.mod(self._plane / cell, 254.0)
            light += FLOOR * GRAIN * 0.5 * cv2.remap(
                pattern, place[..., 0], place[..., 1], cv2.INTER_LINEAR)
        joint = np.abs(np.mod(self._plane / TILE + 0.5, 1.0) - 0.5).min(-1) * TILE < 0.003
        light[joint] *= 0.5
        return np.asarray(np.clip(light * self._shadow(*cv2.split(self._plane)), 0.0, 1.0))

    def _shadow(self, x: Fine, y: Fine) -> Fine:
        """Return the share of light at points [m]: a half plane with a soft edge is shaded."""
        distance = 0.8 * x + 0.6 * y - 0.25
        return np.asarray(1.0 - 0.5 * self._params.shadow * (1.0 + np.tanh(distance / 0.01)))


class _Plate:
    """A flat plate with tags: its reflectance as a texture, x along the columns."""

    def __init__(self, size: tuple[float, float], tags: Iterable[tuple[int, Any, float]],
                 edge: float, params: TagParams, occlusion: float = 0.0) -> None:
        side = _modules(params) * MODULE_PIXELS
        self._size, self._scale = np.array(size), side / edge  # m; pixels per m
        columns, rows = (round(one * self._scale) for one in size)
        texture = np.full((rows, columns), TOP, np.float32)
        for tag, (x, y, *_), yaw in tags:
            code = np.pad(cv2.aruco.generateImageMarker(
                dictionary_of(params.tag_family), tag, side),
                MARGIN_MODULES * MODULE_PIXELS, constant_values=255)
            cos, sin, middle = math.cos(yaw), math.sin(yaw), 0.5 * (len(code) - 1)
            # columns of the code are x of the tag, its rows -y; rows of the texture are y
            axes = np.array([[cos, sin], [sin, -cos]])
            shift = ((x, y) + 0.5 * self._size) * self._scale - 0.5
            affine = np.column_stack([axes, shift - axes @ (middle, middle)])
            cover, placed = (cv2.warpAffine(one, affine, (columns, rows)) for one in (
                np.full_like(code, 255), code))
            texture[cover > 127] = BLACK + (WHITE - BLACK) * placed[cover > 127] / 255.0
            if occlusion:
                begin, end = (round(self._scale * (x + 0.5 * size[0] + share * edge))
                              for share in (-0.6, occlusion - 0.5))
                texture[:, max(begin, 0):end] = FLOOR
        self._texture = np.dstack([texture, np.ones_like(texture)])

    def corners(self, poses: Array) -> Array:
        """Return where the corners are [m], (n, 4, 2), at poses (n, 3)."""
        return np.asarray(poses[:, None, :2] + square(1.0) * self._size @ turn(
            -poses[:, 2]))

    def rays(self, x: Fine, y: Fine, poses: Array) -> Fine:
        """Return light and share (0 or 1) of the plate in rays to x, y; each row has a pose."""
        a, b, yaw = poses.T
        cos, sin = self._scale * np.cos(yaw), self._scale * np.sin(yaw)
        shift = 0.5 * self._scale * self._size - 0.5
        rows = np.array([cos, sin, shift[0] - cos * a - sin * b, shift[1] + sin * a - cos * b])
        cos, sin, column, row = rows[:, :, None].astype(np.float32)
        return np.asarray(cv2.remap(self._texture, cos * x + (sin * y + column),
                                    cos * y - (sin * x - row), cv2.INTER_NEAREST))


def _modules(params: TagParams) -> int:
    return int(dictionary_of(params.tag_family).markerSize) + 2  # with the black border
