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

"""
Inverse kinematics that compensate slip: docs/theory.md, "Slip-compensated kinematics".

Estimated slip belongs to the present motion, the command to the next one. Coefficients that carry
over are learned from the estimates; with them a brush model predicts the slip of the command.
"""

from __future__ import annotations

from collections import deque
import math

from smart_tire.control.slip_coefficients import (
    BodyMotion, Coefficients, Inertia, SlipCoefficients)
from smart_tire.models.constants import GRAVITY
from smart_tire.models.vehicle.steady_turn import steady_turn, SteadyTurn, TurnModel
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.samples import LEFT, NS_PER_S, Odometry, RIGHT, WheelSlip

FIRM_FRICTION = 0.5           # -, mu of the brush model; affects large slip only
WINDOW_NS = 80_000_000        # of slip and motion that are averaged for one correction
MAX_OFFSET_NS = 30_000_000    # from the motion that belongs to a slip
HISTORY = 256                 # odometry messages: 2 s, longer than slip is late
MIN_ROLLING = 0.1             # m/s, of the faster side, below which nothing is learned
MAX_SLIP = 0.7                # -, of the faster side, above which it slides: nothing is learned
MAX_COMPENSATION = 1.5        # slip velocity over the largest speed of a wheel center
RESTART_NS = NS_PER_S         # step back in time that indicates another clock

Motion = tuple[float, float, float]  # v_x, v_y [m/s], yaw rate [rad/s]


