# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Recovery of damaged bags."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from smart_tire.bags.reader import Bag
from smart_tire.bags.storage import Channel
from smart_tire.bags.writer import BagWriter, channel_of


@dataclass(frozen=True)
class Recovery:
    """Recovered message counts, and warnings about lost data."""

    counts: dict[str, int]  # messages by topic
    warnings: list[str]
    span_ns: tuple[int, int]


def recover(path: str | Path, out: str | Path) -> Recovery:
    """
    Write all readable messages of the bag at ``path`` into a new, indexed bag at ``out``.

    The parameters in the bag and other custom data are kept.

    Raises BagError if the bag cannot be read or ``out`` exists.
    """
    with Bag(path) as bag:
        topics = [topic.channel for topic in bag.topics.values()]
        with BagWriter(out, custom_data=bag.custom_data) as writer:
            for channel in topics:
                writer.add_topic(_completed(channel))
            for receive_ns, channel, data in bag.raw():
                writer.write(channel.topic, receive_ns, data)
            return Recovery(writer.counts, bag.warnings, bag.span_ns)


def _completed(channel: Channel) -> Channel:
    """Return ``channel`` with its type definition, which sqlite3 bags may lack."""
    known = channel_of(channel.topic, channel.type)
    if channel.definition or not known.definition:
        return channel
    return replace(channel, definition=known.definition, type_hash=known.type_hash,
                   definition_encoding=known.definition_encoding)
