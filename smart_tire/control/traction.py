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

"""Traction control: wheel speeds that keep the slip of each wheel below critical."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from smart_tire.control.ground_speed import GroundSpeed, Motion, Onset
from smart_tire.control.slip_band import (
    lowered, most_held, share_within, slip_band, stopping_speed)
from smart_tire.control.slip_limit import (
    expected_friction, GroundKnowledge, Sides, wheel_grounds, WheelGround)
from smart_tire.control.tire_load import TireLoad
from smart_tire.control.yaw_control import yaw_deviation, YawControl
from smart_tire.models.constants import GRAVITY
from smart_tire.models.vehicle.skid_steer import AXLE_SIGNS, normal_loads, SIDE_SIGNS
from smart_tire.parameters.control import TractionParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import Four, Friction, LEFT, NS_PER_S, Odometry, RIGHT, WHEELS

NOT_SLIPPING = (None,) * len(WHEELS)
AXLES = (0, 1), (2, 3)   # indices into WHEELS
SIDES = tuple(map(float, SIDE_SIGNS))
ENDS = tuple(map(float, AXLE_SIGNS))
MAX_ACCELERATION = GRAVITY  # m/s2, of the robot on ground of unknown friction
MAX_PERIOD = 0.1            # s, of the controller
RESISTANCE = 0.2            # -, rolling resistance and slope that add to friction, at most
MIN_SHARE = 0.5             # of a slip limit that remains for the longitudinal slip
ONSET_DELAY = 0.05          # s, from an onset until the robot accelerates
LEAD_PERIODS = 1.0          # periods from a set point to the mean wheel speed it causes
MIN_SLIP_SHARE = 0.3        # of critical slip, down to which a wheel that was limited slips
MIN_EXCESS = 0.1            # m/s, sum of wanted minus limited rolling speeds that is an onset


@dataclass(frozen=True)
class TractionState:
    """What traction control did in the latest step, for diagnostics."""

    reason: str = 'no odom'          # why it was not active, '' if it was
    limiting: bool = False           # whether set points were changed
    slip_limit: float = math.nan     # -, smallest one of the wheels
    friction: float = math.nan       # -, smallest one assumed; NaN where unknown
    limited_steps: int = 0           # steps in which set points were changed, since the start


class TractionControl:
    """
    Limits set points of the wheel speeds; all times are nanoseconds of the message clock.

    Without recent estimates of the motion of the robot set points are not changed.
    """

    def __init__(self, params: TractionParams, robot: RobotParams) -> None:
        self.params = params  # may be replaced at run time
        self.state = TractionState()
        self._robot = robot
        self._ground, self._motion = GroundKnowledge(), GroundSpeed()
        # of the latest step, for the feed-forward; None for wheels that do not slip
        self.tires: tuple[TireLoad | None, ...] = NOT_SLIPPING
        self._onset, self._direction = Onset(), 0
        self._held: Four = (0.0, 0.0, 0.0, 0.0)  # rad/s, most that may be held while stopping
        self._ratio = 0.0                # difference over sum of the sides, latest command
        self._yaw = YawControl(0.5 * robot.track_width / robot.yaw_inertia)
        self._limited_ns: int | None = None
        # m, between wheels that roll without longitudinal force in a turn (isotropic tires)
        self._rolling_track = robot.track_width + robot.wheelbase ** 2 / robot.track_width

    def update_odometry(self, odometry: Odometry) -> None:
        """Add an estimate of the motion of the robot; one that is not finite is ignored."""
        before_ns = self._motion.stamp_ns
        if (self._motion.update(odometry, self.params.acceleration_filter)
                and before_ns is not None and odometry.stamp_ns < before_ns):
            self._ground.clear()  # a new clock: another run

    def update_friction(self, friction: Friction) -> None:
        """Add the friction of one patch crossing."""
        self._ground.update(friction, self._motion.distance_at(friction.stamp_ns))

    def limit(self, set_points: Four, now_ns: int) -> Four:
        """Return ``set_points`` [rad/s], limited at time ``now_ns``."""
        period, before_tires, self.tires = self._period(now_ns), self.tires, NOT_SLIPPING
        if reason := self._inactive(now_ns):
            self._report(reason)
            self._held = set_points
            self._yaw.reset()
            return set_points
        sides = self._ground.on_sides(self._motion.distance, self.params.max_distance)
        radius = self._robot.wheel_radius
        a, b, c, d = (radius * speed for speed in set_points)
        wanted = a, b, c, d
        limited, motion, grounds = self._predicted_limit(wanted, now_ns, period, sides)
        if self._begins(sum(wanted) - sum(limited), now_ns, sides):
            limited, motion, grounds = self._predicted_limit(wanted, now_ns, period, sides)
        tires = [self._tire(*one, motion) for one in enumerate(grounds)]
        if limited == wanted:
            self._yaw.reset()
        else:
            limited = self._balanced(limited, tires, motion, now_ns, period)
            limited = self._stopping(limited, wanted, period)
        slipping = [speed != target or (
            before is not None and target != 0.0
            and tire.slip_share(speed / radius) > MIN_SLIP_SHARE)
            for tire, before, speed, target in zip(tires, before_tires, limited, wanted)]
        self.tires = tuple(tire if slips else None for tire, slips in zip(tires, slipping))
        self._held = most_held(self._held, wanted, limited, self._step(period), radius)
        self._report('', limited != wanted, min(ground.limit for ground in grounds), sides)
        a, b, c, d = (speed / radius for speed in limited)
        return (a, b, c, d) if self.state.limiting else set_points

    def _stopping(self, speeds: Four, wanted: Four, period: float) -> Four:
        """Return the rolling speeds [m/s] of wheels that stop, whatever the estimates."""
        radius, step = self._robot.wheel_radius, self._step(period)
        a, b, c, d = (stopping_speed(speed, target, lowered(radius * held, step))
                      for speed, target, held in zip(speeds, wanted, self._held))
        return a, b, c, d

    def _step(self, period: float) -> float:
        """Return the change of speed [m/s] of a wheel that stops, whatever the estimates."""
        return self.params.min_deceleration * period

    def _predicted_limit(self, wanted: Four, now_ns: int, period: float, sides: Sides) -> tuple[
            Four, Motion, tuple[WheelGround, ...]]:
        """Return limited rolling speeds [m/s], and the motion and the ground for them."""
        motion = self._motion.predicted(
            now_ns, LEAD_PERIODS * period + self.params.lead, self._onset,
            _acceleration_bound(sides, self.params))
        assert motion is not None  # else it was inactive
        grounds = wheel_grounds(sides, self._loads(motion), motion.acceleration, self.params)
        return self._within(wanted, motion, grounds), motion, grounds

    def _tire(self, wheel: int, ground: WheelGround, motion: Motion) -> TireLoad:
        radius = self._robot.wheel_radius
        return TireLoad(self._free_rolling(wheel, motion) / radius, radius * ground.friction,
                        ground.critical)

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
        a, b, c, d = (radius * tire.with_share(speed / radius, shares[i % 2])
                      for i, (speed, tire) in enumerate(zip(speeds, tires)))
        return a, b, c, d

    def _begins(self, excess: float, now_ns: int, sides: Sides) -> bool:
        """Return whether the robot begins to accelerate or to brake at the limit."""
        direction = (excess > MIN_EXCESS) - (excess < -MIN_EXCESS)
        begins = direction not in (0, self._direction)
        if begins:
            friction = _expected_friction(sides, self.params)
            self._onset = Onset(now_ns, direction * GRAVITY * friction,
                                self.params.acceleration_filter + ONSET_DELAY)
        self._direction = direction
        return begins

    def _inactive(self, now_ns: int) -> str:
        """Return why set points are not limited, '' if they are."""
        if not self.params.enabled:
            return 'disabled'
        age = self._motion.age(now_ns)
        if math.isinf(age):
            return 'no odom'
        return '' if abs(age) <= self.params.max_age else f'odom is {age:.2f} s old'

    def _report(self, reason: str, limiting: bool = False, slip: float = math.nan,
                sides: Sides = (None, None)) -> None:
        friction = [one.friction.value for one in sides if one is not None]
        self.state = TractionState(reason, limiting, slip, min(friction, default=math.nan),
                                   self.state.limited_steps + limiting)

    def _period(self, now_ns: int) -> float:
        before, self._limited_ns = self._limited_ns, now_ns
        elapsed = 0.0 if before is None else (now_ns - before) / NS_PER_S
        return min(max(elapsed, 0.0), MAX_PERIOD)

    def _loads(self, motion: Motion) -> Four:
        robot = self._robot
        a, b, c, d = normal_loads(
            robot.mass, robot.center_of_mass, robot.wheelbase, robot.track_width,
            motion.acceleration, motion.v_x * motion.yaw_rate, radius=robot.wheel_radius).tolist()
        return a, b, c, d

    def _within(self, wanted: Four, motion: Motion, grounds: Sequence[WheelGround]) -> Four:
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
        a, b, c, d = result
        return a, b, c, d

    def _rolling(self, wanted: Four, motion: Motion) -> Four:
        """Return the rolling speeds [m/s] at the present speed on the commanded curve."""
        left, right = wanted[LEFT[0]], wanted[RIGHT[0]]
        if left or right:  # a command to stop keeps the curve
            sum_ = abs(left + right)
            self._ratio = (right - left) / (left + right) if sum_ > abs(right - left) else math.nan
        if math.isnan(self._ratio):  # spinning
            a, b, c, d = (self._free_rolling(i, motion) for i in range(4))
        else:
            a, b, c, d = (motion.v_x * (1.0 - side * self._ratio) for side in SIDES)
        return a, b, c, d

    def _free_rolling(self, wheel: int, motion: Motion) -> float:
        """Return the rolling speed [m/s] of a wheel without longitudinal force."""
        return motion.v_x - 0.5 * SIDES[wheel] * self._rolling_track * motion.yaw_rate

    def _band(self, wheel: int, motion: Motion, limit: float) -> tuple[float, float]:
        """Return the smallest and the largest rolling speed [m/s] of a wheel."""
        speed = self._free_rolling(wheel, motion)
        lateral = motion.v_y + 0.5 * ENDS[wheel] * self._robot.wheelbase * motion.yaw_rate
        lateral_slip = lateral / max(abs(speed), self.params.floor)
        margin = motion.v_x_sigma / max(abs(speed), self.params.floor)
        slip = math.sqrt(max(limit ** 2 - lateral_slip ** 2, (MIN_SHARE * limit) ** 2))
        slip = max(slip - margin, MIN_SHARE * limit)
        return slip_band(speed, slip, self.params.floor)


def _acceleration_bound(sides: Sides, params: TractionParams) -> float:
    """Return the largest acceleration [m/s2] that friction permits."""
    if None in sides:
        return MAX_ACCELERATION
    return GRAVITY * (RESISTANCE + max(
        sum(expected_friction(side, params)) for side in sides))


def _expected_friction(sides: Sides, params: TractionParams) -> float:
    """Return the friction [-] expected: that of the lower side."""
    return min(expected_friction(side, params).value for side in sides)
