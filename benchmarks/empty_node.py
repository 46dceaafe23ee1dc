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
A node with rclpy and numpy that only publishes its state: the floor of ``benchmarks.start``.

With a file of topics (``exchange``) and a name it also publishes and receives messages, as bytes
that it does not look at: the floor of ``benchmarks.load``.
"""

from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

PERIOD = 1.0  # s, as that of the diagnostics of all nodes


def main() -> None:
    """Publish one status a second, and other messages if asked, until SIGINT or SIGTERM."""
    rclpy.init()
    node = rclpy.create_node(sys.argv[2] if len(sys.argv) > 2 else 'empty_node')
    publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
    status = DiagnosticStatus(name=node.get_name(), message=f'numpy {np.__version__}')
    message = DiagnosticArray(status=[status])
    node.create_timer(PERIOD, lambda: publisher.publish(message))
    for file in sys.argv[1:2]:
        import json  # no part of the floor of a start
        exchange(node, json.loads(Path(file).read_text(encoding='utf-8')))
    try:
        executor = import_module('rclpy.experimental').EventsExecutor()
    except ModuleNotFoundError:  # before Kilted
        executor = SingleThreadedExecutor()
    executor.add_node(node)
    while rclpy.ok():
        executor.spin_once(timeout_sec=PERIOD)  # ``spin`` does not notice signals


def exchange(node: Node, messages: dict[str, Any]) -> None:
    """
    Subscribe to ``received`` topics and publish the ``published`` ones.

    Both are lists of topic, type and depth of the queue, the latter with rate [Hz], messages per
    period and a message as hexadecimal digits. One timer serves all topics of a rate.
    """
    from smart_tire.nodes.compat import message_class  # no part of the floor of a start
    for topic, kind, depth in messages['received']:
        node.create_subscription(message_class(kind), topic, lambda _: None, depth, raw=True)
    by_rate: dict[float, list[Callable[[], None]]] = {}
    for topic, kind, depth, rate, count, digits in messages['published']:
        publish = node.create_publisher(message_class(kind), topic, depth).publish
        by_rate.setdefault(rate, []).extend([partial(publish, bytes.fromhex(digits))] * count)
    for rate, functions in by_rate.items():
        node.create_timer(1.0 / rate, partial(call_all, functions))


def call_all(functions: Sequence[Callable[[], None]]) -> None:
    """Call ``functions`` in order."""
    for one in functions:
        one()


if __name__ == '__main__':
    main()
