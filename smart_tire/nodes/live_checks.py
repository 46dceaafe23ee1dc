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

They are those of recordings (``smart_tire.checks``), of a window of the inputs, in a thread of
their own, and at most for ``MAX_SHARE`` of a core. Only errors are kept: what a window of a drive
may show by chance or slip, a recording does not call an error either. They hold until the robot
has driven again for a window without them.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from threading import Thread
import time

from smart_tire.findings import Finding, Level
from smart_tire.host_load import HostLoad
from smart_tire.parameters import RobotParams
from smart_tire.recording import Faults, SampleArrays
from smart_tire.samples import ImuSample, NS_PER_S, WheelSample

WINDOW = 30.0        # s of samples; a drive of 24 s shows all kinds (docs/other_robots.md)
PERIOD = 10.0        # s between two checks, if these are not slow
MAX_SHARE = 0.02     # of a core
MIN_SPEED = 0.5      # rad/s of a wheel, which shows motion
MAX_CHANGE = 0.5     # s, of the delay from stamp to reception: a clock was set
MAX_SAMPLES = 20_000  # of a topic in the window: more are of no use

Work = Callable[[], None]


def in_thread(work: Work) -> None:
    """Do ``work`` in a thread that does not hold up the end of the process."""
    Thread(target=work, daemon=True).start()


class LiveChecks:
    """
    The samples of the last seconds, and what the checks find in them.

    ``start`` begins a check: in a thread, or at once. Times are in ns of reception.
    """

    def __init__(self, robot: RobotParams, start: Callable[[Work], None] = in_thread,
                 cpu_time: Callable[[], float] = time.thread_time) -> None:
        self.errors: Sequence[Finding] = ()
        self._robot, self._start, self._cpu_time = robot, start, cpu_time
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

    def _check(self, now_ns: int, received: Sequence[tuple[int, ImuSample | WheelSample]],
               host: HostLoad, completed: Counter[str]) -> None:
        begin = self._cpu_time()
        # these need scipy, without which nodes start
        from smart_tire.checks import findings, LIVE
        from smart_tire.checks.recording import CheckedRecording
        samples = SampleArrays()
        for receive_ns, sample in received:
            samples.add_sample(sample, receive_ns)
        try:
            found = findings(CheckedRecording(
                self._robot, samples, Faults(completed=completed), live=True, host=host), LIVE)
            self.errors = [one for one in found if one.level is Level.ERROR]
        finally:  # an error of a check does not end those of later samples
            spent = (self._cpu_time() - begin) / MAX_SHARE
            self._due_ns = now_ns + round(max(PERIOD, spent) * NS_PER_S)
            self._busy = False
