# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Inputs of a node, its port, and its diagnostics.

The log of the inputs has one line when an input is missing, begins, stops and returns, so that a
healthy node is silent after its start. The diagnostics are those of REP-107: one status with
level, message and exact counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
import math
import threading
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from smart_tire.host_load import EXPLAINED, HostLoad, PERIOD
from smart_tire.samples import NS_PER_S

CHECK_PERIOD = PERIOD           # s between calls of ``check``, the resolution of the gaps logged
WAIT_NS = 2 * NS_PER_S          # without a first message until a line
WAIT_FACTOR = 4                 # between the waiting times at which the line is repeated
SILENCE_NS = 2 * NS_PER_S       # without a message until an input is reported as lost
RATE_NS = NS_PER_S              # over which the rate is measured after the first message
PORT_GRACE_NS = 2 * NS_PER_S    # age of a port problem that is logged; a simulator starts in 1 s


@dataclass
class InputCounter:
    """Counts accepted and rejected messages, frames or replies of one stream."""

    required: bool = False      # whether silence of the stream is a fault
    ok: int = 0                 # accepted
    bad: int = 0                # rejected
    last_ns: int | None = None  # steady clock, arrival of the latest accepted one
    latest: str = ''            # reason of the latest rejection

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


@dataclass
class Status:
    """
    Diagnostic status of a node; errors take precedence over warnings in the level.

    While the host is late, the message says so, and nothing of what this explains.
    """

    warnings: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    values: dict[str, Any] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)  # those of the previous status
    explained: list[str] = field(default_factory=list)    # problems that a late host causes
    host: HostLoad | None = None

    def new(self, name: str, count: int) -> int:
        """Return by how much a count has grown since the previous status; it may restart at 0."""
        before, self.counts[name] = self.counts.get(name, 0), count
        return count - before if count >= before else count

    def warn(self, text: str, *, by_host: bool = False) -> None:
        """Add a problem with which the node still does its work; a late host may cause it."""
        self.warnings.append(text)
        self.explained += [text] * by_host

    def error(self, text: str, *, by_host: bool = False) -> None:
        """Add a problem that prevents the node from doing its work; a late host may cause it."""
        self.errors.append(text)
        self.explained += [text] * by_host

    def message(self, name: str, hardware: str = '') -> DiagnosticStatus:
        """Return the DiagnosticStatus of the component ``name``."""
        late = self.host is not None and self.host.late
        level, problems = DiagnosticStatus.OK, [*self.errors, *self.warnings]
        if problems or late:
            level = DiagnosticStatus.ERROR if self.errors else DiagnosticStatus.WARN
        if late:
            problems = [str(self.host), *(
                text for text in problems if text not in self.explained)]
        elif self.explained:
            self.values[EXPLAINED] = '; '.join(self.explained)
        return DiagnosticStatus(
            level=level, name=name, hardware_id=hardware,
            message='; '.join(problems) or 'ok',
            values=[KeyValue(key=key, value=_text(value)) for key, value in self.values.items()])


def diagnostic_array(stamp: Any, status: DiagnosticStatus) -> DiagnosticArray:
    """Return a DiagnosticArray that contains ``status`` only."""
    array = DiagnosticArray(status=[status])
    array.header.stamp = stamp
    return array


def _text(value: Any) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)


