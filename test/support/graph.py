"""The test's own place in the ROS graph, and the processes of this package beside it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from support.waiting import PATIENCE, wait_for

from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.qos import publisher_qos, subscriber_qos


def node_arguments(name: str) -> list[str]:
    """Return Python's arguments for a node of this package; ROS arguments may follow."""
    return ['-m', f'smart_tire.nodes.{name}', '--ros-args']


class Process:
    """Python in a process of its own; a context that ends it by its id."""

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
        """Return the exit status when the process has ended by itself."""
        return self.popen.wait(PATIENCE)

    def end(self, *signals: signal.Signals) -> int:
        """Send ``signals`` (SIGINT if none are given) and return the exit status."""
        for number in signals or (signal.SIGINT,):
            self.popen.send_signal(number)
        return self.ended()


class Graph:
    """A node that listens, publishes and calls in the test's thread; a context."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._context = Context()
        rclpy.init(args=[], context=self._context)
        self.node = rclpy.create_node('test', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._publishers: dict[str, Any] = {}
        self.heard: defaultdict[str, list[Any]] = defaultdict(list)  # topic -> messages
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

    def turn(self, longest: float = 0.02) -> None:
        """Handle what comes next, within ``longest`` [s]."""
        self._executor.spin_once(timeout_sec=longest)

    def until(self, condition: Callable[[], object],
              do: Callable[[], object] = lambda: None) -> None:
        """Handle what comes until ``condition`` is true, and ``do`` something all the time."""
        wait_for(condition, lambda: (do(), self.turn()))

    def start(self, name: str, **parameters: Any) -> Process:
        """Start a node with parameters; a double underscore stands for the dot of a name."""
        files = [part for key, value in parameters.items()
                 for part in ('-p', f'{key.replace("__", ".")}:={value}')]
        return Process([*node_arguments(name), *files], self._folder / f'{name}.log')

    def listen(self, *names: str) -> None:
        """Collect the messages of topics of the contract in ``heard``."""
        for name in names:
            self.node.create_subscription(
                message_class(TOPICS[name].type), name, self.heard[name].append,
                subscriber_qos(name, wheels=4))

    def is_fed(self) -> bool:
        """Return whether somebody publishes everything that is listened to."""
        return all(map(self.node.count_publishers, self.heard))

    def samples(self, name: str) -> list[Any]:
        """Return what has been heard on a topic, decoded."""
        return [TOPICS[name].decode(message) for message in self.heard[name]]

    def say(self, name: str, *samples: Any) -> None:
        """Publish samples on a topic of the contract, once somebody listens."""
        for sample in samples:
            topic = TOPICS[name]
            self.say_message(name, topic.fill(message_class(topic.type)(), sample))

    def say_on(self, name: str, topic_name: str, sample: Any) -> None:
        """Publish a sample of a topic of the contract under another name."""
        topic = TOPICS[topic_name]
        self.say_message(name, topic.fill(message_class(topic.type)(), sample))

    def say_message(self, name: str, message: Any) -> None:
        """Publish a message, be it good or bad."""
        self.connect(name, type(message))
        self._publishers[name].publish(message)

    def connect(self, name: str, cls: type[Any], readers: int = 1) -> None:
        """Prepare to publish on a topic: return when so many listen to it."""
        if name not in self._publishers:
            publisher = self.node.create_publisher(cls, name, publisher_qos(name, wheels=4))
            self._publishers[name] = publisher
            self.until(lambda: publisher.get_subscription_count() >= readers)

    def call(self, type_name: str, name: str, **fields: Any) -> Any:
        """Call a service and return its response."""
        service = message_class(type_name)
        client = self.node.create_client(service, name)
        self.until(client.service_is_ready)
        future = client.call_async(service.Request(**fields))
        self.until(future.done)
        return future.result()

    def value(self, node: str, key: str) -> str:
        """Return what the diagnostics of ``node`` say of ``key``, '' before they do."""
        values = {item.key: item.value for item in self.health[node].values} \
            if node in self.health else {}
        return values.get(key, '')

    def complaint(self, node: str) -> str:
        """Return the sentence of the diagnostics of ``node``."""
        return self.health[node].message if node in self.health else ''
