# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Publishers of a topic that permits one at a time: who sends, and conflicts between several."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from smart_tire.control import constants as c
from smart_tire.samples import NS_PER_S

UNDISCOVERED = 'a node whose name is not discovered yet'


@dataclass(frozen=True)
class MessageInfo:
    """What the middleware reports of a message; times [ns] since 1970."""

    source_ns: int                 # when it was published
    received_ns: int
    number: int | None = None      # counted by its publisher; unknown with some middleware
    publisher: bytes | None = None  # identifier of its endpoint; unknown before Kilted


def renew(known: dict[Any, int], publisher: Hashable, value: int) -> None:
    """Set the value of the publisher that sends; forget the one that is silent for longest."""
    known.pop(publisher, None)
    if len(known) >= c.MAX_PUBLISHERS:
        del known[next(iter(known))]
    known[publisher] = value


class SequenceTracker:
    """
    Distinguishes publishers by the sequence numbers of their messages.

    A number belongs to the sequence that it continues with the smallest gap, among equal ones to
    that which was continued last: the others may be of publishers that have ended. One that
    continues no sequence belongs to another publisher. Of two publishers that send alternately,
    the third message at the latest continues none. For ROS 2 before Kilted, whose rclpy provides
    these numbers but not the identifier of the publisher.
    """

    def __init__(self) -> None:
        self._latest: dict[int, int] = {}  # publisher -> latest number; the last to send is last
        self._count = 0

    def publisher(self, number: int) -> int:
        """Return the index of the publisher that sent message ``number``, counted from 0."""
        index = min((index for index, latest in reversed(self._latest.items())
                     if 0 < number - latest <= c.MAX_SEQUENCE_GAP),
                    key=lambda index: number - self._latest[index], default=self._count)
        self._count = max(self._count, index + 1)
        renew(self._latest, index, number)
        return index


class PublisherCheck:
    """
    Names the publishers that send on the topic ``name`` within ``window`` [s], if several.

    One that was replaced, for example at a restart, has been silent for longer by then.
    ``existing`` returns the nodes of those in the graph. All of them count as senders of a message
    of which nothing is known.
    """

    def __init__(self, name: str, window: float,
                 existing: Callable[[], Mapping[Hashable, str]]) -> None:
        self._name, self._existing = name, existing
        self._window_ns, self._sequences = round(window * NS_PER_S), SequenceTracker()
        self._latest_ns: dict[Hashable, int] = {}  # publisher -> time of its latest message

    def record(self, sender: Hashable, now_ns: int, *, by_node: bool = False) -> str:
        """
        Record a message; return the text for a conflict of publishers, '' if there is none.

        With ``by_node``, publishers of one node count once, and those that have ended do not. The
        sender of this message has not ended, even if it is not discovered yet.
        """
        for publisher in self._existing() if sender is None else (sender,):
            self._latest_ns[publisher] = now_ns
        if not (publishers := self.conflicting(now_ns)):
            return ''
        existing = self._existing()
        if by_node and not isinstance(sender, int):
            publishers = [item for item in publishers if item in existing or item == sender]
        names, count = self._names(publishers, existing), len(publishers)
        if by_node:
            names = sorted({*names})
            count = len(names)
        return f'{count} publishers on {self._name}: {", ".join(names)}' if count > 1 else ''

    def conflicting(self, now_ns: int) -> list[Hashable]:
        """Return the active publishers if there are several, otherwise an empty list."""
        self._latest_ns = {publisher: latest_ns for publisher, latest_ns in self._latest_ns.items()
                           if now_ns - latest_ns <= self._window_ns}
        return list(self._latest_ns) if len(self._latest_ns) > 1 else []

    def sender(self, info: MessageInfo) -> Hashable:
        """Return the publisher of a message, once per message; None if that is not known."""
        if info.publisher is not None or info.number is None:
            return info.publisher
        return self._sequences.publisher(info.number)

    @staticmethod
    def _names(publishers: Iterable[Hashable], existing: Mapping[Hashable, str]) -> list[str]:
        """Return the nodes of ``publishers``; of all that exist if these are only numbers."""
        if any(isinstance(publisher, int) for publisher in publishers):
            return sorted(existing.values())
        return sorted(existing.get(publisher, UNDISCOVERED) for publisher in publishers)
