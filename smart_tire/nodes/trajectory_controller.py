# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Node ``trajectory_controller``: ``path`` or ``goal_pose``, and estimates, to ``cmd_vel``."""

from __future__ import annotations

from functools import partial
import math
from pathlib import Path
import sys
import time
from typing import Any

from smart_tire.control.command_check import check_age
from smart_tire.control.publishers import MessageInfo, PublisherCheck
from smart_tire.control.trajectory_control import Cause, PathState, TrajectoryControl
from smart_tire.drivers.clock import SYSTEM
from smart_tire.errors import CommandError
from smart_tire.mapping.raster import Raster, read_raster
from smart_tire.messages import (
    check_pose_count, path_from_bytes, path_from_msg, wheels_from_msg)
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.compat import installed_class, publisher_names
from smart_tire.nodes.diagnostics import InputCounter, Status
from smart_tire.nodes.follow_path import FollowPathServer, Goal, NAME as ACTION
from smart_tire.nodes.runner import run
from smart_tire.nodes.transforms import Order, Transforms
from smart_tire.parameters import TrajectoryControllerParams
from smart_tire.samples import GoalPose, Odometry, PlannedPath
from std_srvs.srv import Trigger

PROGRESS_PERIOD = 0.25  # s between messages of path_progress, docs/topics.md
PUBLISHER_WINDOW = 5.0  # s: planners that renew their paths at 0.2 Hz and faster are in conflict
MAP_PERIOD = 1.0  # s between two looks at the transform of the friction map
LOG_PERIOD = 1.0  # s between log lines for messages that are refused
SPEED_LIMIT = 'speed_limit'
ORDERS = ('path', 'goal_pose', ACTION)


