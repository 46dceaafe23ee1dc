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

"""Diagnostic statuses of nodes, from ``diagnostic_msgs/DiagnosticArray``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class NodeStatus:
    """Diagnostic status of a node."""

    name: str               # fully qualified, without the leading slash
    level: int              # DiagnosticStatus: 0 OK, 1 warning, 2 error, 3 stale
    message: str
    values: dict[str, str]


def statuses_from_msg(msg: Any) -> list[NodeStatus]:
    """Return the statuses in a DiagnosticArray."""
    return [NodeStatus(status.name, _level(status.level), status.message,
                       {item.key: item.value for item in status.values})
            for status in msg.status]


def _level(level: bytes | int) -> int:
    return level[0] if isinstance(level, bytes) else int(level)  # rclpy has a byte
