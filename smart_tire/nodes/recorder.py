"""Recorder: every topic, with the bytes as they come, into a bag that survives its end."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
import os
from pathlib import Path
import time
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from smart_tire.bags import BagWriter, channel_of, Qos
from smart_tire.messages import find_topic
from smart_tire.nodes.base import run, SmartTireNode
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.qos import subscriber_qos
from smart_tire.nodes.ros import message_class
from smart_tire.samples import WHEELS

LOOK = 0.2           # s between looks at what is published
FLUSH = 0.25         # s between chunks, half of what a crash may cost
OTHER_DEPTH = 1000   # messages kept of a topic that is not ours while the disk is busy


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

    def start(self) -> None:
        """Begin with what is there, and go on looking."""
        self._look()
        self.every(LOOK, self._look)
        self.every(FLUSH, self._writer.flush)

    def fill_status(self, status: Status) -> None:
        """Tell how much has been written."""
        counts = self._writer.counts
        status.values['topics'] = len(counts)
        status.values['messages'] = sum(counts.values())
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
        offers = [info.qos_profile for info in self.get_publishers_info_by_topic(name)]
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
            message_class(type_name), name, self._keeper(name), wanted, raw=True)

    def _keeper(self, name: str) -> Callable[[Any], None]:
        write, now_ns = self._writer.write, time.time_ns
        return lambda data: write(name, now_ns(), data)

    def _refuse(self, name: str, reason: str) -> None:
        if name not in self._refused:
            self._refused.add(name)
            self.get_logger().warning(f'{name} {reason}: not recorded')


def adapted(name: str, offers: list[QoSProfile]) -> QoSProfile:
    """Return the most that a subscriber may ask of all publishers that made ``offers``."""
    topic = find_topic(name)
    profile = (QoSProfile(depth=OTHER_DEPTH) if topic is None
               else subscriber_qos(topic.name, wheels=len(WHEELS)))
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


def record(directory: Path, topics: Collection[str] = ()) -> tuple[int, dict[str, int]]:
    """Record until SIGINT or SIGTERM; return the exit status and the messages by topic."""
    with BagWriter(directory, ros_distro=os.environ.get('ROS_DISTRO', '')) as writer:
        return run(lambda: Recorder(writer, topics), own_arguments=True), writer.counts
