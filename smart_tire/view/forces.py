# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Friction circles of the wheels with the forces of the ground, by the brush model."""

from __future__ import annotations

import math

import numpy as np
import rerun as rr

from smart_tire.arrays import Array
from smart_tire.models.tire.brush_tire import brush_force, slip_vector
from smart_tire.models.vehicle.skid_steer import normal_loads, wheel_velocities
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import (
    Friction, GroundState, LEFT, NS_PER_S, Odometry, RIGHT, WHEELS, WheelSlip)
from smart_tire.view.recorder import Recorder
from smart_tire.view.style import WHEEL_COLORS

PERIOD_NS = 64_000_000      # between two evaluations
MAX_AGE_NS = NS_PER_S // 10  # of the odometry
PLACES = np.array([[-50.0, -35.0], [50.0, -35.0], [-50.0, 30.0], [50.0, 30.0]])  # N, on screen
LABEL_GAP = 6.0  # N, below a circle
CIRCLE = np.linspace(0.0, math.tau, 49)


class ForceLayer:
    """
    Force and friction circle of each wheel, as seen from above, forward is up.

    Slip, C_x and mu are the estimated ones, loads those of level ground in steady motion. A wheel
    without films gets mu of an instrumented wheel, preferably of its side.
    """

    def __init__(self, recorder: Recorder, robot: RobotParams) -> None:
        self._recorder, self._robot = recorder, robot
        self._odometry: Odometry | None = None
        self._friction: dict[str, float] = {}  # wheel -> mu
        self._stiffness = robot.tire.longitudinal_stiffness
        self._evaluated_ns: int | None = None
        self._used = [recorder.line(
            f'friction_used/{wheel}', f'{wheel}, |F| / (mu F_z) [-]', color)
            for wheel, color in WHEEL_COLORS.items()]
        self._traction = [recorder.line(f'traction/{wheel}/model', f'{wheel}, F_x [N]', color)
                          for wheel, color in WHEEL_COLORS.items()]

    def add_odometry(self, sample: Odometry) -> None:
        """Add the motion of the body."""
        self._odometry = sample

    def add_friction(self, sample: Friction) -> None:
        """Add the friction coefficient of a wheel."""
        if math.isfinite(sample.friction_coefficient.value):
            self._friction[sample.wheel] = sample.friction_coefficient.value

    def add_ground(self, sample: GroundState) -> None:
        """Add the stiffness of the present ground."""
        self._stiffness = sample.stiffness.value

    def add_slip(self, sample: WheelSlip) -> None:
        """Add slips; evaluate the forces if it is time."""
        odometry, last_ns = self._odometry, self._evaluated_ns
        if (odometry is None or not self._friction
                or abs(sample.stamp_ns - odometry.stamp_ns) > MAX_AGE_NS
                or last_ns is not None and 0 <= sample.stamp_ns - last_ns < PERIOD_NS):
            return
        self._evaluated_ns = sample.stamp_ns
        self._show(sample.stamp_ns, *self.evaluate(sample, odometry))

    def evaluate(self, slip: WheelSlip, odometry: Odometry) -> tuple[Array, Array]:
        """Return the forces (4, 2) [N], forward and to the left, and mu F_z (4,) [N]."""
        robot, (v_x, v_y, _), rate = self._robot, odometry.linear, odometry.angular[2]
        wheel_x, wheel_y = wheel_velocities(v_x, v_y, rate, robot.wheelbase, robot.track_width)
        loads = normal_loads(
            robot.mass, robot.center_of_mass, robot.wheelbase, robot.track_width,
            -rate * v_y, rate * v_x, radius=robot.wheel_radius)
        friction = np.array([self._friction[self.source(wheel)] for wheel in WHEELS])
        s_x, s_y = slip_vector(wheel_x + np.array(slip.slip_velocity), wheel_x, wheel_y,
                               floor=robot.slip.standstill_speed)
        force = brush_force(s_x, s_y, friction, loads, self._stiffness)
        return np.stack(force, axis=-1), friction * loads

    def source(self, wheel: str) -> str:
        """Return the wheel whose mu is used for ``wheel``; there is at least one with mu."""
        side = LEFT if WHEELS.index(wheel) in LEFT else RIGHT
        candidates = [wheel, *(WHEELS[i] for i in side), *WHEELS]
        return next(name for name in candidates if name in self._friction)

    def _show(self, stamp_ns: int, force: Array, limit: Array) -> None:
        share = np.hypot(*force.T) / np.maximum(limit, 1e-9)
        for used, traction, part, value in zip(self._used, self._traction, share, force[:, 0]):
            used.add(stamp_ns, float(part))
            traction.add(stamp_ns, float(value))
        colors = list(WHEEL_COLORS.values())
        circle = np.stack([np.cos(CIRCLE), np.sin(CIRCLE)], axis=-1)
        self._recorder.shape('forces/circles', stamp_ns, rr.LineStrips2D(
            PLACES[:, np.newaxis] + limit[:, np.newaxis, np.newaxis] * circle, colors=colors,
            radii=rr.Radius.ui_points(1.0)), rr.Points2D(
            PLACES + np.stack([np.zeros(len(limit)), limit + LABEL_GAP], axis=-1), colors=colors,
            labels=[self._label(wheel, float(value)) for wheel, value in zip(WHEELS, limit)],
            show_labels=True, radii=rr.Radius.ui_points(0.0)))
        # forward is up, left is left: both against the axes of the screen
        self._recorder.shape('forces/arrows', stamp_ns, rr.Arrows2D(
            vectors=-force[:, ::-1], origins=PLACES, colors=colors,
            labels=[f'{math.hypot(*one):.1f} N' for one in force.tolist()], show_labels=False,
            radii=rr.Radius.ui_points(2.5)))

    def _label(self, wheel: str, limit: float) -> str:
        source = self.source(wheel)
        note = '' if source == wheel else f'\nwith mu of {source}'
        return f'{wheel}: mu F_z {limit:.0f} N{note}'
