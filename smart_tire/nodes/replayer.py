# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Node ``replayer``: publishes messages of a bag at the pace at which they were received."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
import math
import signal
import sys
import threading
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock

from smart_tire.bags import Bag
from smart_tire.drivers.clock import Clock as HostClock, SYSTEM
from smart_tire.messages import find_topic, stamp_in
from smart_tire.nodes.compat import full_name, installed_class, new_executor, node_names
from smart_tire.nodes.lockstep import Leader, MAX_STEPS_AHEAD
from smart_tire.nodes.qos import matches, replayer_qos
from smart_tire.parameters.files import ros_arguments
from smart_tire.samples import NS_PER_S

CLOCK_RATE = 100.0                  # Hz, of /clock
PACING_TOLERANCE_NS = 500_000       # ns that a message may be early: fewer, longer sleeps
MATCHING_SETTLE_TIME = 0.5          # s without a new subscription until matching is complete
POLL_PERIOD = 0.02                  # s between checks of the subscriptions
WAIT_LOG_DELAY = 2.0                # s of waiting until a line names what is waited for
WAIT_LOG_PERIOD = 5.0               # s between these lines
ANNOUNCE_PERIOD = 0.1               # s between announcements to the estimators
MAX_STEP_NS = 20_000_000            # ns of reception time in one step of the lockstep
MAX_TOPIC_MESSAGES = 50             # of one topic in a step: three steps fit into all queues
PROGRESS_PERIOD = 0.5               # s between reports of the progress
STEP_TIMEOUT = 15.0                 # s for the estimators to complete a step
ACK_TIMEOUT = Duration(seconds=2)   # for subscribers to acknowledge the last messages

Progress = Callable[[float], None]  # s since the start of the bag
Event = tuple[int, str, bytes]      # time of reception [ns], topic ('': /clock), message


@dataclass
class Replay:
    """Result of a replay."""

    counts: dict[str, int] = field(default_factory=dict)    # topic -> messages published
    missing: dict[str, str] = field(default_factory=dict)   # topic -> type that is not installed
    unsubscribed: list[str] = field(default_factory=list)   # topics without subscribers at start
    failures: list[str] = field(default_factory=list)       # why estimates are missing or differ
    followers: list[str] = field(default_factory=list)      # estimators in lockstep
    complete: bool = False
    rate: float = math.nan                                  # multiple of the recorded rate


