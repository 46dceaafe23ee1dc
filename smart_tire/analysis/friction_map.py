# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction maps of bags: the track of each drive, the figure and the files of a map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math
from pathlib import Path

import numpy as np

from smart_tire.analysis.drawing import save
from smart_tire.analysis.export import write_table
from smart_tire.analysis.figure import ColorField, Curve, Figure, Mark, Panel
from smart_tire.analysis.metrics import given_covariance, rotated
from smart_tire.arrays import Array
from smart_tire.bags import Bag, BagWriter
from smart_tire.bags.cdr import Decoder
from smart_tire.errors import MessageError
from smart_tire.estimates import PoseEstimate
from smart_tire.mapping.grid import FrictionMap
from smart_tire.mapping.raster import grid_of, speed_mask, write_image, write_raster
from smart_tire.mapping.track import friction_track, FrictionTrack
from smart_tire.messages import stamp_of, transform_from_msg
from smart_tire.parameters import TrajectoryControllerParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import Vector3

MAP, CELLS, FIGURE = 'friction_map', 'friction_map.csv', 'friction_map_figure.png'
MASK = 'speed_mask'
FILES = (f'{MAP}.yaml', f'{MAP}.png', f'{MAP}_sigma.png', CELLS, FIGURE)
MASK_FILES = (f'{MASK}.yaml', f'{MASK}.png')
MAX_FRICTION, MAX_SIGMA = 1.0, 0.2  # upper ends of the color scales
FIGURE_CELL = 5.0, 4.2  # inch
MAX_STEP = 0.1  # m between the points of a line: four of a track
TRANSFORMS = 'tf2_msgs/msg/TFMessage'
LOCALIZED = 0.05, 0.05, 0.02  # m, m, rad: x, y, yaw of a localization by lidar, assumed


def track_of(estimates: SampleArrays, camera: SampleArrays, robot: RobotParams,
             bag: Bag | None = None, *, drive: str) -> FrictionTrack:
    """
    Return the friction on the tracks of a drive.

    In ``map`` if the ``camera`` has seen the robot, or the recorded ``bag`` has its place there,
    else in ``odom``. The bag also names the robot.
    """
    poses, seen = estimates.poses(), camera.poses()
    if bag is not None and not (len(seen) and _overlap(poses, seen)):
        seen = localization(bag, poses, robot)
    frame = 'odom'
    if len(poses) and len(seen) and _overlap(poses, seen):
        poses, frame = in_map(poses, seen), 'map'
    return friction_track(poses, estimates.grounds(), estimates.frictions(), robot, frame=frame,
                          drive=drive, name='' if bag is None else robot_name(bag))


def _overlap(poses: PoseEstimate, seen: PoseEstimate) -> bool:
    return bool(seen.stamp_ns[-1] > poses.stamp_ns[0] and seen.stamp_ns[0] < poses.stamp_ns[-1])


def robot_name(bag: Bag) -> str:
    """Return the namespace of the inputs in a bag: drives in one namespace are of one robot."""
    name = bag.match(['wheel_states']).get('wheel_states', '').strip('/')
    return name.removesuffix('wheel_states').strip('/')


def localization(bag: Bag, poses: PoseEstimate, robot: RobotParams) -> PoseEstimate:
    """
    Return the poses in ``map`` when it was related to the frame of ``poses``; empty if never.

    By the transforms from ``map`` to the frame of the odometry in a bag, whose standard deviation
    is ``LOCALIZED``: the messages have none.
    """
    found: dict[int, Vector3] = {}  # index of a pose -> x, y, yaw of the odometry in the map
    names = {name for name, kind in bag.types.items() if kind == TRANSFORMS}
    read = Decoder(TRANSFORMS)
    for _, channel, data in bag.raw(names) if names and len(poses) > 1 else ():
        try:
            for one in read(data).transforms:
                if (one.header.frame_id, one.child_frame_id) == ('map', robot.frames['odom']):
                    offset, stamp_ns = transform_from_msg(one), stamp_of(one)
                    if math.isfinite(offset[2]) and stamp_ns <= poses.stamp_ns[-1]:
                        found[max(1, int(np.searchsorted(poses.stamp_ns, stamp_ns)))] = offset
        except MessageError as error:
            bag.faults.reject(channel.topic, error)
    at = np.array(sorted(found), np.intp)
    place = np.array([found[index] for index in at.tolist()]).reshape(-1, 3)
    pose = poses.pose[at] + place
    pose[:, :2] = place[:, :2] + rotated(poses.pose[at, :2], place[:, 2])
    return PoseEstimate(
        poses.stamp_ns[at], pose, poses.twist[at],
        np.broadcast_to(np.diag(np.square(LOCALIZED)), (len(at), 3, 3)), poses.twist_sigma[at])


