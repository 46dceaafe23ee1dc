"""
Lockstep of a replay: the estimators take their inputs in the order in which a bag recorded them.

DDS keeps the order of messages within a topic, but not between topics, so what is late differs
from one replay to the next, and from the offline analysis. Therefore a replayer (the leader)
publishes the recorded order, in steps of some 20 ms, on a topic of its own. An estimator (a
follower) holds each input until it is the next one of that order. When it has worked off a step it
publishes the order of what it passes on, its estimates among its inputs: the order for the next
estimator, exactly as one stage feeds the next one offline, and the acknowledgement for the leader,
which never is more than ``AHEAD`` steps ahead, so that no queue overruns at any rate.

Before the first message the leader calls and each follower answers which of its subscriptions have
matched as the subscriber sees it, for a writer may have matched a reader that has not matched it
yet. The topic is hidden, global as /clock is, and silent except during a replay.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
import json
import struct
from typing import Any
import uuid

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from smart_tire.nodes.compat import has_matched
from smart_tire.samples import NS_PER_S

TOPIC = '/_replay_lockstep'
DEPTH = 1000  # notes; a leader that is AHEAD of two followers has less than ten on the way
LAST = Duration(seconds=2)  # for what is on the way at the end
UNKNOWN = '_NODE_NAME_UNKNOWN_'  # rmw's name of a node of which only an endpoint is discovered
AHEAD = 2     # steps that are published before the first of them is acknowledged

Entry = tuple[str, int]  # topic, stamp [ns] of a message


@dataclass(frozen=True, kw_only=True)
class Note:
    """What leader and followers publish, as JSON."""

    kind: str     # 'call', 'plan', 'step' and 'end' of a leader; 'ready' and 'step' of a follower
    sender: str   # fully qualified name of the node
    run: str      # identifies one replay
    topics: Sequence[str] = ()     # call: replayed, or published by followers; ready: the same
    inputs: Sequence[str] = ()     # ready: subscribed to
    feedback: Sequence[str] = ()   # ready: of these, those that a node further down publishes
    outputs: Sequence[str] = ()    # ready: published
    unmatched: Sequence[str] = ()  # ready: of ``topics``, inputs without a matched publisher
    heard: Sequence[str] = ()      # ready: names of the other followers that were heard
    upstream: dict[str, str] = field(default_factory=dict)  # plan: follower -> whose order it uses
    number: int = 0                     # of the step
    entries: Sequence[Entry] = ()       # of the step: the messages in order

    @classmethod
    def read(cls, message: String) -> Note | None:
        """Return the note in ``message``; None for what is not one."""
        try:
            return cls(**json.loads(message.data))
        except (TypeError, ValueError):
            return None

    def message(self) -> String:
        """Return the note as a message."""
        return String(data=json.dumps(asdict(self)))


class Link:
    """A node's publisher and subscription on the topic of the lockstep."""

    def __init__(self, node: Node, on_note: Callable[[Note], None]) -> None:
        self.name: str = node.get_fully_qualified_name()
        self._on_note = on_note
        profile = QoSProfile(depth=DEPTH)
        self._publisher: Publisher[String] = node.create_publisher(String, TOPIC, profile)
        node.create_subscription(String, TOPIC, self._on_message, profile)

    def send(self, run: str, kind: str, **values: Any) -> None:
        """Publish a note."""
        note = Note(kind=kind, sender=self.name, run=run, **values)
        self._publisher.publish(note.message())

    def flush(self) -> None:
        """Wait until all that was sent has arrived, before the node is destroyed."""
        self._publisher.wait_for_all_acked(LAST)

    def _on_message(self, message: String) -> None:
        note = Note.read(message)
        if note is not None and note.sender != self.name:
            self._on_note(note)


@dataclass
class Input:
    """An input of a follower, and its messages that are not yet the next ones."""

    handle: Callable[[Any], None]
    feedback: bool
    waiting: deque[Any] = field(default_factory=deque)

    def take(self, stamp_ns: int) -> tuple[Any, int]:
        """Return the message of ``stamp_ns`` or None, and how many others were in front."""
        foreign = 0
        while self.waiting:
            message = self.waiting.popleft()
            if stamp_of(message) == stamp_ns:
                return message, foreign
            foreign += 1
        return None, foreign


