# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Subscription to a command topic with checks of age and of the number of publishers."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping
import math
import time
from typing import Any

from smart_tire.control.command_check import (
    check_age, PublisherMonitor, SequenceTracker, StallDetector, TransitTimes)
from smart_tire.errors import CommandError
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.compat import action_clients, publisher_names, UNDISCOVERED
from smart_tire.nodes.diagnostics import Status
from smart_tire.samples import NS_PER_S

ON_DEMAND = {'cmd_vel': 'trajectory_controller'}  # topic -> node that publishes temporarily
TICK_PERIOD = 0.025        # s, a tenth of the shortest stall that must be detected
MIN_PUBLISHER_WINDOW = 1.5  # s after its latest message that a publisher counts; a line fault ends
PUBLISHER_WINDOW_TIMEOUTS = 2.0  # the same in time-outs: a slow publisher must not be overlooked


def without_idle(topic: str, publishers: Iterable[str]) -> list[str]:
    """
    Return the nodes of ``publishers`` that may send at any time on ``topic``, one of ``TOPICS``.

    Left out is the one that publishes only while it follows a path: it is no second publisher as
    long as it is idle, and messages of both at the same time are detected as such.
    """
    return [name for name in publishers if name.rpartition('/')[2] != ON_DEMAND.get(topic)]


class PublisherCheck:
    """
    Names the publishers that send on the topic ``name`` within ``window`` [s], if several.

    With ``action``, those are the clients that send goals to the action ``name``.
    """

    def __init__(self, node: SmartTireNode[Any], name: str, window: float, *,
                 action: bool = False) -> None:
        self._node, self._name, self._action = node, name, action
        self._monitor = PublisherMonitor(round(window * NS_PER_S))
        self._sequences = SequenceTracker()
        self._latest: Hashable = None

    def record(self, sender: Hashable, now_ns: int, *, by_node: bool = False) -> str:
        """
        Record a message; return the text for a conflict of publishers, '' if there is none.

        With ``by_node``, publishers of one node count once, and those that have ended do not. The
        sender of this message has not ended, even if it is not discovered yet.
        """
        self._latest = sender
        self._monitor.record(sender, now_ns)
        if not (publishers := self._monitor.conflicting(now_ns)):
            return ''
        existing = (action_clients if self._action else publisher_names)(self._node, self._name)
        if by_node and isinstance(sender, bytes):
            publishers = [item for item in publishers if item in existing or item == sender]
        names, count = self._names(publishers, existing), len(publishers)
        if by_node:
            names = sorted({*names})
            count = len(names)
        kind = 'clients of' if self._action else 'publishers on'
        return f'{count} {kind} {self._name}: {", ".join(names)}' if count > 1 else ''

    def renew(self, now_ns: int) -> None:
        """Record that what the latest sender has sent is still in force."""
        self._monitor.record(self._latest, now_ns)

    def forget(self) -> None:
        """Forget all senders and their sequence numbers: what they have sent is done."""
        self._monitor.forget()
        self._sequences = SequenceTracker()

    def conflicting(self, now_ns: int) -> bool:
        """Return whether several publishers are active."""
        return len(self._monitor.conflicting(now_ns)) > 1

    def sender(self, info: Mapping[str, Any]) -> Hashable:
        """Return the publisher of a message, once; rclpy of Jazzy gives sequence numbers only."""
        identifier = info.get('publisher_gid')
        if identifier is not None:
            return bytes(identifier['data'])
        return self._sequences.publisher(info['publication_sequence_number'])

    @staticmethod
    def _names(publishers: Iterable[Hashable], existing: Mapping[Hashable, str]) -> list[str]:
        """Return the nodes of ``publishers``; of all that exist if these are only numbers."""
        if any(isinstance(publisher, int) for publisher in publishers):
            return sorted(existing.values())
        return sorted(existing.get(publisher, UNDISCOVERED) for publisher in publishers)


