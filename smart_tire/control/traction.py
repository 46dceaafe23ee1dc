# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Traction control: wheel speeds that keep the slip of each wheel below critical."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from smart_tire.control import constants as c
from smart_tire.control.ground_knowledge import GroundKnowledge, Measured, ShownFriction
from smart_tire.control.ground_motion import Expected, GroundSpeed, Motion, Onset
from smart_tire.control.slip_limits import (
    bounded, share_within, slip_band, TireLoad, yaw_deviation, YawControl)
from smart_tire.models.vehicle.skid_steer import AXLE_SIGNS, normal_loads, SIDE_SIGNS
from smart_tire.parameters.control import TractionParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import (
    Four, four, Friction, GRAVITY, GroundState, LEFT, Odometry, RIGHT, WHEELS, WheelSample)
from smart_tire.uncertain import fused, Uncertain

NOT_SLIPPING = (None,) * len(WHEELS)
AXLES = tuple(zip(LEFT, RIGHT))
SIDES = tuple(map(float, SIDE_SIGNS))
ENDS = tuple(map(float, AXLE_SIGNS))


Known = tuple[Measured, float] | None  # latest measurement of a side's ground, and its weight


@dataclass(frozen=True)
class TractionState:
    """What traction control did in the latest step, for diagnostics."""

    reason: str = 'no odom'          # why it was not active, '' if it was
    limiting: bool = False           # whether set points were changed
    slip_limit: float = math.nan     # -, smallest one of the wheels
    friction: float = math.nan       # -, that the robot has shown or is expected to show
    limited_steps: int = 0           # steps in which set points were changed, since the start


@dataclass(frozen=True)
class Side:
    """Ground under the wheels of one side."""

    known: Known
    friction: Uncertain  # -, the measured one fused with that of unknown ground


@dataclass(frozen=True)
class WheelGround:
    """Ground under one wheel."""

    limit: float     # -, total slip aimed at
    critical: float  # -, critical slip expected
    friction: float  # N, force of a sliding wheel: mu F_z


