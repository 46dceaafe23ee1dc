# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Path of the robot from above: wanted, estimate, references, pose with its bounds."""

from __future__ import annotations

import cmath
import math

import numpy as np
import rerun as rr

from smart_tire.analysis.figure import ellipse, SIGMAS
from smart_tire.arrays import Array
from smart_tire.rotation import yaw_of
from smart_tire.samples import FrictionGrid, GoalPose, NS_PER_S, Odometry, PlannedPath
from smart_tire.view.writer import AXIS, Color, COMMAND, ESTIMATE, REFERENCES, ViewWriter

SEGMENT_NS = NS_PER_S // 2  # of the path that becomes one shape
MIN_STEP = 0.005            # m between two points of the path
ROBOT_LENGTH = 0.3          # m, of the arrow that shows the pose
GRID_STEPS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)  # m
MAX_GRID_LINES = 6
SLIPPERY, GRIPPING = np.array([[40.0, 60.0, 140.0], [250.0, 220.0, 80.0]])  # colors of mu 0 and 1
COVARIANCE_XY = (0, 1, 6, 7)  # in the row-major 6x6 covariance of the pose


def on_screen(points: Array) -> Array:
    """Return points (..., 2) with x to the right and y up; on the screen y points down."""
    return points * np.array([1.0, -1.0])


class _Strip:
    """A path that is sent in segments, so that a long one costs no more than a short one."""

    def __init__(self, writer: ViewWriter, path: str, name: str, color: Color) -> None:
        self._writer, self._path, self._name, self._color = writer, path, name, color
        self._points: list[tuple[float, float]] = []
        self._begin_ns: int | None = None
        self._newest_ns = 0

    def add_point(self, stamp_ns: int, x: float, y: float) -> None:
        if not self._points or math.dist(self._points[-1], (x, y)) >= MIN_STEP:
            self._points.append((x, y))
        self._newest_ns = stamp_ns
        if self._begin_ns is None:
            self._begin_ns = stamp_ns
        elif stamp_ns - self._begin_ns >= SEGMENT_NS:
            self.finish()

    def finish(self) -> None:
        """Send the points since the last segment."""
        if len(self._points) > 1:
            self._writer.shape(self._path, self._newest_ns, rr.LineStrips2D(
                [on_screen(np.array(self._points))], colors=self._color, labels=self._name,
                show_labels=False, radii=rr.Radius.ui_points(1.5)))
            self._points = self._points[-1:]
        self._begin_ns = self._newest_ns


class _Reference:
    """A path in a frame of its own, shown as a strip in the frame of ``odom``."""

    def __init__(self, strip: _Strip) -> None:
        self.strip = strip
        self.frame: tuple[complex, complex] | None = None  # origin and rotation in odom
        self.waiting: list[Odometry] = []