class TrajectoryController(SmartTireNode[TrajectoryControllerParams]):
    """
    Follows a path, or drives to a goal, with commands of the body velocity.

    Subscribes to ``path``, ``goal_pose``, ``odom``, ``wheel_states``, ``wheel_slip``,
    ``ground_state``, ``emergency_stop_active`` and, if tf2_msgs is installed, ``/tf`` and
    ``/tf_static``; publishes ``cmd_vel`` (only while it follows,
    then one command of zero, or zero from then on with ``hold_on_arrival``), ``path_progress`` and
    ``/diagnostics``. Service: ``cancel_path``. If nav2_msgs is installed, it subscribes to
    ``speed_limit``, too, and unless the parameter ``follow_path`` is false, serves the action of
    this name.

    Parameters: those of ``TrajectoryControllerParams``.
    """

    # also if many messages wait: what it receives is never old
    paced_timers, paced_by, pace_lag_ns = True, 'wheel_states', 1_000_000_000

    def __init__(self) -> None:
        super().__init__('trajectory_controller', TrajectoryControllerParams)
        params = self.params
        self._server: FollowPathServer | None = None
        self._control = TrajectoryControl(params)
        self._given: Order | None = None  # the latest one that was accepted
        self._order: Order | None = None  # the same in the frame of odom
        self._goal: Goal | None = None    # of follow_path, from which it is
        self._is_ending = False
        self._odometry: Odometry | None = None
        self._emergency_stop = False
        self._reported = self._control.state, self._control.reason
        self._late_host = ''  # why the path was not followed to its end, if the host was late
        self._publish_velocity = self.make_publisher('cmd_vel')
        self._publish_progress = self.make_publisher('path_progress')
        self._transforms = Transforms(self)
        self._map_fault = ''  # why the friction map is not used
        if params.friction_map:
            self._use_map(read_raster(Path(params.friction_map)).widened(
                params.friction_map_margin, params.friction.sigmas))
        self._subscribe_orders()
        action = installed_class('nav2_msgs/action/FollowPath')
        if action is not None and params.follow_path:
            self.inputs[ACTION] = InputCounter()
            self._server = FollowPathServer(self, action, self._on_goal)
        speed_limit = installed_class('nav2_msgs/msg/SpeedLimit')
        if speed_limit is not None:
            self.inputs[SPEED_LIMIT] = InputCounter()
            self.create_subscription(  # queue as of nav2's controller_server
                speed_limit, SPEED_LIMIT, self._on_speed_limit, 10)
        self.subscribe('odom', self._on_odometry, required=True, reliability=params.reliability)
        self.subscribe('wheel_states', self._control.add_wheels, announced=True,
                       reliability=params.reliability,
                       from_msg=partial(wheels_from_msg, joints=params.robot.joints))
        self.subscribe('wheel_slip', self._control.add_slip, announced=True,
                       reliability=params.reliability)
        self.subscribe('ground_state', self._control.set_ground, announced=True,
                       reliability=params.reliability)
        self.subscribe_state('emergency_stop_active', self._on_emergency_stop)
        self.create_service(Trigger, 'cancel_path', self._on_cancel)
        self._step_timer = self.call_every(1.0 / params.rate, self._step)
        self._pace()
        self.call_every(PROGRESS_PERIOD, self._send_progress, wakes=False)

    def _use_map(self, found: Raster) -> None:
        """Limit the speed by a friction map, in whatever frame it is."""
        def update() -> None:
            try:
                origin = self._transforms.in_frame(
                    self.params.robot.frames['odom'], 'friction map',
                    GoalPose(0, found.frame, (0.0, 0.0, 0.0)), self.params.transform_max_age)
                if origin.frame not in ('', self.params.robot.frames['odom']):
                    raise CommandError(f'friction map: frame {found.frame!r}, /tf is not received')
            except CommandError as error:
                self._control.lower_bound, self._map_fault = None, str(error)
            else:
                assert isinstance(origin, GoalPose)
                self._control.lower_bound = partial(found.lower_bound, pose=origin.pose)
                self._map_fault = ''

        update()
        self.call_every(MAP_PERIOD, update, wakes=False)

    def _subscribe_orders(self) -> None:
        self._senders = {name: PublisherCheck(name, PUBLISHER_WINDOW,
                                              partial(publisher_names, self, name))
                         for name in ('path', 'goal_pose')}
        self.subscribe('path', partial(self._on_message, 'path'),
                       kept=True, raw=True, from_msg=self._read_path)
        self.subscribe('goal_pose', partial(self._on_message, 'goal_pose'), kept=True)

    def _read_path(self, data: bytes) -> PlannedPath:
        return path_from_bytes(data, self.params.checks.max_path_poses)

    def stop(self) -> None:
        """Stop the robot if it follows a path."""
        self._is_ending = True
        self._end('node ended')
        if self._server is not None:
            self._server.close()

    def destroy_node(self) -> None:
        """Destroy the action server, which rclpy leaves to its owner, and the node."""
        if self._server is not None:
            self._server.destroy()
        super().destroy_node()

    def on_parameters_changed(self) -> None:
        """Use the new parameters."""
        self._control.params = self.params

    def _on_goal(self, goal: Goal, waited_ns: int) -> None:
        """Follow the path in a goal of the action, of any client: the newest one wins."""
        def follow() -> None:
            path = goal.request.path
            check_pose_count(len(path.poses), self.params.checks.max_path_poses)
            self._on_order(ACTION, path_from_msg(path), waited_ns, goal)

        self.guarded(ACTION, self.inputs[ACTION], follow)

    def _on_message(self, name: str, order: Order, info: MessageInfo) -> None:
        """Follow a new path or goal, unless another node has sent one a short time ago, too."""
        senders = self._senders[name]
        if conflict := senders.record(senders.sender(info), self.steady_ns(), by_node=True):
            raise CommandError(conflict)
        # from its publication on, since a latched one is received when this node starts; the
        # middleware has the time of the machine
        waited_ns = 0 if SYSTEM.simulated is not None else time.time_ns() - info.source_ns
        self._on_order(name, order, max(waited_ns, 0))

    def _on_order(self, name: str, order: Order, waited_ns: int, goal: Goal | None = None) -> None:
        """Follow a new path or goal, unless it is of the past: it has waited [ns] at most."""
        if self._is_ending:
            raise CommandError(f'{name}: the node ends')
        if self._control.state == PathState.FOLLOWING and order == self._given:
            # repeated: a new beginning would lead back to parts already driven
            self._goal = goal or self._goal
            self._step()
            return
        check_age(name, order.stamp_ns, self.now_ns(), waited_ns, self.params.path_max_age)
        if self._emergency_stop:
            raise CommandError(f'{name}: the emergency stop is active')
        self._order = self._transforms.in_frame(
            self.params.robot.frames['odom'], name, order, self.params.transform_max_age)
        self._given, self._goal = order, goal
        self._control.follow(self._order, self.now_ns())
        self._reported = self._reported[0], 'new order'  # report it, also if the state is the same
        self._step()

    def reject_input(self, name: str, counter: InputCounter, error: Exception) -> None:
        """Stop the robot for a path or goal that is invalid: the one before is outdated."""
        if name not in ORDERS:
            super().reject_input(name, counter, error)
            return
        counter.reject(str(error))
        self._reported = self._reported[0], ''  # report each, as often as the log permits
        self._control.refuse(error)
        self._step()

    def _on_odometry(self, odometry: Odometry) -> None:
        self._odometry = odometry
        self._control.add_odometry(odometry, self.now_ns())

    def _on_speed_limit(self, msg: Any) -> None:
        """Use a limit; it remains until the next one, as nav2 sends changes only."""
        self.guarded(SPEED_LIMIT, self.inputs[SPEED_LIMIT], lambda: self._control.limit_speed(
            float(msg.speed_limit), percentage=bool(msg.percentage)))

    def _on_emergency_stop(self, engaged: bool) -> None:
        self._emergency_stop = engaged
        if engaged:
            self._end('emergency stop')

    def _on_cancel(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._end('canceled by cancel_path')
        response.message = 'stopped' if response.success else 'no path is followed'
        return response

    def _end(self, reason: str) -> bool:
        """Stop at once; return whether a path was followed, or the robot held after it."""
        if not self._control.active:
            return False
        self._control.cancel(reason)
        self._step()
        return True

    def _step(self) -> None:
        if self._goal is not None and self._goal.is_cancel_requested:
            self._control.cancel('canceled by the client of follow_path')
        command = self._control.step(self.now_ns())
        if command is not None:
            self._publish_velocity(command)
        found = self._control.state, self._control.reason
        if self._reported != found:
            self._late_host = self._host_as_reason()
        if self._server is not None:
            self._end_goals(self._server)
        self._pace()
        if self._reported != found:
            self._log_state(before=self._reported[0])
            self._reported = found
            self._send_progress()

    def _pace(self) -> None:
        """Let the timer run while there is something to do; goals of the action end with it."""
        if self._control.active:
            if self._step_timer.is_canceled():
                self._step_timer.reset()
        else:
            self._step_timer.cancel()

    def _end_goals(self, server: FollowPathServer) -> None:
        """End goals of the action that are not followed any more."""
        state = self._control.state
        if state != PathState.FOLLOWING:
            self._goal = None
        server.end_others(self._goal, state, self._control.cause, self._reason)

    def _host_as_reason(self) -> str:
        """Return that the host is late, if this explains the present state; else ''."""
        host = self.host_load
        return str(host) if host.late and self._may_be_host else ''

    @property
    def _may_be_host(self) -> bool:
        """Return whether a late host explains the state; orders are too old by seconds."""
        return self._control.state == PathState.STOPPED and self._control.cause is not Cause.ORDER

    @property
    def _reason(self) -> str:
        """Return why the path was not followed to its end: the host, if it was late."""
        return self._late_host or self._control.reason

    def _log_state(self, before: PathState) -> None:
        state, reason = self._control.state, self._reason
        if state == PathState.FOLLOWING:
            length = self._control.progress(self.now_ns()).remaining_distance
            self.get_logger().info(f'following {described(self._order, length)}')
            self._warn_without_wheels()
        elif state == PathState.ARRIVED:
            self.get_logger().info(f'arrived {self._distance_from_end():.3f} m from the end')
        elif state == PathState.STOPPED:
            self.get_logger().warning(f'stopped: {reason}')
        elif state == PathState.REFUSED and before != PathState.REFUSED:
            self.get_logger().warning(f'refused: {reason}')
        elif state == PathState.REFUSED:  # perhaps for each message of a fast publisher
            self.get_logger().warning(f'again refused: {reason}', throttle_duration_sec=LOG_PERIOD)

    def _warn_without_wheels(self) -> None:
        if not self.inputs['wheel_states'].ok:
            self.get_logger().warning('no wheel_states: odom is not compared with the motion of '
                                      'the wheels', once=True)

    def _distance_from_end(self) -> float:
        if self._order is None or self._odometry is None:
            return math.nan
        end = self._order.pose if isinstance(self._order, GoalPose) else self._order.poses[-1]
        return math.dist(end[:2], self._odometry.position[:2])

    def _send_progress(self) -> None:
        progress = self._control.progress(self.now_ns())
        self._publish_progress(progress)
        if self._server is None or self._goal is None or self._odometry is None:
            return
        if math.isfinite(progress.remaining_distance):
            self._server.send_feedback(self._goal, progress.remaining_distance,
                                       progress.cross_track_error, abs(self._odometry.linear[0]))

    def fill_status(self, status: Status) -> None:
        """Add state and progress, and why the robot does not follow."""
        state, reason = self._control.state, self._reason
        progress = self._control.progress(self.now_ns())
        status.values.update(
            state=state.name.lower(), reason=reason, cause=self._control.cause.value,
            emergency_stop=self._emergency_stop, max_speed=self._control.max_speed,
            remaining_distance=progress.remaining_distance,
            cross_track_error=progress.cross_track_error)
        if twist := self._control.twist_fault:
            status.warn(twist)
        if self._map_fault:
            status.warn(f'not used: {self._map_fault}')
        if state in (PathState.STOPPED, PathState.REFUSED):
            status.warn(f'{state.name.lower()}: {reason}',
                        by_host=self._may_be_host)


def described(order: Order | None, length: float) -> str:
    """Return what is followed, for the log; ``length`` [m] is NaN while there is no odometry."""
    text = ''
    if isinstance(order, GoalPose):
        text = f'goal_pose: x {order.pose[0]:.2f} m, y {order.pose[1]:.2f} m'
    elif order is not None:
        text = f'path: {len(order.poses)} poses' if len(order.poses) > 1 else 'path: one pose'
    return f'{text}, {length:.2f} m to drive' if math.isfinite(length) else f'{text}, without odom'


def main() -> int:
    """Run the node."""
    return run(TrajectoryController)


if __name__ == '__main__':
    sys.exit(main())
