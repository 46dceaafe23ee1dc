"""Health of a node as REP-107 wants it: one status, a level, a sentence, and exact counts."""

from __future__ import annotations

from dataclasses import dataclass, field
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from smart_tire.samples import NS_PER_S


@dataclass
class InputCounter:
    """What became of the messages, frames or replies of one stream."""

    required: bool = False      # whether its silence is a fault
    ok: int = 0
    bad: int = 0
    last_ns: int | None = None  # steady clock, when the last good one came
    latest: str = ''            # what was wrong with the latest bad one
    reported: int = 0           # ``bad`` at the last report

    def good(self, now_ns: int, count: int = 1) -> None:
        """Count good ones that came at ``now_ns``."""
        self.ok += count
        self.last_ns = now_ns

    def fail(self, reason: str = '') -> bool:
        """Count a bad one; return whether it is the 1st, 2nd, 4th, 8th ... and worth a line."""
        self.bad += 1
        self.latest = reason
        return self.bad.bit_count() == 1

    def age(self, now_ns: int) -> float:
        """Return the seconds since the last good one, infinite if there was none."""
        return math.inf if self.last_ns is None else (now_ns - self.last_ns) / NS_PER_S

    def newly_bad(self) -> int:
        """Return how many were bad since this was last asked."""
        new, self.reported = self.bad - self.reported, self.bad
        return new


@dataclass
class Status:
    """What a node says of itself; the worst of its complaints gives the level."""

    complaints: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    values: dict[str, Any] = field(default_factory=dict)

    def warn(self, text: str) -> None:
        """Add something that is wrong while the node still does its work."""
        self.complaints.append(text)

    def error(self, text: str) -> None:
        """Add something that keeps the node from its work."""
        self.errors.append(text)

    def message(self, name: str, hardware: str = '') -> DiagnosticStatus:
        """Return the message for the component ``name``."""
        level = DiagnosticStatus.OK
        if self.complaints or self.errors:
            level = DiagnosticStatus.ERROR if self.errors else DiagnosticStatus.WARN
        return DiagnosticStatus(
            level=level, name=name, hardware_id=hardware,
            message='; '.join(self.errors + self.complaints) or 'ok',
            values=[KeyValue(key=key, value=_text(value)) for key, value in self.values.items()])


def diagnostic_array(stamp: Any, status: DiagnosticStatus) -> DiagnosticArray:
    """Return the array that carries ``status``."""
    array = DiagnosticArray(status=[status])
    array.header.stamp = stamp
    return array


def _text(value: Any) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)
