# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Parameters of the overhead camera (``config/overhead.yaml``)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import inlined, nested, param, reliability

if TYPE_CHECKING:
    from numpy import float64
    from numpy.typing import NDArray

ROUNDING = 1e-5  # of the eigenvalues of correlations, which are written with seven digits


@dataclass(frozen=True, kw_only=True)
class TagParams:
    """Tags on the robot, flat on its top, and markers on the floor."""

    tag_family: str = param(
        '36h11', '-', 'AprilTag family, or ArUco dictionary as opencv names it')
    tag_ids: tuple[int, ...] = param((0,), '-', 'tags on the robot', (0, 100000))
    tag_size: float = param(0.16, 'm', 'edge of the black square', (1e-3, 10.0))
    tag_position: tuple[float, ...] = param(
        (0.0, 0.0, 0.15), 'm', 'centers of the tags in base_link: x, y, z of each', (-10.0, 10.0))
    tag_yaw: tuple[float, ...] = param(
        (0.0,), 'rad', 'of the upright x axis of each tag against the x axis of the robot',
        (-math.tau, math.tau), scalar=True)
    floor_ids: tuple[int, ...] = param(
        (), '-', 'markers on the floor, for "smart_tire calibrate camera"', (0, 100000))
    floor_position: tuple[float, ...] = param(
        (), 'm', 'centers of these markers in map: x, y of each', (-1e3, 1e3))
    floor_size: float = param(0.16, 'm', 'edge of the black square of these markers', (1e-3, 10.0))

    def __post_init__(self) -> None:
        count = len(self.tag_ids)
        if len(set(self.tag_ids)) != count or not count:
            raise ValueError(f'overhead.tag_ids: {list(self.tag_ids)}, expected different ids')
        if len(self.tag_position) != 3 * count or len(self.tag_yaw) != count:
            raise ValueError(
                f'overhead.tag_position has {len(self.tag_position)} and overhead.tag_yaw '
                f'{len(self.tag_yaw)} numbers, expected 3 and 1 for each of {count} tags')
        if len(self.floor_position) != 2 * len(self.floor_ids):
            raise ValueError(f'overhead.floor_position has {len(self.floor_position)} numbers, '
                             f'expected 2 for each of {len(self.floor_ids)} markers')
        if both := {*self.floor_ids} & {*self.tag_ids}:
            raise ValueError(f'overhead.floor_ids: {min(both)} is one of overhead.tag_ids')

    @property
    def tags(self) -> Iterable[tuple[int, tuple[float, ...], float]]:
        """Return id, position [m] in ``base_link`` and yaw [rad] of each tag."""
        return zip(self.tag_ids, zip(*[iter(self.tag_position)] * 3), self.tag_yaw)


@dataclass(frozen=True, kw_only=True)
class OverheadParams(TagParams):
    """
    Camera above the floor and the tags on the robot.

    Sigmas are standard deviations of the calibration: all frames share these errors. Those of a
    calibrated camera are strongly correlated; without ``camera_correlation`` they are independent.
    """

    camera_position: tuple[float, ...] = param(
        (), 'm', 'position of overhead_camera_optical_frame in map; must be given', (-1e3, 1e3))
    camera_rotation: tuple[float, ...] = param(
        (), 'rad', 'roll, pitch, yaw of that frame in map; must be given', (-math.tau, math.tau))
    camera_position_sigma: tuple[float, ...] = param(
        (0.0, 0.0, 0.0), 'm', 'standard deviations of camera_position', (0.0, 10.0), length=3)
    camera_rotation_sigma: tuple[float, ...] = param(
        (0.0, 0.0, 0.0), 'rad', 'standard deviations of camera_rotation', (0.0, 1.0), length=3)
    camera_correlation: tuple[float, ...] = param(
        (), '-', 'correlations of x, y, z, roll, pitch, yaw of the camera: the 15 above the '
        'diagonal, by rows; empty: independent', (-1.0, 1.0))
    camera_info_file: str = param(
        '', '-', 'YAML file by camera_calibration, in place of overhead_camera/camera_info')
    floor_position_sigma: float = param(
        0.002, 'm', 'standard deviation of x and y of floor_position', (1e-5, 1.0))
    tag_position_sigma: float = param(
        0.0, 'm', 'standard deviation of x and y of tag_position', (0.0, 1.0))
    tag_yaw_sigma: float = param(0.0, 'rad', 'standard deviation of tag_yaw', (0.0, 1.0))
    time_offset: float = param(
        math.nan, 's', 'by which the timestamps of images are late; .nan: estimated',
        (-10.0, 10.0), nan=True)
    lag: float = param(
        0.5, 's', 'of the live estimates behind the images: later frames that are used',
        (0.0, 5.0))

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, count in (('position', 3), ('rotation', 3), ('correlation', 15)):
            if len(given := getattr(self, f'camera_{name}')) not in (0, count):
                raise ValueError(f'overhead.camera_{name} has {len(given)} numbers, '
                                 f'expected {count}')
        if self.camera_correlation and self._correlations()[0].min() < -ROUNDING:
            raise ValueError('overhead.camera_correlation: not positive semidefinite')

    def _correlations(self) -> tuple[NDArray[float64], NDArray[float64]]:
        """Return eigenvalues (6,) and eigenvectors (6, 6) of the correlations."""
        import numpy as np  # with the first camera: the help of a node is printed without it
        found = np.eye(6)
        found[np.triu_indices(6, 1)] = self.camera_correlation or 0.0
        values, vectors = np.linalg.eigh(found, 'U')
        return values, vectors

    @property
    def camera_errors(self) -> NDArray[float64]:
        """
        Return independent errors of the place of the camera, one standard deviation each, (6, 6).

        Each column is an error of position [m] and angles [rad]; the covariance is their sum of
        outer products.
        """
        values, vectors = self._correlations()
        sigma = (*self.camera_position_sigma, *self.camera_rotation_sigma)
        return (vectors.T * sigma).T * values.clip(0.0) ** 0.5