class Replayer:
    """
    Publishes those topics ``names`` of ``bag`` whose type is installed, as ``renamed``.

    Estimators in the graph process them in lockstep, in order of reception. They and the nodes
    ``awaited`` must be ready before the first message. Publishes ``/clock`` if ``clock`` is true.
    ``on_progress`` is called every PROGRESS_PERIOD while messages are published. All times are
    those of ``host``.
    """

    def __init__(self, node: Node, bag: Bag, names: Collection[str], *, rate: float,
                 clock: bool, awaited: Collection[str], stop: threading.Event,
                 renamed: Mapping[str, str], on_progress: Progress | None = None,
                 host: HostClock = SYSTEM) -> None:
        self.result = Replay()
        self._host = host
        self._on_progress, self._report_at = on_progress, 0.0
        self._next_ns = 0               # reception time of the next message
        self._first_ns, self._started_ns = 0, 0  # that of the first one, and when it was sent
        self._node, self._bag, self._rate, self._stop = node, bag, rate, stop
        self._publishers: dict[str, Publisher[Any]] = {}
        self._renamed = renamed
        self._clock = node.create_publisher(Clock, '/clock', 10) if clock else None
        for name in names:
            topic, published = bag.topics[name], renamed.get(name, name)
            ours = find_topic(renamed.get(name, ''))
            type_name = topic.channel.type if ours is None else ours.type
            cls = installed_class(type_name)
            if cls is None:
                self.result.missing[name] = type_name
            else:
                self._publishers[name] = node.create_publisher(
                    cls, published, replayer_qos(published, topic.channel, topic.messages, rate))
                self.result.counts[name] = 0
        self._topics = {name: publisher.topic_name for name, publisher in self._publishers.items()}
        self._awaited = [resolved(node, name) for name in awaited]
        self._inputs: set[str] = set()  # topics in the bag that estimators subscribe to
        self._leader = Leader(node)
        self._executor = new_executor()
        self._executor.add_node(node)

    def close(self) -> None:
        """End the replay for the estimators and release the node."""
        self._leader.end()
        self._executor.remove_node(self._node)
        self._executor.shutdown()

    def wait(self, seconds: float) -> bool:
        """
        Wait at most ``seconds`` until all nodes are ready; return whether the replay may begin.

        Waits for the ``awaited`` nodes and the estimators; if no nodes are named, also for one
        subscription per topic. A topic without subscriptions is not a failure; an estimator that
        is not ready is one.
        """
        now = settled = announce_at = self._now()
        end, report_at, before = now + seconds, now + WAIT_LOG_DELAY, -1
        while not self._stop.is_set() and (now := self._now()) < end:
            matched = [publisher.get_subscription_count()
                       for publisher in self._publishers.values()]
            if sum(matched) != before:
                settled, before = now + MATCHING_SETTLE_TIME, sum(matched)
            elif now >= settled and (self._awaited or all(matched)) and not self._unready_nodes():
                break
            if now >= announce_at:
                self._leader.announce(list(self._topics.values()))
                announce_at = now + ANNOUNCE_PERIOD
            if now >= report_at and (reasons := self._waiting_reasons()):
                self._node.get_logger().info(f'waiting: {"; ".join(reasons)}')
                report_at = now + WAIT_LOG_PERIOD
            self._executor.spin_once(timeout_sec=POLL_PERIOD)
        self.result.unsubscribed = [name for name, publisher in self._publishers.items()
                                    if not publisher.get_subscription_count()]
        if not self._stop.is_set():
            self.result.failures = [f'{name} {why}' for name, why in self._unready_nodes().items()]
        self.result.followers = self._leader.followers
        return not self._stop.is_set() and not self.result.failures

    def _waiting_reasons(self) -> list[str]:
        """Return what the replay waits for, in words."""
        return [f'{name} {why}' for name, why in self._unready_nodes().items()] or [
            f'{self._topics[name]} has no subscribers'
            for name, publisher in self._publishers.items()
            if not self._awaited and not publisher.get_subscription_count()]

    def _unready_nodes(self) -> dict[str, str]:
        """Return node -> why it is not ready."""
        subscribers, followers = self._subscribers_of_replay(), self._leader.candidates()
        reasons = {name: 'does not answer' for name in followers & subscribers.keys()
                   if name not in self._leader.followers}
        reasons |= self._leader.unready()
        for name in self._awaited:
            if name not in subscribers:
                reasons[name] = ('subscribes to none of ' + ', '.join(self._topics.values())
                                 if name in node_names(self._node) else 'is not running')
        unmatched = self._unmatched_topics()
        for name, topics in subscribers.items():
            if (name in self._awaited or name in followers) and (late := topics & unmatched):
                reasons.setdefault(name, f'is not matched on {", ".join(sorted(late))}')
        return reasons

    def _subscribers_of_replay(self) -> dict[str, set[str]]:
        """Return node -> replayed topics that it subscribes to."""
        found: dict[str, set[str]] = {}
        for topic in self._topics.values():
            for info in self._node.get_subscriptions_info_by_topic(topic):
                found.setdefault(full_name(info), set()).add(topic)
        return found

    def _unmatched_topics(self) -> set[str]:
        """Return the topics with subscriptions in the graph that are not matched yet."""
        return {topic for name, topic in self._topics.items()
                if self._publishers[name].get_subscription_count()
                < sum(matches(self._publishers[name].qos_profile, info.qos_profile)
                      for info in self._node.get_subscriptions_info_by_topic(topic))}

    def play(self) -> None:
        """Publish all messages and wait for their acknowledgment; return early if stopped."""
        if self._leader.followers:
            self._leader.begin()
        inputs = self._leader.inputs()
        self._inputs = {name for name, topic in self._topics.items() if topic in inputs}
        start_ns, started_ns, number, bag_ns = None, self._host.now_ns(), -1, 0
        for number, step in enumerate(self._steps()):
            if not self._send_step(number, step):
                return
            for bag_ns, name, data in step:
                if start_ns is None:  # the time to read the bag until here does not count
                    start_ns = self._first_ns = bag_ns
                    started_ns = self._started_ns = self._host.now_ns()
                self._next_ns = bag_ns
                if not self._sleep_until(started_ns + int((bag_ns - start_ns) / self._rate)):
                    return
                self._publish(bag_ns, name, data)
        if not self._await_step(number):
            return
        estimators = self._leader.candidates() & self._subscribers_of_replay().keys()
        self.result.failures = [f'{name} started after the replay had begun'
                                for name in sorted(estimators - set(self._leader.followers))]
        if start_ns is not None and (elapsed_ns := self._host.now_ns() - started_ns):
            self.result.rate = (bag_ns - start_ns) / elapsed_ns
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(ACK_TIMEOUT)
        self.result.complete = True

    def _now(self) -> float:
        """Return the steady time [s]."""
        return self._host.now_ns() / NS_PER_S

    def _publish(self, bag_ns: int, name: str, data: bytes) -> None:
        if name:
            self._publishers[name].publish(data)
            self.result.counts[name] += 1
        elif self._clock is not None:
            self._clock.publish(clock_message(bag_ns))

    def _sleep_until(self, due_ns: int) -> bool:
        """Sleep until ``due_ns`` (steady time); return False if stopped."""
        while (not self._stop.is_set()
               and (left_ns := due_ns - self._host.now_ns()) > PACING_TOLERANCE_NS):
            self._host.wait(self._stop, min(PROGRESS_PERIOD, left_ns / NS_PER_S))
            self._report()
        self._report()
        return not self._stop.is_set()

    def _report(self) -> None:
        """Report the position: that of the next message, or less while it is not due."""
        now = self._now()
        if self._on_progress is None or not self._started_ns or now < self._report_at:
            return
        self._report_at = now + PROGRESS_PERIOD
        due_ns = self._first_ns + (self._host.now_ns() - self._started_ns) * self._rate
        self._on_progress((min(self._next_ns, due_ns) - self._bag.span_ns[0]) / NS_PER_S)

    def _send_step(self, number: int, step: list[Event]) -> bool:
        """Send a step's order once the estimators are near enough; return False if stopped."""
        if not self._leader.followers:
            return True
        if not self._await_step(number - MAX_STEPS_AHEAD):
            return False
        self._leader.step(number, [(self._topics[name], stamp_in(data))
                                   for _, name, data in step if name in self._inputs])
        return True

    def _await_step(self, number: int) -> bool:
        """Wait until the estimators have completed a step; return False if they do not."""
        end = self._now() + STEP_TIMEOUT
        while behind := self._leader.behind(number):
            if self._stop.is_set():
                return False
            if gone := set(behind) - self._leader.candidates():
                self.result.failures = [f'{name} ended during the replay'
                                        for name in sorted(gone)]
                return False
            if self._now() > end:
                self.result.failures = [f'{name} did not process all messages'
                                        for name in behind]
                return False
            self._executor.spin_once(timeout_sec=POLL_PERIOD)
            self._report()
        return True

    def _steps(self) -> Iterator[list[Event]]:
        """Yield the messages in steps of ``MAX_STEP_NS`` of reception time, none of them empty."""
        step: list[Event] = []
        sizes: Counter[str] = Counter()
        for event in self._events():
            receive_ns, name, _ = event
            if step and (receive_ns - step[0][0] > MAX_STEP_NS
                         or sizes[name] == MAX_TOPIC_MESSAGES):
                yield step
                step, sizes = [], Counter()
            step.append(event)
            sizes[name] += 1
        if step:
            yield step

    def _events(self) -> Iterator[Event]:
        """Yield the messages and, between them, the instants of /clock with topic ''."""
        step_ns, tick_ns = int(self._rate * NS_PER_S / CLOCK_RATE), None
        for ns, channel, data in self._bag.replayable(self._publishers, self._renamed):
            if self._clock is not None:
                tick_ns = ns if tick_ns is None else tick_ns
                while tick_ns <= ns:
                    yield tick_ns, '', b''
                    tick_ns += step_ns
            yield ns, channel.topic, data


