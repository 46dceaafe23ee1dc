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
A node in the test process whose messages, timers, log and clocks are those of the test.

Nothing is sent over DDS and nothing waits: a time limit is reached at once, exactly, on any
machine. Parameters, conversions, callbacks and timers are those of the node that ships.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, MutableSequence, Sequence
from contextlib import AbstractContextManager, contextmanager
from copy import deepcopy
from functools import partial
import inspect
import sys
import time
from types import SimpleNamespace
from typing import Any

import pytest
import rclpy
from rclpy.serialization import deserialize_message, serialize_message
from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.qos import publisher_qos
from smart_tire.samples import NS_PER_S
from support.waiting import wait_for

EPOCH_NS, BOOT_NS = 1_700_000_000 * NS_PER_S, 5_000 * NS_PER_S  # clocks at the start of a node
VIRTUAL_PATIENCE_NS = 60 * NS_PER_S
TEST = b'test'  # identifies the publisher of the messages


class Log:
    """Logger that keeps its lines; all levels but information are named in them."""

    def __init__(self, clock: Callable[[], int]) -> None:
        self.lines: list[str] = []
        self._clock, self._once, self._again_ns = clock, set[str](), 0

    def info(self, text: str, *, once: bool = False, throttle_duration_sec: float = 0.0) -> None:
        """Add a line."""
        if throttle_duration_sec:
            if self._clock() < self._again_ns:
                return
            self._again_ns = self._clock() + round(throttle_duration_sec * NS_PER_S)
        if not once or text not in self._once:
            self._once.add(text)
            self.lines.append(text)

    def warning(self, text: str, **options: Any) -> None:
        """Add a line that names the level."""
        self.info(f'warning: {text}', **options)

    def error(self, text: str, **options: Any) -> None:
        """Add a line that names the level."""
        self.info(f'error: {text}', **options)

    def get_child(self, _: str) -> Log:
        """Return this log."""
        return self


class Messages(MutableSequence[Any]):
    """Messages, which are deserialized when a test looks at them: most are never looked at."""

    def __init__(self) -> None:
        self._kept: list[Any] = []  # messages, or the arguments of deserialize_message

    def __len__(self) -> int:
        return len(self._kept)

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, slice):
            return [self[k] for k in range(*key.indices(len(self)))]
        if isinstance(self._kept[key], tuple):
            self._kept[key] = deserialize_message(*self._kept[key])
        return self._kept[key]

    def __setitem__(self, key: Any, value: Any) -> None:
        self._kept[key] = value

    def __delitem__(self, key: Any) -> None:
        del self._kept[key]

    def __eq__(self, other: object) -> bool:
        return list(self) == other

    def insert(self, index: int, value: Any) -> None:
        """Insert a message."""
        self._kept.insert(index, value)


