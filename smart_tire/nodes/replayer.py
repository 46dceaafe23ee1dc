"""Replayer: the messages of a bag, at the pace at which they were received."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
import signal
import threading
import time
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock

from smart_tire.bags import Bag, BagTopic
from smart_tire.messages import find_topic
from smart_tire.nodes.qos import latched, publisher_qos
from smart_tire.nodes.ros import message_class
from smart_tire.samples import NS_PER_S, WHEELS

CLOCK_RATE = 100.0                  # Hz, of /clock
SLACK = 500_000                     # ns that a message may be early, to sleep less often
SETTLED = 0.5                       # s without a new subscriber: then all are there
POLL = 0.02                         # s between looks at the subscribers
LAST = Duration(seconds=2)          # what slow subscribers get at the end
LATCHED_DEPTH = 1000                # transforms of all publishers that a bag may have in one


@dataclass
class Replay:
    """What was published."""

    counts: dict[str, int] = field(default_factory=dict)    # messages by topic
    missing: dict[str, str] = field(default_factory=dict)   # topic -> type that nobody installed
    unheard: list[str] = field(default_factory=list)        # topics without subscriber at first
    complete: bool = False


class Replayer:
    """Publishes topics of a bag, those whose type is installed."""

    def __init__(self, node: Node, bag: Bag, names: Collection[str], *, rate: float,
                 clock: bool, stop: threading.Event) -> None:
        self.result = Replay()
        self._bag, self._rate, self._stop = bag, rate, stop
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

    def wait(self, seconds: float) -> None:
        """Wait until subscribers of all topics are there and no more come, or it gets late."""
        now = settled = time.monotonic()
        end, before = now + seconds, -1
        while not self._stop.is_set() and (now := time.monotonic()) < end:
            matched = [publisher.get_subscription_count()
                       for publisher in self._publishers.values()]
            if sum(matched) != before:
                settled, before = now + SETTLED, sum(matched)
            elif all(matched) and now >= settled:
                break
            self._stop.wait(POLL)
        self.result.unheard = [name for name, publisher in self._publishers.items()
                               if not publisher.get_subscription_count()]

    def play(self) -> None:
        """Publish everything, and wait until it has arrived; return early when stopped."""
        counts, start_ns, started_ns = self.result.counts, None, time.monotonic_ns()
        for bag_ns, name, data in self._events():
            start_ns = bag_ns if start_ns is None else start_ns
            due_ns = started_ns + int((bag_ns - start_ns) / self._rate)
            while (left_ns := due_ns - time.monotonic_ns()) > SLACK and not self._stop.is_set():
                self._stop.wait(left_ns / NS_PER_S)
            if self._stop.is_set():
                return
            if name:
                self._publishers[name].publish(data)
                counts[name] += 1
            elif self._clock is not None:
                self._clock.publish(clock_message(bag_ns))
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(LAST)
        self.result.complete = True

    def _events(self) -> Iterator[tuple[int, str, bytes]]:
        """Yield the messages, and in between the instants for /clock, which have no name."""
        step_ns, tick_ns = int(self._rate * NS_PER_S / CLOCK_RATE), None
        for ns, channel, data in self._bag.raw(self._publishers):
            if self._clock is not None:
                tick_ns = ns if tick_ns is None else tick_ns
                while tick_ns <= ns:
                    yield tick_ns, '', b''
                    tick_ns += step_ns
            yield ns, channel.topic, data


def profile(topic: BagTopic, rate: float) -> QoSProfile:
    """Return the profile of the contract, its queue as long in time at ``rate``."""
    ours = find_topic(topic.channel.topic)
    if 'transient_local' in topic.channel.qos:
        transient = latched()
        transient.depth = min(max(1, topic.messages), LATCHED_DEPTH)
        return transient
    if ours is None:
        return publisher_qos(topic.channel.topic)
    return publisher_qos(ours.name, rate=max(1.0, rate) * ours.rate, wheels=len(WHEELS))


def clock_message(now_ns: int) -> Clock:
    """Return the message that sets /clock."""
    msg = Clock()
    msg.clock.sec, msg.clock.nanosec = divmod(now_ns, NS_PER_S)
    return msg


def replay(bag: Bag, names: Collection[str], *, rate: float = 1.0, clock: bool = False,
           wait: float = 0.0) -> Replay:
    """
    Publish the topics ``names`` of ``bag``, ``rate`` times as fast as they were received.

    Begins when subscribers of all of them are there, after ``wait`` [s] at the latest; ends
    early at SIGINT or SIGTERM.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('replayer')
    try:
        replayer = Replayer(node, bag, names, rate=rate, clock=clock, stop=stop)
        replayer.wait(wait)
        for name in replayer.result.unheard:
            node.get_logger().warning(f'nobody listens to {name}')
        replayer.play()
        return replayer.result
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
