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
Checks of the latest IMU and wheel samples of a running robot: what they contradict.

They are those of recordings (``smart_tire.checks``), of a window of the inputs, in a process of
their own, and at most for ``MAX_SHARE`` of a core. Only errors are kept: what a window of a drive
may show by chance or slip, a recording does not call an error either. They hold until the robot
has driven again for a window without them.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
import os
import pickle
import sys
from threading import Thread

from smart_tire.findings import Finding
from smart_tire.host_load import HostLoad
from smart_tire.parameters import RobotParams
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample

WINDOW = 30.0        # s of samples; a drive of 24 s shows all kinds (docs/other_robots.md)
PERIOD = 10.0        # s between two checks, if these are not slow
MAX_SHARE = 0.02     # of a core
MIN_SPEED = 0.5      # rad/s of a wheel, which shows motion
MAX_CHANGE = 0.5     # s, of the delay from stamp to reception: a clock was set
MAX_SAMPLES = 20_000  # of a topic in the window: more are of no use

# with the modules of this process: the working directory of a user may have others of their names
PROGRAM = ('import sys; sys.path[:] = sys.argv[1:]; '
           'from smart_tire.checks.live import main; main()')

Work = Callable[[], None]
Received = Sequence[tuple[int, ImuSample | WheelSample]]
# of robot, samples, load of the host and completed messages: errors, and the CPU time [s]
Find = Callable[[RobotParams, Received, HostLoad, 'Counter[str]'], tuple[Sequence[Finding], float]]


def in_thread(work: Work) -> None:
    """Do ``work`` in a thread that does not hold up the end of the process."""
    Thread(target=work, daemon=True).start()


def in_process(robot: RobotParams, received: Received, host: HostLoad, completed: Counter[str]
               ) -> tuple[Sequence[Finding], float]:
    """
    Return the errors and the CPU time [s] of a process that checks the samples.

    It loads libraries, and its memory is released; raises OSError or EOFError if it fails.
    """
    import subprocess  # nodes start without
    # a copy of the environment: other threads may change it while the child begins (vfork)
    with subprocess.Popen([sys.executable, '-c', PROGRAM, *sys.path], stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE, start_new_session=True,
                          env=dict(os.environ)) as process:
        assert process.stdin is not None and process.stdout is not None
        with process.stdin as samples:  # in parts, between which other threads run
            pickle.dump((robot, received, host, completed), samples)
        found: tuple[Sequence[Finding], float] = pickle.load(process.stdout)
        return found


class LiveChecks:
    """
    The samples of the last seconds, and what the checks find in them.

    ``start`` begins a check: in a thread, which waits for ``find``, or at once. Times are in ns of
    reception.
    """

    def __init__(self, robot: RobotParams, start: Callable[[Work], None] = in_thread,
                 find: Find = in_process) -> None:
        self.errors: Sequence[Finding] = ()
        self._robot, self._start, self._find = robot, start, find
        self._samples: dict[type, deque[tuple[int, ImuSample | WheelSample]]] = {
            kind: deque(maxlen=MAX_SAMPLES) for kind in (ImuSample, WheelSample)}
        self._due_ns: int | None = None
        self._moved = True  # the first check may be one at standstill
        self._busy, self._forgotten_ns = False, 0

    def add(self, receive_ns: int, sample: ImuSample | WheelSample) -> None:
        """Add a sample that was received; those before a clock was set are forgotten."""
        kept = self._samples[type(sample)]
        if kept:
            last_ns, last = kept[-1]
            change = receive_ns - last_ns - sample.stamp_ns + last.stamp_ns
            # stamps that are always wrong are not forgotten: they are to be found
            if (receive_ns < last_ns or abs(change) > MAX_CHANGE * NS_PER_S) and abs(
                    receive_ns - self._forgotten_ns) > WINDOW * NS_PER_S:
                self._forgotten_ns = receive_ns
                for one in self._samples.values():
                    one.clear()
        kept.append((receive_ns, sample))
        while kept[0][0] < receive_ns - WINDOW * NS_PER_S:
            kept.popleft()
        if isinstance(sample, WheelSample):
            self._moved |= any(abs(speed) > MIN_SPEED for speed in sample.velocity)

    def poll(self, now_ns: int, host: HostLoad, completed: Counter[str]) -> Sequence[Finding]:
        """Return the errors found so far; begin the next check if it is due."""
        if self._due_ns is None or now_ns < self._due_ns - WINDOW * NS_PER_S:  # the clock was set
            self._due_ns = now_ns + round(PERIOD * NS_PER_S)
        if now_ns >= self._due_ns and self._moved and not self._busy:
            self._busy, self._moved = True, False
            received = [one for kept in self._samples.values() for one in kept]
            self._start(lambda: self._check(now_ns, received, host, completed.copy()))
        return self.errors

    def _check(self, now_ns: int, received: Received, host: HostLoad, completed: Counter[str]
               ) -> None:
        spent = 0.0
        try:
            self.errors, spent = self._find(self._robot, received, host, completed)
        finally:  # an error of a check does not end those of later samples
            self._due_ns = now_ns + round(max(PERIOD, spent / MAX_SHARE) * NS_PER_S)
            self._busy = False
