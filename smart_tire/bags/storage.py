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

"""Interface of the bag file readers."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, eq=False)  # compared and hashed by identity: once per message
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


class Storage(Protocol):
    """One file of a bag, open for reading."""

    warnings: list[str]           # what could not be read, for the user

    def counts(self) -> dict[Channel, int]:
        """Return the message count of each channel."""

    def custom_data(self) -> dict[str, str]:
        """Return the custom data of ``ros2 bag record --custom-data``."""

    def span(self) -> tuple[int, int] | None:
        """Return the receive times of the first and last message [ns]; None without messages."""

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Yield the messages of ``topics`` (None: all) in order of receive time."""

    def close(self) -> None:
        """Close the file."""


def add_warning(warnings: list[str], text: str) -> None:
    """Append ``text`` to ``warnings`` unless it is already listed."""
    if text not in warnings:
        warnings.append(text)
