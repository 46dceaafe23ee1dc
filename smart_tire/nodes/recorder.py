"""Recorder: every topic, with the bytes as they come, into a bag that survives its end."""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Mapping
from dataclasses import dataclass
import os
from pathlib import Path
import time
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from smart_tire.bags import BagWriter, channel_of, Qos
from smart_tire.messages import find_topic
from smart_tire.nodes.base import run, SmartTireNode
from smart_tire.nodes.compat import message_class, with_info
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.qos import subscriber_qos
from smart_tire.samples import WHEELS

LOOK = 0.2           # s between looks at what is published
FLUSH = 0.25         # s between chunks, half of what a crash may cost
DISCOVERY_NS = 2_000_000_000  # ns from the start, in which publishers are found that were there
MIN_DEPTH = 100      # messages kept of any topic: a bag wants every command, not the newest
OTHER_DEPTH = 1000   # messages kept of a topic that is not ours while the disk is busy


class SequenceGaps:
    """
    Counts messages of a topic that its publishers sent but that never came.

    By the sequence numbers of the publishers, for the event ``message_lost`` of DDS does not occur
    where a queue of the subscriber overruns. ``missed`` are the first ones of publishers that are
    not among ``old``, sent before they and the subscriber were connected; with None they do not
    count. What was sent after the last message that came is not known.
    """

    def __init__(self, old: Container[bytes] | None = None) -> None:
        self.lost = self.missed = 0
        self.reported = 0  # of both, at the last report
        self._old = old
        self._last: dict[bytes, int] = {}  # publisher -> newest sequence number

    def add(self, info: Mapping[str, Any]) -> bool:
        """Take a message in; return whether losses have reached 1, 2, 4, 8 ... with it."""
        number = info.get('publication_sequence_number')
        if number is None:  # older distributions, and middlewares that do not number
            return False
        publisher, before = bytes(info['publisher_gid']['data']), self.lost + self.missed
        last = self._last.get(publisher)
        if last is not None:
            self.lost += max(0, number - last - 1)
        elif self._old is not None and publisher not in self._old:
            self.missed += number - 1
        self._last[publisher] = max(last or 0, number)
        return before.bit_length() < (self.lost + self.missed).bit_length()

    def newly_lost(self) -> int:
        """Return how many were lost or missed since this was last asked."""
        total = self.lost + self.missed
        new, self.reported = total - self.reported, total
        return new

    def __str__(self) -> str:
        if self.missed and self.lost:
            return f'the first {self.missed} and {self.lost} later'
        return f'the first {self.missed}' if self.missed else str(self.lost)


@dataclass(frozen=True, kw_only=True)
class RecorderParams:
    """The recorder takes what it needs from its command line."""