class Follower:
    """The inputs of an estimator node: at once as a rule, in recorded order during a replay."""

    def __init__(self, node: Node, restart: Callable[[], None]) -> None:
        self.foreign = 0  # messages during replays that no bag has
        self._node, self._restart = node, restart
        self._inputs: dict[str, Input] = {}
        self._outputs: list[str] = []
        self._link = Link(node, self._on_note)
        self._enter('', '')

    @property
    def leader(self) -> str:
        """Return the name of the replayer that is followed; '' without a replay."""
        return self._leader

    def add_input(self, topic: str, handle: Callable[[Any], None],
                  feedback: bool = False) -> Callable[[Any], None]:
        """Return the callback for ``topic``; ``feedback`` comes from a node further down."""
        given = self._inputs[topic] = Input(handle, feedback)

        def on_message(message: Any) -> None:
            if not self._leader:
                handle(message)
            else:
                given.waiting.append(message)
                self._advance()

        return on_message

    def add_output(self, topic: str) -> None:
        """Note that the node publishes ``topic``."""
        self._outputs.append(topic)

    def published(self, topic: str, stamp_ns: int) -> None:
        """Note that the node has just published."""
        if self._leader:
            self._passed.append((topic, stamp_ns))

    def abandon(self) -> str:
        """Leave a replay whose replayer has vanished and return that one's name, '' as a rule."""
        gone = self._leader
        if not gone or gone in map(full_name, self._node.get_publishers_info_by_topic(TOPIC)):
            return ''
        self._enter('', '')
        return gone

    def _enter(self, leader: str, run: str) -> None:
        self._leader, self._run = leader, run
        self._upstream = ''
        self._steps: defaultdict[str, deque[Note]] = defaultdict(deque)  # by sender
        self._next = 0  # entry of the first step
        self._passed: list[Entry] = []
        self._heard: set[str] = set()
        for given in self._inputs.values():
            given.waiting.clear()

    def _on_note(self, note: Note) -> None:
        if note.kind == 'call':
            self._on_call(note)
        elif note.run != self._run:
            return
        elif note.kind == 'ready':
            self._heard.add(note.sender)
        elif note.kind == 'plan':
            self._upstream = note.upstream.get(self._link.name, '')
            self._advance()
        elif note.kind == 'step':
            self._steps[note.sender].append(note)
            self._advance()
        elif note.kind == 'end':
            self._enter('', '')

    def _on_call(self, call: Note) -> None:
        if not self._inputs.keys() & set(call.topics):
            return
        if call.run != self._run:
            self._enter(call.sender, call.run)
            self._restart()
        unmatched = [topic for topic in self._inputs
                     if topic in call.topics and not has_matched(self._node, topic)]
        self._link.send(
            self._run, 'ready', topics=call.topics, unmatched=unmatched, heard=list(self._heard),
            inputs=list(self._inputs), outputs=self._outputs,
            feedback=[topic for topic, given in self._inputs.items() if given.feedback])

    def _advance(self) -> None:
        steps = self._steps[self._upstream] if self._upstream else deque()
        while steps and self._work_off(steps[0].entries):
            self._link.send(self._run, 'step', number=steps[0].number, entries=self._passed)
            steps.popleft()
            self._passed, self._next = [], 0

    def _work_off(self, entries: Sequence[Entry]) -> bool:
        """Handle what has come of a step; return whether that was all of it."""
        while self._next < len(entries):
            topic, stamp_ns = entries[self._next]
            given = self._inputs.get(topic)
            if given is not None:
                message, foreign = given.take(stamp_ns)
                self.foreign += foreign
                if message is None:
                    return False
                given.handle(message)
            if topic not in self._outputs:  # else it was passed on when it was published
                self._passed.append((topic, stamp_ns))  # behind what it made the node publish
            self._next += 1
        return True