class VirtualNode:
    """
    What replaces the connections of a node, in front of its class.

    ``received`` holds topic -> messages of the node, ``times`` when they were sent [s]. Names are
    those that the node uses. The graph is ``publishers_of``: topic -> identifiers and nodes of
    publishers, and ``types_of``: topic -> type of their messages, if it is another one;
    ``subscribers`` counts those of a topic, none unless the test says so.
    """

    def __init__(self, *given: Any) -> None:
        self.elapsed_ns, self.waited = 0, 0.0    # s, for a core
        self.log = Log(self.steady_ns)
        self.received: defaultdict[str, Messages] = defaultdict(Messages)
        self.times: defaultdict[str, list[float]] = defaultdict(list)
        self.open: list[Any] = []                # publishers
        self.profiles: dict[str, Any] = {}       # of topics and services
        self.failures: dict[str, list[Exception]] = defaultdict(list)  # topic -> when published
        self.publishers_of: dict[str, dict[bytes, str]] = {}
        self.types_of: dict[str, str] = {}
        self.subscribers: Counter[str] = Counter()
        self._readers: defaultdict[str, list[tuple[Callable[..., None], bool]]] = defaultdict(list)
        self._answers: dict[str, tuple[type[Any], Callable[[Any, Any], Any]]] = {}
        self._number = 0
        super().__init__(*given)

    def now_ns(self) -> int:
        """Return the time for message stamps."""
        return EPOCH_NS + self.elapsed_ns

    def steady_ns(self) -> int:
        """Return the steady time, which has another origin."""
        return BOOT_NS + self.elapsed_ns

    def get_logger(self) -> Any:
        """Return the log."""
        return self.log

    def create_publisher(self, cls: type[Any], name: str, profile: Any) -> Any:
        """Return an object that keeps the messages with their times, or fails."""
        self.profiles[name] = profile

        def publish(message: Any) -> None:
            if self.failures[name]:
                raise self.failures[name].pop()
            if isinstance(message, SimpleNamespace):  # of a type that is not installed
                kept: Any = deepcopy(message)         # it may be used again
            else:
                kept = (message, cls) if isinstance(message, bytes) else (
                    serialize_message(message), type(message))
            self.received[name].append(kept)
            self.times[name].append(self.elapsed_ns / NS_PER_S)

        self.open.append(SimpleNamespace(
            publish=publish, topic_name=self.resolve_topic_name(name),
            get_subscription_count=lambda: self.subscribers[name]))
        return self.open[-1]

    @property
    def publishers(self) -> Iterator[Any]:
        """Return the publishers."""
        return iter(self.open)

    def destroy_publisher(self, publisher: Any) -> bool:
        """Forget a publisher."""
        self.open.remove(publisher)
        return True

    def create_subscription(self, cls: type[Any], name: str, callback: Callable[..., None],
                            profile: Any, *, raw: bool = False, **_: Any) -> Any:
        """Keep the callback."""
        reader = callback, raw
        self._readers[name].append(reader)
        self.profiles[name] = profile
        return SimpleNamespace(name=name, reader=reader)

    def destroy_subscription(self, subscription: Any) -> bool:
        """Forget the callback."""
        self._readers[subscription.name].remove(subscription.reader)
        return True

    def create_service(self, service: type[Any], name: str, callback: Callable[[Any, Any], Any],
                       qos_profile: Any = None) -> None:
        """Keep the callback."""
        self.profiles[name] = qos_profile
        self._answers[name] = service, callback

    def count_publishers(self, name: str) -> int:
        """Return the number of publishers in the graph."""
        return len(self.publishers_of.get(name, ()))

    def get_publishers_info_by_topic(self, name: str) -> list[Any]:
        """Return the publishers in the graph."""
        return [SimpleNamespace(endpoint_gid=gid, node_name=node, node_namespace='/',
                                qos_profile=publisher_qos('cmd_vel'),  # volatile
                                topic_type=self.types_of.get(name) or TOPICS[name].type)
                for gid, node in self.publishers_of.get(name, {}).items()]

    def receives(self, name: str) -> bool:
        """Return whether the node subscribes to a topic."""
        return bool(self._readers[name])

    def run(self, seconds: float, until: Callable[[], object] = lambda: False) -> None:
        """Let time pass, calling the timers that are due, or until a condition is true."""
        end_ns = self.steady_ns() + round(seconds * NS_PER_S)
        while not until() and (due_ns := self.loop_timers.due_ns) <= end_ns:
            self.elapsed_ns = max(due_ns - BOOT_NS, self.elapsed_ns)
            self.loop_timers.handle()
        if not until():
            self.elapsed_ns = end_ns - BOOT_NS

    def until(self, condition: Callable[[], object],
              do: Callable[[], object] = lambda: None) -> None:
        """Let time pass until a condition is true, with ``do`` each millisecond."""
        end_ns = self.elapsed_ns + VIRTUAL_PATIENCE_NS
        while not condition():
            assert self.elapsed_ns < end_ns, f'still not true: {condition}'
            do()
            self.run(0.001)

    def stall(self, seconds: float) -> None:
        """Let time pass while the process does not run."""
        self.elapsed_ns += round(seconds * NS_PER_S)

    def starve(self, seconds: float) -> None:
        """Let time pass while the process waits for a core."""
        self.waited += seconds
        self.stall(seconds)

    def publish(self, name: str, *samples: Any, topic: str = '', publisher: bytes = TEST,
                sent: float = 0.0) -> None:
        """
        Hand samples, or messages, serialized or not, to the subscriptions.

        They were ``sent`` [s] ago; ``topic`` is their topic in ``TOPICS`` if it is not ``name``.
        """
        given = TOPICS.get(topic or name)
        for sample in samples:
            self._number += 1
            message = sample
            if not isinstance(sample, bytes) and not hasattr(sample, 'get_fields_and_field_types'):
                message = given.to_msg(message_class(given.type)(), sample)
            info = {'source_timestamp': self.now_ns() - round(sent * NS_PER_S),
                    'received_timestamp': self.now_ns(), 'publisher_gid': {'data': publisher},
                    'publication_sequence_number': self._number}
            for callback, raw in list(self._readers[name]):
                data = serialize_message(message) if raw and not isinstance(
                    message, bytes) else message
                callback(*(data, info)[:len(inspect.signature(callback).parameters)])
            self.loop_timers.handle()

    def call(self, name: str, **fields: Any) -> Any:
        """Call a service and return its response."""
        service, callback = self._answers[name]
        return callback(service.Request(**fields), service.Response())

    def set_parameter(self, name: str, value: Any) -> bool:
        """Set a parameter; return whether the node accepts it."""
        return bool(self.set_parameters([rclpy.parameter.Parameter(name, value=value)])
                    [0].successful)

    def samples(self, name: str) -> list[Any]:
        """Return the samples in the messages sent on a topic."""
        return [TOPICS[name].from_msg(message) for message in self.received[name]]

    def latest(self, name: str) -> Any:
        """Return the latest sample sent on a topic."""
        return TOPICS[name].from_msg(self.received[name][-1])

    def health(self) -> Any:
        """Return the present DiagnosticStatus, with its values as a dictionary."""
        status = self.status().message('')
        return SimpleNamespace(level=status.level, message=status.message,
                               values={item.key: item.value for item in status.values})


