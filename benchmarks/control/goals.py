# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Goals with a final yaw, of robots drawn at random: whether one that is reported was reached."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math

from benchmarks.control.closed_loop import run_closed_loop
from benchmarks.control.drawn import (
    draw_robot, DrawnRobot, OdometryErrors, SlopeStack, stack_params)
from benchmarks.control.scenarios import MAX_DURATION, OURS
from benchmarks.robots.plant import plant_with
from benchmarks.scoring import Run
import numpy as np
from smart_tire.control.trajectory_control import PathState
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.rotation import euler
from smart_tire.samples import NS_PER_S, Odometry, PlannedPath

DISTANCES = 0.3, 2.0    # m, of goals
JUMP_TIME = 3.0, 6.0    # s, in which odom jumps: the robot stands, drives or turns
STREAM = 6              # of random numbers; differs from the streams of the simulator


@dataclass(frozen=True)
class Localization:
    """What ``odom`` is like, beyond the errors of ``drawn``."""

    ahead: float = 0.0               # m, of the point that it locates, from that of the turns
    rate: float | None = None        # Hz; None: that of the robot
    delay: tuple[float, float] | None = None  # s, range; None: that of the robot
    jump: float = 0.0                # m, of its position, in any direction


LOCALIZATIONS: Mapping[str, Localization] = {
    'as drawn': Localization(), 'point 4.5 cm ahead': Localization(ahead=0.045),
    'odom at 4 Hz': Localization(rate=4.0), '0.1 to 0.3 s late': Localization(delay=(0.1, 0.3)),
    'jumps by 8 cm': Localization(jump=0.08)}


class GoalErrors(OdometryErrors):
    """Errors of ``odom``, of which a jump and the point that it locates are known."""

    def __init__(self, robot: DrawnRobot, ahead: float, jump: tuple[float, float], jump_ns: int
                 ) -> None:
        super().__init__(robot)
        self._ahead, self._jump, self._jump_ns = ahead, jump, jump_ns
        self._begin_ns: int | None = None

    def located(self, true: Odometry) -> Odometry:
        """Return the pose and the velocity of the point that is located, without noise."""
        if self._begin_ns is None:
            self._begin_ns = true.stamp_ns
        jumped = true.stamp_ns - self._begin_ns >= self._jump_ns
        yaw, rate = euler(true.orientation)[2], true.angular[2]
        (x, y, _), (v_x, v_y, _) = true.position, true.linear
        return replace(true, position=(x + self._ahead * math.cos(yaw) + jumped * self._jump[0],
                                       y + self._ahead * math.sin(yaw) + jumped * self._jump[1],
                                       0.0), linear=(v_x, v_y + self._ahead * rate, 0.0))

    def _measured(self, true: Odometry) -> Odometry:
        return super()._measured(self.located(true))


def run_goal(name: str, seed: int, row: str) -> list[Run]:
    """
    Drive the robot of ``seed`` to a goal; return how far it is from it when that is reported.

    A report is false if the robot is not within the tolerances then. Its motors are released: on
    slopes it may roll away later, without ``hold_on_arrival``.
    """
    robot, kind = draw_robot(seed), LOCALIZATIONS[name]
    rng = np.random.default_rng([seed, STREAM])
    distance, bearing, yaw, side, jump_time = rng.uniform(
        (DISTANCES[0], -math.pi, -math.pi, -math.pi, JUMP_TIME[0]),
        (DISTANCES[1], math.pi, math.pi, math.pi, JUMP_TIME[1])).tolist()
    delay = robot.odom_delay if kind.delay is None else rng.uniform(*kind.delay)
    errors = GoalErrors(
        replace(robot, rate=kind.rate or robot.rate, odom_delay=float(delay)), kind.ahead,
        (kind.jump * math.cos(side), kind.jump * math.sin(side)), round(jump_time * NS_PER_S))
    params = replace(stack_params(robot, OURS, estimated=False), fault=errors)
    goal = distance * math.cos(bearing), distance * math.sin(bearing), yaw
    stack = SlopeStack(params, PlannedPath(0, params.trajectory.robot.frames['odom'], (goal,)),
                       robot)
    run_closed_loop(
        replace(robot.simulator, robot=replace(robot.simulator.robot,
                                               film=TreadFilmParams(wheels=()))),
        stack, MAX_DURATION, wheel_rate=robot.rate, control_rate=robot.rate,
        plant=plant_with(robot.traits))
    ended_ns = stack.ended_ns or stack.truth[-1].stamp_ns
    end = errors.located(next(one for one in stack.truth if one.stamp_ns >= ended_ns))
    (x, y, wanted), = stack.path.poses
    miss = math.hypot(end.position[0] - x, end.position[1] - y)
    turn = abs(math.remainder(euler(end.orientation)[2] - wanted, math.tau))
    arrival = params.trajectory.arrival
    arrived = stack.trajectory.state == PathState.ARRIVED
    false = arrived and (miss > arrival.xy_tolerance or turn > arrival.yaw_tolerance)
    missed = {'miss': miss, 'turn': turn} if arrived else {}
    return [Run(f'{row}/{name}', seed, values={
        'arrived': float(arrived), 'false': float(false), **missed,
        'duration': (ended_ns - stack.start_ns) / NS_PER_S})]