class CommandInput:
    """
    Subscription of ``node`` to the commands on ``topic``, a topic of ``TOPICS``.

    Calls ``on_command`` with each accepted command and the time [ns] from which its ``timeout``
    [s] counts: its timestamp or its arrival, whichever is earlier. The timestamp of another host
    (not ``same_host``), whose clock may be off by ``max_age`` [s], counts only for a command that
    may have been queued while this process was stopped. Refused are expired commands, those older
    or further in the future than ``max_age`` (None: timestamps are not read), those that may have
    been queued without a timestamp, and all while two publishers send: ``on_conflict`` is then
    called with the reason, and with '' when the conflict ends. ``from_msg`` replaces the
    conversion of the topic, ``unstamped_type`` its type, for messages without a timestamp by
    design.
    """

    def __init__(self, node: SmartTireNode[Any], topic: str,
                 on_command: Callable[[Any, int], None],
                 on_conflict: Callable[[str], None], *, timeout: float,
                 max_age: float | None = None, same_host: bool = False,
                 name: str | None = None, required: bool = False, reliability: str = 'reliable',
                 from_msg: Callable[[Any], Any] | None = None,
                 unstamped_type: str | None = None) -> None:
        self._node, self._topic, self._name = node, topic, name or topic
        self._on_command, self._on_conflict, self._max_age = on_command, on_conflict, max_age
        self._timeout, self._same_host = timeout, same_host
        window = max(MIN_PUBLISHER_WINDOW, PUBLISHER_WINDOW_TIMEOUTS * timeout)
        self._publishers = PublisherCheck(node, self._name, window)
        self._stalls, self._transit = StallDetector(node.steady_ns()), TransitTimes()
        self._conflict = ''
        self._warned_unstamped = unstamped_type is not None
        node.subscribe(topic, self._on_message, name=name, info=True, required=required,
                       announced=True, reliability=reliability, from_msg=from_msg,
                       type_name=unstamped_type)
        node.call_every(TICK_PERIOD, self.tick)

    def tick(self) -> None:
        """Detect stalls of this process and the end of a conflict."""
        now_ns = self._node.steady_ns()
        self._stalls.tick(now_ns)
        if self._conflict and not self._publishers.conflicting(now_ns):
            self._conflict = ''
            self._on_conflict('')

    def _on_message(self, command: Any, info: Mapping[str, Any]) -> None:
        now_ns = self._node.steady_ns()
        self._stalls.tick(now_ns)
        received_ns = info['received_timestamp']
        waited_ns = max(time.time_ns() - received_ns, 0)
        sender = self._publishers.sender(info)
        excess_ns = self._transit.excess(sender, received_ns - info['source_timestamp'])
        self._check_publisher(sender, now_ns)
        queued = self._stalls.may_be_queued(now_ns - waited_ns, excess_ns)
        self._on_command(command, now_ns - self._age(command, now_ns, waited_ns, queued=queued))

    def _age(self, command: Any, now_ns: int, waited_ns: int, *, queued: bool) -> int:
        """Return the age [ns] of a command; raise CommandError if it is not of the present."""
        age_ns = waited_ns
        if self._max_age is not None:
            by_stamp = queued or self._same_host
            oldest_ns = check_age(self._name, command.stamp_ns, self._node.now_ns(), waited_ns,
                                  self._max_age, self._timeout if by_stamp else math.inf)
            age_ns = oldest_ns if by_stamp else waited_ns
        if queued and not (self._max_age and command.stamp_ns):
            raise CommandError(f'{self._name}: was queued while this process was stopped')
        if self._max_age is not None and not command.stamp_ns and not self._warned_unstamped:
            self._warned_unstamped = True
            self._node.get_logger().warning(
                f'{self._name} has no timestamp: its age is counted from its arrival')
        return age_ns

    def _check_publisher(self, sender: Hashable, now_ns: int) -> None:
        """Raise CommandError while more than one publisher sends."""
        if text := self._publishers.record(sender, now_ns):
            self._conflict = text
            self._on_conflict(text)
            raise CommandError(text)

    def fill_status(self, status: Status) -> None:
        """Add a conflict of publishers, and a warning while a second publisher exists."""
        if self._conflict:
            status.error(f'motors stopped: {self._conflict}')
        elif len(names := without_idle(self._topic, (
                name for name in publisher_names(self._node, self._name).values()
                if name != UNDISCOVERED))) > 1:
            status.warn(f'{len(names)} publishers exist on {self._name}: '
                        + ', '.join(sorted(names)))
