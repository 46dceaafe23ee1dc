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
Crash-safe writer of rosbag2 directories, and recovery of damaged bags.

A crash loses the messages since the latest chunk: less than 0.2 s of them, however late ``flush``
is called, which is for the case that messages stop arriving. The index of a file is in memory
until the file is complete (3 kB per chunk with 30 topics): a long recording is divided into
several files.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
import math
import os
from pathlib import Path

from smart_tire.bags.cdr import definition, SampleEncoder
from smart_tire.bags.mcap_writer import McapWriter
from smart_tire.bags.metadata import (
    Channel, Contents, metadata_text, Qos, qos_text, Span, write_metadata)
from smart_tire.bags.reader import Bag
from smart_tire.errors import BagError
from smart_tire.messages import ALL_TOPICS
from smart_tire.samples import NS_PER_S, Sample

# Of message time between chunks; of the 0.2 s allowed the rest is for the next message to arrive.
FLUSH_PERIOD_NS = 150_000_000
METADATA_PERIOD_NS = 5_000_000_000  # of message time between updates of metadata.yaml


def channel_of(topic: str, type_name: str, profiles: tuple[Qos, ...] = ()) -> Channel:
    """Return the channel of a topic; without definition if ROS 2 Jazzy does not have the type."""
    text, type_hash = definition(type_name)
    return Channel('/' + topic.lstrip('/'), type_name, 'cdr', text, 'ros2msg' if text else '',
                   qos_text(list(profiles)), type_hash)