def resolved(node: Node, name: str) -> str:
    """Return the fully qualified name of a node; a relative name is in the own namespace."""
    return name if name.startswith('/') else f'{node.get_namespace().rstrip("/")}/{name}'


def clock_message(now_ns: int) -> Clock:
    """Return the message for /clock."""
    msg = Clock()
    msg.clock.sec, msg.clock.nanosec = divmod(now_ns, NS_PER_S)
    return msg


def replay(bag: Bag, names: Collection[str], *, rate: float, clock: bool, wait: float,
           wait_for: Collection[str], renamed: Mapping[str, str],
           on_progress: Progress) -> Replay:
    """
    Publish the topics ``names`` of ``bag`` at ``rate`` times the recorded rate.

    ``renamed`` are names in the bag of topics that are published with other names.
    Begins when the nodes ``wait_for`` and all estimators are ready and, if no nodes are named,
    all topics have subscriptions, but after ``wait`` [s] at the latest. Publishes nothing if a
    node or an estimator is not ready by then. Ends early on SIGINT or SIGTERM. ``on_progress`` is
    called with the position in the bag [s].
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    rclpy.init(args=ros_arguments(sys.argv), signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('replayer')  # with shared memory, for images
    try:
        replayer = Replayer(node, bag, names, rate=rate, clock=clock, awaited=wait_for, stop=stop,
                            renamed=renamed, on_progress=on_progress)
        try:
            ready = replayer.wait(wait)
            for name in replayer.result.unsubscribed:
                node.get_logger().warning(f'no subscribers on {name}')
            if ready:
                replayer.play()
        finally:
            replayer.close()
        return replayer.result
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
