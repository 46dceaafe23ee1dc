"""Replayer: the messages of a bag, at the pace at which they were received."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
import math
import signal
import threading
import time
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock

from smart_tire.bags import Bag, BagTopic
from smart_tire.messages import find_topic
from smart_tire.nodes.compat import message_class, new_executor
from smart_tire.nodes.lockstep import AHEAD, full_name, Leader, stamp_in
from smart_tire.nodes.qos import latched, publisher_qos
from smart_tire.samples import NS_PER_S, WHEELS

CLOCK_RATE = 100.0                  # Hz, of /clock
SLACK = 500_000                     # ns that a message may be early, to sleep less often
SETTLED = 0.5                       # s without a new subscriber: then all are there
POLL = 0.02                         # s between looks at the subscribers
SILENT = 2.0                        # s of waiting without a line that says for whom
CALL = 0.1                          # s between calls to the estimators
STEP_NS = 20_000_000                # ns of reception in one step of the lockstep, and ...
STEP_SIZE = 50                      # ... messages of a topic: three steps fit in all queues
PATIENCE = 15.0                     # s for the estimators to work off one step
LAST = Duration(seconds=2)          # what slow subscribers get at the end
DEPTH = 1000                        # of a publisher: a bag may hold long bursts

Event = tuple[int, str, bytes]      # when received [ns], topic ('': /clock), serialized message


@dataclass
class Replay:
    """What was published."""

    counts: dict[str, int] = field(default_factory=dict)    # messages by topic
    missing: dict[str, str] = field(default_factory=dict)   # topic -> type that nobody installed
    unheard: list[str] = field(default_factory=list)        # topics without subscriber at first
    failures: list[str] = field(default_factory=list)       # why no or not all estimates are right
    followers: list[str] = field(default_factory=list)      # estimators that kept the order
    complete: bool = False
    rate: float = math.nan                                  # times as fast as received


class Replayer:
    """
    Publishes topics of a bag, those whose type is installed.

    Estimators that are there take them in lockstep, in the order of reception. Nodes that are
    ``awaited`` by name, and estimators, must be ready before the first message.
    """

    def __init__(self, node: Node, bag: Bag, names: Collection[str], *, rate: float,
                 clock: bool, awaited: Collection[str], stop: threading.Event) -> None:
        self.result = Replay()
        self._node, self._bag, self._rate, self._stop = node, bag, rate, stop
        self._publishers: dict[str, Publisher[Any]] = {}
        self._clock = node.create_publisher(Clock, '/clock', 10) if clock else None
        for name in names:
            topic = bag.topics[name]
            try:
                cls = message_class(topic.channel.type)
            except (ModuleNotFoundError, AttributeError):
                self.result.missing[name] = topic.channel.type
            else:
                self._publishers[name] = node.create_publisher(cls, name, profile(topic, rate))
                self.result.counts[name] = 0
        self._topics = {name: publisher.topic_name for name, publisher in self._publishers.items()}
        self._awaited = [resolved(node, name) for name in awaited]
        self._inputs: set[str] = set()  # names in the bag of what estimators take
        self._leader = Leader(node)
        self._executor = new_executor()
        self._executor.add_node(node)

    def close(self) -> None:
        """Let the estimators go, and give the node back."""
        self._leader.end()
        self._executor.remove_node(self._node)
        self._executor.shutdown()

    def wait(self, seconds: float) -> bool:
        """
        Wait until all that are to listen do; return whether the replay may begin.

        Those are the ``awaited`` nodes and the estimators, and without names one subscriber per
        topic. A topic without any is no failure, an estimator that is not ready is one.
        """
        now = settled = called = time.monotonic()
        end, report_at, before = now + seconds, now + SILENT, -1
        while not self._stop.is_set() and (now := time.monotonic()) < end:
            matched = [publisher.get_subscription_count()
                       for publisher in self._publishers.values()]
            if sum(matched) != before:
                settled, before = now + SETTLED, sum(matched)
            elif now >= settled and (self._awaited or all(matched)) and not self._unready():
                break
            if now >= called:
                self._leader.call(list(self._topics.values()))
                called = now + CALL
            if now >= report_at and (unready := self._unready()):
                self._node.get_logger().info('waiting: ' + '; '.join(
                    f'{name} {why}' for name, why in unready.items()))
                report_at = math.inf
            self._executor.spin_once(timeout_sec=POLL)
        self.result.unheard = [name for name, publisher in self._publishers.items()
                               if not publisher.get_subscription_count()]
        if not self._stop.is_set():
            self.result.failures = [f'{name} {why}' for name, why in self._unready().items()]
        self.result.followers = self._leader.followers
        return not self._stop.is_set() and not self.result.failures

    def _unready(self) -> dict[str, str]:
        """Return node -> what keeps it from listening to all that it needs."""
        listening, followers = self._listening(), self._leader.candidates()
        found = {name: 'does not answer' for name in followers & listening.keys()
                 if name not in self._leader.followers}
        found |= self._leader.unready()
        for name in self._awaited:
            if name not in listening:
                found[name] = ('listens to none of ' + ', '.join(self._topics.values())
                               if name in self._nodes() else 'is not there')
        unmatched = self._unmatched()
        for name, topics in listening.items():
            if (name in self._awaited or name in followers) and (late := topics & unmatched):
                found.setdefault(name, f'is not matched on {", ".join(sorted(late))}')
        return found

    def _nodes(self) -> set[str]:
        return {f'{namespace.rstrip("/")}/{name}'
                for name, namespace in self._node.get_node_names_and_namespaces()}

    def _listening(self) -> dict[str, set[str]]:
        """Return node -> the replayed topics that it subscribes to."""
        found: dict[str, set[str]] = {}
        for topic in self._topics.values():
            for info in self._node.get_subscriptions_info_by_topic(topic):
                found.setdefault(full_name(info), set()).add(topic)
        return found

    def _unmatched(self) -> set[str]:
        """Return the topics of which subscribers in the graph are not matched yet."""
        return {topic for name, topic in self._topics.items()
                if self._publishers[name].get_subscription_count()
                < sum(compatible(self._publishers[name].qos_profile, info.qos_profile)
                      for info in self._node.get_subscriptions_info_by_topic(topic))}

    def play(self) -> None:
        """Publish everything, and wait until it has arrived; return early when stopped."""
        if self._leader.followers:
            self._leader.begin()
        inputs = self._leader.inputs()
        self._inputs = {name for name, topic in self._topics.items() if topic in inputs}
        start_ns, started_ns, number, bag_ns = None, time.monotonic_ns(), -1, 0
        for number, step in enumerate(self._steps()):
            if not self._lead(number, step):
                return
            for bag_ns, name, data in step:
                start_ns = bag_ns if start_ns is None else start_ns
                if not self._pace(started_ns + int((bag_ns - start_ns) / self._rate)):
                    return
                self._publish(bag_ns, name, data)
        if not self._await_step(number):
            return
        strangers = self._leader.candidates() & self._listening().keys()
        self.result.failures = [f'{name} came after the replay had begun'
                                for name in sorted(strangers - set(self._leader.followers))]
        if start_ns is not None:
            self.result.rate = (bag_ns - start_ns) / max(1, time.monotonic_ns() - started_ns)
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(LAST)
        self.result.complete = True

    def _publish(self, bag_ns: int, name: str, data: bytes) -> None:
        if name:
            self._publishers[name].publish(data)
            self.result.counts[name] += 1
        elif self._clock is not None:
            self._clock.publish(clock_message(bag_ns))

    def _pace(self, due_ns: int) -> bool:
        """Wait until it is time; return False when stopped."""
        while (left_ns := due_ns - time.monotonic_ns()) > SLACK and not self._stop.is_set():
            self._stop.wait(left_ns / NS_PER_S)
        return not self._stop.is_set()

    def _lead(self, number: int, step: list[Event]) -> bool:
        """Tell the estimators the order of a step once they have come near; False when stopped."""
        if not self._leader.followers:
            return True
        if not self._await_step(number - AHEAD):
            return False
        self._leader.step(number, [(self._topics[name], stamp_in(data))
                                   for _, name, data in step if name in self._inputs])
        return True

    def _await_step(self, number: int) -> bool:
        """Wait until the estimators have worked off a step; return False if they do not."""
        end = time.monotonic() + PATIENCE
        while behind := self._leader.behind(number):
            if self._stop.is_set():
                return False
            if gone := set(behind) - self._leader.candidates():
                self.result.failures = [f'{name} is gone' for name in sorted(gone)]
                return False
            if time.monotonic() > end:
                self.result.failures = [f'{name} did not take all messages' for name in behind]
                return False
            self._executor.spin_once(timeout_sec=POLL)
        return True

    def _steps(self) -> Iterator[list[Event]]:
        """
        Yield the messages in steps, which are never empty.

        Neither the time of reception nor that of the stamps advances by more than STEP_NS in one:
        after a recorder has stalled, much of the latter passes in little of the former, and what
        an estimator gets back from one further down must not be late by more than a few steps.
        """
        step: list[Event] = []
        sizes: Counter[str] = Counter()
        newest_ns = last_ns = 0  # stamps: now, and at the end of the step before
        for event in self._events():
            receive_ns, name, data = event
            if name in self._inputs:
                newest_ns = max(newest_ns, stamp_in(data))
            if step and (receive_ns - step[0][0] > STEP_NS or newest_ns - last_ns > STEP_NS
                         or sizes[name] == STEP_SIZE):
                yield step
                step, sizes, last_ns = [], Counter(), newest_ns
            step.append(event)
            sizes[name] += 1
        if step:
            yield step

    def _events(self) -> Iterator[Event]:
        """Yield the messages, and in between the instants for /clock, which have no name."""
        step_ns, tick_ns = int(self._rate * NS_PER_S / CLOCK_RATE), None
        for ns, channel, data in self._bag.raw(self._publishers):
            if self._clock is not None:
                tick_ns = ns if tick_ns is None else tick_ns
                while tick_ns <= ns:
                    yield tick_ns, '', b''
                    tick_ns += step_ns
            yield ns, channel.topic, data


def resolved(node: Node, name: str) -> str:
    """Return the fully qualified name of a node that may be named within the own namespace."""
    return name if name.startswith('/') else f'{node.get_namespace().rstrip("/")}/{name}'


def compatible(offered: QoSProfile, requested: QoSProfile) -> bool:
    """Return whether a reliable publisher matches a subscriber."""
    return (requested.durability != DurabilityPolicy.TRANSIENT_LOCAL
            or offered.durability == DurabilityPolicy.TRANSIENT_LOCAL)


def profile(topic: BagTopic, rate: float) -> QoSProfile:
    """Return the profile of the contract, its queue as long in time at ``rate`` and for bursts."""
    ours = find_topic(topic.channel.topic)
    if 'transient_local' in topic.channel.qos:
        transient = latched()
        transient.depth = min(max(1, topic.messages), DEPTH)
        return transient
    found = (publisher_qos(topic.channel.topic) if ours is None else
             publisher_qos(ours.name, rate=max(1.0, rate) * ours.rate, wheels=len(WHEELS)))
    found.depth = max(found.depth, DEPTH)
    return found


def clock_message(now_ns: int) -> Clock:
    """Return the message that sets /clock."""
    msg = Clock()
    msg.clock.sec, msg.clock.nanosec = divmod(now_ns, NS_PER_S)
    return msg


def replay(bag: Bag, names: Collection[str], *, rate: float = 1.0, clock: bool = False,
           wait: float = 0.0, wait_for: Collection[str] = ()) -> Replay:
    """
    Publish the topics ``names`` of ``bag``, ``rate`` times as fast as they were received.

    Begins when the nodes ``wait_for`` and all estimators are ready, or, where no nodes are named,
    when subscribers of all topics are there too, after ``wait`` [s] at the latest. Publishes
    nothing when a node or an estimator is not ready by then. Ends early at SIGINT or SIGTERM.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('replayer')
    try:
        replayer = Replayer(node, bag, names, rate=rate, clock=clock, awaited=wait_for, stop=stop)
        try:
            ready = replayer.wait(wait)
            for name in replayer.result.unheard:
                node.get_logger().warning(f'nobody listens to {name}')
            if ready:
                replayer.play()
        finally:
            replayer.close()
        return replayer.result
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
