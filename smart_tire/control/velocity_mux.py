"""Several sources of body velocity commands: the one of highest priority that is fresh."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.samples import NS_PER_S, VelocityCommand


@dataclass
class _Input:
    priority: int
    timeout_ns: int
    command: VelocityCommand | None = None
    received_ns: int = 0
    blocked: bool = False  # publishers contradict each other


class VelocityMux:
    """
    Selects among named inputs as twist_mux does: a higher number has priority.

    An input counts until its time-out after its latest command. One that is blocked, because
    publishers contradict each other on it, stops the robot unless an input of higher priority is
    in use. Times are nanoseconds of one steady clock.
    """

    def __init__(self, inputs: list[tuple[str, int, float]]) -> None:
        """Take (name, priority, time-out [s]) of each input."""
        self._inputs = {name: _Input(priority, round(timeout * NS_PER_S))
                        for name, priority, timeout in inputs}
        self._order = sorted(self._inputs, key=lambda name: -self._inputs[name].priority)

    def take(self, name: str, command: VelocityCommand, received_ns: int) -> None:
        """Take a command of the input ``name``."""
        item = self._inputs[name]
        item.command, item.received_ns, item.blocked = command, received_ns, False

    def block(self, name: str) -> None:
        """Refuse the input ``name`` until it is unblocked or commands again."""
        self._inputs[name].command = None
        self._inputs[name].blocked = True

    def unblock(self, name: str) -> None:
        """Let the input ``name`` count again, from its next command on."""
        self._inputs[name].blocked = False

    def discard(self) -> None:
        """Forget all commands."""
        for item in self._inputs.values():
            item.command = None

    def selected(self, now_ns: int) -> tuple[str, VelocityCommand] | None:
        """Return the input in use and its command; None if the robot has to stop."""
        for name in self._order:
            item = self._inputs[name]
            if item.blocked:
                return None
            if item.command is not None and now_ns - item.received_ns <= item.timeout_ns:
                return name, item.command
        return None