def in_map(poses: PoseEstimate, references: PoseEstimate) -> PoseEstimate:
    """
    Return ``poses`` of an odometry in the frame of ``references``, such as ``overhead/odom``.

    The transform between both is that at the references, interpolated in time. From a reference
    on, the covariance is that of the reference and what that of the odometry has grown since.
    """
    order = np.searchsorted(poses.stamp_ns, references.stamp_ns)
    inside = (order > 0) & (order < len(poses))
    at, stamps = order[inside], references.stamp_ns[inside]
    known, own = references.pose[inside], poses.pose[at]
    yaw = np.unwrap(known[:, 2] - own[:, 2])
    offset = known[:, :2] - rotated(own[:, :2], yaw)
    origin = poses.stamp_ns[0]
    turn, x, y = (np.interp(poses.stamp_ns - origin, stamps - origin, column)
                  for column in (yaw, *offset.T))
    pose = np.column_stack([rotated(poses.pose[:, :2], turn) + np.column_stack([x, y]),
                            poses.pose[:, 2] + turn])
    last = np.clip(np.searchsorted(stamps, poses.stamp_ns, 'right') - 1, 0, None)
    grown = np.abs(poses.covariance - poses.covariance[at][last]) * np.eye(3)
    return replace(poses, pose=pose,
                   covariance=given_covariance(references.covariance[inside])[last] + grown)


def write_map(folder: Path, found: FrictionMap, tracks: Sequence[FrictionTrack]) -> None:
    """Write the map with its images, the cells, the figure and a bag with ``friction_map``."""
    write_raster(folder / f'{MAP}.yaml', found.raster)
    write_table(folder / CELLS, found.cells)
    save(map_figure(found, tracks), folder / FIGURE)
    stamp_ns = int(found.cells.stamp_ns.max())
    with BagWriter(folder / 'bag', live=False) as writer:
        writer.write_sample(MAP, stamp_ns, grid_of(found.raster, stamp_ns))


def write_mask(folder: Path, found: FrictionMap, params: TrajectoryControllerParams,
               distance: float) -> None:
    """Write the mask of a speed filter: the robot stops within ``distance`` [m]."""
    write_image(folder / MASK_FILES[0], found.raster, speed_mask(
        found.raster, params.friction, distance, params.max_speed))


def map_figure(found: FrictionMap, tracks: Sequence[FrictionTrack]) -> Figure:
    """Return friction and its standard deviation next to each other, with the tracks on them."""
    raster, marks = found.raster, [
        Mark(Curve(*_line(track, side)), 'tracks of the wheels', 'ink', width=0.4, opacity=0.5)
        for track in tracks for side in (0, 1)]
    rows, columns = raster.friction.shape
    (x, y), edge = raster.origin, raster.resolution
    extent = x, x + columns * edge, y, y + rows * edge
    panels = [Panel(marks, 'x [m]', 'y [m]', title, equal=True,
                    field=ColorField(values, extent, title, (0.0, top)))
              for title, values, top in (
                  ('friction coefficient [-]', raster.friction, MAX_FRICTION),
                  ('standard deviation [-]', raster.sigma, MAX_SIGMA))]
    changed = len(np.unique(np.column_stack([found.cells.x, found.cells.y])[
        found.cells.current == 0], axis=0))
    return Figure(
        MAP, 'Map of the friction coefficient and its standard deviation',
        f'Friction of cells of {edge:g} m in the frame {raster.frame}, from {len(tracks)} '
        f'{"drive" if len(tracks) == 1 else "drives"}; white: unknown. {changed} of '
        f'{int(found.cells.current.sum())} cells have changed between drives: their latest '
        'friction is shown.', [panels], FIGURE_CELL)


def _line(track: FrictionTrack, side: int) -> tuple[Array, Array]:
    """Return the track of a side, with NaN where it is interrupted."""
    places = track.position[track.side == side]
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    x, y = np.insert(places, np.flatnonzero(steps > MAX_STEP) + 1, np.nan, axis=0).T
    return x, y
