# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The ROS graph from outside: what others publish, and checks of nodes, topics and discovery."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
import os
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_check_compatible, QoSCompatibility, QoSProfile

from smart_tire.findings import Finding, Level
from smart_tire.messages import find_topic, IMAGES, NodeStatus, statuses_from_msg, TOPICS
from smart_tire.nodes.base import NoParams, SmartTireNode
from smart_tire.nodes.command_input import without_idle
from smart_tire.nodes.compat import full_name, message_class
from smart_tire.nodes.diagnostics import InputCounter
from smart_tire.nodes.qos import latched, matches, matching_qos, requests_less, subscriber_qos
from smart_tire.samples import Sample, WHEELS
from std_msgs.msg import Bool

DISCOVERY_PERIOD = 0.3  # s between queries of the published topics
BOOL = 'std_msgs/msg/Bool'
STATES = ('emergency_stop_active', 'motors_enabled')  # of motor_driver, not in TOPICS

OnSample = Callable[[str, Sample], None]
OnStatus = Callable[[NodeStatus], None]
OnImage = Callable[[str, bytes], None]
OnMessage = Callable[[str, bytes], None]  # fully qualified topic, message in CDR
ORDERS = ('path', 'goal_pose')  # the latest one counts, whoever publishes it
OWNERS = {'motor_commands': 'wheel_controller', 'wheel_commands': 'wheel_controller'}
ENVIRONMENT = ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_LOCALHOST_ONLY',
               'ROS_STATIC_PEERS', 'RMW_IMPLEMENTATION')
DISCOVERY_TIMEOUT = 5.0  # s; usual on one host are 0.1 to 3
SLOW_DISCOVERY = 3.5     # s


class Listener(SmartTireNode[NoParams]):
    """
    Calls ``on_sample`` with the standard topic name and each sample, ``on_status`` per status.

    Subscribes to ``topics``, by default all of ``TOPICS``, and to ``/diagnostics``; with
    ``on_image``, which is called with type and content (CDR), also to the images of the overhead
    camera. Publishes ``/diagnostics``. ``inputs`` counts the messages of each topic. No
    parameters.
    """

    def __init__(self, on_sample: OnSample, on_status: OnStatus, *,
                 topics: Iterable[str] = tuple(TOPICS), on_image: OnImage | None = None,
                 name: str = 'listener') -> None:
        super().__init__(name, NoParams)
        self._on_status = on_status
        for topic in topics:
            self.subscribe(topic, partial(on_sample, topic),
                           wheels=len(WHEELS) if topic == 'tire_samples' else 1)
        if on_image is not None:
            for topic, kind in IMAGES.items():
                self._subscribe_images(topic, partial(on_image, kind), message_class(kind))
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics,
                                 subscriber_qos('/diagnostics'))

    def _subscribe_images(self, topic: str, on_data: Callable[[bytes], None], cls: Any) -> None:
        """Subscribe to serialized images of any publisher: most are to be shown by nobody."""
        counter = self.inputs[topic] = InputCounter()
        self.create_subscription(
            cls, topic, lambda data: self.guarded(topic, counter, partial(on_data, data)),
            subscriber_qos(topic, reliability='best_effort'), raw=True)

    def _on_diagnostics(self, msg: Any) -> None:
        for status in statuses_from_msg(msg):
            self._on_status(status)


class Observer(Listener):
    """
    Calls ``on_message`` for each message of the standard topics of all robots.

    Subscribes to the topics of ``TOPICS`` and ``STATES`` in all namespaces, with profiles that
    match their publishers, as they appear, and to ``/diagnostics``; publishes ``/diagnostics``.
    No parameters.
    """

    def __init__(self, on_message: OnMessage, on_status: OnStatus, *,
                 name: str = 'observer') -> None:
        super().__init__(lambda *_: None, on_status, topics=(), name=name)
        self._on_message = on_message
        self._observed: dict[str, tuple[QoSProfile, Any]] = {}

    def start(self) -> None:
        """Subscribe to the topics that exist, and look for new ones."""
        self._discover()
        self.call_every(DISCOVERY_PERIOD, self._discover)

    def _discover(self) -> None:
        for name, types in self.get_topic_names_and_types():
            topic = find_topic(name)
            if topic is not None and topic.name not in TOPICS:
                continue  # typed: the same samples again
            expected = topic.type if topic else BOOL if state_of(name) else ''
            if types == [expected]:
                self._observe(name, expected)

    def _observe(self, name: str, type_name: str) -> None:
        offers = [info.qos_profile for info in self.get_publishers_info_by_topic(name)]
        if not offers:
            return
        requested = matching_qos(name, offers)
        if name in self._observed:
            profile, subscription = self._observed[name]
            if not requests_less(requested, profile):
                return
            self.destroy_subscription(subscription)
        self._observed[name] = requested, self.create_subscription(
            message_class(type_name), name, partial(self._on_message, name), requested, raw=True)


def state_of(name: str) -> str:
    """Return which of ``STATES`` a topic is, in any namespace; '' if none."""
    last = name.rpartition('/')[2]
    return last if last in STATES else ''


@dataclass(frozen=True)
class Endpoint:
    """A publisher or subscription."""

    node: str  # fully qualified
    profile: QoSProfile


@dataclass(frozen=True)
class TopicEnds:
    """All publishers and subscriptions of a topic."""

    types: tuple[str, ...]
    publishers: tuple[Endpoint, ...]
    subscriptions: tuple[Endpoint, ...]


