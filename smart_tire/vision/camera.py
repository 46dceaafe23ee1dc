# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Pinhole camera of a ``CameraInfo`` at a known place: points of ``map`` to pixels and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np

from smart_tire.arrays import Array
from smart_tire.errors import MessageError, ParameterError
from smart_tire.rotation import matrix
from smart_tire.yaml_text import parse_yaml

# distortion_model of CameraInfo -> numbers of coefficients (sensor_msgs/distortion_models.hpp)
DISTORTION = {'plumb_bob': (0, 4, 5), 'rational_polynomial': (8, 12, 14), 'equidistant': (0, 4)}
# opencv 5 has one function for both
UNDISTORT: Any = getattr(cv2, 'undistortPointsIter', cv2.undistortPoints)
UNDISTORTION = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-10)  # steps, change


@dataclass(frozen=True, eq=False)
class Intrinsics:
    """Size, matrix and distortion of a camera; pixel (0, 0) has its center at (0, 0)."""

    size: tuple[int, int]    # pixels, width and height
    matrix: Array            # (3, 3) K
    distortion: Array        # coefficients D, (n,)
    model: str = 'plumb_bob'  # a key of DISTORTION

    @classmethod
    def from_msg(cls, msg: Any) -> Intrinsics:
        """
        Return the intrinsics in a CameraInfo, for the window and binning that it states.

        Raises MessageError if the camera is not calibrated (K is zero, not finite or not that of a
        pinhole), or if the distortion is unknown.
        """
        K = np.array(msg.k, dtype=float).reshape(3, 3)
        D = np.array(msg.d, dtype=float)
        if not np.isfinite(K).all() or K[0, 0] <= 0.0 or K[1, 1] <= 0.0 or K[2, 2] != 1.0:
            raise MessageError(f'camera_info: K is {K.ravel().tolist()}: not calibrated')
        if not np.isfinite(D).all() or len(D) not in DISTORTION.get(msg.distortion_model, ()):
            raise MessageError(
                f'camera_info: distortion_model is {msg.distortion_model!r} with {len(D)} '
                f'coefficients, expected one of {", ".join(DISTORTION)}')
        roi, size = msg.roi, np.array([msg.width, msg.height])
        if roi.width and roi.height:
            size = np.array([roi.width, roi.height])
            K[:2, 2] -= roi.x_offset, roi.y_offset
        binning = np.array([max(msg.binning_x, 1), max(msg.binning_y, 1)])
        K[:2, 2] = (K[:2, 2] + 0.5) / binning - 0.5
        K[[0, 1], [0, 1]] /= binning
        width, height = (size // binning).tolist()
        if min(width, height) <= 0:
            raise MessageError(f'camera_info: an image of {width} x {height} pixels')
        return cls((width, height), K, D, msg.distortion_model)

    def fill(self, msg: Any) -> Any:
        """Write the intrinsics into a CameraInfo and return it."""
        msg.width, msg.height = self.size
        msg.distortion_model, msg.d = self.model, self.distortion.tolist()
        msg.k, msg.r = self.matrix.ravel(), np.eye(3).ravel()
        msg.p = np.column_stack([self.matrix, np.zeros(3)]).ravel()
        return msg

    @classmethod
    def from_file(cls, path: str) -> Intrinsics:
        """Return those in a YAML file by ``camera_calibration``; raise ParameterError."""
        try:
            found = parse_yaml(Path(path).read_bytes())
            return cls.from_msg(SimpleNamespace(
                width=found['image_width'], height=found['image_height'],
                k=found['camera_matrix']['data'], d=found['distortion_coefficients']['data'],
                distortion_model=found['distortion_model'], binning_x=0, binning_y=0,
                roi=SimpleNamespace(width=0, height=0)))
        except (OSError, LookupError, TypeError, ValueError, MessageError) as error:
            raise ParameterError(f'parameter overhead.camera_info_file: {path}: no calibration '
                                 f'of a camera ({type(error).__name__}: {error})') from error

    def differs(self, other: Intrinsics) -> bool:
        """Return whether a number or the model differs from that of ``other``."""
        return (self.size, self.model) != (other.size, other.model) or not (
            np.array_equal(self.matrix, other.matrix)
            and np.array_equal(self.distortion, other.distortion))


class Camera:
    """
    A camera with ``intrinsics`` at a pose of its optical frame (z forward, x right) in ``map``.

    ``position`` is in m; ``angles`` (roll, pitch, yaw) in rad, the rotation is Rz Ry Rx.
    """

    def __init__(self, intrinsics: Intrinsics, position: Sequence[float] | Array,
                 angles: Sequence[float] | Array) -> None:
        self.intrinsics = intrinsics
        self.position = np.asarray(position, dtype=float)
        self.rotation = matrix(*angles)  # of vectors from the optical frame to map

    def pixels(self, points: Array) -> Array:
        """Return where points (..., 3) [m] in ``map`` are in the image [pixels], (..., 2)."""
        own = ((points - self.position) @ self.rotation).reshape(-1, 1, 3)
        inner, zero = self.intrinsics, np.zeros(3)
        if inner.model == 'equidistant':
            found, _ = cv2.fisheye.projectPoints(own, zero, zero, inner.matrix, _four(inner))
        else:
            found, _ = cv2.projectPoints(own, zero, zero, inner.matrix, inner.distortion)
        return np.asarray(found, dtype=float).reshape(*points.shape[:-1], 2)

    def rays(self, pixels: Array) -> Array:
        """Return the points (..., 2) at unit distance along z of the optical frame on the rays."""
        inner, given = self.intrinsics, np.asarray(pixels, dtype=float).reshape(-1, 1, 2)
        if inner.model == 'equidistant':
            plane = cv2.fisheye.undistortPoints(
                given, inner.matrix, _four(inner), criteria=UNDISTORTION)
        else:
            plane = UNDISTORT(given, inner.matrix, inner.distortion, R=None, P=None,
                              criteria=UNDISTORTION)
        return np.asarray(plane.reshape(pixels.shape))

    def floor(self, pixels: Array, height: float | Array) -> Array:
        """
        Return where the rays of pixels (..., 2) meet the plane z = ``height`` [m]: x, y (..., 2).

        ``height`` may be that of each pixel, (..., 1). NaN for rays that do not meet it in front
        of the camera.
        """
        rays = self.rays(pixels) @ self.rotation[:, :2].T + self.rotation[:, 2]
        with np.errstate(divide='ignore', invalid='ignore'):
            reach = (height - self.position[2]) / rays[..., 2:]
        return np.asarray(self.position[:2] + np.where(reach > 0.0, reach, np.nan) * rays[..., :2])


def _four(inner: Intrinsics) -> Array:
    return inner.distortion if len(inner.distortion) else np.zeros(4)
