# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
The nodes of a robot in one process, with threads of their own: ``composed [NODE ...]``.

They keep their names, parameters and diagnostics. What one of them publishes and another one
subscribes to is handed over in the process (``smart_tire.nodes.hand_over``). The nodes on which
safety depends, ``motor_driver`` and ``wheel_controller``, are processes of their own.
"""

from __future__ import annotations

from collections.abc import Callable
import sys
from typing import Any

from rclpy.logging import get_logger
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.friction_estimator import FrictionEstimatorNode
from smart_tire.nodes.hand_over import Exchange
from smart_tire.nodes.imu_driver import ImuDriver
from smart_tire.nodes.runner import EXIT_REFUSED, run
from smart_tire.nodes.slip_estimator import SlipEstimatorNode
from smart_tire.nodes.tire_receiver import TireReceiver
from smart_tire.nodes.trajectory_controller import TrajectoryController
from smart_tire.parameters.files import foreign_arguments

# In this order, since an input is handed over if its publisher has been created before:
DRIVERS: dict[str, Callable[[], SmartTireNode[Any]]] = {
    'tire_receiver': TireReceiver, 'imu_driver': ImuDriver}
NODES = {**DRIVERS, 'friction_estimator': FrictionEstimatorNode,
         'slip_estimator': SlipEstimatorNode, 'trajectory_controller': TrajectoryController}
# s until a thread that computes lets another one run; 0.005 is Python's default, and odom waits
# for several threads in turn
SWITCH_INTERVAL = 0.0005


def main() -> int:
    """Run the nodes that the command line names, all by default."""
    names = foreign_arguments(sys.argv) or list(NODES)
    if unknown := [name for name in names if name not in NODES]:
        get_logger('smart_tire').fatal(
            f'unknown arguments: {" ".join(unknown)} (nodes: {", ".join(NODES)}; ROS arguments '
            'come after --ros-args)')
        return EXIT_REFUSED
    SmartTireNode.exchange = Exchange(live=any(name in DRIVERS for name in names))
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run(*(cls for name, cls in NODES.items() if name in names), own_arguments=True)


if __name__ == '__main__':
    sys.exit(main())
