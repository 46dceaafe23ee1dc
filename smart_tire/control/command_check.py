# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Validity of commands: age, queuing, conflicting publishers; choice among inputs."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
import math

from smart_tire.control import constants as c
from smart_tire.errors import CommandError, LateCommandError
from smart_tire.samples import NS_PER_S, VelocityCommand


class StallDetector:
    """
    Detects messages that were queued while this process was stopped.

    Their DDS reception time is the time at which the process resumed, as if they had just
    arrived, or later, if the transport repeats them. Call ``tick`` more often than every
    ``MIN_STALL_NS``. Times are nanoseconds of one steady clock.
    """

    def __init__(self, now_ns: int) -> None:
        self._ticked_ns = self._stalled_ns = self._drained_ns = now_ns
        self._resumed_ns: int | None = None
        self.stalls = 0

    def tick(self, now_ns: int) -> None:
        """Record that the process is running."""
        if now_ns - self._ticked_ns > c.MIN_STALL_NS:
            if self._ticked_ns >= self._drained_ns:  # otherwise still the backlog of the last one
                self._stalled_ns = self._ticked_ns
            self._resumed_ns, self._drained_ns = now_ns, 2 * now_ns - self._stalled_ns
            self.stalls += 1
        self._ticked_ns = now_ns

    def may_be_queued(self, received_ns: int, excess_ns: int) -> bool:
        """
        Return whether a message received then may have been queued during a stall.

        ``excess_ns`` is that of its transit time: the message was sent so long before, at least.
        """
        return self._resumed_ns is not None and (
            received_ns < self._resumed_ns + c.QUEUE_DRAIN_NS
            or received_ns - excess_ns < self._resumed_ns)

    def waited_ns(self, received_ns: int) -> int:
        """
        Return for how long a message handled then may have been queued [ns], at most.

        For messages without reception time: what a stall has left is handled within a time as long
        as the stall.
        """
        return received_ns - self._stalled_ns if received_ns < self._drained_ns else 0


class TransitTimes:
    """
    The least transit time of the messages of each publisher.

    The difference to it is known even if the clock of the publisher is another one.
    """

    def __init__(self) -> None:
        self._least_ns: dict[Hashable, int] = {}

    def excess(self, publisher: Hashable, transit_ns: int) -> int:
        """Return the excess [ns] of ``transit_ns``: time of reception minus that of sending."""
        least_ns = min(self._least_ns.pop(publisher, transit_ns), transit_ns)
        if len(self._least_ns) >= c.MAX_PUBLISHERS:
            del self._least_ns[next(iter(self._least_ns))]  # the one that is silent for longest
        self._least_ns[publisher] = least_ns
        return transit_ns - least_ns


def check_age(topic: str, stamp_ns: int, now_ns: int, waited_ns: int, max_age: float,
              timeout: float = math.inf) -> int:
    """
    Return the age [ns] of a command: since its timestamp or its arrival, whichever is earlier.

    ``stamp_ns`` and ``now_ns`` are times of the message clock, ``waited_ns`` is the time since the
    arrival; a timestamp of zero means none. Raises CommandError if the timestamp is negative, and
    LateCommandError if it is further in the future than ``max_age`` [s], or if the command is
    older than that or than its ``timeout`` [s].
    """
    if stamp_ns < 0:
        raise CommandError(f'{topic}: the timestamp is negative')
    ahead = (stamp_ns - now_ns) / NS_PER_S if stamp_ns else 0.0
    if ahead > max_age:
        raise LateCommandError(f'{topic}: {ahead:.3g} s ahead, expected at most {max_age:g} s')
    age_ns = max(now_ns - stamp_ns, waited_ns) if stamp_ns else waited_ns
    if age_ns > min(max_age, timeout) * NS_PER_S:
        raise LateCommandError(f'{topic}: {age_ns / NS_PER_S:.3g} s old, expected at most '
                               f'{min(max_age, timeout):g} s')
    return age_ns


class PublisherMonitor:
    """
    Detects messages of several publishers on a command topic that permits only one.

    A publisher is active for ``window_ns`` after its latest message; one that was replaced, for
    example at a restart, is inactive by then.
    """

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._latest_ns: dict[Hashable, int] = {}  # publisher -> time of its latest message

    def record(self, publisher: Hashable, now_ns: int) -> None:
        """Record a message of ``publisher``."""
        self._latest_ns[publisher] = now_ns

    def forget(self) -> None:
        """Forget all publishers."""
        self._latest_ns.clear()

    def conflicting(self, now_ns: int) -> list[Hashable]:
        """Return the active publishers if there are several, otherwise an empty list."""
        self._latest_ns = {publisher: latest_ns for publisher, latest_ns in self._latest_ns.items()
                           if now_ns - latest_ns <= self._window_ns}
        return list(self._latest_ns) if len(self._latest_ns) > 1 else []


class SequenceTracker:
    """
    Distinguishes publishers by the sequence numbers of their messages.

    A number that does not continue a known sequence belongs to another publisher. For ROS 2 before
    Kilted, whose rclpy provides these numbers but not the identifier of the publisher.
    """

    def __init__(self) -> None:
        self._latest: list[int] = []

    def publisher(self, number: int) -> int:
        """Return the index of the publisher that sent message ``number``, counted from 0."""
        gaps = [(number - latest, index) for index, latest in enumerate(self._latest)
                if 0 < number - latest <= c.MAX_SEQUENCE_GAP]
        if not gaps:
            self._latest.append(number)
            return len(self._latest) - 1
        _, index = min(gaps)
        self._latest[index] = number
        return index


@dataclass
class _Input:
    priority: int
    timeout_ns: int
    command: VelocityCommand | None = None
    received_ns: int = 0
    blocked: bool = False  # conflicting publishers


class VelocityMux:
    """
    Selects among named inputs as twist_mux does: higher numbers have priority.

    An input is valid until its time-out after its latest command. A blocked input, one with
    conflicting publishers, stops the robot unless an input of higher priority is valid. Times are
    nanoseconds of one steady clock.
    """

    def __init__(self, inputs: list[tuple[str, int, float]]) -> None:
        """Create the inputs from (name, priority, time-out [s])."""
        self._inputs = {name: _Input(priority, round(timeout * NS_PER_S))
                        for name, priority, timeout in inputs}
        self._order = sorted(self._inputs, key=lambda name: -self._inputs[name].priority)

    def set_command(self, name: str, command: VelocityCommand, received_ns: int) -> None:
        """Set the command of the input ``name`` and unblock it."""
        item = self._inputs[name]
        item.command, item.received_ns, item.blocked = command, received_ns, False

    def block(self, name: str) -> None:
        """Block the input ``name`` until it is unblocked or gets a new command."""
        self._inputs[name].command = None
        self._inputs[name].blocked = True

    def unblock(self, name: str) -> None:
        """Unblock the input ``name``; it is valid from its next command on."""
        self._inputs[name].blocked = False

    def discard(self) -> None:
        """Discard all commands."""
        for item in self._inputs.values():
            item.command = None

    def selected(self, now_ns: int) -> tuple[str, VelocityCommand] | None:
        """Return the selected input and its command; None if the robot must stop."""
        for name in self._order:
            item = self._inputs[name]
            if item.blocked:
                return None
            if item.command is not None and now_ns - item.received_ns <= item.timeout_ns:
                return name, item.command
        return None