class TractionControl:
    """
    Limits set points of the wheel speeds; all times are nanoseconds of the message clock.

    Whatever the estimates are, a set point is between zero and the command, or on its way there
    (``slip_limits.bounded``). Without recent estimates of the motion of the robot set points are
    not changed.
    """

    def __init__(self, params: TractionParams, robot: RobotParams) -> None:
        self.params = params  # may be replaced at run time
        self.state = TractionState()
        self._robot = robot
        self._grounds, self._motion = (GroundKnowledge(), GroundKnowledge()), GroundSpeed()
        self._shown = ShownFriction(robot, params.unknown)
        # of the latest step, for the feed-forward; None for wheels that do not slip
        self.tires: tuple[TireLoad | None, ...] = NOT_SLIPPING
        self._onset, self._direction = Onset(), 0
        self._latest: Four | None = None  # rad/s, set points of the latest step
        self._ratio = 0.0                # difference over sum of the sides, latest command
        self._yaw = YawControl(0.5 * robot.track_width / robot.yaw_inertia)
        # m, between wheels that roll without longitudinal force in a turn (isotropic tires)
        self._rolling_track = robot.track_width + robot.wheelbase ** 2 / robot.track_width

    def add_odometry(self, odometry: Odometry) -> None:
        """Add an estimate of the motion of the robot; one that is not plausible is ignored."""
        before_ns, before = self._motion.stamp_ns, self._motion.distance
        if self._motion.add_odometry(odometry, self.params.acceleration_filter):
            for ground in self._grounds:
                if before_ns is not None and odometry.stamp_ns < before_ns:
                    ground.clear()  # a new clock: another run
                ground.drive(self._motion.distance - before, odometry.stamp_ns)

    def add_friction(self, friction: Friction) -> None:
        """
        Use the ground of one patch crossing for the side of its wheel.

        The sides may differ; ``ground_state`` is the mean of both.
        """
        if friction.wheel in self._robot.film.wheels:
            late = max(-self._motion.age(friction.stamp_ns), 0.0)
            self._grounds[WHEELS.index(friction.wheel) % 2].set_ground(
                GroundState(friction.stamp_ns, friction.stiffness, friction.friction_coefficient),
                abs(self._motion.motion.v_x) * late)

    def add_wheels(self, wheels: WheelSample) -> None:
        """Add wheel speeds and motor torques."""
        middle_ns = wheels.stamp_ns - self._shown.period_ns(wheels.stamp_ns) // 2
        self._shown.add_wheels(
            wheels, self._motion.speed_at(middle_ns), self.params.acceleration_filter)

    def reset(self) -> None:
        """Forget the set points: the motors do not follow them."""
        self._latest, self.tires = None, NOT_SLIPPING
        self._direction = 0

    def limit(self, set_points: Four, now_ns: int, period: float) -> Four:
        """Return ``set_points`` [rad/s], limited at ``now_ns`` for a control ``period`` [s]."""
        limited: Four = set_points
        tires: Sequence[TireLoad] = ()
        if reason := self._inactive(now_ns):
            self._report(reason)
            self._direction = 0
            self._yaw.reset()
        else:
            limited, tires = self._limited(set_points, now_ns, period)
        step = self.params.min_deceleration * period / self._robot.wheel_radius
        self._latest = four(
            map(bounded, limited, set_points, self._latest or set_points, (step,) * 4))
        self.tires = tuple(tire if speed != target else None for tire, speed, target in zip(
            tires, self._latest, set_points)) or NOT_SLIPPING
        return self._latest

    def _limited(self, set_points: Four, now_ns: int, period: float) -> tuple[
            Four, list[TireLoad]]:
        """Return the set points [rad/s] with slips within their limits, and the tires there."""
        sides, radius = self._sides(), self._robot.wheel_radius
        wanted = four(radius * speed for speed in set_points)
        limited, motion, grounds = self._predicted_limit(wanted, now_ns, period, sides)
        if self._begins(sum(wanted) - sum(limited), now_ns, sides):
            limited, motion, grounds = self._predicted_limit(wanted, now_ns, period, sides)
        elif self._direction and motion.unseen < c.MAX_ONSET_WEIGHT:
            self._shown.learn_friction(motion.measured, motion.v_x, self._direction,
                                       min(ground.limit for ground in grounds), period)
        if motion.unseen < c.MAX_ONSET_WEIGHT:
            self._shown.learn_resistance(
                motion.measured, motion.v_x, period, self.params.acceleration_filter)
        tires = [self._tire(*one, motion) for one in zip(range(4), grounds, set_points)]
        if limited == wanted:
            self._yaw.reset()
        else:
            limited = self._balanced(limited, tires, motion, now_ns, period)
        self._report('', limited != wanted, min(ground.limit for ground in grounds))
        if self.state.limiting:
            set_points = four(speed / radius for speed in limited)
        return set_points, tires

    def _sides(self) -> list[Side]:
        """Return the ground of the left and the right side; one without films has the other's."""
        left, right = (Side(known, ground.friction(self.params.unknown, self.params))
                       if (known := ground.latest(self.params)) else None
                       for ground in self._grounds)
        unknown = Side(None, Uncertain(self.params.unknown, c.PRIOR_SIGMA))
        return [left or right or unknown, right or left or unknown]

    def _predicted_limit(self, wanted: Four, now_ns: int, period: float, sides: Sequence[Side]
                         ) -> tuple[Four, Expected, list[WheelGround]]:
        """Return limited rolling speeds [m/s], and the motion and the ground for them."""
        motion = self._motion.expected(now_ns, period + self.params.lead, self._onset)
        grounds = [self._wheel_ground(sides[i % 2], load)
                   for i, load in enumerate(
                     normal_loads(self._robot, motion.acceleration, 0.0).tolist())]
        return self._within(wanted, motion, grounds), motion, grounds

    def _wheel_ground(self, side: Side, load: float) -> WheelGround:
        """
        Return the ground under a wheel with its load [N].

        The critical slip is 3 mu F_z / C_x, with the friction that the robot shows and the
        stiffness of the tire; it is fused with the measured one, in so far as the robot confirms
        the friction that was measured with it.
        """
        params, shown = self.params, self._shown.value
        per_friction = 3.0 * load / self._robot.tire.longitudinal_stiffness
        critical = Uncertain(shown * per_friction, c.PRIOR_RELATIVE_SIGMA * shown * per_friction)
        friction = shown
        if side.known is not None:
            measured, weight = side.known
            friction = min(side.friction.value, shown)
            confirmed = min(shown / measured.friction.value, 1.0)
            slip, sigma = measured.slip_per_load
            mean, sigma = fused(critical, Uncertain(confirmed * slip * load, sigma * load))
            critical = Uncertain(critical.value + weight * (mean - critical.value), sigma)
        bound = max(critical.value - params.sigmas * critical.sigma, 0.0)
        return WheelGround(min(params.share * bound, params.max_slip),
                           max(critical.value, c.TINY), friction * load)

    def _tire(self, wheel: int, ground: WheelGround, command: float, motion: Expected) -> TireLoad:
        radius = self._robot.wheel_radius
        return TireLoad(self._free_rolling(wheel, motion) / radius, radius * ground.friction,
                        ground.critical, motion.v_x_sigma / radius, command)

    def _balanced(self, speeds: Four, tires: Sequence[TireLoad], motion: Motion, now_ns: int,
                  period: float) -> Four:
        """Return the rolling speeds [m/s] with less force on the side that turns the robot."""
        if not self._direction or math.isnan(self._ratio):
            self._yaw.reset()
            return speeds
        if abs(motion.v_x) < self.params.floor:  # a start is not prevented
            return speeds
        radius = self._robot.wheel_radius
        commanded = 2.0 * motion.v_x * self._ratio / self._rolling_track
        shares = self._yaw.shares(
            yaw_deviation(motion.yaw_rate, commanded), period,
            self._motion.age(now_ns) + period + self.params.lead,
            0.5 * sum(tire.torque for tire in tires) / radius, self._direction)
        return four(radius * tire.with_share(speed / radius, shares[i % 2])
                    for i, (speed, tire) in enumerate(zip(speeds, tires)))

    def _begins(self, excess: float, now_ns: int, sides: Sequence[Side]) -> bool:
        """Return whether the robot begins to accelerate or to brake at the limit."""
        least = 2.0 * self.params.floor
        direction = (excess > least) - (excess < -least)
        begins = direction not in (0, self._direction)
        if begins:
            self._shown.begin(self._shown.value if sides[0].known is None else min(
                side.friction.value for side in sides))
            self._onset = Onset(now_ns, direction * GRAVITY * self._shown.value,
                                self.params.acceleration_filter + c.ONSET_DELAY)
        self._direction = direction
        return begins

    def _inactive(self, now_ns: int) -> str:
        """Return why set points are not limited, '' if they are."""
        age = self._motion.age(now_ns)
        if math.isinf(age):
            return 'no odom'
        return '' if abs(age) <= self.params.max_age else f'odom is {age:.2f} s old'

    def _report(self, reason: str, limiting: bool = False, slip: float = math.nan) -> None:
        self.state = TractionState(reason, limiting, slip, self._shown.value,
                                   self.state.limited_steps + limiting)

    def _within(self, wanted: Four, motion: Expected, grounds: Sequence[WheelGround]) -> Four:
        """
        Return rolling speeds [m/s] within the limits of slip, on the commanded curve.

        Both wheels of an axle take the same share of the way from free rolling on the commanded
        curve to the wanted speeds: the largest share for which both are within their limits.
        """
        rolling = self._rolling(wanted, motion)
        result = list(wanted)
        for axle in AXLES:
            bands = [self._band(i, motion, grounds[i].limit) for i in axle]
            share = min(share_within(rolling[i], wanted[i], band) for i, band in zip(axle, bands))
            for i, (low, high) in zip(axle, bands):
                speed = (wanted[i] if share == 1.0
                         else rolling[i] + share * (wanted[i] - rolling[i]))
                result[i] = min(max(speed, low), high)
        return four(result)

    def _rolling(self, wanted: Four, motion: Motion) -> Four:
        """Return the rolling speeds [m/s] at the present speed on the commanded curve."""
        left, right = wanted[LEFT[0]], wanted[RIGHT[0]]
        if left or right:  # a command to stop keeps the curve
            sum_ = abs(left + right)
            self._ratio = (right - left) / (left + right) if sum_ > abs(right - left) else math.nan
        if math.isnan(self._ratio):  # spinning
            return four(self._free_rolling(i, motion) for i in range(4))
        return four(motion.v_x * (1.0 - side * self._ratio) for side in SIDES)

    def _free_rolling(self, wheel: int, motion: Motion) -> float:
        """Return the rolling speed [m/s] of a wheel without longitudinal force."""
        return motion.v_x - 0.5 * SIDES[wheel] * self._rolling_track * motion.yaw_rate

    def _band(self, wheel: int, motion: Expected, limit: float) -> tuple[float, float]:
        """Return the smallest and the largest rolling speed [m/s] of a wheel."""
        speed = self._free_rolling(wheel, motion)
        lateral = motion.v_y + 0.5 * ENDS[wheel] * self._robot.wheelbase * motion.yaw_rate
        lateral_slip = lateral / max(abs(speed), self.params.floor)
        margin = self.params.sigmas * motion.v_x_sigma / max(abs(speed), self.params.floor)
        slip = math.sqrt(max(limit ** 2 - lateral_slip ** 2, (c.MIN_SHARE * limit) ** 2))
        slip = max(slip - margin, c.MIN_SHARE * limit)
        return slip_band(speed, slip, self.params.floor)