class Recorder(SmartTireNode[RecorderParams]):
    """Subscribes to what is published and writes it down."""

    def __init__(self, writer: BagWriter, topics: Collection[str] = ()) -> None:
        super().__init__('recorder', RecorderParams)
        self._writer = writer
        self._names = {self.resolve_topic_name(topic) for topic in topics}
        self._taken: dict[str, tuple[QoSProfile, Any]] = {}
        self._refused: set[str] = set()
        self._old: set[bytes] = set()  # publishers that were there before
        self._old_until_ns = self.steady_ns() + DISCOVERY_NS
        self._gaps: dict[str, SequenceGaps] = {}

    @property
    def losses(self) -> list[str]:
        """Return a line for each topic of which messages were published but did not come."""
        return [f'lost {gaps} messages of {name}' for name, gaps in sorted(self._gaps.items())
                if gaps.lost or gaps.missed]

    def start(self) -> None:
        """Begin with what is there, and go on looking."""
        self._look()
        self.every(LOOK, self._look)
        self.every(FLUSH, self._writer.flush)

    def fill_status(self, status: Status) -> None:
        """Add how much has been written and how much was lost."""
        counts = self._writer.counts
        status.values['topics'] = len(counts)
        status.values['messages'] = sum(counts.values())
        lost = {name: gaps.lost + gaps.missed for name, gaps in self._gaps.items()}
        status.values['messages_lost'] = sum(lost.values())
        for name, gaps in self._gaps.items():
            if lost[name]:
                status.values[f'{name}.messages_lost'] = lost[name]
            if new := gaps.newly_lost():
                status.warn(f'lost {new} messages of {name}')
        for name in sorted(self._names - counts.keys()):
            status.warn(f'no {name}')

    def _look(self) -> None:
        for name, types in self.get_topic_names_and_types():
            if self._names and name not in self._names:
                continue
            if not self._names and '/_' in name:  # hidden, as the events of services
                continue
            if len(types) == 1:
                self._take(name, types[0])
            else:
                self._refuse(name, f'has several types: {", ".join(types)}')

    def _take(self, name: str, type_name: str) -> None:
        publishers = self.get_publishers_info_by_topic(name)
        if self.steady_ns() < self._old_until_ns:
            self._old.update(bytes(info.endpoint_gid) for info in publishers)
        offers = [info.qos_profile for info in publishers]
        if not offers or name in self._refused:
            return
        wanted = adapted(name, offers)
        if name in self._taken:
            profile, subscription = self._taken[name]
            if not weaker(wanted, profile):
                return
            self.destroy_subscription(subscription)
        else:
            try:
                message_class(type_name)
            except (ModuleNotFoundError, AttributeError):
                self._refuse(name, f'is {type_name}, which is not installed')
                return
            self._writer.add_topic(channel_of(name, type_name, tuple(map(offered, offers))))
            self.get_logger().info(f'recording {name}')
        self._taken[name] = wanted, self.create_subscription(
            message_class(type_name), name, with_info(self._keeper(name, wanted)), wanted,
            raw=True)

    def _keeper(self, name: str,
                profile: QoSProfile) -> Callable[[Any, Mapping[str, Any]], None]:
        latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        gaps = self._gaps.setdefault(name, SequenceGaps(None if latched else self._old))
        write, now_ns = self._writer.write, time.time_ns

        def keep(data: bytes, info: Mapping[str, Any]) -> None:
            write(name, now_ns(), data)
            if gaps.add(info):
                self.get_logger().warning(f'lost {gaps} messages of {name} so far')

        return keep

    def _refuse(self, name: str, reason: str) -> None:
        if name not in self._refused:
            self._refused.add(name)
            self.get_logger().warning(f'{name} {reason}: not recorded')


def adapted(name: str, offers: list[QoSProfile]) -> QoSProfile:
    """Return the most that a subscriber may ask of all publishers that made ``offers``."""
    topic = find_topic(name)
    profile = (QoSProfile(depth=OTHER_DEPTH) if topic is None
               else subscriber_qos(topic.name, wheels=len(WHEELS)))
    profile.depth = max(profile.depth, MIN_DEPTH)
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    profile.reliability = (
        ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT)
    profile.durability = (
        DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE)
    return profile


def weaker(new: QoSProfile, old: QoSProfile) -> bool:
    """Return whether ``new`` connects to publishers that ``old`` does not."""
    return (old.reliability == ReliabilityPolicy.RELIABLE != new.reliability
            or old.durability == DurabilityPolicy.TRANSIENT_LOCAL != new.durability)


def offered(profile: QoSProfile) -> Qos:
    """Return what the bag says of a publisher's profile; a depth is not always told."""
    return Qos(
        'reliable' if profile.reliability == ReliabilityPolicy.RELIABLE else 'best_effort',
        'transient_local' if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        else 'volatile', profile.depth or Qos().depth)


@dataclass
class Recording:
    """What became of a recording."""

    status: int             # for ``sys.exit``
    counts: dict[str, int]  # messages by topic
    losses: list[str]       # a line for each topic of which messages did not come


def record(directory: Path, topics: Collection[str] = ()) -> Recording:
    """Record until SIGINT or SIGTERM."""
    recorders: list[Recorder] = []

    def new() -> Recorder:
        recorders.append(Recorder(writer, topics))
        return recorders[-1]

    with BagWriter(directory, ros_distro=os.environ.get('ROS_DISTRO', '')) as writer:
        status = run(new, own_arguments=True)
        return Recording(status, writer.counts, recorders[0].losses if recorders else [])
