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
Pose of the robot on the floor from the tags in one image.

The heights of the tags are known: x, y and yaw in ``map`` are fitted to the corners by least
squares. A fourth value, the inset, is how far the detected edges are inside the tag, by blur,
light and print. It moves all corners to the middle of their tag, so that it changes the size of
the tag but not its pose: an inset that no blur explains is a wrong size or height.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import math

import cv2
import numpy as np

from smart_tire.arrays import Array
from smart_tire.parameters.overhead import OverheadParams
from smart_tire.rotation import wrapped
from smart_tire.vision.camera import Camera

NOMINAL_INSET = 0.0    # pixels
MAX_INSET_ERROR = 1.0  # pixels; blur and exposure of rendered images caused up to 0.4
UNKNOWNS = 4
START_NOISE = 0.1      # pixels, of a corner; in rendered images 0.07 to 0.12
START_WEIGHT = 4       # degrees of freedom that this counts as
EXPLAINED = 0.25       # of the squares of residuals, left by the pose that explains them
MAX_NOISE_RATIO = 5.0  # residuals of an image over those of the others, in standard deviations

WRONG_SIZE = 'size of the tag contradicts overhead.tag_size and the height of the camera'
TILTED = 'tag tilted, or at another height than overhead.tag_position'
NOT_SQUARE = 'corners are not those of a flat square: partly hidden or blurred'


@dataclass(frozen=True, eq=False)
class Fix:
    """Pose of ``base_link`` in ``map`` from one image."""

    stamp_ns: int      # of the image
    pose: Array        # (3,) m, m, rad: x, y, yaw
    shape: Array       # (3, 3) covariance for a pixel noise of 1
    squares: float     # pixels^2, sum of the squared residuals
    freedom: int       # number of residuals minus unknowns
    inset: float       # pixels
    calibration: Array  # (3, 3) covariance of the error that all images share
    reason: str = ''   # why the image is not used, if its residuals prove large
    # of the k coordinates of corners: residuals (k,) [pixels], derivatives by pose and inset
    # (k, 4), rows of the image below its middle (k,)
    residual: Array = field(default_factory=lambda: np.zeros(0))
    jacobian: Array = field(default_factory=lambda: np.zeros((0, UNKNOWNS)))
    rows: Array = field(default_factory=lambda: np.zeros(0))

    def row_shift(self, rates: Array) -> tuple[Array, Array]:
        """
        Return what a second per row of a rolling shutter changes, at ``rates`` (3,) of the pose.

        These are the changes of the residuals (k,) [pixels], and of the pose (3,), by which rows
        below the middle of the image are seen later.
        """
        moved = self.rows * (self.jacobian[:, :3] @ rates)
        pose = np.linalg.lstsq(self.jacobian, moved, rcond=None)[0]
        return moved - self.jacobian @ pose, np.asarray(pose[:3], dtype=float)

    def variance(self, noise: float) -> float:
        """Return the variance [pixels^2] of a coordinate, if that of all images is noise^2."""
        return (START_WEIGHT * noise ** 2 + self.squares) / (START_WEIGHT + self.freedom)

    def fits(self, noise: float) -> bool:
        """Return whether the residuals are possible with a ``noise`` [pixels], or a shadow."""
        return self.squares <= self.freedom * (MAX_NOISE_RATIO * max(noise, START_NOISE)) ** 2


