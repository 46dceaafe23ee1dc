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
Lockstep replay: estimators process their inputs in the order in which a bag recorded them.

DDS keeps the order of messages within a topic, but not between topics. Without lockstep, which
messages are late would differ between two replays, and from the offline analysis.

* The replayer (leader) publishes the recorded order on a topic of its own, in steps of 20 ms.
* An estimator (follower) holds each input until it is the next one in that order.
* After a step, a follower publishes the order of its inputs with its estimates inserted. This is
  the order for the next estimator, as one stage feeds the next one offline, and the acknowledgment
  for the leader, which is at most ``MAX_STEPS_AHEAD`` steps ahead, so that no queue overflows.
* Before the first message the leader announces the replay until every follower has answered that
  its subscriptions have matched, as seen by the subscriber: a writer may have matched a reader
  that has not matched it yet.

The topic is hidden, global like /clock, and silent except during a replay.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from itertools import chain
import json
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from smart_tire.messages import stamp_in
from smart_tire.nodes.compat import full_name, has_matched
from std_msgs.msg import String

TOPIC = '/_replay_lockstep'
CONTROL_DEPTH = 1000  # control messages; with two followers, fewer than ten are in transit
ACK_TIMEOUT = Duration(seconds=2)  # for control messages in transit at the end
MAX_STEPS_AHEAD = 2   # steps published before the first of them is acknowledged

Entry = tuple[str, int]  # topic, stamp [ns] of a message


@dataclass(frozen=True, kw_only=True)
class ControlMessage:
    """Message between leader and followers, published as JSON."""

    kind: str     # 'announce', 'plan', 'step' and 'end' of a leader; 'ready', 'step' of a follower
    sender: str   # fully qualified name of the node
    run: str      # identifies one replay
    topics: Sequence[str] = ()     # announce: replayed or published by followers; ready: the same
    inputs: Sequence[str] = ()     # ready: topics subscribed to
    outputs: Sequence[str] = ()    # ready: topics published
    unmatched: Sequence[str] = ()  # ready: inputs among ``topics`` without a matched publisher
    heard: Sequence[str] = ()      # ready: names of the other followers heard
    upstream: dict[str, str] = field(default_factory=dict)  # plan: follower -> source of its order
    number: int = 0                # step: its number
    entries: Sequence[Entry] = ()  # step: its messages in order

    @classmethod
    def read(cls, message: String) -> ControlMessage | None:
        """Return the control message in ``message``; None if it is not one."""
        try:
            control = cls(**json.loads(message.data))
            names = (control.kind, control.sender, control.run, *control.topics, *control.inputs,
                     *control.outputs, *control.unmatched, *control.heard,
                     *chain(*control.upstream.items()), *(topic for topic, _ in control.entries))
            numbers = control.number, *(stamp_ns for _, stamp_ns in control.entries)
        except (TypeError, ValueError, AttributeError, RecursionError):
            return None
        valid = (all(isinstance(name, str) for name in names)
                 and all(isinstance(number, int) for number in numbers))
        return control if valid else None

    def message(self) -> String:
        """Return this control message as a ROS message."""
        return String(data=json.dumps(asdict(self)))


class ControlChannel:
    """Publisher and subscription of a node on the lockstep topic."""

    def __init__(self, node: Node, on_control: Callable[[ControlMessage], None]) -> None:
        self.name: str = node.get_fully_qualified_name()
        self._on_control = on_control
        profile = QoSProfile(depth=CONTROL_DEPTH)
        self._publisher: Publisher[String] = node.create_publisher(String, TOPIC, profile)
        node.create_subscription(String, TOPIC, self._on_message, profile)

    def send(self, run: str, kind: str, **values: Any) -> None:
        """Publish a control message."""
        control = ControlMessage(kind=kind, sender=self.name, run=run, **values)
        self._publisher.publish(control.message())

    def flush(self) -> None:
        """Wait until all control messages are acknowledged, before the node is destroyed."""
        self._publisher.wait_for_all_acked(ACK_TIMEOUT)

    def _on_message(self, message: String) -> None:
        control = ControlMessage.read(message)
        if control is not None and control.sender != self.name:
            self._on_control(control)


