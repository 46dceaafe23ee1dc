# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Node ``recorder``: writes serialized messages of all topics to a bag, readable if truncated."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
import math
import os
from pathlib import Path
import shutil
import signal
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from smart_tire.bags import BagWriter, Channel, channel_of, PARAMETERS_KEY, Qos
from smart_tire.control.publishers import MessageInfo
from smart_tire.drivers.clock import SYSTEM
from smart_tire.errors import BagError
from smart_tire.messages import stamp_in
from smart_tire.nodes.base import NoParams, SmartTireNode, with_info
from smart_tire.nodes.compat import installed_class
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.parameters import ParameterCollector
from smart_tire.nodes.qos import matching_qos, requests_less
from smart_tire.nodes.runner import run
from smart_tire.parameters.files import snapshot_text

DISCOVERY_PERIOD = 0.2      # s between queries of the published topics
FLUSH_PERIOD = 0.1          # s between chunks; while timers are late, the writer ends them
PROGRESS_PERIOD = 1.0       # s between reports of the progress, and looks at the disk
MIN_FREE = 200_000_000      # bytes on the disk with which a recording ends: the bag is completed
MAX_DURATION = 300.0        # s of a file: its index is in memory, up to 10 MB with 30 topics
DISCOVERY_GRACE_NS = 2_000_000_000  # ns after start, until publishers that existed are discovered

PACED_BY, PACE_LAG_NS = 'sensor_msgs/msg/Imu', 100_000_000  # ns after its timestamp

Progress = Callable[[Mapping[str, int], int], None]  # topic -> messages, number of lost ones


class SequenceGaps:
    """
    Counts lost messages of a topic by the sequence numbers of its publishers.

    The DDS event ``message_lost`` does not occur when a queue of the subscriber overflows. A
    publisher is counted from its first message that is received on: what it sent before it matched
    the subscription was never on its way. Losses after the last received message are not detected.
    Messages that do not identify their publisher (before Kilted) are of the ``only_publisher``;
    their losses are not counted while it is None or other publishers are not ``discovered``.
    """

    def __init__(self) -> None:
        self.lost = 0
        self.only_publisher: bytes | None = None
        self.discovered = False  # whether there is no other that has existed for long
        self._last: dict[bytes, int] = {}  # publisher -> latest sequence number

    def count(self, info: MessageInfo) -> bool:
        """Add a received message; return whether the losses have reached 1, 2, 4, 8 ... now."""
        number, publisher = info.number, info.publisher or self.only_publisher
        if number is None or publisher is None:
            return False
        before, last = self.lost, self._last.get(publisher, number)
        if info.publisher is not None or self.discovered:
            self.lost += max(0, number - last - 1)
        self._last[publisher] = max(last, number)
        return before.bit_length() < self.lost.bit_length()