class PathLayer:
    """
    Paths in the frame of ``odom``.

    The path of a reference is transformed so that both start with the same pose, because its frame
    is unrelated to ``odom``; without an estimate it is shown as it is, by ``finish``.
    """

    def __init__(self, writer: ViewWriter) -> None:
        self._writer = writer
        self._estimate = _Strip(writer, 'path/estimate', 'estimate', ESTIMATE)
        self._references = {name: _Reference(_Strip(writer, f'path/{name}', name, color))
                            for name, color in REFERENCES.items()}
        self._wanted: PlannedPath | GoalPose | None = None  # not shown yet
        self._pose: tuple[complex, float] | None = None  # latest estimate
        self._shown_ns: int | None = None
        self._extent = np.zeros((2, 2))  # m, lowest and highest x, y of the grid

    def add_odometry(self, sample: Odometry) -> None:
        """Add an estimated pose."""
        self._pose = place, yaw = _pose(sample)
        x, y = place.real, place.imag
        if self._wanted is not None:
            self._show_wanted(self._wanted, sample.stamp_ns)
        self._estimate.add_point(sample.stamp_ns, x, y)
        if self._shown_ns is None or sample.stamp_ns - self._shown_ns >= NS_PER_S // 10:
            self._shown_ns = sample.stamp_ns
            self._show_pose(sample, x, y, yaw)
            self._cover(x, y)

    def add_wanted(self, order: PlannedPath | GoalPose) -> None:
        """Show a path to follow, or a goal, from the next estimate on: it may have no stamp."""
        self._wanted = order

    def add_map(self, sample: FrictionGrid) -> None:
        """Show the known cells of a friction map below the paths, if it is in ``odom``."""
        if sample.frame != 'odom':
            return
        values = np.frombuffer(sample.values, np.uint8).reshape(-1, sample.columns)
        rows, columns = np.nonzero(values <= 100)
        mu = values[rows, columns, None] / 100.0
        centers = np.array(sample.origin) + sample.resolution * (
            np.column_stack([columns, rows]) + 0.5)
        self._writer.shape('path/friction_map', sample.stamp_ns, rr.Points2D(
            on_screen(centers), radii=0.5 * sample.resolution, draw_order=-1.0,
            colors=(SLIPPERY + mu * (GRIPPING - SLIPPERY)).astype(np.uint8)))

    def add_reference(self, name: str, sample: Odometry) -> None:
        """Add a pose of the reference ``name``."""
        one = self._references[name]
        one.waiting.append(sample)
        if one.frame is None and self._pose is not None:
            (place, yaw), (true_place, true_yaw) = self._pose, _pose(sample)
            turn = cmath.rect(1.0, yaw - true_yaw)
            one.frame = place - turn * true_place, turn
        if one.frame is not None:
            self._release(one, *one.frame)

    def finish(self) -> None:
        """Send what is left, at the end of the recording."""
        for one in self._references.values():
            self._release(one, 0.0, 1.0)
            one.strip.finish()
        if self._wanted is not None and self._wanted.stamp_ns:
            self._show_wanted(self._wanted, self._wanted.stamp_ns)
        self._estimate.finish()

    def _show_wanted(self, order: PlannedPath | GoalPose, stamp_ns: int) -> None:
        poses = [order.pose] if isinstance(order, GoalPose) else order.poses
        points = np.array(poses).reshape(-1, 3)[:, :2]
        strips = [on_screen(points)] if len(points) > 1 else []
        self._writer.shape('path/wanted', stamp_ns, rr.LineStrips2D(
            strips, colors=COMMAND, labels=['wanted'] * len(strips), show_labels=False,
            radii=rr.Radius.ui_points(1.5)))
        self._writer.shape('path/goal', stamp_ns, rr.Points2D(
            on_screen(points[-1:]), colors=COMMAND, radii=rr.Radius.ui_points(5.0)))
        for corner in (points.min(axis=0), points.max(axis=0)) if len(points) else ():
            self._cover(*corner.tolist())
        self._wanted = None

    def _release(self, one: _Reference, origin: complex, turn: complex) -> None:
        """Show the poses that wait, in a frame with ``origin`` and rotation in odom."""
        for sample in one.waiting:
            moved = origin + turn * _pose(sample)[0]
            one.strip.add_point(sample.stamp_ns, moved.real, moved.imag)
            self._cover(moved.real, moved.imag)
        one.waiting.clear()

    def _show_pose(self, sample: Odometry, x: float, y: float, yaw: float) -> None:
        position = np.array([x, y])
        heading = ROBOT_LENGTH * np.array([math.cos(yaw), math.sin(yaw)])
        self._writer.shape('path/robot', sample.stamp_ns, rr.Arrows2D(
            vectors=[on_screen(heading)], origins=[on_screen(position - 0.5 * heading)],
            colors=ESTIMATE, radii=rr.Radius.ui_points(3.0)))
        covariance = np.array([sample.pose_covariance[i] for i in COVARIANCE_XY]).reshape(2, 2)
        self._writer.shape('path/bounds', sample.stamp_ns, rr.LineStrips2D(
            [on_screen(position + ellipse(covariance))], colors=ESTIMATE, show_labels=False,
            labels=f'{SIGMAS:g} σ', radii=rr.Radius.ui_points(0.75)))

    def _cover(self, x: float, y: float) -> None:
        """Draw a larger grid if the position is outside the present one."""
        point, empty = np.array([x, y]), not self._extent.any()
        if not empty and (self._extent[0] <= point).all() and (point <= self._extent[1]).all():
            return
        low, high = np.minimum(self._extent[0], point), np.maximum(self._extent[1], point)
        size = max(float((high - low).max()), 1.0)
        step = next((step for step in GRID_STEPS if size / step < MAX_GRID_LINES), GRID_STEPS[-1])
        self._extent = np.array([np.floor(low / step - 0.2), np.ceil(high / step + 0.2)]) * step
        self._draw_grid(step)

    def _draw_grid(self, step: float) -> None:
        (left, bottom), (right, top) = self._extent.tolist()
        columns = np.arange(left, right + 0.5 * step, step)
        rows = np.arange(bottom, top + 0.5 * step, step)
        lines = [*([(x, bottom), (x, top)] for x in columns),
                 *([(left, y), (right, y)] for y in rows)]
        self._writer.static('path/grid', rr.LineStrips2D(
            list(on_screen(np.array(lines))), colors=(*AXIS, 110), radii=rr.Radius.ui_points(0.5)))
        ticks = [*((x, bottom) for x in columns), *((left, y) for y in rows)]
        labels = [*(f'{x:g} m' for x in columns), *(f'{y:g} m' for y in rows)]
        self._writer.static('path/ticks', rr.Points2D(
            on_screen(np.array(ticks)), labels=labels, show_labels=True, colors=AXIS,
            radii=rr.Radius.ui_points(1.0)))


def _pose(sample: Odometry) -> tuple[complex, float]:
    """Return the place x + iy [m] and the yaw [rad]."""
    x, y, _ = sample.position
    return complex(x, y), yaw_of(sample.orientation)
