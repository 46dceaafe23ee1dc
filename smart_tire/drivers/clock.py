# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The clock of drivers and nodes: reading it, sleeping, waiting. Tests replace it by another."""

from __future__ import annotations

from collections.abc import Callable
import os
import threading
import time

from smart_tire.drivers.simulated_time import NEVER, SimulatedTime, VARIABLE
from smart_tire.samples import NS_PER_S

MIN_WAIT = 0.5e-3   # s, between two looks at a time that stands
LAG_NS = 2_000_000  # ns that a simulated time passes while a thread should act, at most


class Clock:
    """
    Time of this machine, or of the simulated robot that runs on it; the only source of time.

    It is ``simulated`` after ``follow_environment`` in a process that was started with such a
    time. It then waits for each thread that has called ``act``: this acts when it says, and after
    each ``wait`` or ``sleep``, and the time passes by ``LAG_NS`` at most meanwhile.
    """

    simulated: SimulatedTime | None = None
    _of_thread = threading.local()  # by which it announces

    def follow_environment(self) -> None:
        """Use the simulated time that the environment names; raise ParameterError without it."""
        if path := os.environ.get(VARIABLE):
            self.simulated = SimulatedTime(path)

    def leave(self) -> None:
        """Let a simulated time pass without this process, which ends."""
        if self.simulated is not None:
            self.simulated.leave()

    def now_ns(self) -> int:
        """Return the steady time [ns]."""
        return time.monotonic_ns() if self.simulated is None else self.simulated.now_ns()

    def now(self) -> float:
        """Return the steady time [s]."""
        return self.now_ns() / NS_PER_S

    def time_ns(self) -> int:
        """Return the time since the epoch [ns]."""
        simulated = self.simulated
        return time.time_ns() if simulated is None else simulated.epoch_ns + simulated.now_ns()

    def sleep(self, seconds: float) -> None:
        """Return after ``seconds``."""
        if self.simulated is None:
            time.sleep(seconds)
        else:
            self.wait(threading.Event(), seconds)

    def wait(self, event: threading.Event, seconds: float) -> bool:
        """Return when ``event`` is set, or after ``seconds``; return whether it is set."""
        if self.simulated is None:
            return event.wait(seconds)
        end_ns, left = self.now_ns() + round(seconds * NS_PER_S), seconds
        if hasattr(self._of_thread, 'announce'):
            self.act(end_ns)
        while left > 0.0 and not event.wait(max(left, MIN_WAIT)):
            left = (end_ns - self.now_ns()) / NS_PER_S
        return event.is_set()

    def act(self, due_ns: int | None) -> None:
        """Announce when this thread acts, see ``join``."""
        if self.simulated is None:
            return
        if not hasattr(self._of_thread, 'announce'):
            self._of_thread.announce = self.join(threading.current_thread().name)
        self._of_thread.announce(due_ns)

    def join(self, name: str) -> Callable[[int | None], None]:
        """
        Return the function by which ``name`` announces the steady time [ns] at which it acts.

        None: not any more. It does nothing unless the time is simulated.
        """
        if self.simulated is None:
            return lambda due_ns: None
        participant = self.simulated.join(name)
        return lambda due_ns: participant.permit(NEVER if due_ns is None else due_ns + LAG_NS)


SYSTEM = Clock()