class Recorder(SmartTireNode[NoParams]):
    """
    Subscribes to all published topics, or to ``topics``, and writes them to a bag.

    The bag also gets the parameters of the nodes of this package, by default ``parameters`` (flat
    values by node). Publishes ``/diagnostics``, subscribes to ``/parameter_events``. Hidden
    topics and those whose type is not installed are skipped. Of several types of a topic, such as
    ``Twist`` and ``TwistStamped``, the type found last before its first message is recorded. No
    parameters. ``on_progress`` is called once a second. When the disk is almost full, ``problem``
    is set and the recording ends.
    """

    def __init__(self, writer: BagWriter, topics: Collection[str] = (),
                 parameters: Mapping[str, Mapping[str, Any]] | None = None,
                 on_progress: Progress | None = None) -> None:
        super().__init__('recorder', NoParams)
        self._writer = writer
        self._on_progress = on_progress
        self._given = dict(parameters or {})
        self._collector = ParameterCollector(self)
        self._stored: Mapping[str, Mapping[str, Any]] = {}  # parameters in the bag
        self._names = {self.resolve_topic_name(topic) for topic in topics}
        self._recorded: dict[str, tuple[str, QoSProfile, Any]] = {}  # type, profile, subscription
        self._discovered_ns = self.steady_ns() + DISCOVERY_GRACE_NS
        self._published: dict[str, list[str]] = {}  # of the publishers, in the order of discovery
        self.problem = ''  # that ended the recording
        self._gaps: dict[str, SequenceGaps] = {}

    @property
    def losses(self) -> list[str]:
        """Return a line for each topic with lost messages."""
        return [f'lost {gaps.lost} messages of {name}'
                for name, gaps in sorted(self._gaps.items()) if gaps.lost]

    def start(self) -> None:
        """Record the topics that exist, and look for new ones."""
        self._discover()
        self._collect_parameters()
        self.call_every(DISCOVERY_PERIOD, self._discover)
        self.call_every(DISCOVERY_PERIOD, self._collect_parameters)
        self.call_every(FLUSH_PERIOD, self._writer.flush)
        self.call_every(PROGRESS_PERIOD, self._report)

    def fill_status(self, status: Status) -> None:
        """Add counts of recorded and lost messages, and requested topics without messages."""
        counts = self._writer.counts
        status.values['topics'] = len(counts)
        status.values['messages'] = sum(counts.values())
        lost = {name: gaps.lost for name, gaps in self._gaps.items()}
        status.values['messages_lost'] = sum(lost.values())
        for name, count in lost.items():
            if count:
                status.values[f'{name}.messages_lost'] = count
            if new := status.new(f'lost {name}', count):
                status.warn(f'lost {new} messages of {name}', by_host=True)
        for name in sorted(self._names - counts.keys()):
            status.warn(f'no {name}')

    def _report(self) -> None:
        free = shutil.disk_usage(self._writer.directory).free
        if free < MIN_FREE and not self.problem:
            self.problem = (f'{self._writer.directory}: the recording ended, its disk has '
                            f'{free / 1e6:.0f} MB left, needed are {MIN_FREE / 1e6:.0f} MB')
            signal.raise_signal(signal.SIGTERM)  # ends the runner as an operator does
        if self._on_progress is not None:
            lost = sum(gaps.lost for gaps in self._gaps.values())
            self._on_progress(self._writer.counts, lost)

    def _discover(self) -> None:
        for name, _ in self.get_topic_names_and_types():
            hidden = not self._names and '/_' in name  # such as the events of services
            if not hidden and (not self._names or name in self._names):
                self._record(name)

    def _collect_parameters(self) -> None:
        self._collector.poll()
        found = {**self._given, **self._collector.values}
        if found != self._stored:
            self._stored = found
            self._writer.set_custom_data(PARAMETERS_KEY, snapshot_text(found))

    def _record(self, name: str) -> None:
        published = self.get_publishers_info_by_topic(name)
        if not published:
            return
        type_name = self._type_of(name, [info.topic_type for info in published])
        publishers = [info for info in published if info.topic_type == type_name]
        if not publishers or (cls := installed_class(type_name)) is None:
            return
        offers = [info.qos_profile for info in publishers]
        requested = matching_qos(name, offers)
        gaps = self._gaps.setdefault(name, SequenceGaps())
        gaps.only_publisher = bytes(publishers[0].endpoint_gid) if len(publishers) == 1 else None
        gaps.discovered = self.steady_ns() > self._discovered_ns
        if name in self._recorded:
            present, profile, subscription = self._recorded[name]
            if present == type_name and not requests_less(requested, profile):
                return
            self.destroy_subscription(subscription)
            if present != type_name:  # two types at a time on a topic are not possible
                del self._recorded[name]
                return
        else:
            self.get_logger().info(f'recording {name}')
        channel = channel_of(name, type_name, tuple(map(recorded_qos, offers)))
        callback = with_info(self._write_callback(channel, gaps))
        self._recorded[name] = type_name, requested, self.create_subscription(
            cls, name, callback, requested, raw=True)

    def _type_of(self, name: str, published: list[str]) -> str:
        """Return the type to record: that of the recorded messages, or the one found last."""
        found = self._published.setdefault(name, [])
        new = list(dict.fromkeys(kind for kind in published if kind not in found))
        found += new
        type_name = self._recorded[name][0] if self._writer.has_topic(name) else found[-1]
        if new and installed_class(type_name) is None:
            self.get_logger().warning(f'{name} is {type_name}, which is not installed: not '
                                      'recorded')
        elif new and len(found) > 1:
            self.get_logger().warning(f'{name} is published as {" and ".join(sorted(found))}: '
                                      f'only {type_name} is recorded')
        return type_name

    def _write_callback(self, channel: Channel,
                        gaps: SequenceGaps) -> Callable[[Any, MessageInfo], None]:
        name = channel.topic
        add_topic, write, now_ns = self._writer.add_topic, self._writer.write, SYSTEM.time_ns

        announce = SYSTEM.join(self.get_name()) if channel.type == PACED_BY else None

        def on_message(data: bytes, info: MessageInfo) -> None:
            add_topic(channel)
            write(name, now_ns(), data)
            if announce is not None:
                announce(stamp_in(data) - now_ns() + self.steady_ns() + PACE_LAG_NS)
            if gaps.count(info):
                self.get_logger().warning(f'lost {gaps.lost} messages of {name} so far')

        return on_message


def recorded_qos(profile: QoSProfile) -> Qos:
    """Return a publisher's profile as stored in the bag; its depth is not always known."""
    return Qos(
        'reliable' if profile.reliability == ReliabilityPolicy.RELIABLE else 'best_effort',
        'transient_local' if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        else 'volatile', profile.depth or Qos().depth)


@dataclass
class RecordSummary:
    """Result of a recording."""

    status: int             # for ``sys.exit``
    counts: dict[str, int]  # topic -> messages
    losses: list[str]       # a line for each topic with lost messages


def record(directory: Path, topics: Collection[str] = (),
           parameters: Mapping[str, Mapping[str, Any]] | None = None,
           on_progress: Progress | None = None, *, max_size: float = math.inf,
           max_duration: float = MAX_DURATION) -> RecordSummary:
    """
    Record all topics, or ``topics``, into ``directory`` until SIGINT or SIGTERM.

    The bag carries ``parameters`` (flat values by node), or those of the running nodes. A new file
    begins after ``max_size`` [bytes] or ``max_duration`` [s]. ``on_progress`` is called once a
    second. Raises BagError, with the bag complete, when its disk is almost full.
    """
    recorders: list[Recorder] = []

    def new_recorder() -> Recorder:
        recorders.append(Recorder(writer, topics, parameters, on_progress))
        return recorders[-1]

    with BagWriter(directory, ros_distro=os.environ.get('ROS_DISTRO', ''), max_size=max_size,
                   max_duration=max_duration) as writer:
        status = run(new_recorder, own_arguments=True, images=True)
    for recorder in recorders:
        if recorder.problem:
            raise BagError(recorder.problem)
    return RecordSummary(status, writer.counts, recorders[0].losses if recorders else [])