@dataclass
class FollowerInput:
    """An input of a follower, with the messages that wait for their position in the order."""

    handle: Callable[[Any], None]
    waiting: deque[Any] = field(default_factory=deque)

    def take(self, stamp_ns: int) -> tuple[Any, int]:
        """Return the message of ``stamp_ns`` or None, and the number of others before it."""
        foreign = 0
        while self.waiting:
            message = self.waiting.popleft()
            if stamp_in(message) == stamp_ns:
                return message, foreign
            foreign += 1
        return None, foreign


class Follower:
    """
    Inputs of an estimator node: handled on arrival; during a replay, in recorded order.

    ``restart`` is called at the begin of a replay and ``finish`` after its last input.
    """

    def __init__(self, node: Node, restart: Callable[[], None],
                 finish: Callable[[], None] = lambda: None) -> None:
        self.foreign = 0  # messages received during replays that are not part of the bag
        self._node, self._restart, self._finish = node, restart, finish
        self._inputs: dict[str, FollowerInput] = {}
        self._outputs: list[str] = []
        self._channel = ControlChannel(node, self._on_control)
        self._reset('', '')

    @property
    def leader(self) -> str:
        """Return the name of the replayer that is followed; '' without a replay."""
        return self._leader

    def add_input(self, topic: str,
                  handle: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return the callback for ``topic``."""
        own = self._inputs[topic] = FollowerInput(handle)

        def on_message(message: Any) -> None:
            if not self._leader:
                handle(message)
            else:
                own.waiting.append(message)
                self._advance()

        return on_message

    def remove_input(self, topic: str) -> None:
        """Forget the input ``topic``, whose subscription has ended."""
        self._inputs.pop(topic, None)

    def add_output(self, topic: str) -> None:
        """Register a topic that the node publishes."""
        self._outputs.append(topic)

    def published(self, topic: str, stamp_ns: int) -> None:
        """Register a message that the node has just published."""
        if self._leader:
            self._passed_on.append((topic, stamp_ns))

    def leave_lost_leader(self) -> str:
        """End a replay whose replayer is gone; return the replayer's name, otherwise ''."""
        lost = self._leader
        if not lost or lost in map(full_name, self._node.get_publishers_info_by_topic(TOPIC)):
            return ''
        self._reset('', '')
        return lost

    def _reset(self, leader: str, run: str) -> None:
        """Start to follow ``leader``, or none if it is ''."""
        self._leader, self._run = leader, run
        self._upstream = ''
        self._steps: defaultdict[str, deque[ControlMessage]] = defaultdict(deque)  # by sender
        self._next_entry = 0  # index in the first step
        self._passed_on: list[Entry] = []
        self._heard: set[str] = set()
        for own in self._inputs.values():
            own.waiting.clear()

    def _on_control(self, control: ControlMessage) -> None:
        if control.kind == 'announce':
            self._on_announce(control)
        elif control.run != self._run:
            return
        elif control.kind == 'ready':
            self._heard.add(control.sender)
        elif control.kind == 'plan':
            self._upstream = control.upstream.get(self._channel.name, '')
            self._advance()
        elif control.kind == 'step':
            self._steps[control.sender].append(control)
            self._advance()
        elif control.kind == 'end':
            self._finish()
            self._reset('', '')

    def _on_announce(self, announced: ControlMessage) -> None:
        if not self._inputs.keys() & set(announced.topics):
            return
        if announced.run != self._run:
            self._reset(announced.sender, announced.run)
            self._restart()
        unmatched = [topic for topic in self._inputs
                     if topic in announced.topics and not has_matched(self._node, topic)]
        self._channel.send(
            self._run, 'ready', topics=announced.topics, unmatched=unmatched,
            heard=list(self._heard), inputs=list(self._inputs), outputs=self._outputs)

    def _advance(self) -> None:
        steps = self._steps[self._upstream] if self._upstream else deque()
        while steps and self._process(steps[0].entries):
            self._channel.send(self._run, 'step', number=steps[0].number,
                               entries=self._passed_on)
            steps.popleft()
            self._passed_on, self._next_entry = [], 0

    def _process(self, entries: Sequence[Entry]) -> bool:
        """Handle the received messages of a step in order; return whether it is complete."""
        while self._next_entry < len(entries):
            topic, stamp_ns = entries[self._next_entry]
            own = self._inputs.get(topic)
            if own is not None:
                message, foreign = own.take(stamp_ns)
                self.foreign += foreign
                if message is None:
                    return False
                own.handle(message)
            if topic not in self._outputs:  # outputs were added by ``published``
                self._passed_on.append((topic, stamp_ns))  # after the estimates it completed
            self._next_entry += 1
        return True


class Leader:
    """The replayer's side: its followers, whether they are ready, and their progress."""

    def __init__(self, node: Node) -> None:
        import uuid  # followers start without
        self._node = node
        self._run = uuid.uuid4().hex
        self._channel = ControlChannel(node, self._on_control)
        self._topics: list[str] = []
        self._followers: dict[str, ControlMessage] = {}  # name -> latest 'ready'
        self._upstream: dict[str, str] = {}
        self._done: dict[str, int] = {}        # name -> latest completed step

    @property
    def followers(self) -> list[str]:
        """Return the names of the nodes that answered."""
        return sorted(self._followers)

    def inputs(self) -> set[str]:
        """Return the topics that followers subscribe to, whose order matters."""
        return {topic for ready in self._followers.values() for topic in ready.inputs}

    def candidates(self) -> set[str]:
        """Return the names of all nodes in the graph that can follow."""
        return {full_name(info) for info in self._node.get_subscriptions_info_by_topic(TOPIC)
                } - {self._channel.name}

    def announce(self, topics: Sequence[str]) -> None:
        """Announce a replay of ``topics``; followers answer later."""
        estimates = {topic for ready in self._followers.values() for topic in ready.outputs}
        self._topics = sorted({*topics, *estimates})
        self._channel.send(self._run, 'announce', topics=self._topics)

    def unready(self) -> dict[str, str]:
        """Return follower -> why it is not ready."""
        reasons = {}
        for name, ready in self._followers.items():
            unheard = self._followers.keys() - {name, *ready.heard}
            if ready.unmatched:
                reasons[name] = f'has not matched the publisher of {", ".join(ready.unmatched)}'
            elif unheard:
                reasons[name] = f'has not heard from {", ".join(sorted(unheard))}'
            elif list(ready.topics) != self._topics:
                reasons[name] = 'does not answer'
        return reasons

    def begin(self) -> None:
        """Send each follower the node whose order it has to keep."""
        for name, ready in self._followers.items():
            sources = sorted(source for source, other in self._followers.items()
                             if source != name and set(ready.inputs) & set(other.outputs))
            self._upstream[name] = sources[0] if sources else self._channel.name
        self._channel.send(self._run, 'plan', upstream=self._upstream)

    def step(self, number: int, entries: Sequence[Entry]) -> None:
        """Publish the order of the step ``number``."""
        self._channel.send(self._run, 'step', number=number, entries=entries)

    def behind(self, number: int) -> list[str]:
        """Return the followers that have not completed the step ``number``."""
        return [name for name in self.followers if self._done.get(name, -1) < number]

    def end(self) -> None:
        """End the replay for all followers."""
        self._channel.send(self._run, 'end')
        self._channel.flush()

    def _on_control(self, control: ControlMessage) -> None:
        if control.run != self._run:
            return
        if control.kind == 'ready':
            self._followers[control.sender] = control
        elif control.kind == 'step':
            self._done[control.sender] = control.number
