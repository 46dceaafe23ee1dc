# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A node of the test in the ROS graph, and nodes of this package as processes."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from itertools import count
import math
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.qos import publisher_qos, subscriber_qos
from support.waiting import PATIENCE, wait_for

REPEAT = 5.0  # s, after which a service that does not answer is called again


def node_arguments(name: str) -> list[str]:
    """Return Python's arguments for a node of this package; ROS arguments may follow."""
    return ['-m', f'smart_tire.nodes.{name}', '--ros-args']


class Process:
    """Context manager of a Python process; kills it by its id at the end."""

    def __init__(self, arguments: list[str], log: Path) -> None:
        self._log = log
        with log.open('wb') as output:
            self.popen = subprocess.Popen(
                [sys.executable, *arguments], stdout=output, stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL)

    def __enter__(self) -> Process:
        return self

    def __exit__(self, *_: object) -> None:
        if self.popen.poll() is None:
            self.popen.kill()
            self.popen.wait()

    @property
    def output(self) -> str:
        """Return what the process has printed."""
        return self._log.read_text(errors='replace')

    def ended(self) -> int:
        """Wait until the process ends; return its exit status."""
        return self.popen.wait(PATIENCE)

    def end(self, *signals: signal.Signals) -> int:
        """Send ``signals`` (SIGINT if none are given) and return the exit status."""
        for number in signals or (signal.SIGINT,):
            self.popen.send_signal(number)
        return self.ended()


class Graph:
    """Context manager of a node that subscribes, publishes and calls in the test's thread."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._numbers = folder, count()
        self._context = Context()
        rclpy.init(args=[], context=self._context)
        self.node = rclpy.create_node('test', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._publishers: dict[str, Any] = {}
        self.received: defaultdict[str, list[Any]] = defaultdict(list)  # topic -> messages
        self.health: dict[str, Any] = {}  # status name -> latest DiagnosticStatus
        self.node.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, 100)

    def __enter__(self) -> Graph:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.shutdown()

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            self.health[status.name] = status

    def spin(self, timeout: float = 0.02) -> None:
        """Handle one callback, if one is ready within ``timeout`` [s]."""
        self._executor.spin_once(timeout_sec=timeout)

    def until(self, condition: Callable[[], object],
              do: Callable[[], object] = lambda: None) -> None:
        """Spin until ``condition`` is true, calling ``do`` before each callback."""
        wait_for(condition, lambda: (do(), self.spin()))

    def start(self, name: str, *, namespace: str = '/', **parameters: Any) -> Process:
        """Start a node with parameters; a double underscore stands for the dot of a name."""
        arguments = [word for key, value in parameters.items()
                     for word in ('-p', f'{key.replace("__", ".")}:={value}')]
        return Process([*node_arguments(name), '-r', f'__ns:={namespace}', *arguments],
                       self._folder / f'{name}.{next(self._numbers)}.log')

    def subscribe(self, *names: str) -> None:
        """Collect the messages of topics of ``TOPICS`` in ``received``."""
        for name in names:
            self.node.create_subscription(
                message_class(TOPICS[name].type), name, self.received[name].append,
                subscriber_qos(name, wheels=4))

    def has_publishers(self) -> bool:
        """Return whether every subscribed topic has a publisher."""
        return all(map(self.node.count_publishers, self.received))

    def samples(self, name: str, last: int = 0) -> list[Any]:
        """Return the samples in the messages received on a topic, or in the ``last`` of them."""
        return [TOPICS[name].from_msg(message) for message in self.received[name][-last:]]

    def publish(self, name: str, *samples: Any) -> None:
        """Publish samples on a topic of ``TOPICS``, once it has a subscription."""
        for sample in samples:
            topic = TOPICS[name]
            self.publish_message(name, topic.to_msg(message_class(topic.type)(), sample))

    def publish_as(self, name: str, topic_name: str, sample: Any) -> None:
        """Publish a sample of the topic ``topic_name`` under the name ``name``."""
        topic = TOPICS[topic_name]
        self.publish_message(name, topic.to_msg(message_class(topic.type)(), sample))

    def publish_message(self, name: str, message: Any) -> None:
        """Publish a message, valid or not."""
        self.connect(name, type(message))
        self._publishers[name].publish(message)

    def connect(self, name: str, cls: type[Any], readers: int = 1) -> None:
        """Create a publisher; return when ``readers`` subscriptions have matched it."""
        if name not in self._publishers:
            publisher = self.node.create_publisher(cls, name, publisher_qos(name, wheels=4))
            self._publishers[name] = publisher
            self.until(lambda: publisher.get_subscription_count() >= readers)

    def call(self, type_name: str, name: str, **fields: Any) -> Any:
        """Call a service, again if there is no answer, and return the response."""
        service = message_class(type_name)
        client = self.node.create_client(service, name)
        self.until(client.service_is_ready)
        futures: list[Any] = []

        def answered() -> bool:
            # a server that was killed stays in the graph, and one that is started may be
            # discovered before it has discovered the client
            if time.monotonic() > self._asked + REPEAT:
                self._asked = time.monotonic()
                futures.append(client.call_async(service.Request(**fields)))
            return any(future.done() for future in futures)

        self._asked = -math.inf
        self.until(answered)
        return next(future.result() for future in futures if future.done())

    def set_parameter(self, node: str, name: str, value: bool | float) -> bool:
        """Set a parameter as ``ros2 param set`` does; return whether the node accepts it."""
        made = ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=value) \
            if isinstance(value, bool) \
            else ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
        (result,) = self.call('rcl_interfaces/srv/SetParameters', f'{node}/set_parameters',
                              parameters=[Parameter(name=name, value=made)]).results
        return result.successful

    def value(self, node: str, key: str) -> str:
        """Return the value of ``key`` in the diagnostics of ``node``, '' if there is none."""
        values = {item.key: item.value for item in self.health[node].values} \
            if node in self.health else {}
        return values.get(key, '')

    def status_message(self, node: str) -> str:
        """Return the message of the diagnostics of ``node``, '' if there is none."""
        return self.health[node].message if node in self.health else ''
