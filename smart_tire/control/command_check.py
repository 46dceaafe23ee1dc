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

from collections.abc import Callable, Hashable, Mapping
import math
from typing import Any

from smart_tire.control import constants as c
from smart_tire.control.publishers import MessageInfo, PublisherCheck, renew
from smart_tire.errors import CommandError, LateCommandError
from smart_tire.samples import FIRST_DATE_NS, NS_PER_S, VelocityCommand

NO_CLOCK = 'use_sim_time is set, but nothing was received on /clock'


class StallDetector:
    """
    Detects messages that were queued while this process was stopped.

    Their DDS reception time is the time at which the process resumed, as if they had just
    arrived, or later, if the transport repeats them. Call ``tick`` more often than every
    ``MIN_STALL_NS``, or the shortest stall that counts. Times are nanoseconds of one steady clock.
    """

    def __init__(self, now_ns: int) -> None:
        self._ticked_ns = self._stalled_ns = self._drained_ns = now_ns
        self._resumed_ns: int | None = None
        self.stalls = 0

    def tick(self, now_ns: int, shortest_ns: int = 0) -> None:
        """Record that the process is running, after a stall if it is long enough."""
        if now_ns - self._ticked_ns > max(shortest_ns, c.MIN_STALL_NS):
            if self._ticked_ns >= self._drained_ns:  # otherwise still the backlog of the last one
                self._stalled_ns = self._ticked_ns
            self._resumed_ns = now_ns
            self._drained_ns = 2 * now_ns - self._stalled_ns + c.REPAIR_NS
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
        as the stall, and what it has lost is repeated within ``REPAIR_NS``.
        """
        return received_ns - self._stalled_ns if received_ns < self._drained_ns else 0


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
        reason = '' if now_ns >= FIRST_DATE_NS or stamp_ns < FIRST_DATE_NS else (
            ': its time is that of a host, that of this node simulated')
        raise LateCommandError(
            f'{topic}: {ahead:.3g} s ahead, expected at most {max_age:g} s{reason}' if now_ns else
            f'{topic}: this node has no time: {NO_CLOCK}')
    age_ns = max(now_ns - stamp_ns, waited_ns) if stamp_ns else waited_ns
    if age_ns > min(max_age, timeout) * NS_PER_S:
        raise LateCommandError(f'{topic}: {age_ns / NS_PER_S:.3g} s old, expected at most '
                               f'{min(max_age, timeout):g} s')
    return age_ns


class CommandCheck:
    """
    Checks the commands on the topic ``name`` before ``on_command`` gets them.

    Calls ``on_command`` with each accepted command and the steady time [ns] from which its
    ``timeout`` [s] counts: its timestamp or its arrival, whichever is earlier. The timestamp of
    another host (not ``same_host``), whose clock may be off by ``max_age`` [s], counts only for a
    command that may have been queued while this process was stopped. Refused are expired commands,
    those older or further in the future than ``max_age`` (None: timestamps are not read), those
    that may have been queued without a timestamp, and all while two publishers send:
    ``on_conflict`` is then called with the reason, and with '' when the conflict ends.
    ``existing`` returns the nodes of the publishers in the graph; ``warn`` is called once if a
    command has no timestamp.
    """

    def __init__(self, name: str, existing: Callable[[], Mapping[Hashable, str]],
                 on_command: Callable[[Any, int], None], on_conflict: Callable[[str], None],
                 now_ns: int, *, timeout: float, max_age: float | None = None,
                 same_host: bool = False,
                 warn: Callable[[str], None] = lambda text: None) -> None:
        window = max(c.MIN_PUBLISHER_WINDOW, c.PUBLISHER_WINDOW_TIMEOUTS * timeout)
        self._publishers = PublisherCheck(name, window, existing)
        self._name, self._warn = name, warn
        self._on_command, self._on_conflict, self._max_age = on_command, on_conflict, max_age
        self._timeout, self._same_host = timeout, same_host
        self._stalls = StallDetector(now_ns)
        # of each publisher, whose clock may be another one: only the excess over it is known
        self._least_transit_ns: dict[Hashable, int] = {}
        self._warned = False
        self.conflict = ''  # its description while several publishers send

    def tick(self, now_ns: int) -> None:
        """Detect stalls of this process and the end of a conflict, at the steady ``now_ns``."""
        self._stalls.tick(now_ns)
        if self.conflict and not self._publishers.conflicting(now_ns):
            self.conflict = ''
            self._on_conflict('')

    def receive(self, command: Any, info: MessageInfo, now_ns: int, *, wall_ns: int,
                stamp_ns: int) -> None:
        """
        Check a command handled at the steady time ``now_ns``; raise CommandError if refused.

        ``info`` came with the message, ``wall_ns`` is the present time of its clock
        and ``stamp_ns`` that of the clock of timestamps, which may be simulated.
        """
        self._stalls.tick(now_ns)
        waited_ns = max(wall_ns - info.received_ns, 0)
        sender = self._publishers.sender(info)
        transit_ns = info.received_ns - info.source_ns
        least_ns = min(self._least_transit_ns.get(sender, transit_ns), transit_ns)
        renew(self._least_transit_ns, sender, least_ns)
        if text := self._publishers.record(sender, now_ns):
            self.conflict = text
            self._on_conflict(text)
            raise CommandError(text)
        queued = self._stalls.may_be_queued(now_ns - waited_ns, transit_ns - least_ns)
        self._on_command(command, now_ns - self._age(command, stamp_ns, waited_ns, queued=queued))

    def _age(self, command: Any, now_ns: int, waited_ns: int, *, queued: bool) -> int:
        """Return the age [ns] of a command; raise CommandError if it is not of the present."""
        age_ns = waited_ns
        if self._max_age is not None:
            by_stamp = queued or self._same_host
            oldest_ns = check_age(self._name, command.stamp_ns, now_ns, waited_ns, self._max_age,
                                  self._timeout if by_stamp else math.inf)
            age_ns = oldest_ns if by_stamp else waited_ns
        if queued and not (self._max_age and command.stamp_ns):
            raise CommandError(f'{self._name}: was queued while this process was stopped')
        if self._max_age is not None and not command.stamp_ns and not self._warned:
            self._warned = True
            self._warn(f'{self._name} has no timestamp: its age is counted from its arrival')
        return age_ns


class VelocityMux:
    """
    Selects among named inputs as twist_mux does: higher numbers have priority.

    An input is valid until its time-out after its latest command. A blocked input, one with
    conflicting publishers, stops the robot unless an input of higher priority is valid. Times are
    nanoseconds of one steady clock.
    """

    def __init__(self, inputs: list[tuple[str, int, float]]) -> None:
        """Create the inputs from (name, priority, time-out [s])."""
        self._timeouts_ns = {name: round(timeout * NS_PER_S) for name, _, timeout in sorted(
            inputs, key=lambda item: -item[1])}
        self._commands: dict[str, tuple[VelocityCommand, int]] = {}  # and when they expire
        self._blocked: set[str] = set()

    def set_command(self, name: str, command: VelocityCommand, received_ns: int) -> None:
        """Set the command of the input ``name`` and unblock it."""
        self._commands[name] = command, received_ns + self._timeouts_ns[name]
        self.unblock(name)

    def block(self, name: str) -> None:
        """Block the input ``name`` until it is unblocked or gets a new command."""
        self._commands.pop(name, None)
        self._blocked.add(name)

    def unblock(self, name: str) -> None:
        """Unblock the input ``name``; it is valid from its next command on."""
        self._blocked.discard(name)

    def discard(self) -> None:
        """Discard all commands."""
        self._commands.clear()

    def selected(self, now_ns: int) -> tuple[str, VelocityCommand] | None:
        """Return the selected input and its command; None if the robot must stop."""
        for name in self._timeouts_ns:
            if name in self._blocked:
                return None
            if (held := self._commands.get(name)) and now_ns <= held[1]:
                return name, held[0]
        return None
