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
Timers of a node, which the loop that spins it calls; how a simulated time waits for the node.

Those of rclpy would wake two threads each time. In simulated time, their callbacks would have to
reset them; each reset of one that is due again makes two events of one, so that the queue of an
executor grows faster than it is handled where a process gets little of a core.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from smart_tire.drivers.clock import SYSTEM
from smart_tire.drivers.simulated_time import NEVER, Participant
from smart_tire.samples import NS_PER_S

TIMER_LAG_NS = 20_000_000  # ns of simulated time that passes after a timer is due, at most


class LoopTimer:
    """
    A timer with the methods of those of rclpy.

    The loop awaits it if it ``wakes`` the node. An ``elastic`` one is called when the loop handles
    something in the second half of its period, and the next period begins then.
    """

    def __init__(self, clock: Callable[[], int], period: float, callback: Callable[[], None],
                 *, wakes: bool, elastic: bool) -> None:
        self.wakes = wakes
        self._clock, self._callback = clock, callback
        self._period_ns = round(period * NS_PER_S)
        self.early_ns = self._period_ns // 2 if elastic else 0
        self.reset()

    def reset(self) -> None:
        """Call the callback after a period from now on."""
        self.due_ns = self._clock() + self._period_ns

    def cancel(self) -> None:
        """Do not call the callback any more."""
        self.due_ns = NEVER

    def is_canceled(self) -> bool:
        """Return whether it is canceled."""
        return self.due_ns == NEVER

    def call(self, now_ns: int) -> None:
        """Call the callback, which is due at ``now_ns``, once if it was several times."""
        if self.early_ns:
            self.reset()
        else:
            self.due_ns += self._period_ns * (1 + (now_ns - self.due_ns) // self._period_ns)
        self._callback()


class Timers:
    """The timers of one node; a ``participant`` is what simulated time waits for."""

    def __init__(self, clock: Callable[[], int] = SYSTEM.now_ns) -> None:
        self.participant: Participant | None = None
        self._clock = clock  # ns, steady
        self._timers: list[LoopTimer] = []

    def add(self, period: float, callback: Callable[[], None], *, wakes: bool = True,
            elastic: bool = False) -> LoopTimer:
        """Return a new timer of ``period`` [s]."""
        self._timers.append(
            LoopTimer(self._clock, period, callback, wakes=wakes, elastic=elastic))
        return self._timers[-1]

    @property
    def due_ns(self) -> int:
        """Return when the loop must call ``handle`` at the latest."""
        return min([timer.due_ns for timer in self._timers if timer.wakes], default=NEVER)

    def handle(self) -> float:
        """Call the timers that are due; return the time [s] until the next one."""
        now_ns = self._clock()
        for timer in self._timers:
            if now_ns >= timer.due_ns - timer.early_ns:
                timer.call(now_ns)
        due_ns = self.due_ns
        if self.participant is not None:
            self.participant.permit(min(due_ns + TIMER_LAG_NS, NEVER))
        return math.inf if due_ns == NEVER else (due_ns - self._clock()) / NS_PER_S


def paced(on_sample: Callable[..., None], participant: Participant, lag_ns: int
          ) -> Callable[..., None]:
    """
    Return ``on_sample`` that permits the simulated time to pass until the next sample is due.

    This is ``lag_ns`` after the longest of the latest periods.
    """
    latest_ns = period_ns = 0

    def handle(sample: Any, *info: Any) -> None:
        nonlocal latest_ns, period_ns
        try:
            on_sample(sample, *info)
        finally:
            if latest_ns:  # periods vary, and samples may be missing
                period_ns = max(sample.stamp_ns - latest_ns, period_ns * 9 // 10)
            latest_ns = sample.stamp_ns
            behind_ns = SYSTEM.time_ns() - SYSTEM.now_ns()  # of the steady time
            if period_ns:
                participant.permit(latest_ns - behind_ns + period_ns + lag_ns)

    return handle
