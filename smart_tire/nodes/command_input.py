"""A topic that only one publisher may command: fresh messages in, everything else refused."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
import time
from typing import Any

from smart_tire.control.command_check import (
    check_age, PublisherMonitor, SequenceTracker, StallDetector)
from smart_tire.errors import CommandError
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.compat import endpoint_names
from smart_tire.nodes.diagnostics import Status
from smart_tire.samples import NS_PER_S

TICK = 0.025       # s between looks at the clock, a tenth of the shortest stall
MIN_WINDOW = 1.5   # s after its latest message for which a publisher counts, above a line fault
WINDOWS = 2.0      # time-outs, likewise: one that is slow but in force must not be overlooked


class CommandInput:
    """
    Subscribes ``node`` to the commands on ``topic``, a topic of the contract.

    ``handle`` gets each command that is of the present with the time of its arrival [ns]; a
    ``max_age`` of None leaves the stamps unchecked. Messages that were queued while the process
    was stopped are refused, as far as their stamps do not tell their age. As long as two
    publishers send, both are refused, and ``on_conflict`` gets the reason, or '' at the end.
    """

    def __init__(self, node: SmartTireNode[Any], topic: str, handle: Callable[[Any, int], None],
                 on_conflict: Callable[[str], None], *, timeout: float,
                 max_age: float | None = None, name: str | None = None,
                 required: bool = False, reliability: str = 'reliable') -> None:
        self._node, self._topic, self._name = node, topic, name or topic
        self._handle, self._on_conflict, self._max_age = handle, on_conflict, max_age
        self._monitor = PublisherMonitor(round(max(MIN_WINDOW, WINDOWS * timeout) * NS_PER_S))
        self._sequences = SequenceTracker()
        self._stalls = StallDetector(node.steady_ns())
        self._conflict = ''
        self._unstamped = False
        node.subscribe(topic, self._on_message, name=name, info=True, required=required,
                       reliability=reliability)
        node.every(TICK, self.tick)

    def tick(self) -> None:
        """Notice a stall, and the end of a conflict."""
        now_ns = self._node.steady_ns()
        self._stalls.tick(now_ns)
        if self._conflict and not self._monitor.conflicting(now_ns):
            self._conflict = ''
            self._on_conflict('')

    def _on_message(self, command: Any, info: Mapping[str, Any]) -> None:
        now_ns = self._node.steady_ns()
        self._stalls.tick(now_ns)
        waited_ns = max(time.time_ns() - info['received_timestamp'], 0)
        self._check_publisher(info, now_ns)
        if self._max_age is not None:
            check_age(self._name, command.stamp_ns, self._node.now_ns(), waited_ns,
                      self._max_age)
        age_checked = self._max_age and command.stamp_ns
        if not age_checked and self._stalls.may_be_queued(now_ns - waited_ns):
            raise CommandError(f'{self._name}: was queued while this process was stopped')
        if self._max_age is not None and not command.stamp_ns and not self._unstamped:
            self._unstamped = True
            self._node.get_logger().warning(
                f'{self._name} has no stamp: its age is taken from its arrival')
        self._handle(command, now_ns - waited_ns)

    def _check_publisher(self, info: Mapping[str, Any], now_ns: int) -> None:
        """Raise CommandError while more than one publisher sends."""
        self._monitor.record(self._publisher(info), now_ns)
        if rivals := self._monitor.conflicting(now_ns):
            text = f'{len(rivals)} publishers on {self._name}: {", ".join(self._names(rivals))}'
            self._conflict = text
            self._on_conflict(text)
            raise CommandError(text)

    def _publisher(self, info: Mapping[str, Any]) -> Hashable:
        """Return what identifies the publisher; Jazzy's rclpy gives the message's number only."""
        identifier = info.get('publisher_gid')
        if identifier is not None:
            return bytes(identifier['data'])
        return self._sequences.publisher(info['publication_sequence_number'])

    def _names(self, publishers: list[Hashable]) -> list[str]:
        names = endpoint_names(self._node, self._name)
        if any(isinstance(publisher, int) for publisher in publishers):
            return sorted(names.values())
        return sorted(names.get(publisher, 'a publisher not discovered yet')
                      if isinstance(publisher, bytes) else '' for publisher in publishers)

    def fill_status(self, status: Status) -> None:
        """Add who else publishes, or could."""
        if self._conflict:
            status.error(f'motors stopped: {self._conflict}')
        elif len(names := endpoint_names(self._node, self._name)) > 1:
            status.warn(f'{len(names)} publishers exist on {self._name}: '
                        + ', '.join(sorted(names.values())))
