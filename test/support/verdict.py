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
Verdict on a bound in real time, on a machine that other programs use as well.

While a thread waits on a run queue, its program is not the one that is slow. A measured time above
the bound proves a defect only if it is above the bound without the waiting times of all processes
on the path; between the two nothing is proven, and the scenario is repeated.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from enum import Enum
from pathlib import Path

import pytest

MAX_TRIALS = 5
PROC = Path('/proc')


class Verdict(Enum):
    """What a measured time says about a bound."""

    PASS = 'pass'
    FAIL = 'fail'
    INCONCLUSIVE = 'inconclusive'


def verdict(measured: float, waited: float, bound: float) -> Verdict:
    """Return the verdict on ``measured`` [s], of which threads waited ``waited`` [s]."""
    if measured <= bound:
        return Verdict.PASS
    return Verdict.FAIL if measured - waited > bound else Verdict.INCONCLUSIVE


class RunQueues:
    """
    Time that all threads of some processes have waited on a run queue since they were added.

    What a thread waited is lost when it ends: ``seconds`` counts it until it was last called.
    """

    def __init__(self, *processes: int, proc: Path = PROC) -> None:
        """Begin with the ``processes`` of these ids; ``proc`` has a folder of each."""
        self._proc = proc
        self._processes: list[int] = []
        self._begin: dict[Path, int] = {}   # thread -> ns when its process was added
        self._latest: dict[Path, int] = {}  # thread -> ns, of those that began later as well
        for process in processes:
            self.add(process)

    def add(self, process: int) -> None:
        """Add a process that has just started, or is on the path from now on."""
        self._processes.append(process)
        self._begin.update(self._read(process))

    def seconds(self) -> float:
        """Return the sum over all threads [s]."""
        return sum(self._waited())

    def longest(self) -> float:
        """Return the time of the thread that has waited longest [s]."""
        return max(self._waited(), default=0.0)

    def _waited(self) -> list[float]:
        for process in self._processes:
            self._latest.update(self._read(process))
        return [1e-9 * (now - self._begin.get(thread, 0)) for thread, now in self._latest.items()]

    def _read(self, process: int) -> dict[Path, int]:
        waited = {}
        for thread in (self._proc / str(process) / 'task').glob('*'):
            with suppress(OSError):  # it has ended, or the kernel has no statistics
                waited[thread] = int((thread / 'schedstat').read_text().split()[1])
        return waited


def assert_within(bound: float, scenario: Callable[[], tuple[float, float]]) -> None:
    """
    Assert that a scenario takes at most ``bound`` [s] in one of ``MAX_TRIALS``.

    ``scenario`` returns the time measured and the time waited [s]. Not all that delays a process
    is on a run queue: a host that stands still for a moment is not. The bounds themselves are
    proven in virtual time. Skips the test if all trials are inconclusive; the reason begins so.
    """
    figures, failed = [], False
    for _ in range(MAX_TRIALS):
        measured, waited = scenario()
        figures.append(f'{measured:.3f} s with {waited:.3f} s on run queues')
        found = verdict(measured, waited, bound)
        if found is Verdict.PASS:
            return
        failed = failed or found is Verdict.FAIL
    text = f'{"; ".join(figures)}; allowed are {bound} s'
    assert not failed, text
    pytest.skip(f'inconclusive: {text}')
