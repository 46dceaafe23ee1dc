# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A node in a program that spins it itself: the demo, the viewer, the status screen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import sys
from typing import Any, Generic, TypeVar

import rclpy
from rclpy.signals import SignalHandlerOptions

from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.command_line import ros_arguments
from smart_tire.nodes.compat import new_executor

MAX_SPIN_TIME = 0.1  # s, of one call of the executor

Running = TypeVar('Running', bound=SmartTireNode[Any])


class NodeRunner(Generic[Running]):
    """Context manager around a node and its executor; the caller spins it."""

    def __init__(self, node_class: Callable[[], Running],
                 arguments: Sequence[str] | None = None) -> None:
        """
        Create the node; raise ParameterError for an invalid parameter.

        ``arguments`` are those of ROS, by default the command line of the process.
        """
        rclpy.init(args=ros_arguments(sys.argv) if arguments is None else list(arguments),
                   signal_handler_options=SignalHandlerOptions.NO)
        self.node = node_class()
        self._executor = new_executor()
        self._executor.add_node(self.node)

    def __enter__(self) -> NodeRunner[Running]:
        self.node.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.node.stop()
        self._executor.remove_node(self.node)
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def spin(self, seconds: float) -> None:
        """Handle callbacks for ``seconds``."""
        end_ns = self.node.steady_ns() + round(seconds * 1e9)
        while (left_ns := end_ns - self.node.steady_ns()) > 0:
            self._executor.spin_once(timeout_sec=min(MAX_SPIN_TIME, left_ns * 1e-9))
