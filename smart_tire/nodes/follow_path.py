# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Server of the action ``follow_path``, the interface to nav2's behavior trees."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from smart_tire.control.command_check import StallDetector
from smart_tire.control.trajectory_control import Cause, PathState
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.compat import action_servers
from smart_tire.nodes.diagnostics import CHECK_PERIOD
from smart_tire.samples import NS_PER_S

NAME = 'follow_path'
ERRORS = {  # of nav2_msgs/action/FollowPath. Only for the second one nav2 tries its recoveries
    Cause.LATE: 'TF_ERROR', Cause.MOTION: 'FAILED_TO_MAKE_PROGRESS',
    Cause.ORDER: 'INVALID_CONTROLLER'}  # the robot was stopped, or drives for somebody else
REPLACED = 'replaced by a newer goal or path'
ENDING_SPINS = 100  # of the executor, one event each, until results are sent at the end
Goal = Any  # rclpy's ServerGoalHandle, which is generic from Kilted on


class FollowPathServer(ActionServer):
    """
    Accepts goals, and returns their results when the node reports that they have ended.

    ``on_goal`` is called with each goal and the time [ns] for which it may have been queued. A
    goal that its client cancels is marked so. Goals are rejected while another node serves the
    action.
    """

    def __init__(self, node: SmartTireNode[Any], action: type[Any],
                 on_goal: Callable[[Goal, int], None]) -> None:
        super().__init__(node, action, NAME, lambda goal: None, goal_callback=self._check,
                         handle_accepted_callback=self._accept,
                         cancel_callback=lambda goal: CancelResponse.ACCEPT)
        self._owner, self._on_goal = node, on_goal
        self._goals: list[Goal] = []  # that have not ended
        self._stalls = StallDetector(node.steady_ns())
        node.call_every(CHECK_PERIOD, self._tick, elastic=True)

    def notify_execute(self, goal_handle: Goal, execute_callback: Any) -> None:
        """Do nothing for a goal that begins: the timer of the node follows the path."""
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)

    def _check(self, _: Any) -> GoalResponse:
        """Reject all goals while another node follows them, too: only one may drive."""
        servers = action_servers(self._owner, NAME)
        if len(servers) > 1:
            self._owner.get_logger().error(
                f'goal rejected: {len(servers)} servers of {NAME}: {", ".join(servers)}')
        return GoalResponse.REJECT if len(servers) > 1 else GoalResponse.ACCEPT

    def _accept(self, goal: Goal) -> None:
        goal.execute()
        self._goals.append(goal)
        self._tick()
        stamp = goal.request.path.header.stamp
        self._on_goal(goal, 0 if stamp.sec or stamp.nanosec else
                      self._stalls.waited_ns(self._owner.steady_ns()))

    def _tick(self) -> None:
        """Record that the process is running; a stall counts if goals may be too old after it."""
        shortest_ns = round(0.5 * self._owner.params.path_max_age * NS_PER_S)
        self._stalls.tick(self._owner.steady_ns(), shortest_ns)

    def end_others(self, followed: Goal | None, state: PathState, cause: Cause,
                   reason: str) -> None:
        """End all goals except the one that is ``followed``, for the state of the controller."""
        for goal in [goal for goal in self._goals if goal is not followed]:
            self._goals.remove(goal)
            result = self.action_type.Result()
            if state == PathState.ARRIVED:
                self.notify_execute(goal, returning(result, goal.succeed))
            elif goal.is_cancel_requested:
                self.notify_execute(goal, returning(result, goal.canceled))
            else:
                if state == PathState.FOLLOWING:
                    cause, reason = Cause.ORDER, REPLACED
                name = ('INVALID_PATH' if (state, cause) == (PathState.REFUSED, Cause.ORDER)
                        else ERRORS[cause])
                fill(result, error_code=getattr(result, name, 0), error_msg=reason)
                self.notify_execute(goal, returning(result, goal.abort))

    def send_feedback(self, goal: Goal, distance: float, cross_track: float, speed: float) -> None:
        """Send the distance to the end along the path [m], that to the path, and speed [m/s]."""
        feedback = self.action_type.Feedback()
        fill(getattr(feedback, 'tracking_feedback', feedback),  # after Kilted
             distance_to_goal=distance, remaining_path_length=distance, speed=speed,
             position_tracking_error=cross_track)
        goal.publish_feedback(feedback)

    def close(self) -> None:
        """Send the results of goals that ended last; the executor is not spun any more."""
        for _ in range(ENDING_SPINS):
            if self._owner.executor is not None:
                self._owner.executor.spin_once(timeout_sec=0.0)


def returning(result: Any, end: Callable[[], None]) -> Callable[[Goal], Any]:
    """Return a callback that changes the state of a goal by ``end`` and returns ``result``."""
    def finish(_: Goal) -> Any:
        end()
        return result

    return finish


def fill(msg: Any, **values: Any) -> None:
    """Set the fields of ``msg`` that this distribution of nav2 has."""
    for name, value in values.items():
        if hasattr(msg, name):
            setattr(msg, name, value)