class LocalNode(VirtualNode):
    """The same in real time, for nodes whose threads read ports."""

    def now_ns(self) -> int:
        """Return the time for message stamps."""
        return time.time_ns()

    def steady_ns(self) -> int:
        """Return the steady time."""
        return time.monotonic_ns()

    def until(self, condition: Callable[[], object],
              do: Callable[[], object] = lambda: None) -> None:
        """Call the timers that are due, and ``do``, until a condition is true."""
        def work() -> None:
            do()
            self.loop_timers.handle()
            time.sleep(0.005)

        wait_for(condition, work)


@contextmanager
def _running(base: type[VirtualNode], node_class: Callable[..., Any], words: Sequence[str],
             parameters: Mapping[str, Any]) -> Iterator[Any]:
    arguments = ['--ros-args', *words, *(
        word for key, value in parameters.items()
        for word in ('-p', f'{key.replace("__", ".")}:={value}'))]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, 'argv', ['node', *arguments])
        rclpy.init(args=arguments)
        try:
            given = node_class.args if isinstance(node_class, partial) else ()
            kind = getattr(node_class, 'func', node_class)
            node: Any = type('Node', (base, kind), {})(*given)
            if base is VirtualNode:
                patch.setattr(time, 'time_ns', node.now_ns)
            patch.setattr(node._timer_lateness, '_waited', lambda: node.waited)
            node.start()
            try:
                yield node
            finally:
                node.stop()
            node.destroy_node()
        finally:
            rclpy.try_shutdown()


def virtual(node_class: Callable[..., Any], *words: str,
            **parameters: Any) -> AbstractContextManager[Any]:
    """
    Return the context of a node with ROS arguments and parameters, which override those in files.

    A double underscore stands for the dot of a parameter's name.
    """
    return _running(VirtualNode, node_class, words, parameters)


def local(node_class: Callable[..., Any], *words: str,
          **parameters: Any) -> AbstractContextManager[Any]:
    """Return the same in real time."""
    return _running(LocalNode, node_class, words, parameters)
