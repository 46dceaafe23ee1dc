# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How late the timers of this process are because other programs use the processor cores."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import FileIO
import os
from pathlib import Path
import threading

SCHEDSTAT = Path('/proc/thread-self/schedstat')  # ns running, ns waiting for a core, time slices
MAX_BYTES = 64                # of these three numbers
PERIOD = 0.1                  # s between checks
WINDOW = 100                  # latest checks
WINDOW_TIME = WINDOW * PERIOD  # s
SHARE = 0.99                  # of the checks that were at most ``typical`` late
CORES = os.cpu_count() or 1   # asking again takes longer than the statistics
MAX_LATENESS = 0.020          # s, of a robot at work; reorder_window of the estimators is 0.03
PREFIX = 'timers late by'  # of the text
TOLERANCE = 1e-3              # s, by which clocks of timers may differ
EXPLAINED = 'host.explained'   # parts of a message that a late host causes
FACTOR = 'real_time_factor'      # of the simulator: simulated over real time
WAITED_FOR = 'time_waited_for.'  # of the simulator, with a node: real time [s] that it waited
GIVEN_UP = 'time_passed_without.'  # of the simulator, with a node: how often
FULL_SPEED = 0.95                # factor of a host that keeps up
KEYS = tuple(f'host.{name}' for name in ('timer_lateness', 'longest_lateness', 'load', 'cores'))


@dataclass(frozen=True)
class HostLoad:
    """Lateness of timers [s] and the load of the host while it was measured."""

    typical: float  # of ``SHARE`` of the timers at most
    longest: float
    load: float     # processes that want to run, average of one minute
    cores: int

    @property
    def late(self) -> bool:
        """Return whether the lateness disturbs the robot."""
        return self.typical > MAX_LATENESS

    @property
    def values(self) -> dict[str, float]:
        """Return the values by their names in the diagnostics."""
        return dict(zip(KEYS, (self.typical, self.longest, self.load, self.cores)))

    def __str__(self) -> str:
        return (f'{PREFIX} {1e3 * self.typical:.0f} ms ({SHARE:.0%}), '
                f'load {self.load:.1f} on {self.cores} cores: end other programs')


def host_load(late: Sequence[float]) -> HostLoad:
    """Return the load of this host and the statistics of the latenesses [s] of timers."""
    found = sorted(late) or [0.0]
    return HostLoad(
        found[int(SHARE * (len(found) - 1))], found[-1], os.getloadavg()[0], CORES)


def worst_of(diagnostics: Iterable[Mapping[str, str | float]]) -> HostLoad | None:
    """Return the greatest lateness in the diagnostics of nodes; None if they have none."""
    found: list[HostLoad] = []
    for values in diagnostics:
        try:
            typical, longest, load, cores = (float(values[key]) for key in KEYS)
        except (KeyError, ValueError):  # of another program
            continue
        found.append(HostLoad(typical, longest, load, int(cores)))
    return max(found, key=lambda one: one.typical, default=None)


def pace_lines(simulators: Iterable[Mapping[str, str | float]]) -> Iterator[str]:
    """
    Yield what the diagnostics of the simulator say of the host, in their order; nothing without.

    A simulated time that passed slower is no error of the results; one that passed without a node
    that was silent for long is.
    """
    found = [values for values in simulators if FACTOR in values]
    if not found:
        return
    factor = len(found) / sum(1.0 / max(float(values[FACTOR]), 1e-3) for values in found)
    if factor < FULL_SPEED:
        yield f'{factor:.2g} x real time: waiting for nodes'
    given_up = [f'{key.removeprefix(GIVEN_UP)} ({count} x)'
                for key, count in found[-1].items() if key.startswith(GIVEN_UP)]
    if given_up:
        yield ('starved: simulated time passed without '
               f'{", ".join(given_up)}, so that the results are worse: end other programs')


def other_problems(status: str, values: Mapping[str, str], *, late: bool) -> str:
    """
    Return what the text of a diagnostic ``status`` says of other things than the host.

    If the host is ``late``, also without what its node has marked as explained by this.
    """
    explained = values.get(EXPLAINED, '').split('; ') if late else []
    return '; '.join(part for part in status.split('; ')
                     if not part.startswith(PREFIX) and part not in explained)


class TimerLateness:
    """
    Lateness of a periodic timer for which other programs are the reason.

    A timer is also late after a long callback of its own thread. The kernel counts how long a
    thread that could run has waited for a core: lateness beyond this is not counted. Without this
    count, which some containers hide, nothing is. The thread need not wake up for the timer.
    """

    def __init__(self, period: float, waited: Callable[[], float] | None = None) -> None:
        self._period = period  # s
        self._waited = waited or CoreWait()
        self._due: float | None = None
        self._waited_before = 0.0
        self._late: deque[float] = deque(maxlen=WINDOW)

    def check(self, now: float) -> None:
        """
        Count the calls of the timer that were due until ``now`` [s], also those that it skips.

        Call this on the thread of the timer, when it calls and whenever the lateness matters.
        """
        waited = self._waited()
        lost, self._waited_before = waited - self._waited_before, waited
        due = now if self._due is None else self._due
        while due <= now + TOLERANCE:
            late = now - due
            # earlier calls fell into the sleep of a node without input, which no wait had ended
            self._late.append(max(0.0, min(late, lost)) if late <= lost + self._period else 0.0)
            due += self._period
        self._due = due

    @property
    def load(self) -> HostLoad:
        """Return the lateness in the latest ``WINDOW`` checks."""
        return host_load(self._late)


class CoreWait:
    """
    For how long the calling thread has waited for a core, by the count of the kernel.

    Its file remains open, since opening it takes most of the time. Each thread has one of its own,
    as the process has after a fork.
    """

    def __init__(self) -> None:
        self._file: FileIO | None = None
        self._thread = 0  # whose file it is

    def __call__(self) -> float:
        """Return the time [s]; 0 if it is unknown."""
        thread = threading.get_native_id()
        try:
            if self._file is None or thread != self._thread:
                self._file, self._thread = FileIO(SCHEDSTAT), thread
            return int(os.pread(self._file.fileno(), MAX_BYTES, 0).split()[1]) * 1e-9
        except (OSError, ValueError, IndexError):  # also of a file that was closed
            self._file = None
            return 0.0
