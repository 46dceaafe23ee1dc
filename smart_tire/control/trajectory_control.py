# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Upper level of the control: follows a path with commands of the body velocity."""

from __future__ import annotations

from dataclasses import replace
from enum import Enum, IntEnum
import math

import numpy as np

from smart_tire.control import constants as c
from smart_tire.control.base_response import BaseResponse
from smart_tire.control.ground_knowledge import GroundKnowledge, LowerBound, MappedGround
from smart_tire.control.ground_motion import Motion, MotionMonitor, wrap
from smart_tire.control.history import time_step
from smart_tire.control.motion_limits import command_share, motion_limits
from smart_tire.control.path_follower import Conditions, no_lateral_speed, PathFollower
from smart_tire.control.path_plan import check_start, checked, plan_goal, plan_path
from smart_tire.control.slip_kinematics import SlipKinematics
from smart_tire.control.stop_conditions import arrival_error, OdometryCheck, ProgressMonitor
from smart_tire.errors import CommandError, LateCommandError
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.samples import (
    GoalPose, GroundState, NAN, NS_PER_S, Odometry, PathProgress, PlannedPath, Vector3,
    VelocityCommand, WheelSample, WheelSlip)


class PathState(IntEnum):
    """State of the controller, as in ``path_progress``."""

    IDLE = 0
    FOLLOWING = 1
    ARRIVED = 2
    STOPPED = 3
    REFUSED = 4


class Cause(Enum):
    """Kind of the reason for a stop, in the diagnostics: whether it may be worth going on."""

    ORDER = 'order'    # canceled or refused
    LATE = 'late'      # odometry or the order were late
    MOTION = 'motion'  # of the robot: away from the path, without progress, or wrong odometry