@dataclass
class InputWatch:
    """State of one input; ``poll`` returns what has changed."""

    name: str
    required: bool               # whether its absence is logged, not only its first message
    count: int = 0               # valid messages at the latest poll
    changed_ns: int = 0          # when the latest message was noticed
    first_ns: int | None = None  # when the first one was noticed
    first_count: int = 0
    announced: bool = False      # whether the first message was logged
    silent: bool = False         # whether the input is lost

    @property
    def waiting(self) -> bool:
        """Return whether a required input has sent no message yet."""
        return self.required and self.first_ns is None

    def poll(self, count: int, now_ns: int, *, excused: bool = False) -> tuple[str, str]:
        """
        Return a line of information and a warning, '' if nothing has changed.

        ``count`` is the number of valid messages until ``now_ns``. While ``excused`` the reason
        of silence is known and logged elsewhere.
        """
        if count > self.count:
            return self._on_message(count, now_ns), ''
        if self.first_ns is None:
            return '', ''
        if not self.announced:
            return self._announce(now_ns), ''
        if self.required and not self.silent and now_ns - self.changed_ns > SILENCE_NS:
            self.silent = True
            return '', '' if excused else f'no {self.name} for {SILENCE_NS / NS_PER_S:.1f} s'
        return '', ''

    def _on_message(self, count: int, now_ns: int) -> str:
        gap, returned = (now_ns - self.changed_ns) / NS_PER_S, self.silent
        self.count, self.changed_ns, self.silent = count, now_ns, False
        if self.first_ns is None:
            self.first_ns, self.first_count = now_ns, count
        if returned:
            return f'{self.name} again after {gap:.1f} s'
        return '' if self.announced else self._announce(now_ns)

    def _announce(self, now_ns: int) -> str:
        assert self.first_ns is not None
        duration_ns, new = now_ns - self.first_ns, self.count - self.first_count
        if duration_ns < RATE_NS:
            return ''
        self.announced = True
        rate = f' at {new * NS_PER_S / duration_ns:.3g} Hz' if new else ''
        return f'receiving {self.name}{rate}'


class InputLog:
    """
    Watches the inputs of a node and logs changes.

    ``check`` is to be called every CHECK_PERIOD.
    """

    def __init__(self, logger: Any, clock: Callable[[], int]) -> None:
        self._logger, self._clock = logger, clock  # ns, steady
        self._inputs: list[tuple[InputWatch, Callable[[], int], Callable[[], bool]]] = []
        self._since_ns = clock()     # start of the waiting time
        self._next_ns = WAIT_NS      # waiting time of the next line

    def watch(self, name: str, count: Callable[[], int], *, required: bool,
              excused: Callable[[], bool] = lambda: False) -> None:
        """Watch an input by its ``count`` of messages; silence is no news while ``excused``."""
        self._inputs.append((InputWatch(name, required), count, excused))

    def check(self) -> None:
        """Log what has changed since the previous call."""
        now_ns = self._clock()
        for watch, count, excused in self._inputs:
            info, warning = watch.poll(count(), now_ns, excused=excused())
            if info:
                self._logger.info(info)
            if warning:
                self._logger.warning(warning)
        self._log_waiting(now_ns)

    def _log_waiting(self, now_ns: int) -> None:
        waiting = [watch.name for watch, _, _ in self._inputs if watch.waiting]
        if any(watch.waiting and excused() for watch, _, excused in self._inputs):
            self._since_ns = now_ns  # its time begins when nothing else prevents the input
        waited_ns = now_ns - self._since_ns
        if waiting and waited_ns >= self._next_ns:
            self._next_ns *= WAIT_FACTOR
            self._logger.info(f'waiting for {", ".join(waiting)} ({waited_ns / NS_PER_S:.0f} s)')


class PortLog:
    """
    Log of a port: a problem is logged once it has lasted for PORT_GRACE_NS.

    A simulated device and its driver start together and end together with Ctrl-C; neither is an
    error. A shorter interruption is logged when the port is open again. The diagnostics report
    every problem at once. Methods may be called from any thread.
    """

    def __init__(self, logger: Any, clock: Callable[[], int]) -> None:
        self._logger, self._clock = logger, clock  # ns, steady
        self._lock = threading.Lock()
        self._pending: list[str] = []
        self._since_ns: int | None = None  # start of the present problem
        self._was_open = False

    def add_problem(self, text: str) -> None:
        """Add a new problem of the port."""
        with self._lock:
            self._pending.append(text)
            if self._since_ns is None:
                self._since_ns = self._clock()

    def opened(self, text: str) -> None:
        """Log that the port is open, after problems since it was open before."""
        with self._lock:
            if self._was_open:
                self._flush()
            self._pending.clear()
            self._since_ns, self._was_open = None, True
        self._logger.info(text)

    def check(self) -> None:
        """Log problems that have lasted; call this regularly."""
        with self._lock:
            if self._since_ns is not None and self._clock() - self._since_ns >= PORT_GRACE_NS:
                self._flush()

    def _flush(self) -> None:
        for text in self._pending:
            self._logger.error(text)
        self._pending.clear()
