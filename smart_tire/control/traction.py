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

from dataclasses import dataclass
import math

from smart_tire.control import constants as c
from smart_tire.control.ground_knowledge import GroundKnowledge
from smart_tire.control.ground_motion import GroundSpeed, Motion, Onset
from smart_tire.control.slip_limits import bounded, slip_band, TireLoad, YawControl
from smart_tire.models.tire.brush_tire import critical_slip
from smart_tire.models.vehicle.skid_steer import normal_loads, SIDE_SIGNS
from smart_tire.parameters.control import TractionParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import Four, four, GRAVITY, GroundState, Odometry, WHEELS

NOT_SLIPPING = (None,) * len(WHEELS)


@dataclass(frozen=True)
class TractionState:
    """What traction control did in the latest step, for diagnostics."""

    reason: str = 'no odom'          # why it was not active, '' if it was
    limiting: bool = False           # whether set points were changed
    slip_limit: float = math.nan     # -, smallest one of the wheels
    friction: float = math.nan       # -, expected
    limited_steps: int = 0           # steps in which set points were changed, since the start


class TractionControl:
    """
    Limits set points of the wheel speeds; all times are nanoseconds of the message clock.

    The slip of a wheel is at most its critical slip for the lower bound of the friction. Whatever
    the estimates are, a set point is between zero and the command, or on its way there
    (``slip_limits.bounded``). Without recent estimates of the motion of the robot set points are
    not changed.
    """

    def __init__(self, params: TractionParams, robot: RobotParams) -> None:
        self.params = params  # may be replaced at run time
        self.state = TractionState()
        self._robot = robot
        self._ground, self._motion = GroundKnowledge(), GroundSpeed()
        # of the latest step, for the feed-forward; None for wheels that do not slip
        self.tires: tuple[TireLoad | None, ...] = NOT_SLIPPING
        self._onset, self._direction = Onset(), 0
        self._latest: Four | None = None  # rad/s, set points of the latest step
        self._turn_ratio = 0.0                # difference over sum of the sides, latest command
        self._yaw = YawControl(0.5 * robot.track_width / robot.yaw_inertia)
        # m, between wheels that roll without longitudinal force in a turn (isotropic tires)
        self._rolling_track = robot.track_width + robot.wheelbase ** 2 / robot.track_width

    def add_odometry(self, odometry: Odometry) -> None:
        """Add an estimate of the motion of the robot; one that is not plausible is ignored."""
        driven = self._motion.add_odometry(odometry, self.params.acceleration_filter)
        if driven is not None:
            self._ground.drive(driven, odometry.stamp_ns)

    def set_ground(self, ground: GroundState) -> None:
        """Use the state of the ground; what is not plausible is ignored."""
        late = max(-self._motion.age(ground.stamp_ns), 0.0)
        self._ground.set_ground(ground, abs(self._motion.motion.v_x) * late)

    def reset(self) -> None:
        """Forget the set points: the motors do not follow them."""
        self._latest, self.tires = None, NOT_SLIPPING
        self._direction = 0

    def limit(self, set_points: Four, now_ns: int, period: float) -> Four:
        """Return ``set_points`` [rad/s], limited at ``now_ns`` for a control ``period`` [s]."""
        limited = set_points
        tires: tuple[TireLoad | None, ...] = NOT_SLIPPING
        if reason := self._inactive(now_ns):
            self.state = TractionState(reason, limited_steps=self.state.limited_steps)
            self._direction = 0
            self._yaw.reset()
        else:
            limited, tires = self._limited(set_points, now_ns, period)
        step = self.params.min_deceleration * period / self._robot.wheel_radius
        self._latest = four(
            map(bounded, limited, set_points, self._latest or set_points, (step,) * 4))
        self.tires = tuple(tire if speed != target else None for tire, speed, target in zip(
            tires, self._latest, set_points))
        return self._latest

    def _inactive(self, now_ns: int) -> str:
        """Return why set points are not limited, '' if they are."""
        age = self._motion.age(now_ns)
        if math.isinf(age):
            return 'no odom'
        return '' if abs(age) <= self.params.max_age else f'odom is {age:.2f} s old'

    def _limited(self, set_points: Four, now_ns: int, period: float) -> tuple[
            Four, tuple[TireLoad, ...]]:
        """Return the set points [rad/s] with slips within their limits, and the tires there."""
        params, radius = self.params, self._robot.wheel_radius
        left, right, *_ = set_points
        if left or right:  # a command to stop keeps the curve; NaN: a rotation
            sum_ = left + right
            self._turn_ratio = (right - left) / sum_ if abs(sum_) > abs(right - left) else math.nan
        friction = self._ground.friction(params.unknown, params)
        least = max(friction.value - params.sigmas * friction.sigma, c.MIN_FRICTION)
        limited, tires, motion = self._within(set_points, now_ns, period, friction.value, least)
        if self._begins(radius * (sum(set_points) - sum(limited)), now_ns, friction.value):
            limited, tires, motion = self._within(set_points, now_ns, period, friction.value,
                                                  least)
        limiting = limited != set_points
        self.state = TractionState('', limiting, min(map(self._slip_limit, tires)), friction.value,
                                   self.state.limited_steps + limiting)
        if limiting:
            delay = self._motion.age(now_ns) + 0.5 * period + params.lead  # a mean of a period
            limited = self._balanced(limited, tires, motion, least, period, delay)
        else:
            self._yaw.reset()
        return limited, tires

    def _within(self, set_points: Four, now_ns: int, period: float, friction: float, least: float
                ) -> tuple[Four, tuple[TireLoad, ...], Motion]:
        """
        Return the set points [rad/s] within the limits of slip, the tires and the motion for them.

        ``friction`` is the expected one, ``least`` its lower bound, whose critical slip counts.
        """
        radius, floor = self._robot.wheel_radius, self.params.floor
        motion, acceleration = self._motion.expected(
            now_ns, period + self.params.lead, self._onset)
        stiffness = self._ground.stiffness(self._robot.tire.longitudinal_stiffness, self.params)
        loads = normal_loads(self._robot, acceleration, 0.0)
        tires = tuple(
            TireLoad((motion.v_x - 0.5 * side * self._rolling_track * motion.yaw_rate) / radius,
                     radius * least * load, max(critical, c.TINY), set_point)
            for side, load, critical, set_point in zip(
                SIDE_SIGNS.tolist(), loads.tolist(),
                critical_slip(least, loads, stiffness).tolist(), set_points))
        bands = [slip_band(radius * tire.speed, self._slip_limit(tire), floor) for tire in tires]
        return four(set_point if low <= radius * set_point <= high
                    else min(max(radius * set_point, low), high) / radius
                    for set_point, (low, high) in zip(set_points, bands)), tires, motion

    def _slip_limit(self, tire: TireLoad) -> float:
        return min(tire.critical_slip, self.params.max_slip)

    def _begins(self, excess: float, now_ns: int, friction: float) -> bool:
        """Return whether the robot begins to accelerate or to brake at the limit."""
        least = 2.0 * self.params.floor
        direction = (excess > least) - (excess < -least)
        begins = direction not in (0, self._direction)
        if begins:
            self._onset = Onset(now_ns, direction * GRAVITY * friction,
                                self.params.acceleration_filter + c.ONSET_DELAY)
        self._direction = direction
        return begins

    def _balanced(self, speeds: Four, tires: tuple[TireLoad, ...], motion: Motion, least: float,
                  period: float, delay: float) -> Four:
        """Return the wheel speeds [rad/s] with less force on the side that turns the robot."""
        if not self._direction or math.isnan(self._turn_ratio):
            self._yaw.reset()
            return speeds
        if abs(motion.v_x) < self.params.floor:  # a start is not prevented
            return speeds
        commanded = 2.0 * motion.v_x * self._turn_ratio / self._rolling_track
        shares = self._yaw.shares(motion.yaw_rate - commanded, period, delay,
                                  0.5 * least * self._robot.mass * GRAVITY, self._direction)
        return four(tire.with_share(speed, share)
                    for tire, speed, share in zip(tires, speeds, (*shares, *shares)))