class PoseFit:
    """Fits poses to corners in images of a ``camera``."""

    def __init__(self, camera: Camera, params: OverheadParams, wheel_radius: float) -> None:
        self._camera, self._params = camera, params
        place = np.array([*params.camera_position, *params.camera_rotation])
        # wrong by one standard deviation each, in the independent directions of its errors
        self._displaced = [Camera(camera.intrinsics, *np.split(place + error, 2))
                           for error in params.camera_errors.T if error.any()]
        self._square = square(params.tag_size)
        self._corners = {tag: np.column_stack([  # (4, 3) m, above the floor
            position[:2] + self._square @ turn(yaw).T, np.full(4, position[2] + wheel_radius)])
            for tag, position, yaw in params.tags}

    def fix(self, stamp_ns: int, tags: Mapping[int, Array]) -> Fix | str:
        """Return the pose from corners (4, 2) [pixels] by id, or why there is none."""
        own = np.concatenate([self._corners[tag] for tag in tags])
        pixels = np.concatenate(list(tags.values()))
        start = self._start(self._camera, own, pixels)
        if start is None:
            return 'tag outside of the floor that the camera sees'
        inset = inward(pixels)

        def error(values: Array) -> Array:
            flat = values[:2] + own[:, :2] @ turn(values[2]).T
            seen = self._camera.pixels(np.column_stack([flat, own[:, 2]]))
            return np.asarray((seen + values[3] * inset - pixels).ravel())

        from scipy.optimize import least_squares  # at first use: takes a part of a second
        fit = least_squares(error, start, method='lm', x_scale='jac')
        values, residual, jacobian = fit.x, -fit.fun, fit.jac
        shape = np.linalg.inv(jacobian.T @ jacobian)
        squares, freedom = float(residual @ residual), pixels.size - UNKNOWNS
        reason = self._reason(pixels, squares)
        if abs(values[3] - NOMINAL_INSET) > MAX_INSET_ERROR:
            large = squares > freedom * (MAX_NOISE_RATIO * START_NOISE) ** 2
            return TILTED if large and reason == TILTED else WRONG_SIZE
        values[2] = math.remainder(values[2], math.tau)
        return Fix(stamp_ns, values[:3], shape[:3, :3], squares, freedom, float(values[3]),
                   self._calibration(own, pixels, values), reason,
                   residual, jacobian, np.repeat(
                       pixels[:, 1] - 0.5 * (self._camera.intrinsics.size[1] - 1), 2))

    @staticmethod
    def _start(camera: Camera, own: Array, pixels: Array) -> Array | None:
        """Return x, y, yaw and inset from the corners in the plane of the tag."""
        flat = camera.floor(pixels, own[:, 2:])
        if not np.isfinite(flat).all():
            return None
        yaw, shift = aligned(own[:, :2], flat)
        return np.array([*shift, yaw, NOMINAL_INSET])

    def _calibration(self, own: Array, pixels: Array, values: Array) -> Array:
        """Return the covariance of the pose that the errors of the calibration cause."""
        params = self._params
        x, y = own[:, :2].mean(0)
        lever = np.eye(3)
        lever[:2] = turn(values[2]) @ [[1.0, 0.0, y], [0.0, 1.0, -x]]
        lever *= params.tag_position_sigma, params.tag_position_sigma, params.tag_yaw_sigma
        moved = [self._start(camera, own, pixels) for camera in self._displaced]
        errors = np.array([*lever.T, *(one[:3] - values[:3] for one in moved if one is not None)])
        errors[:, 2] = wrapped(errors[:, 2])
        return np.asarray(errors.T @ errors)

    def _reason(self, pixels: Array, squares: float) -> str:
        """Return why residuals are large, from those of a general pose (IPPE) of the tags."""
        general = 0.0
        for quad in pixels.reshape(-1, 4, 2):
            _, _, _, errors = cv2.solvePnPGeneric(
                np.column_stack([self._square, np.zeros(4)]), self._camera.rays(quad)[:, None],
                np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
            focal = self._camera.intrinsics.matrix[0, 0]
            general += 8.0 * (float(np.min(errors)) * focal) ** 2  # rms of the coordinates
        return TILTED if general < EXPLAINED * squares else NOT_SQUARE


def square(size: float) -> Array:
    """Return the corners (4, 2) of an upright tag, clockwise from the upper left."""
    return 0.5 * size * np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])


def aligned(points: Array, others: Array) -> tuple[float, Array]:
    """Return rotation [rad] and shift (2,) that move ``points`` (n, 2) to ``others``."""
    a, b = points - points.mean(0), others - others.mean(0)
    yaw = math.atan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
    return yaw, others.mean(0) - turn(yaw) @ points.mean(0)


def turn(yaw: float | Array) -> Array:
    """Return the rotations (..., 2, 2) by angles (...) [rad]."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.moveaxis(np.array([[cos, -sin], [sin, cos]]), (0, 1), (-2, -1))


def inward(pixels: Array) -> Array:
    """Return for corners (4 n, 2) where a corner moves if both edges move inward by a pixel."""
    quads = pixels.reshape(-1, 4, 2)
    edges = np.roll(quads, -1, 1) - quads
    edges /= np.linalg.norm(edges, axis=-1, keepdims=True)
    return np.asarray((edges - np.roll(edges, 1, 1)).reshape(-1, 2))
