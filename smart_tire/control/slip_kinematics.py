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

Three coefficients that carry over from the present motion to the next one are learned from the
estimated slip; feedback of the reached velocity removes what they leave.
"""

from __future__ import annotations

from collections import deque
import math

from smart_tire.control.motion_limits import command_share
from smart_tire.control.slip_coefficients import Prior, SlipCoefficient
from smart_tire.control.velocity_feedback import Velocity, VelocityFeedback
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.samples import LEFT, NS_PER_S, Odometry, RIGHT, WheelSlip

WINDOW_NS = 80_000_000        # of slip and motion that are averaged for one correction
MAX_OFFSET_NS = 30_000_000    # from the motion that belongs to a slip
HISTORY = 256                 # odometry messages: 2 s, longer than slip is late
RESTART_NS = NS_PER_S         # step back in time that indicates another clock
MAX_SPEED_SHARE = 0.5         # of the wanted speed, by which the feedback changes it at most
MAX_YAW_SHARE = 0.3           # of the largest yaw rate, by which it changes the yaw rate at most
SPREAD = 0.02                 # m/s, of slip velocities and v_y around the model, at the start
FADE = 30.0                   # s, in which the ground is forgotten without new estimates
TURNING_LENGTH = 0.2          # -, of the turning share, correlation length of tires
MIN_SPEED = 0.01              # m/s, lower limit in a denominator
RESISTANCE = Prior(0.01, 0.15, -0.05, 0.5)  # slip velocity over speed, from firm ground to sand
WIDENING_SIGMA, MAX_WIDENING = 0.5, 2.5  # of the track, over it; the most in narrow turns on sand
MAX_COMPLIANCE = 4.0          # over that of the calibrated ground

Motion = tuple[float, float, float]  # v_x, v_y [m/s], yaw rate [rad/s]


class SlipKinematics:
    """
    Commands for a base with ideal kinematics, so that the real body moves as wanted.

    The base turns its wheels at r w = v -+ effective_track / 2 * yaw rate. Times are nanoseconds
    of the message clock.
    """

    def __init__(self, params: TrajectoryControllerParams) -> None:
        robot = params.robot
        self._feedback = VelocityFeedback()
        self._track, self._wheelbase = robot.track_width, robot.wheelbase
        self._effective_track = params.effective_track
        compliance = 0.25 * robot.mass / robot.tire.longitudinal_stiffness
        self._resistance = SlipCoefficient(RESISTANCE, SPREAD)
        self._widening = SlipCoefficient(
            Prior(_prior_widening(params), WIDENING_SIGMA, 0.0, MAX_WIDENING), SPREAD)
        self._compliance = SlipCoefficient(  # s2/m, slip angle over v_x and yaw rate
            Prior(compliance, compliance, 0.0, MAX_COMPLIANCE * compliance), SPREAD)
        self.reset()

    def reset(self) -> None:
        """Discard everything learned and received."""
        for one in (self._resistance, self._widening, self._compliance):
            one.reset()
        self._feedback.reset()
        self._learned_ns: int | None = None             # time of the coefficients
        self._turning = 0.0                             # turning share that they belong to
        self._motions = deque[tuple[int, Motion]](maxlen=HISTORY)
        self._window = list[tuple[float, ...]]()        # motion, slip velocity, sigma of sides
        self._window_ns = 0                             # its first timestamp

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

    def command(self, v_x: float, yaw_rate: float, now_ns: int,
                params: TrajectoryControllerParams) -> Velocity:
        """Return v_x [m/s] and yaw rate [rad/s] to command for wanted ones of the body."""
        if v_x == yaw_rate == 0.0:
            self._feedback.reset()
            return 0.0, 0.0
        speed, turn = self.factors(v_x, yaw_rate, now_ns)
        if self._motions:
            reached_ns, (reached, _, reached_rate) = self._motions[-1]
            added = self._feedback.correction(
                (reached, reached_rate), reached_ns, params.follower.actuation_delay,
                (MAX_SPEED_SHARE * abs(v_x), MAX_YAW_SHARE * params.limits.yaw_rate))
        else:
            added = 0.0, 0.0
        command = speed * (v_x + added[0]), turn * (yaw_rate + added[1])
        share = command_share(command, params)
        self._feedback.want((share * v_x, share * yaw_rate), now_ns)
        return share * command[0], share * command[1]

    def factors(self, v_x: float, yaw_rate: float, now_ns: int) -> Velocity:
        """Return commanded over reached speed and yaw rate, for wanted ones of the body."""
        learned_ns = now_ns if self._learned_ns is None else self._learned_ns
        aged = max(now_ns - learned_ns, 0) / NS_PER_S / FADE
        widening = self._widening.after(aged + self._change(v_x, yaw_rate))
        return (1.0 + self._resistance.after(aged),
                (1.0 + widening) * self._track / self._effective_track)

    def heading_offset(self, v_x: float, yaw_rate: float) -> float:
        """Return the angle [rad] from the x axis of the body to its direction of travel."""
        compliance = self._compliance.after(self._change(v_x, yaw_rate))
        return -math.atan(compliance * abs(v_x) * yaw_rate)

    def _change(self, v_x: float, yaw_rate: float) -> float:
        """Return the change of the turning share from the one learned last, over its length."""
        return abs(self._turning_share(v_x, yaw_rate) - self._turning) / TURNING_LENGTH

    def _turning_share(self, v_x: float, yaw_rate: float) -> float:
        """Return the share of sideways motion of the wheels: 0 straight on, 1 in place."""
        sideways = 0.5 * self._wheelbase * abs(yaw_rate)
        return sideways / (sideways + abs(v_x) + MIN_SPEED)

    def _motion_at(self, stamp_ns: int) -> Motion | None:
        """Return the latest motion up to then, None if there is no recent one."""
        for motion_ns, motion in reversed(self._motions):
            if motion_ns <= stamp_ns:
                return motion if stamp_ns - motion_ns <= MAX_OFFSET_NS else None
        return None

    def _learn(self) -> None:
        """Correct the coefficients with the means of the window, and empty it."""
        count, stamp_ns, last_ns = len(self._window), self._window_ns, self._learned_ns
        v_x, v_y, yaw_rate, left, left_sigma, right, right_sigma = (
            sum(column) / count for column in zip(*self._window))
        self._window.clear()
        self._learned_ns = stamp_ns
        duration = 0.0 if last_ns is None else max(stamp_ns - last_ns, 0) / NS_PER_S
        self._correct((v_x, v_y, yaw_rate), left, right, 0.5 * (left_sigma + right_sigma),
                      duration)

    def _correct(self, motion: Motion, left: float, right: float, sigma: float,
                 duration: float) -> None:
        """Correct the coefficients, ``duration`` [s] after the last time, with slip velocities."""
        v_x, v_y, yaw_rate = motion
        aged = duration / FADE
        change = aged + self._change(v_x, yaw_rate)
        self._turning = self._turning_share(v_x, yaw_rate)
        self._resistance.update(v_x, 0.5 * (left + right), sigma, aged, duration)
        self._widening.update(
            0.5 * self._track * yaw_rate, 0.5 * (right - left), sigma, change, duration)
        self._compliance.update(-abs(v_x) * v_x * yaw_rate, v_y, 0.0, change, duration)


def _prior_widening(params: TrajectoryControllerParams) -> float:
    """Return that of a calibrated ``effective_track``, else of isotropic tires in a wide turn."""
    robot = params.robot
    added = params.effective_track / robot.track_width - 1.0
    return added if added > 0.0 else (robot.wheelbase / robot.track_width) ** 2


def _side(slip: WheelSlip, wheels: tuple[int, int], v_x: float) -> tuple[float, float] | None:
    """Return slip velocity and its sigma [m/s] of a side; None if no wheel of it is known."""
    known = [(slip.slip_velocity[i], slip.sigma[i]) for i in wheels
             if math.isfinite(slip.slip_velocity[i]) and math.isfinite(slip.sigma[i])]
    if not known:
        return None
    velocity = sum(one[0] for one in known) / len(known)
    return velocity, max(one[1] for one in known) * abs(v_x + velocity)