class SlipKinematics:
    """
    Commands for a base with ideal kinematics, so that the real body moves as wanted.

    The base turns its wheels at r w = v -+ effective_track / 2 * yaw rate. Times are nanoseconds
    of the message clock.
    """

    def __init__(self, params: TrajectoryControllerParams) -> None:
        robot = params.robot
        stiffness = robot.tire.longitudinal_stiffness
        load = 0.25 * robot.mass * GRAVITY
        self._track, self._effective_track = robot.track_width, params.effective_track
        self._model = TurnModel(robot.wheelbase, robot.track_width,
                                3.0 * FIRM_FRICTION * load / stiffness)
        self._inertia = Inertia(robot.mass / stiffness,
                                robot.yaw_inertia / (robot.track_width * stiffness))
        self._coefficients = SlipCoefficients(self._model, self._inertia, _prior_scrub(params))
        self.reset()

    def reset(self) -> None:
        """Discard everything learned and received."""
        self._coefficients.reset()
        self._learned_ns: int | None = None             # time of the coefficients
        self._motions = deque[tuple[int, Motion]](maxlen=HISTORY)
        self._window = list[tuple[float, ...]]()        # motion, slip velocity, sigma of sides
        self._window_ns = 0                             # its first timestamp
        self._before: tuple[int, Motion] | None = None  # mean motion in the window before

    def coefficients(self, now_ns: int) -> Coefficients:
        """Return the coefficients; without slip estimates they return to the prior."""
        learned_ns = now_ns if self._learned_ns is None else self._learned_ns
        return self._coefficients.after(max(now_ns - learned_ns, 0) / NS_PER_S)

    def update_odometry(self, odometry: Odometry) -> None:
        """Add an estimate of the motion of the body; older ones than the last are ignored."""
        stamp_ns = odometry.stamp_ns
        if self._motions and stamp_ns <= self._motions[-1][0]:
            if stamp_ns > self._motions[-1][0] - RESTART_NS:
                return
            self.reset()
        motion = odometry.linear[0], odometry.linear[1], odometry.angular[2]
        if all(map(math.isfinite, motion)):
            self._motions.append((stamp_ns, motion))

    def update_slip(self, slip: WheelSlip) -> None:
        """Add estimated slips; without motion of the same time they are ignored."""
        motion = self._motion_at(slip.stamp_ns)
        if motion is None or slip.stamp_ns < self._window_ns:
            return
        half = 0.5 * self._track * motion[2]
        left = _side(slip, LEFT, motion[0] - half)
        right = _side(slip, RIGHT, motion[0] + half)
        if left is None or right is None:
            return
        if self._window and slip.stamp_ns - self._window_ns >= WINDOW_NS:
            self._learn()
        if not self._window:
            self._window_ns = slip.stamp_ns
        self._window.append((*motion, *left, *right))

    def command(self, v_x: float, yaw_rate: float, now_ns: int) -> tuple[float, float]:
        """Return v_x [m/s] and yaw rate [rad/s] to command for wanted ones of the body."""
        turn = self._turn(v_x, yaw_rate, self.coefficients(now_ns))
        half = 0.5 * self._track * yaw_rate
        limit = MAX_COMPENSATION * max(abs(v_x - half), abs(v_x + half))
        left, right = (min(max(u, -limit), limit) for u in (turn.left, turn.right))
        return v_x + 0.5 * (left + right), (2.0 * half + right - left) / self._effective_track

    def heading_offset(self, v_x: float, yaw_rate: float) -> float:
        """Return the angle [rad] from the x axis of the body to its direction of travel."""
        coefficients = self.coefficients(self._learned_ns or 0)
        turn = self._turn(v_x, yaw_rate, coefficients)
        return -math.atan(
            turn.lateral_compliance * coefficients.compliance * self._inertia.mass * yaw_rate)

    def _turn(self, v_x: float, yaw_rate: float, coefficients: Coefficients) -> SteadyTurn:
        return steady_turn(self._model, v_x, yaw_rate, coefficients.resistance,
                           coefficients.scrub)

    def _motion_at(self, stamp_ns: int) -> Motion | None:
        """Return the latest motion up to then, None if there is no recent one."""
        for motion_ns, motion in reversed(self._motions):
            if motion_ns <= stamp_ns:
                return motion if stamp_ns - motion_ns <= MAX_OFFSET_NS else None
        return None

    def _learn(self) -> None:
        """Correct the coefficients with the means of the window, and empty it."""
        count, stamp_ns, before = len(self._window), self._window_ns, self._before
        v_x, v_y, yaw_rate, left, left_sigma, right, right_sigma = (
            sum(column) / count for column in zip(*self._window))
        self._window.clear()
        self._before = stamp_ns, (v_x, v_y, yaw_rate)
        if self._learned_ns is not None:
            self._coefficients.predict((stamp_ns - self._learned_ns) / NS_PER_S)
        self._learned_ns = stamp_ns
        half = 0.5 * self._track * yaw_rate
        rolling, sliding = max((abs(v + u), abs(u)) for v, u in (
            (v_x - half, left), (v_x + half, right)))
        if before is None or rolling < MIN_ROLLING or sliding > MAX_SLIP * rolling:
            return
        dt = (stamp_ns - before[0]) / NS_PER_S
        motion = BodyMotion(v_x, v_y, yaw_rate, (v_x - before[1][0]) / dt,
                            (yaw_rate - before[1][2]) / dt)
        self._coefficients.update(motion, (left, right), (left_sigma, right_sigma))


def _prior_scrub(params: TrajectoryControllerParams) -> float:
    """Return the scrub of a calibrated ``effective_track``; 1 if it is that of the wheels."""
    robot = params.robot
    added = params.effective_track - robot.track_width
    return added * robot.track_width / robot.wheelbase ** 2 if added > 0.0 else 1.0


def _side(slip: WheelSlip, wheels: tuple[int, int], v_x: float) -> tuple[float, float] | None:
    """Return slip velocity and its sigma [m/s] of a side; None if no wheel of it is known."""
    known = [(slip.slip_velocity[i], slip.sigma[i]) for i in wheels
             if math.isfinite(slip.slip_velocity[i]) and math.isfinite(slip.sigma[i])]
    if not known:
        return None
    velocity = sum(one[0] for one in known) / len(known)
    return velocity, max(one[1] for one in known) * abs(v_x + velocity)
