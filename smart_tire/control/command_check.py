"""Whether a command may be obeyed: how old it is, and who else sends commands."""

from __future__ import annotations

from collections.abc import Hashable

from smart_tire.errors import CommandError
from smart_tire.samples import NS_PER_S

STALL_NS = 250_000_000    # a process that did nothing for so long had been stopped
SETTLE_NS = 100_000_000   # in which it then reads what had been queued meanwhile
MAX_SEQUENCE_GAP = 1000   # numbers that one publisher may skip: its messages that were lost


class StallDetector:
    """
    Recognises messages that were queued while this process was stopped.

    DDS stamps them with the time at which the process went on, as if they had just come. Call
    ``tick`` more often than every ``STALL_NS``. Times are nanoseconds of one steady clock.
    """

    def __init__(self, now_ns: int) -> None:
        self._ticked_ns = now_ns
        self._resumed_ns: int | None = None
        self.stalls = 0

    def tick(self, now_ns: int) -> None:
        """Take note that the process is running."""
        if now_ns - self._ticked_ns > STALL_NS:
            self._resumed_ns = now_ns
            self.stalls += 1
        self._ticked_ns = now_ns

    def queued(self, received_ns: int) -> bool:
        """Return whether a message received then may have waited while the process stood."""
        return self._resumed_ns is not None and received_ns < self._resumed_ns + SETTLE_NS


def check_age(topic: str, stamp_ns: int, now_ns: int, waited_ns: int, max_age: float) -> None:
    """
    Raise CommandError unless a command is from the present.

    ``stamp_ns`` and ``now_ns`` are of the clock of stamps; a stamp of zero says that there is
    none, and the age is ``waited_ns``, the time since the message was received. ``max_age`` [s]
    holds for the past and for the future.
    """
    if stamp_ns < 0:
        raise CommandError(f'{topic}: the stamp is negative')
    age = (now_ns - stamp_ns if stamp_ns else waited_ns) / NS_PER_S
    if abs(age) > max_age:
        raise CommandError(f'{topic}: {abs(age):.3g} s {"old" if age > 0.0 else "ahead"}, '
                           f'expected at most {max_age:g} s')


class PublisherClaims:
    """
    Notices messages of more than one publisher on a topic that only one may command.

    Publishers count for ``window_ns`` after their latest message; one that was replaced, as at a
    restart, is silent by then.
    """

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._heard: dict[Hashable, int] = {}

    def heard(self, publisher: Hashable, now_ns: int) -> None:
        """Take note of a message."""
        self._heard[publisher] = now_ns

    def rivals(self, now_ns: int) -> list[Hashable]:
        """Return the publishers that contradict each other, empty if there is at most one."""
        self._heard = {publisher: ns for publisher, ns in self._heard.items()
                       if now_ns - ns <= self._window_ns}
        return list(self._heard) if len(self._heard) > 1 else []


class SequenceStreams:
    """
    Tells publishers apart by the numbers of their messages, where nothing else identifies them.

    A number that continues no known stream belongs to another publisher. Jazzy's rclpy gives
    these numbers, but not the identifier of the publisher.
    """

    def __init__(self) -> None:
        self._latest: list[int] = []

    def publisher(self, number: int) -> int:
        """Return which publisher, counted from 0, sent message ``number``."""
        gaps = [(number - latest, stream) for stream, latest in enumerate(self._latest)
                if 0 < number - latest <= MAX_SEQUENCE_GAP]
        if not gaps:
            self._latest.append(number)
            return len(self._latest) - 1
        _, stream = min(gaps)
        self._latest[stream] = number
        return stream
