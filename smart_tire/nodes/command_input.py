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

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
import time
from typing import Any

from smart_tire.control.command_check import CommandCheck
from smart_tire.control.publishers import MessageInfo, UNDISCOVERED
from smart_tire.drivers.clock import SYSTEM
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.compat import publisher_names
from smart_tire.nodes.diagnostics import Status

TICK_PERIOD = 0.1  # s, between looks for stalls; less than MIN_STALL_NS by what a timer is late
ON_DEMAND = {'cmd_vel': 'trajectory_controller'}  # topic -> node that publishes temporarily


def without_idle(topic: str, publishers: Iterable[str]) -> list[str]:
    """
    Return the nodes of ``publishers`` that may send at any time on ``topic``, one of ``TOPICS``.

    Left out is the one that publishes only while it follows a path: it is no second publisher as
    long as it is idle, and messages of both at the same time are detected as such.
    """
    return [name for name in publishers if name.rpartition('/')[2] != ON_DEMAND.get(topic)]


@dataclass(frozen=True, kw_only=True)
class CommandTopic:
    """A topic of commands: what is expected on it; ``CommandCheck`` describes the bounds."""

    topic: str                  # of ``TOPICS``
    name: str | None = None     # of the topic, if it is another one
    timeout: float              # s
    max_age: float | None = None  # s
    same_host: bool = False
    required: bool = False
    reliability: str = 'reliable'
    from_msg: Callable[[Any], Any] | None = None  # instead of the conversion of the topic
    unstamped_type: str | None = None  # instead of its type: messages without a timestamp


class CommandInput:
    """Subscription of ``node`` to commands."""

    def __init__(self, node: SmartTireNode[Any], commands: CommandTopic,
                 on_command: Callable[[Any, int], None],
                 on_conflict: Callable[[str], None]) -> None:
        self._node, self._topic = node, commands.topic
        self._name = commands.name or commands.topic
        warn = {} if commands.unstamped_type else {'warn': node.get_logger().warning}
        self._check = CommandCheck(
            self._name, partial(publisher_names, node, self._name), on_command, on_conflict,
            node.steady_ns(), timeout=commands.timeout, max_age=commands.max_age,
            same_host=commands.same_host, **warn)
        node.subscribe(commands.topic, self._on_message, name=commands.name, info=True,
                       required=commands.required, announced=True,
                       reliability=commands.reliability, from_msg=commands.from_msg,
                       type_name=commands.unstamped_type)
        node.call_every(
            TICK_PERIOD, lambda: self._check.tick(node.steady_ns()), elastic=True)

    def _on_message(self, command: Any, info: MessageInfo) -> None:
        wall_ns = time.time_ns()
        if SYSTEM.simulated is not None:  # in which the transit of this message is not known
            info = replace(info, source_ns=wall_ns, received_ns=wall_ns)
        self._check.receive(command, info, self._node.steady_ns(), wall_ns=wall_ns,
                            stamp_ns=self._node.now_ns())

    def fill_status(self, status: Status) -> None:
        """Add a conflict of publishers, and a warning while a second publisher exists."""
        if self._check.conflict:
            status.error(f'motors stopped: {self._check.conflict}')
        elif len(names := without_idle(self._topic, (
                name for name in publisher_names(self._node, self._name).values()
                if name != UNDISCOVERED))) > 1:
            status.warn(f'{len(names)} publishers exist on {self._name}: '
                        + ', '.join(sorted(names)))
