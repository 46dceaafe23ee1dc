# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The file metadata.yaml of a bag: reads any version of the format, writes version 9."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
import os
from pathlib import Path, PurePath
from typing import Any

from smart_tire.errors import BagError
from smart_tire.paths import BAG_METADATA, BAG_SUFFIXES, read_file
from smart_tire.yaml_text import MAX_SIZE, parse_yaml
import yaml

ROOT = 'rosbag2_bagfile_information'
VERSION = 9
NO_START = 2**63 - 1                       # ns, start time of a bag without messages
MAX_WARNINGS = 100                         # of a bag or file
MAX_REASONS = 3                            # of losses that are listed
INFINITE_DURATION = {'sec': 9223372036, 'nsec': 854775807}  # RMW_DURATION_INFINITE
# The variants of libyaml, if it is installed, are ten times as fast.
DUMPER = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)


@dataclass(frozen=True, eq=False)  # hashed for each message, so by identity, which is fast
class Channel:
    """A topic as recorded in a bag file; one object per topic and file."""

    topic: str
    type: str                     # such as 'sensor_msgs/msg/Imu'  # noqa: A003
    encoding: str = 'cdr'         # of the messages
    definition: str = ''          # full text, including nested types
    definition_encoding: str = ''
    qos: str = ''                 # offered QoS profiles, as YAML
    type_hash: str = ''


Message = tuple[int, Channel, bytes]  # receive time [ns], channel, data


def add_warning(warnings: list[str], text: str) -> None:
    """Append ``text`` to ``warnings`` unless it, or ``MAX_WARNINGS`` others, are listed."""
    if len(warnings) < MAX_WARNINGS and text not in warnings:
        warnings.append(text)


class Losses:
    """What of a bag could not be read."""

    def __init__(self) -> None:
        self._reasons: dict[str, None] = {}  # in order; a list would be searched for each
        self.messages = 0  # known to be lost for these reasons
        self.missing = 0   # messages that metadata.yaml lists, but the files lack

    @property
    def reasons(self) -> list[str]:
        """Return the reasons of all losses."""
        return list(self._reasons)

    def add(self, reason: str, messages: int = 0) -> None:
        """Note a loss, once, of a known number of messages or of an unknown one, 0."""
        if reason not in self._reasons:
            self._reasons[reason] = None
            self.messages += messages

    def lines(self) -> list[str]:
        """Return all losses in one line; none without losses."""
        if not self._reasons:
            return []
        number = max(self.messages, self.missing)
        shown = self.reasons[:MAX_REASONS]
        if more := len(self._reasons) - len(shown):
            shown.append(f'and {more} more')
        return [f'{f"{number} messages or more" if number else "messages"} are missing: '
                + '; '.join(shown)]


@dataclass(frozen=True)
class Qos:
    """Offered QoS of a publisher: the fields that replay needs."""

    reliability: str = 'reliable'          # or 'best_effort'
    durability: str = 'volatile'           # or 'transient_local'
    depth: int = 10


@dataclass(frozen=True)
class Metadata:
    """What metadata.yaml contains, or its copy in a file of the bag."""

    files: tuple[str, ...] = ()  # names
    messages: int = 0
    ros_distro: str = ''
    custom_data: Mapping[str, str] = field(default_factory=dict)  # none before version 6


@dataclass
class Span:
    """Number of messages, and times of the first and the last one."""

    messages: int = 0
    start_ns: int = NO_START
    end_ns: int = 0

    def add(self, receive_ns: int) -> None:
        """Add a message."""
        self.messages += 1
        if receive_ns < self.start_ns:
            self.start_ns = receive_ns
        if receive_ns > self.end_ns:
            self.end_ns = receive_ns

    def entries(self) -> dict[str, Any]:
        """Return the entries of rosbag2."""
        duration = max(0, self.end_ns - self.start_ns) if self.messages else 0
        return {'duration': {'nanoseconds': duration},
                'starting_time': {'nanoseconds_since_epoch': self.start_ns},
                'message_count': self.messages}


@dataclass
class Contents:
    """Contents of a bag."""

    ros_distro: str = ''
    files: dict[str, Span] = field(default_factory=dict)      # by name, in order
    counts: dict[Channel, int] = field(default_factory=dict)  # messages in all files
    custom_data: dict[str, str] = field(default_factory=dict)  # as of ros2 bag record

    @property
    def span(self) -> Span:
        """Return the span of all files."""
        spans = self.files.values()
        return Span(sum(one.messages for one in spans),
                    min((one.start_ns for one in spans), default=NO_START),
                    max((one.end_ns for one in spans), default=0))


