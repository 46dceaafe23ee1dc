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

"""Multiplexer of velocity commands: selects the valid input with the highest priority."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.samples import NS_PER_S, VelocityCommand


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

    def update(self, name: str, command: VelocityCommand, received_ns: int) -> None:
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