class BagWriter:
    """
    Writes an MCAP bag that ``ros2 bag`` can open, even if the process was killed while writing.

    The writer has no clock: chunks end by message time. If messages may stop arriving, call
    ``flush`` periodically. A new file begins with the first message after a file has ``max_size``
    [bytes], without its last chunk and its index, or ``max_duration`` [s] of message time. If it
    is not ``live``, chunks are full, and metadata.yaml is written at the end only.
    """

    def __init__(self, directory: str | Path, *, ros_distro: str = '',
                 custom_data: Mapping[str, str] | None = None, max_size: float = math.inf,
                 max_duration: float = math.inf, live: bool = True) -> None:
        self.directory = Path(directory)
        self._max_size, self._max_ns = max_size, max_duration * NS_PER_S
        self._contents = Contents(ros_distro, custom_data=dict(custom_data or {}))
        self._live = live
        self._numbers: dict[str, tuple[int, Channel]] = {}  # by topic: of the channel in this file
        self._encoders: dict[str, tuple[SampleEncoder, str]] = {}  # and topic in the bag
        self._receive_ns = self._flushed_ns = self._metadata_ns = 0
        with self._errors_named():
            self.directory.mkdir(parents=True)
        self._begin_file()
        if custom_data:
            self._add_metadata_record()  # for readers of the file alone, after a crash

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of messages written per topic."""
        return {channel.topic: count for channel, count in self._contents.counts.items()}

    def set_custom_data(self, key: str, text: str) -> None:
        """Store ``text`` in the metadata, like ``ros2 bag record --custom-data``, at once."""
        if self._contents.custom_data.get(key) != text:
            self._contents.custom_data[key] = text
            self._add_metadata_record()
            self._write_metadata()

    def has_topic(self, topic: str) -> bool:
        """Return whether a topic is registered."""
        return topic in self._numbers

    def add_topic(self, channel: Channel) -> None:
        """Register a topic; no effect if it is already registered."""
        if not self.has_topic(channel.topic):
            self._contents.counts[channel] = 0
            self._register(channel)
            if self._live:
                self._write_metadata()

    def write(self, topic: str, receive_ns: int, data: bytes) -> None:
        """Write the serialized message of a registered topic."""
        if self._is_full(receive_ns):
            self._end_file()
            self._begin_file()
        number, channel = self._numbers[topic]
        try:
            self._mcap.add_message(number, receive_ns, data)
        except OSError as error:  # without a context, which would take as long as the rest
            raise self._error(error) from error
        self._contents.counts[channel] += 1
        self._span.add(receive_ns)
        self._receive_ns = receive_ns
        if not self._live:
            return
        if abs(receive_ns - self._flushed_ns) >= FLUSH_PERIOD_NS:
            self.flush()
        if abs(receive_ns - self._metadata_ns) >= METADATA_PERIOD_NS:
            self._metadata_ns = receive_ns
            self._write_metadata()

    def write_sample(self, topic: str, receive_ns: int, sample: Sample) -> None:
        """Write a sample of a standard topic such as ``odom``."""
        if topic not in self._encoders:
            self._encoders[topic] = SampleEncoder(ALL_TOPICS[topic]), f'/{topic}'
            self.add_topic(channel_of(topic, ALL_TOPICS[topic].type))
        encode, name = self._encoders[topic]
        self.write(name, receive_ns, encode(sample))

    def flush(self) -> None:
        """Hand over all written data to the operating system."""
        self._flushed_ns = self._receive_ns
        with self._errors_named():
            self._mcap.flush()

    def close(self) -> None:
        """Finish the bag; no effect the second time."""
        if not self._file.closed:
            self._end_file()
            self._write_metadata()

    def _is_full(self, receive_ns: int) -> bool:
        """Return whether the message of this time begins a new file."""
        return self._span.messages > 0 and (
            receive_ns - self._span.start_ns >= self._max_ns or self._max_size < math.inf
            and os.fstat(self._file.fileno()).st_size >= self._max_size)

    def _begin_file(self) -> None:
        name = f'{self.directory.resolve().name}_{len(self._contents.files)}.mcap'
        with self._errors_named():
            self._file = (self.directory / name).open('xb')
            self._mcap = McapWriter(self._file, profile='ros2', library='smart_tire')
            self._file.flush()
        self._span = self._contents.files[name] = Span()
        self._schemas: dict[str, int] = {}
        for channel in self._contents.counts:
            self._register(channel)
        self._write_metadata()

    def _end_file(self) -> None:
        with self._errors_named(), self._file:
            self._add_metadata_record()
            self._mcap.finish()

    def _register(self, channel: Channel) -> None:
        """Add the channel to the present file."""
        if channel.type not in self._schemas:
            self._schemas[channel.type] = self._mcap.add_schema(
                channel.type, channel.definition_encoding, channel.definition.encode())
        self._numbers[channel.topic] = self._mcap.add_channel(
            channel.topic, channel.encoding, self._schemas[channel.type],
            {'offered_qos_profiles': channel.qos, 'topic_type_hash': channel.type_hash}), channel

    def _add_metadata_record(self) -> None:
        with self._errors_named():
            self._mcap.add_metadata(
                'rosbag2', {'serialized_metadata': metadata_text(self._contents)})
            self._file.flush()

    def _write_metadata(self) -> None:
        with self._errors_named():
            write_metadata(self.directory, self._contents)

    @contextmanager
    def _errors_named(self) -> Iterator[None]:
        """Raise BagError with the folder if it cannot be written in this context."""
        try:
            yield
        except BagError:  # an OSError, too
            raise
        except OSError as error:
            raise self._error(error) from error

    def _error(self, error: OSError) -> BagError:
        return BagError(f'{self.directory}: cannot be written ({error.strerror})')


@dataclass(frozen=True)
class Recovery:
    """Recovered message counts, and warnings about lost data."""

    counts: dict[str, int]  # messages by topic
    warnings: list[str]     # about something else than losses
    losses: list[str]       # one line, none if nothing is lost
    span_ns: tuple[int, int]


def recover(path: str | Path, out: str | Path) -> Recovery:
    """
    Write all readable messages of the bag at ``path`` into a new, indexed bag at ``out``.

    The parameters in the bag, other custom data and the ROS distribution are kept.

    Of more than ``Bag.max_content``, only the first messages are. Raises BagError if the bag
    cannot be read or ``out`` exists.
    """
    with Bag(path) as bag:
        topics = [topic.channel for topic in bag.topics.values()]
        with BagWriter(out, ros_distro=bag.ros_distro, custom_data=bag.custom_data,
                       live=False) as writer:
            for channel in topics:
                writer.add_topic(_completed(channel))
            left = bag.max_content
            for receive_ns, channel, data in bag.raw():
                left -= len(data)
                if left < 0:
                    bag.losses.add(f'only the first {bag.max_content / 1e6:.0f} MB of messages '
                                   'are recovered')
                    break
                writer.add_topic(_completed(channel))  # new if it has another name in the summary
                writer.write(channel.topic, receive_ns, data)
            return Recovery(writer.counts, bag.warnings, bag.losses.lines(), bag.span_ns)


def _completed(channel: Channel) -> Channel:
    """Return ``channel`` with its type definition, which sqlite3 bags may lack."""
    if channel.definition or not (known := channel_of(channel.topic, channel.type)).definition:
        return channel
    return replace(channel, definition=known.definition, type_hash=known.type_hash,
                   definition_encoding=known.definition_encoding)