def middleware_findings() -> Iterator[Finding]:
    """Yield the middleware and the environment that decides which nodes find each other."""
    given = ', '.join(f'{name}={os.environ[name]}' for name in ENVIRONMENT if name in os.environ)
    yield Finding(Level.OK, 'ROS', f'{rclpy.get_rmw_implementation_identifier()}, domain '
                  f'{os.environ.get("ROS_DOMAIN_ID") or 0}' + (f' ({given})' if given else ''))


def discovery_finding(elapsed: float | None, *, late: bool) -> Finding:
    """
    Return whether two participants on this host found each other, and how long [s] it took.

    A host that is ``late`` is the reason for a long time.
    """
    if elapsed is None:
        return Finding(
            Level.ERROR, 'ROS', 'two participants on this host do not find each other within '
            f'{DISCOVERY_TIMEOUT:g} s', 'discovery over loopback',
            'enable multicast (ip link set lo multicast on), check the firewall')
    if elapsed > SLOW_DISCOVERY and not late:
        return Finding(
            Level.WARNING, 'ROS', f'discovery took {elapsed:.1f} s',
            f'at most {SLOW_DISCOVERY:g} s', 'check multicast and the load of the host')
    return Finding(Level.OK, 'ROS', f'discovery over loopback works ({elapsed:.2f} s)')


def discovery_time() -> float | None:
    """Return after how long [s] a message reaches a second participant; None if never."""
    received: list[Any] = []
    start = time.monotonic()
    contexts = [Context(), Context()]
    nodes = []
    for index, context in enumerate(contexts):
        rclpy.init(args=[], context=context)
        nodes.append(rclpy.create_node(f'doctor_{os.getpid()}_{index}', context=context,
                                       enable_rosout=False, start_parameter_services=False))
    topic = f'/_doctor_{os.getpid()}'
    nodes[0].create_publisher(Bool, topic, latched()).publish(Bool())
    nodes[1].create_subscription(Bool, topic, received.append, latched())
    executor = SingleThreadedExecutor(context=contexts[1])
    executor.add_node(nodes[1])
    while not received and time.monotonic() - start < DISCOVERY_TIMEOUT:
        executor.spin_once(timeout_sec=0.05)
    elapsed = time.monotonic() - start
    executor.shutdown()
    for node, context in zip(nodes, contexts):
        node.destroy_node()
        context.try_shutdown()
    return elapsed if received else None


def read_graph(node: Node) -> dict[str, TopicEnds]:
    """Return topic -> ends, without those of ``node`` itself and hidden topics."""
    own = node.get_fully_qualified_name()

    def ends(infos: Sequence[Any]) -> tuple[Endpoint, ...]:
        found = (Endpoint(full_name(info), info.qos_profile) for info in infos)
        return tuple(end for end in found if end.node != own)

    return {name: TopicEnds(tuple(types), ends(node.get_publishers_info_by_topic(name)),
                            ends(node.get_subscriptions_info_by_topic(name)))
            for name, types in node.get_topic_names_and_types() if '/_' not in name}


def graph_findings(graph: Mapping[str, TopicEnds], nodes: Sequence[str]) -> Iterator[Finding]:
    """Yield what is wrong in the graph."""
    counts: defaultdict[str, int] = defaultdict(int)
    for name in nodes:
        counts[name] += 1
    for name, count in counts.items():
        if count > 1:
            yield Finding(Level.ERROR, name, f'{count} nodes have this name', 'one',
                          'end one of them, or use namespaces')
    for topic, ends in sorted(graph.items()):
        yield from _command_findings(topic, ends)
        yield from _type_findings(topic, ends)
        yield from _qos_findings(topic, ends)


def _command_findings(name: str, ends: TopicEnds) -> Iterator[Finding]:
    topic = find_topic(name)
    if topic is None or topic.quality != 'command' or topic.name in ORDERS:
        return
    publishers = without_idle(topic.name, [end.node for end in ends.publishers])
    listed = ', '.join(sorted(publishers))
    if len(publishers) > 1:
        yield Finding(Level.ERROR, name, f'{len(publishers)} publishers: {listed}', 'one',
                      'the motors stop while two of them send: end one, or configure '
                      'cmd_vel_inputs')
    owner = OWNERS.get(topic.name)
    for publisher in publishers if owner else ():
        if publisher.rpartition('/')[2] != owner:
            yield Finding(Level.WARNING, name, f'is published by {publisher}', f'{owner}',
                          'end this node unless it replaces the controller')


def _type_findings(name: str, ends: TopicEnds) -> Iterator[Finding]:
    topic = find_topic(name)
    if topic is not None and ends.types != (topic.type,):
        yield Finding(Level.ERROR, name, f'has the type {" and ".join(ends.types)}', topic.type,
                      'correct the node that publishes or subscribes to it')


def _qos_findings(name: str, ends: TopicEnds) -> Iterator[Finding]:
    for publisher in ends.publishers:
        for subscription in ends.subscriptions:
            if any(matches(publisher.profile, other.profile) for other in ends.subscriptions
                   if other.node == subscription.node):
                continue  # a node may subscribe with several profiles
            verdict, reason = qos_check_compatible(publisher.profile, subscription.profile)
            if verdict == QoSCompatibility.ERROR:
                yield Finding(Level.ERROR, name, f'{subscription.node} does not receive what '
                              f'{publisher.node} sends: {reason.strip().rstrip(";")}',
                              'compatible QoS', 'set reliability: best_effort of the subscriber, '
                              'or publish reliably')