class TrajectoryControl:
    """
    Follows one path or drives to one goal; all times are nanoseconds of the message clock.

    A path whose poses are all at one position is a goal. A new order replaces the one that is
    followed without stop. If it is refused, the robot stops: whoever sent it does not expect that
    the old one is driven on. ``reason`` is the text for the present state: why it was stopped or
    refused, for the ``cause``.
    """

    def __init__(self, params: TrajectoryControllerParams) -> None:
        self.params = params  # may be replaced at run time
        self._kinematics = SlipKinematics(params)
        self._ground = GroundKnowledge()
        self.lower_bound: LowerBound | None = None  # of a friction map; may be replaced, too
        self._motion = MotionMonitor()
        self._response = BaseResponse(
            params.follower.actuation_delay, 0.5 * params.robot.track_width)
        self._odometry_check = OdometryCheck(params.robot, self._motion.twist.travel)
        # until the first odometry after it; a goal that is too near, until the robot has stopped
        self._target: PlannedPath | GoalPose | None = None
        self._follower: PathFollower | None = None
        self._goal: GoalPose | None = None  # that the follower drives to
        self._released_ns: int | None = None  # since when the robot is left alone at its end
        self._approaches = 0                 # that were repeated
        self._end_pose: Vector3 = 0.0, 0.0, NAN  # x, y [m], yaw [rad] or NaN
        self._speed_limit = math.inf, False      # m/s, or percent of ``max_speed``
        self._progress = ProgressMonitor()
        self._stepped_ns: int | None = None
        self._stop_due = False             # a command of zero is to be published
        self.holding = False               # commands of zero are published since the arrival
        self._last = (0.0, 0.0)            # command before the compensation of slip
        self.state = PathState.IDLE
        self.reason, self.cause = '', Cause.ORDER

    @property
    def active(self) -> bool:
        """Return whether commands are published."""
        return self.state == PathState.FOLLOWING or self.holding

    @property
    def max_speed(self) -> float:
        """Return the maximum speed [m/s], with the limit of ``limit_speed``."""
        limit, percentage = self._speed_limit
        return min(0.01 * limit * self.params.max_speed if percentage else limit,
                   self.params.max_speed)

    @property
    def twist_fault(self) -> str:
        """Return what contradicts the twist in ``odom``; empty if nothing does."""
        return self._motion.twist.fault

    def follow(self, target: PlannedPath | GoalPose, now_ns: int) -> None:
        """
        Follow a path, or drive to a goal, from now on.

        The state is REFUSED, with the reason, if it is invalid.
        """
        try:
            target = checked(target, self.params.checks, self.params.robot.frames['odom'])
            if self._motion.initialized and not self._stale(now_ns):
                self._begin(target)
            else:
                self._target, self._follower = target, None
                self._progress.renew()
        except CommandError as error:
            self.refuse(error)
            return
        if self.state != PathState.FOLLOWING:
            self._odometry_check.clear()
            self._progress = ProgressMonitor()
            self._stepped_ns = None  # the first step is one period, however long ago the last was
        self.state, self.reason, self._motion.fault = PathState.FOLLOWING, '', ''
        self.holding = False

    def cancel(self, reason: str) -> None:
        """Stop following or holding; nothing happens if neither is done."""
        if self.active:
            self._end(PathState.STOPPED, reason)
            self.holding = False

    def refuse(self, error: Exception) -> None:
        """End following for an order that cannot be read or is too old."""
        late = isinstance(error, LateCommandError)
        self._end(PathState.REFUSED, str(error), Cause.LATE if late else Cause.ORDER)

    def limit_speed(self, limit: float, *, percentage: bool) -> None:
        """
        Limit the speed, from now on, to ``limit`` in m/s or in percent of ``max_speed``.

        A limit of 0 ends the one before, as in ``nav2_msgs/SpeedLimit``; one above ``max_speed``
        changes nothing. Raise CommandError if it is not valid: the one before remains.
        """
        if not 0.0 <= limit < math.inf:
            raise CommandError(f'speed_limit: {limit:g}, expected a finite number from 0 on')
        self._speed_limit = limit or math.inf, percentage

    def add_odometry(self, odometry: Odometry, now_ns: int) -> None:
        """Add the latest pose and velocity."""
        driven = self._motion.add_odometry(odometry, self.params.checks)
        motion, stamp_ns = self._motion.motion, odometry.stamp_ns
        if self._motion.stamp_ns != stamp_ns:
            return  # not plausible
        self._ground.drive(driven, stamp_ns)
        self._kinematics.add_motion(motion, stamp_ns)
        if self.state == PathState.FOLLOWING:
            self._response.learn(motion, stamp_ns)

    def add_wheels(self, wheels: WheelSample) -> None:
        """Add the latest speeds of the wheels; without them, odometry is not compared."""
        self._odometry_check.add_wheels(wheels)

    def add_slip(self, slip: WheelSlip) -> None:
        """Add the latest slips of the wheels."""
        self._kinematics.add_slip(slip)

    def set_ground(self, ground: GroundState) -> None:
        """Use the state of the ground."""
        self._ground.set_ground(ground)

    def step(self, now_ns: int) -> VelocityCommand | None:
        """
        Return the next ``cmd_vel``; None if nothing is to be published.

        After following has ended, the first result is a command of zero, then None, except that
        with ``hold_on_arrival`` commands of zero go on.
        """
        last_ns, self._stepped_ns = self._stepped_ns, now_ns
        if self.state == PathState.FOLLOWING:
            if last_ns is not None and now_ns < last_ns:
                self.cancel('time runs back, expected increasing times')
            else:
                self._check(now_ns)
        if self.state == PathState.FOLLOWING and self._follower is not None:
            dt = time_step(now_ns, last_ns, self.params.rate)
            return self._follow(self._follower, now_ns, dt)
        return self._stop(now_ns)

    def progress(self, now_ns: int) -> PathProgress:
        """Return the progress for ``path_progress``."""
        if self._follower is None:
            return PathProgress(now_ns, NAN, NAN, int(self.state))
        point = self._follower.point
        return PathProgress(now_ns, self._follower.remaining_distance(),
                            NAN if point is None else point.lateral, int(self.state))

    def _end(self, state: PathState, reason: str = '', cause: Cause = Cause.ORDER) -> None:
        self._stop_due = self._stop_due or self.state == PathState.FOLLOWING
        self.state, self.reason, self.cause = state, reason, cause
        self._target, self._follower, self._last = None, None, (0.0, 0.0)

    def _stop(self, now_ns: int) -> VelocityCommand | None:
        """Return a command of zero, once after following has ended."""
        due, self._stop_due = self._stop_due or self.holding, False
        return self._commanded(now_ns, 0.0, 0.0) if due else None

    def _commanded(self, now_ns: int, v_x: float, yaw_rate: float) -> VelocityCommand:
        """Return the command; the base is expected to follow it."""
        self._response.command(v_x, yaw_rate, now_ns)
        return VelocityCommand(now_ns, v_x, yaw_rate)

    def _check(self, now_ns: int) -> None:
        """Begin with a new target; end following where a condition for it is not met."""
        known = self._motion.initialized
        late = self._stale(now_ns) if known else ''
        fault = (self._motion.fault or late or ('' if known else self._progress.waiting(now_ns))
                 or self._odometry_check.fault(self.params.checks.max_slip))
        if fault:
            self._end(PathState.STOPPED, fault, Cause.LATE if fault == late else Cause.MOTION)
        elif self._target is not None and known and (
                self._follower is None or self._follower.finished):
            try:
                self._begin(self._target)
            except CommandError as error:
                self.refuse(error)

    def _stale(self, now_ns: int) -> str:
        age, limit = self._motion.age(now_ns), self.params.checks.odom_timeout
        if abs(age) <= limit:
            return ''
        return f'odom: {age:.2f} s old, expected at most {limit:g} s'

    def _begin(self, target: PlannedPath | GoalPose) -> None:
        motion, params = self._motion.motion, self.params
        check_start(target, motion, params.checks)
        if self._is_renewed(target):
            return
        self._target, self._goal = None, target if isinstance(target, GoalPose) else None
        if isinstance(target, PlannedPath):
            maneuvers = plan_path(target.poses, params.follower.corner_angle)
        elif self._must_stop_before(target):
            maneuvers, self._target = (), target
        else:
            maneuvers = plan_goal(motion, target.pose, params.arrival)
        follower = PathFollower(maneuvers, *self._last)
        self._approaches = 0
        self._end_pose = self._goal.pose if self._goal is not None else follower.end
        self._drive(follower)

    def _drive(self, follower: PathFollower) -> None:
        """Begin to follow."""
        self._follower, self._released_ns = follower, None
        self._progress.renew()

    def _is_renewed(self, target: PlannedPath | GoalPose) -> bool:
        """
        Return whether ``target`` is the goal that is followed, within the tolerances.

        A new beginning would turn, or drive, to and fro: nav2 renews goals where the robot is.
        """
        goal, arrival = self._goal, self.params.arrival
        if (goal is None or not isinstance(target, GoalPose) or self._follower is None
                or self._follower.finished and self._released_ns is None):
            return False
        x, y, yaw = (new - old for new, old in zip(target.pose, goal.pose))
        return math.hypot(x, y) <= arrival.xy_tolerance and (
            abs(wrap(yaw)) <= arrival.yaw_tolerance
            or math.isnan(goal.pose[2]) and math.isnan(target.pose[2]))

    def _must_stop_before(self, goal: GoalPose) -> bool:
        """Return whether the robot cannot stop at the goal: it is planned from rest."""
        motion, params = self._motion.motion, self.params
        if self._follower is not None and self._follower.finished:
            return False
        limits = motion_limits(params, self._allowed_acceleration(motion))
        braking = motion.speed() ** 2 / (2.0 * c.PLANNED_SHARE * limits.deceleration)
        distance = math.hypot(goal.pose[0] - motion.x, goal.pose[1] - motion.y)
        return distance <= braking + motion.speed() * self._response.delay

    @property
    def _mapped(self) -> MappedGround | None:
        params = self.params
        return None if self.lower_bound is None else MappedGround(
            self.lower_bound, params.friction, params.robot)

    def _allowed_acceleration(self, motion: Motion) -> float:
        """Return the acceleration [m/s2] on the present ground, the less of estimate and map."""
        estimated, mapped = self._ground.acceleration(self.params.friction), self._mapped
        return estimated if mapped is None else min(estimated, *mapped.acceleration(
            *(np.array([one]) for one in (motion.x, motion.y, motion.yaw))).tolist())

    def _follow(self, follower: PathFollower, now_ns: int, dt: float) -> VelocityCommand | None:
        params = self.params
        assert self._motion.stamp_ns is not None
        self._response.given = params.follower.actuation_delay
        factors = (self._kinematics.factors(*self._last, now_ns) if params.slip_compensation
                   else (1.0, 1.0))
        self._response.factors[:] = factors
        motion = self._response.predicted(self._motion.motion, self._motion.stamp_ns, now_ns)
        limits = motion_limits(params, self._allowed_acceleration(motion), factors)
        limits = replace(limits, speed=min(limits.speed, self.max_speed), mapped=self._mapped)
        lateral = self._kinematics.lateral_speed if params.slip_compensation else no_lateral_speed
        self._last = follower.step(
            Conditions(motion, dt, limits, params, lateral, self._response.delay))
        if self._target is None:  # else the robot stops before it drives there
            if follower.finished:
                return self._finish(now_ns)
            if reason := self._progress.check(follower, self._motion.motion, now_ns, params):
                self._end(PathState.STOPPED, reason, Cause.MOTION)
                return self._stop(now_ns)
        return self._commanded(now_ns, *self._compensated(now_ns))

    def _finish(self, now_ns: int) -> VelocityCommand | None:
        """
        Arrive, if the robot is where it was to be once it has come to rest; or approach again.

        Tires that are twisted by a turn move the robot when the motors are released.
        """
        params, motion, released_ns = self.params, self._motion.motion, self._released_ns
        if released_ns is None:
            released_ns = self._released_ns = now_ns
        elapsed = (now_ns - released_ns) / NS_PER_S
        self._response.command(0.0, 0.0, now_ns)
        wait = c.RELEASE_TIME if motion.at_rest() else 2.0 * c.RELEASE_TIME
        if elapsed < wait:
            zero = params.hold_on_arrival or released_ns == now_ns
            return VelocityCommand(now_ns, 0.0, 0.0) if zero else None
        end = self._end_pose
        if not (reason := arrival_error(motion, end, params.arrival)):
            self._end(PathState.ARRIVED)
            self._stop_due, self.holding = False, params.hold_on_arrival
        elif self._approaches < c.MAX_APPROACHES:
            self._approaches += 1
            self._drive(PathFollower(plan_goal(motion, end, params.arrival), *self._last))
            return VelocityCommand(now_ns, 0.0, 0.0)
        else:
            self._end(PathState.STOPPED, reason, Cause.MOTION)
        return self._stop(now_ns)

    def _compensated(self, now_ns: int) -> tuple[float, float]:
        """Return the command for the wanted motion of the body, within its bounds."""
        command = self._last
        if self.params.slip_compensation:
            command = self._kinematics.command(*command, now_ns, self._response.delay, self.params)
        share = command_share(command, self.params)
        return (share * command[0], share * command[1]) if share else (0.0, 0.0)
