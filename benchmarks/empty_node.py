# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A node with rclpy and numpy that only publishes its state: the floor of ``benchmarks.start``."""

from importlib import import_module

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor

PERIOD = 1.0  # s, as that of the diagnostics of all nodes


def main() -> None:
    """Publish one status a second until SIGINT or SIGTERM."""
    rclpy.init()
    node = rclpy.create_node('empty_node')
    publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
    status = DiagnosticStatus(name=node.get_name(), message=f'numpy {np.__version__}')
    message = DiagnosticArray(status=[status])
    node.create_timer(PERIOD, lambda: publisher.publish(message))
    try:
        executor = import_module('rclpy.experimental').EventsExecutor()
    except ModuleNotFoundError:  # before Kilted
        executor = SingleThreadedExecutor()
    executor.add_node(node)
    while rclpy.ok():
        executor.spin_once(timeout_sec=PERIOD)  # ``spin`` does not notice signals


if __name__ == '__main__':
    main()