def qos_text(profiles: list[Qos]) -> str:
    """Return offered QoS profiles in the format of rosbag2."""
    entries = [{
        'history': 'keep_last', 'depth': profile.depth, 'reliability': profile.reliability,
        'durability': profile.durability, 'deadline': INFINITE_DURATION,
        'lifespan': INFINITE_DURATION,
        'liveliness': 'automatic', 'liveliness_lease_duration': INFINITE_DURATION,
        'avoid_ros_namespace_conventions': False} for profile in profiles]
    return _dump(entries) if entries else ''


def metadata_text(contents: Contents) -> str:
    """Return the content of metadata.yaml without its root key, for the record in the bag file."""
    return _dump(_entry(contents))


def write_metadata(directory: Path, contents: Contents) -> None:
    """Write metadata.yaml atomically."""
    draft = directory / f'.{BAG_METADATA}'
    draft.write_text(_dump({ROOT: _entry(contents)}), encoding='utf-8')
    os.replace(draft, directory / BAG_METADATA)


def read_metadata(directory: Path) -> Metadata | None:
    """Return the content of metadata.yaml; None if it is missing; BagError if it is invalid."""
    path = directory / BAG_METADATA
    try:
        document = parse_yaml(read_file(path, MAX_SIZE))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BagError(f'{path}: cannot be read ({error.strerror})') from error
    except ValueError as error:
        raise BagError(f'{path}: not valid YAML ({error})') from error
    root = document.get(ROOT) if isinstance(document, Mapping) else None
    names = root.get('relative_file_paths') if isinstance(root, Mapping) else None
    if not isinstance(names, list):
        raise BagError(f'{path}: relative_file_paths is missing')
    for name in names:
        if not isinstance(name, str) or not name.endswith(BAG_SUFFIXES):
            raise BagError(f'{path}: relative_file_paths has {name!r}, which is no file of a bag')
    return _metadata_of(root)


def metadata_in(text: str) -> Metadata:
    """Return the content of ``metadata_text``; empty if it is not valid YAML."""
    try:
        return _metadata_of(parse_yaml(text))
    except ValueError:
        return Metadata()


def _metadata_of(entry: Any) -> Metadata:
    """Return the valid parts of a metadata entry."""
    if not isinstance(entry, Mapping):
        return Metadata()
    files, messages, distro, data = map(entry.get, (
        'relative_file_paths', 'message_count', 'ros_distro', 'custom_data'))
    return Metadata(
        # Old versions put the name of the folder in front.
        tuple(dict.fromkeys(PurePath(name).name for name in files if isinstance(name, str)))
        if isinstance(files, list) else (),
        messages if isinstance(messages, int) else 0, distro if isinstance(distro, str) else '',
        {str(key): str(value) for key, value in data.items()
         if isinstance(value, str | int | float)}
        if isinstance(data, Mapping) else {})


def _dump(document: Any) -> str:
    dumper = type('Dumper', (DUMPER,), {'ignore_aliases': lambda self, data: True})
    return yaml.dump(document, Dumper=dumper, sort_keys=False)


def _entry(contents: Contents) -> dict[str, Any]:
    return {
        'version': VERSION, 'storage_identifier': 'mcap', **contents.span.entries(),
        'topics_with_message_count': [
            {'topic_metadata': _topic(channel), 'message_count': count}
            for channel, count in contents.counts.items()],
        'compression_format': '', 'compression_mode': '',
        'relative_file_paths': list(contents.files),
        'files': [{'path': name, **span.entries()} for name, span in contents.files.items()],
        'custom_data': contents.custom_data or None, 'ros_distro': contents.ros_distro}


@lru_cache(maxsize=1024)  # the profiles of all topics take longer to parse than a crash may cost
def _topic(channel: Channel) -> dict[str, Any]:
    return {
        'name': channel.topic, 'type': channel.type, 'serialization_format': channel.encoding,
        'offered_qos_profiles': _profiles(channel.qos),
        'type_description_hash': channel.type_hash}


def _profiles(qos: str) -> Any:
    try:
        found = parse_yaml(qos)
    except ValueError:  # of a damaged bag
        return []
    return found if isinstance(found, list) and all(isinstance(one, dict) for one in found) else []
