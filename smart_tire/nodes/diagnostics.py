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

"""Node diagnostics as specified in REP-107: one status with level, message and exact counts."""

from __future__ import annotations

from dataclasses import dataclass, field
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from smart_tire.samples import NS_PER_S


@dataclass
class InputCounter:
    """Counts accepted and rejected messages, frames or replies of one stream."""

    required: bool = False      # whether silence of the stream is a fault
    ok: int = 0                 # accepted
    bad: int = 0                # rejected
    last_ns: int | None = None  # steady clock, arrival of the latest accepted one
    latest: str = ''            # reason of the latest rejection
    reported: int = 0           # ``bad`` at the last report

    def accept(self, now_ns: int, count: int = 1) -> None:
        """Count ``count`` accepted inputs that arrived at ``now_ns``."""
        self.ok += count
        self.last_ns = now_ns

    def reject(self, reason: str = '') -> bool:
        """Count a rejected input; return whether to log it: the 1st, 2nd, 4th, 8th ... time."""
        self.bad += 1
        self.latest = reason
        return self.bad.bit_count() == 1

    def age(self, now_ns: int) -> float:
        """Return the time since the latest accepted input [s], infinite if there was none."""
        return math.inf if self.last_ns is None else (now_ns - self.last_ns) / NS_PER_S

    def newly_bad(self) -> int:
        """Return the number of rejections since the previous call."""
        new, self.reported = self.bad - self.reported, self.bad
        return new


@dataclass
class Status:
    """Diagnostic status of a node; errors take precedence over warnings in the level."""

    warnings: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    values: dict[str, Any] = field(default_factory=dict)

    def warn(self, text: str) -> None:
        """Add a problem with which the node still does its work."""
        self.warnings.append(text)

    def error(self, text: str) -> None:
        """Add a problem that prevents the node from doing its work."""
        self.errors.append(text)

    def message(self, name: str, hardware: str = '') -> DiagnosticStatus:
        """Return the DiagnosticStatus of the component ``name``."""
        level = DiagnosticStatus.OK
        if self.warnings or self.errors:
            level = DiagnosticStatus.ERROR if self.errors else DiagnosticStatus.WARN
        return DiagnosticStatus(
            level=level, name=name, hardware_id=hardware,
            message='; '.join(self.errors + self.warnings) or 'ok',
            values=[KeyValue(key=key, value=_text(value)) for key, value in self.values.items()])


def diagnostic_array(stamp: Any, status: DiagnosticStatus) -> DiagnosticArray:
    """Return a DiagnosticArray that contains ``status`` only."""
    array = DiagnosticArray(status=[status])
    array.header.stamp = stamp
    return array


def _text(value: Any) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
