"""What a file of a bag gives, whatever its format."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, eq=False)  # compared and hashed by identity: once per message
class Channel:
    """A topic as it is written in a bag; one object per topic and file."""

    topic: str
    type: str                     # such as 'sensor_msgs/msg/Imu'
    encoding: str = 'cdr'         # of the messages
    definition: str = ''          # full text, with the types that it is made of
    definition_encoding: str = ''
    qos: str = ''                 # offered profiles, as YAML
    type_hash: str = ''


Message = tuple[int, Channel, bytes]  # when it was received [ns], where, and its bytes


class Storage(Protocol):
    """One file of a bag, open for reading."""

    losses: list[str]             # what could not be read, for the user

    def counts(self) -> dict[Channel, int]:
        """Return the number of messages of each channel."""

    def span(self) -> tuple[int, int] | None:
        """Return when the first and the last message were received [ns]; None without any."""

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Yield the messages of ``topics`` (None: all) in the order of their reception."""

    def close(self) -> None:
        """Give the file back."""


def note(losses: list[str], text: str) -> None:
    """Add ``text`` to ``losses`` unless a former reading has found the same."""
    if text not in losses:
        losses.append(text)
