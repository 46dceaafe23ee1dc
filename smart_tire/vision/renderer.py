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

Each pixel of the robot is the mean over ``SAMPLES`` x ``SAMPLES`` rays and ``EXPOSURES`` instants
of the exposure; each row has its own instants if the shutter is a rolling one. The floor stands
still: it is rendered once.
"""

from __future__ import annotations

from collections.abc import Callable
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.parameters.overhead import ImageParams, OverheadParams
from smart_tire.vision.camera import Camera, Intrinsics
from smart_tire.vision.detection import dictionary_of, Image

Motion = Callable[[Array], Array]  # times (n,) [s] -> x, y, yaw (n, 3) of base_link in map

SAMPLES = 3               # rays per pixel and axis
EXPOSURES = 6             # instants of an exposure
MARGIN_MODULES = 1        # of white around a tag, as AprilTag and ArUco require
MODULE_PIXELS = 12        # of the texture of a tag
PLATE = (0.34, 0.30)      # m, length and width of the top of the robot; assumed
FLOOR, TOP, BLACK, WHITE = 0.55, 0.30, 0.06, 1.0  # reflectances; assumed: concrete, painted, ink
GRAIN = 0.15              # relative standard deviation of the floor
TILE = 0.5                # m, distance of the joints in the floor


def camera_of(params: ImageParams) -> Camera:
    """Return the camera that takes the images."""
    width, height = params.size
    f = params.focal_length
    K = np.array([[f, 0.0, 0.5 * (width - 1)], [0.0, f, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    return Camera(Intrinsics((width, height), K, np.array(params.distortion)), params.position,
                  params.rotation)


class Renderer:
    """Renders gray images of a robot with the tags of ``overhead`` (their top at ``height``)."""

    def __init__(self, params: ImageParams, overhead: OverheadParams, wheel_radius: float,
                 seed: int = 0) -> None:
        self._params, self._overhead, self._radius = params, overhead, wheel_radius
        self.camera = camera_of(params)
        self._rng = np.random.default_rng(seed)
        self._height = wheel_radius + overhead.tag_position[2]  # m, of the plate
        width, height = params.size
        columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
        self._plane = self.camera.floor(np.stack([columns, rows], -1), 0.0)  # (h, w, 2) m
        self._texture, self._scale = self._plate()
        radius = np.hypot(columns - 0.5 * width, rows - 0.5 * height) / math.hypot(
            0.5 * width, 0.5 * height)
        self._light = params.brightness * (1.0 - params.vignette * radius ** 2)
        self._floor = self._floor_image()

    def image(self, time: float, motion: Motion) -> Image:
        """Return the image stamped ``time`` [s], the middle of the exposure of the first row."""
        params, shares = self._params, (np.arange(EXPOSURES) + 0.5) / EXPOSURES - 0.5
        line = params.readout / params.size[1]
        left, top, right, bottom = self._window(motion(time + np.array(
            [-0.5 * params.exposure, 0.5 * params.exposure + params.readout])))
        image = self._floor.copy()
        if right > left and bottom > top:
            plane = self._fine_plane(left, top, right, bottom)
            row = top - 0.5 + (np.arange(plane.shape[0]) + 0.5) / SAMPLES
            parts = [self._robot(plane, motion(time + line * row + share * params.exposure))
                     for share in shares]
            weight, light = (np.mean(part, axis=0).reshape(
                bottom - top, SAMPLES, right - left, SAMPLES).mean((1, 3))
                for part in zip(*parts))
            window = image[top:bottom, left:right]
            window[:] = (1.0 - weight) * window + light
        return self._exposed(image * self._light)

    def _exposed(self, image: Array) -> Image:
        """Return ``image`` through lens and sensor: blurred, noisy, clipped and quantized."""
        params = self._params
        if params.lens_blur:
            image = cv2.GaussianBlur(image, (0, 0), params.lens_blur)
        noise = params.noise * np.sqrt(image + 0.5) * self._rng.standard_normal(image.shape)
        found = np.clip(255.0 * image + noise, 0.0, 255.0)
        return np.asarray(np.rint(found), dtype=np.uint8)

    def _window(self, poses: Array) -> tuple[int, int, int, int]:
        """Return left, top, right, bottom of the pixels that may show the robot."""
        reach = 0.5 * math.hypot(*PLATE)
        corners = np.array([[a, b] for a in (-reach, reach) for b in (-reach, reach)])
        points = (poses[:, None, :2] + corners).reshape(-1, 2)
        pixels = self.camera.pixels(np.column_stack([points, np.full(len(points), self._height)]))
        low = np.maximum(np.floor(pixels.min(0)) - 2, 0).astype(int)
        high = np.minimum(np.ceil(pixels.max(0)) + 3, self._params.size).astype(int)
        return int(low[0]), int(low[1]), int(high[0]), int(high[1])

    def _fine_plane(self, left: int, top: int, right: int, bottom: int) -> Array:
        """Return x, y [m] at the height of the plate for all rays of a window."""
        center, z = self.camera.position[:2], self.camera.position[2]
        step = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
        columns = (np.arange(left, right)[:, None] + step).ravel().astype(np.float32)
        rows = (np.arange(top, bottom)[:, None] + step).ravel().astype(np.float32)
        grid = np.meshgrid(columns, rows)
        floor = np.stack([_linear(self._plane[..., axis], *grid) for axis in range(2)], -1)
        return np.asarray(center + (floor - center) * (z - self._height) / z)

    def _robot(self, plane: Array, poses: Array) -> tuple[Array, Array]:
        """Return share of the robot in each ray (0 or 1), and its light."""
        cos, sin = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
        x, y = plane[..., 0] - poses[:, 0, None], plane[..., 1] - poses[:, 1, None]
        own = np.stack([cos * x + sin * y, cos * y - sin * x], -1)
        inside = (np.abs(own[..., 0]) < 0.5 * PLATE[0]) & (np.abs(own[..., 1]) < 0.5 * PLATE[1])
        place = ((own + 0.5 * np.array(PLATE)) * self._scale - 0.5).astype(np.float32)
        light = cv2.remap(self._texture, place[..., 0], place[..., 1], cv2.INTER_LINEAR,
                          borderMode=cv2.BORDER_REPLICATE)
        if self._params.occlusion:
            size = self._overhead.tag_size
            tag = self._overhead.tag_position
            edge = tag[0] + (self._params.occlusion - 0.5) * size
            hidden = (own[..., 0] < edge) & (own[..., 0] > tag[0] - 0.6 * size)
            light = np.where(hidden, FLOOR, light)
        light = light * self._shadow(plane)
        return inside.astype(float), np.where(inside, light, 0.0)

    def _plate(self) -> tuple[Array, float]:
        """Return the reflectance of the top of the robot, x along the columns, and its scale."""
        dictionary = dictionary_of(self._overhead.tag_family)
        modules = dictionary.markerSize + 2  # with the black border
        scale = MODULE_PIXELS * modules / self._overhead.tag_size  # pixels per m
        size = (round(PLATE[0] * scale), round(PLATE[1] * scale))
        texture = np.full(size[::-1], TOP, np.float32)
        side = modules * MODULE_PIXELS
        for tag, position, yaw in self._overhead.tags:
            code = cv2.aruco.generateImageMarker(dictionary, tag, side)
            margin = MARGIN_MODULES * MODULE_PIXELS
            code = np.pad(code, margin, constant_values=255)
            cos, sin = math.cos(yaw), math.sin(yaw)
            middle = 0.5 * (len(code) - 1)
            # columns of the code are x of the tag, its rows -y; rows of the texture are y
            turn = np.array([[cos, sin], [sin, -cos]])
            shift = (np.array(position[:2]) + 0.5 * np.array(PLATE)) * scale - 0.5
            affine = np.column_stack([turn, shift - turn @ (middle, middle)])
            for source, ink in ((np.full_like(code, 255), None), (code, code)):
                placed = cv2.warpAffine(source, affine, size, flags=cv2.INTER_LINEAR)
                if ink is None:
                    cover = placed > 127
                else:
                    texture[cover] = BLACK + (WHITE - BLACK) * placed[cover] / 255.0
        return texture, scale

    def _floor_image(self) -> Array:
        """Return the light of the floor: grain of two sizes, joints of tiles, a shadow."""
        rng = np.random.default_rng(1)
        light = np.full(self._plane.shape[:2], FLOOR)
        for cell in (0.01, 0.15):  # m
            pattern = rng.standard_normal((256, 256)).astype(np.float32)
            place = np.mod(self._plane / cell, 254.0).astype(np.float32)
            light += FLOOR * GRAIN * 0.5 * cv2.remap(
                pattern, place[..., 0], place[..., 1], cv2.INTER_LINEAR)
        joint = np.abs(np.mod(self._plane / TILE + 0.5, 1.0) - 0.5).min(-1) * TILE < 0.003
        light[joint] *= 0.5
        return np.asarray(np.clip(light * self._shadow(self._plane), 0.0, 1.0))

    def _shadow(self, points: Array) -> Array:
        """Return the share of light at points [m]: a half plane with a soft edge is shaded."""
        distance = 0.8 * points[..., 0] + 0.6 * points[..., 1] - 0.25
        return np.asarray(1.0 - self._params.shadow / (1.0 + np.exp(-distance / 0.005)))


def _linear(values: Array, columns: NDArray[np.float32], rows: NDArray[np.float32]) -> Array:
    return np.asarray(cv2.remap(values, columns, rows, cv2.INTER_LINEAR,
                                borderMode=cv2.BORDER_REPLICATE), dtype=float)