class Leader:
    """The replayer's side: who follows, who is ready, and which steps all have worked off."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._run = uuid.uuid4().hex
        self._link = Link(node, self._on_note)
        self._topics: list[str] = []
        self._followers: dict[str, Note] = {}  # name -> latest 'ready'
        self._upstream: dict[str, str] = {}
        self._done: dict[str, int] = {}        # name -> last step that was worked off
        self._feedback: defaultdict[int, list[Entry]] = defaultdict(list)  # step -> made by it

    @property
    def followers(self) -> list[str]:
        """Return the names of all that answered."""
        return sorted(self._followers)

    def inputs(self) -> set[str]:
        """Return the topics whose order matters."""
        return {topic for ready in self._followers.values() for topic in ready.inputs}

    def candidates(self) -> set[str]:
        """Return the names of all nodes in the graph that can follow."""
        return {full_name(info) for info in self._node.get_subscriptions_info_by_topic(TOPIC)
                } - {self._link.name}

    def call(self, topics: Sequence[str]) -> None:
        """Call all that listen to ``topics``; their answers come later."""
        made = {topic for ready in self._followers.values() for topic in ready.outputs}
        self._topics = sorted({*topics, *made})
        self._link.send(self._run, 'call', topics=self._topics)

    def unready(self) -> dict[str, str]:
        """Return follower -> what it still waits for."""
        found = {}
        for name, ready in self._followers.items():
            unheard = self._followers.keys() - {name, *ready.heard}
            if ready.unmatched:
                found[name] = f'has not matched the publisher of {", ".join(ready.unmatched)}'
            elif unheard:
                found[name] = f'has not heard {", ".join(sorted(unheard))}'
            elif list(ready.topics) != self._topics:
                found[name] = 'does not answer'
        return found

    def begin(self) -> None:
        """Tell each follower whose order it has to keep."""
        for name, ready in self._followers.items():
            wanted = set(ready.inputs) - set(ready.feedback)
            makers = sorted(maker for maker, other in self._followers.items()
                            if maker != name and wanted & set(other.outputs))
            self._upstream[name] = makers[0] if makers else self._link.name
        self._link.send(self._run, 'plan', upstream=self._upstream)

    def step(self, number: int, entries: Sequence[Entry]) -> None:
        """
        Publish the order of the step ``number``.

        In front is what came back from step ``number - AHEAD``: at the same place each time.
        """
        self._link.send(self._run, 'step', number=number,
                        entries=[*self._feedback.pop(number - AHEAD, []), *entries])

    def behind(self, number: int) -> list[str]:
        """Return the followers that have not yet worked off the step ``number``."""
        return [name for name in self.followers if self._done.get(name, -1) < number]

    def end(self) -> None:
        """Let the followers go."""
        self._link.send(self._run, 'end')
        self._link.flush()

    def _on_note(self, note: Note) -> None:
        if note.run != self._run:
            return
        if note.kind == 'ready':
            self._followers[note.sender] = note
        elif note.kind == 'step':
            self._done[note.sender] = note.number
            ready, wanted = self._followers[note.sender], {
                topic for other in self._followers.values() for topic in other.feedback}
            self._feedback[note.number] += [
                (topic, stamp_ns) for topic, stamp_ns in note.entries
                if topic in ready.outputs and topic in wanted]


def full_name(info: Any) -> str:
    """Return the fully qualified name of the node of an endpoint in the graph."""
    if info.node_name == UNKNOWN:
        return 'a node whose name is not known yet'
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def stamp_of(message: Any) -> int:
    """Return the stamp [ns] in the header of ``message``."""
    stamp = message.header.stamp
    return int(stamp.sec * NS_PER_S + stamp.nanosec)


def stamp_in(data: bytes) -> int:
    """Return the stamp [ns] in the header with which a serialized message begins, 0 if cut off."""
    if len(data) < 12:
        return 0
    sec, nanosec = struct.unpack_from('<iI' if data[1] & 1 else '>iI', data, 4)
    return int(sec * NS_PER_S + nanosec)
