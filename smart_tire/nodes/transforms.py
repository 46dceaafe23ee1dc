# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Paths and goals in frames to which /tf connects ``odom``, where tf2_msgs is installed."""

from __future__ import annotations

import cmath
from dataclasses import dataclass, replace
from functools import partial
import math
from typing import Any

from smart_tire.control.command_check import check_age
from smart_tire.errors import CommandError, LateCommandError
from smart_tire.messages import stamp_of, transform_from_msg
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.compat import installed_class
from smart_tire.nodes.diagnostics import InputCounter
from smart_tire.nodes.qos import latched, publisher_qos
from smart_tire.samples import GoalPose, PlannedPath, Vector3

STATIC_DEPTH = 100  # messages of /tf_static, which has many publishers
MAX_FRAMES = 1000   # that are remembered: names from the network must not fill the memory
Order = PlannedPath | GoalPose


@dataclass(frozen=True, slots=True)
class Link:
    """Latest transform of a frame, in the plane: complex numbers are x + iy."""

    parent: str
    place: complex   # m, origin of the frame in its parent
    turn: complex    # exp(i yaw) of the frame in its parent; NaN if it is tilted
    stamp_ns: int    # 0: static
    received_ns: int  # steady clock


class Transforms:
    """
    Converts orders to the frame in which the robot is controlled, once, when they arrive.

    Subscribes to ``/tf`` and ``/tf_static``. Frames that move with the robot are refused.
    """

    def __init__(self, node: SmartTireNode[Any]) -> None:
        self._node, self._links = node, dict[str, Link]()
        cls = installed_class('tf2_msgs/msg/TFMessage')
        self._is_available = cls is not None
        if cls is None:
            return
        static = latched()
        static.depth = STATIC_DEPTH
        for name, profile in (('/tf', publisher_qos('/tf')), ('/tf_static', static)):
            node.inputs[name] = InputCounter()
            node.create_subscription(cls, name, partial(self.add, name), profile)

    def add(self, name: str, msg: Any) -> None:
        """Remember the transforms in a message of the topic ``name``."""
        counter = self._node.inputs[name]
        for item in msg.transforms:
            self._node.guarded(name, counter, partial(
                self._add_one, item, static=name == '/tf_static'))

    def _add_one(self, item: Any, *, static: bool) -> None:
        x, y, yaw = transform_from_msg(item)
        if item.child_frame_id in self._links or len(self._links) < MAX_FRAMES:
            self._links[item.child_frame_id] = Link(
                item.header.frame_id, complex(x, y), cmath.exp(1j * yaw),
                0 if static else max(stamp_of(item), 1), self._node.steady_ns())

    def in_frame(self, frame: str, name: str, order: Order, max_age: float) -> Order:
        """
        Return ``order``, of the topic ``name``, in ``frame``.

        Raises LateCommandError if no transforms connect them that are at most ``max_age`` [s] old,
        and CommandError if the frame of the order moves with the robot, or is tilted.
        """
        if order.frame in ('', frame) or not self._is_available:
            return order
        given, wanted = self._ancestors(order.frame), self._ancestors(frame)
        expected = f'{name}: frame {order.frame!r}, expected {frame}'
        if frame in given:
            raise CommandError(f'{expected} or a frame that does not move with the robot')
        common = next((item for item in wanted if item in given), None)
        if common is None:
            raise LateCommandError(f'{expected}: /tf does not connect them')
        (place, turn), (origin, yaw) = (self._pose_in(common, item, max_age)
                                        for item in (order.frame, frame))
        if cmath.isnan(turn * yaw):
            raise CommandError(f'{expected}: one of the frames between them is tilted')
        offset, turn = (place - origin) / yaw, turn / yaw

        def converted(pose: Vector3) -> Vector3:
            point = offset + turn * complex(*pose[:2])
            return point.real, point.imag, math.remainder(pose[2] + cmath.phase(turn), math.tau)

        if isinstance(order, GoalPose):
            return replace(order, frame=frame, pose=converted(order.pose))
        return replace(order, frame=frame, poses=tuple(map(converted, order.poses)))

    def _ancestors(self, frame: str) -> list[str]:
        """Return ``frame``, its parent, and so on; a loop ends the list."""
        found = [frame]
        while (link := self._links.get(found[-1])) and link.parent not in found:
            found.append(link.parent)
        return found

    def _pose_in(self, ancestor: str, frame: str, max_age: float) -> tuple[complex, complex]:
        """Return origin [m] and exp(i yaw) of ``frame`` in ``ancestor``."""
        place, turn = 0j, 1 + 0j
        while frame != ancestor:
            link = self._links[frame]
            if link.stamp_ns:
                check_age(f'/tf from {link.parent} to {frame}', link.stamp_ns,
                          self._node.now_ns(), self._node.steady_ns() - link.received_ns, max_age)
            place, turn = link.place + link.turn * place, link.turn * turn
            frame = link.parent
        return place, turn