@dataclass(frozen=True, kw_only=True)
class OverheadLocalizerParams:
    """Overhead camera: pose, velocity and slip of a robot with tags on it."""

    overhead: OverheadParams = nested(OverheadParams)
    reliability: str = reliability()
    robot: RobotParams = inlined(RobotParams)


@dataclass(frozen=True, kw_only=True)
class ImageParams:
    """Simulated images: sensor, light and lens."""

    size: tuple[int, ...] = param(
        (1280, 720), '-', 'pixels, width and height', (16, 8192), length=2)
    focal_length: float = param(1000.0, '-', 'focal length in pixels', (10.0, 1e5))
    distortion: tuple[float, ...] = param(
        (0.0, 0.0, 0.0, 0.0, 0.0), '-', 'coefficients k1, k2, p1, p2, k3 (plumb_bob)',
        (-10.0, 10.0), length=5)
    position: tuple[float, ...] = param(
        (0.0, 0.0, 3.0), 'm', 'position of the camera in map', (-100.0, 100.0), length=3)
    rotation: tuple[float, ...] = param(
        (math.pi, 0.0, 0.0), 'rad', 'roll, pitch, yaw of its optical frame in map; looks down',
        (-math.tau, math.tau), length=3)
    rate: float = param(15.0, 'Hz', 'images per second', (0.1, 120.0))
    exposure: float = param(0.005, 's', 'exposure time, centered at the timestamp', (0.0, 0.1))
    readout: float = param(
        0.0, 's', 'from the first to the last row of a rolling shutter; 0: global', (0.0, 0.1))
    lens_blur: float = param(
        0.6, '-', 'standard deviation of the point spread in pixels', (0.0, 10.0))
    brightness: float = param(
        0.7, '-', 'of white over the full scale; above 1: clipped', (0.01, 10.0))
    vignette: float = param(0.3, '-', 'loss of light in the corners', (0.0, 1.0))
    shadow: float = param(0.5, '-', 'loss of light in the shadow of an edge', (0.0, 1.0))
    noise: float = param(
        2.0, '-', 'standard deviation of one pixel at half scale, of 255', (0.0, 100.0))
    occlusion: float = param(
        0.0, '-', 'share of the tag that a bar in front of it hides', (0.0, 1.0))
    jpeg_quality: int = param(0, '-', 'of compressed images; 0: not compressed', (0, 100))


@dataclass(frozen=True, kw_only=True)
class OverheadCameraSimulatorParams:
    """Simulated camera above the floor of the simulated robot."""

    seed: int = param(1, '-', 'seed of the noise', (0, 2**32 - 1))
    image: ImageParams = nested(ImageParams)
    overhead: TagParams = nested(TagParams)
    robot: RobotParams = inlined(RobotParams)
