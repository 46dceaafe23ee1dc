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
Pacing of samples that arrive in batches.

A batch of the tire radio is a burst of 16 samples. A reliable subscriber with a history depth of
10, the default of ROS 2 and of ``ros2 bag record``, loses the samples that it has not taken before
the next ones arrive. So they are sent about 1 ms apart, which gives it several milliseconds to be
scheduled.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
import heapq
import math
import threading

from smart_tire.drivers.clock import SYSTEM
from smart_tire.samples import TireSample

SAMPLE_SPACING_NS = 1_000_000  # between two samples of any wheels, if the sampling period permits
MAX_SPACING_SHARE = 0.8        # of the sampling period: a batch is sent before the next arrives
WAKE_PERIOD_NS = 2_000_000     # between wake-ups, which cost CPU time here and in each subscriber
MIN_WAKE_PERIOD_NS = 250_000   # however high the rate: four wake-ups per ms; assumed
MIN_BURST_SAMPLES = 4          # per wake-up that are permitted: four wheels at 400 Hz
MAX_BURST_SAMPLES = 8          # less than the history of 10; above, wake-ups are more frequent
MAX_PENDING_SAMPLES = 128      # two batches of 16 from each of four wheels
CLOSE_TIMEOUT = 2.0            # s for the thread to send the remaining samples and end


class PacingQueue:
    """
    Queue of samples with the times to send them, without a clock or a thread.

    Each sample gets a time slot when its batch arrives: the first sample immediately, the others
    at a spacing that depends on the number of instrumented ``wheels``. A batch that arrives before
    the previous one is sent gets its own slots, which overlap, so that no backlog builds up. The
    samples of a wheel keep their order. All times are of a steady clock [ns].
    """

    def __init__(self, wheels: int) -> None:
        self.overruns = 0   # batches after which more than MAX_PENDING_SAMPLES were pending
        self._wheels = wheels
        self._slots: list[tuple[int, str]] = []  # heap of (time, wheel)
        self._waiting: dict[str, deque[TireSample]] = {}
        self._next_tick_ns = 0
        self._burst, self._wake_ns = MIN_BURST_SAMPLES, WAKE_PERIOD_NS

    def put(self, batch: Sequence[TireSample], now_ns: int) -> None:
        """Add the samples of one batch of one wheel, received at ``now_ns``."""
        wheel, period_ns = batch[0].wheel, _period_ns(batch)
        spacing_ns = min(SAMPLE_SPACING_NS * self._wheels, int(MAX_SPACING_SHARE * period_ns))
        # at the spacing of all wheels, so that none waits for the next batch
        needed = math.ceil(WAKE_PERIOD_NS * self._wheels / spacing_ns) if spacing_ns else 0
        self._burst = min(max(needed, MIN_BURST_SAMPLES), MAX_BURST_SAMPLES)
        self._wake_ns = max(MIN_WAKE_PERIOD_NS, WAKE_PERIOD_NS * MAX_BURST_SAMPLES // max(
            needed, MAX_BURST_SAMPLES))
        self._waiting.setdefault(wheel, deque()).extend(batch)
        for index in range(len(batch)):
            heapq.heappush(self._slots, (now_ns + index * spacing_ns, wheel))
        self.overruns += len(self._slots) > MAX_PENDING_SAMPLES

    def due_ns(self) -> int | None:
        """Return the next time to take samples, None if the queue is empty."""
        return max(self._slots[0][0], self._next_tick_ns) if self._slots else None

    def take(self, now_ns: int) -> list[TireSample]:
        """Return the samples to send at ``now_ns``; all of them if too many are pending."""
        due_ns = self.due_ns() or now_ns
        count, horizon_ns = self._burst, now_ns + max(self._wake_ns - SAMPLE_SPACING_NS, 0)
        if len(self._slots) > MAX_PENDING_SAMPLES:
            count, horizon_ns = len(self._slots), max(self._slots)[0]
        samples: list[TireSample] = []
        # The count limits the burst after a late wake-up.
        while self._slots and len(samples) < count and self._slots[0][0] <= horizon_ns:
            _, wheel = heapq.heappop(self._slots)
            samples.append(self._waiting[wheel].popleft())
        # Small wake-up delays do not accumulate; a long one is not compensated.
        self._next_tick_ns = max(due_ns + self._wake_ns, now_ns + self._wake_ns // 2)
        return samples


def _period_ns(batch: Sequence[TireSample]) -> float:
    """Return the period of the samples [ns]; 0 of a single one or of stamps that run back."""
    return max(0.0, (batch[-1].stamp_ns - batch[0].stamp_ns) / max(1, len(batch) - 1))


class PacedSender:
    """
    Sends samples from its own thread, so that pacing never delays the reading of a port.

    ``stop`` returns when all pending samples are sent.
    """

    def __init__(self, send: Callable[[TireSample], None], wheels: int,
                 clock: Callable[[], int] = SYSTEM.now_ns) -> None:
        self._send, self._clock = send, clock
        self._queue = PacingQueue(wheels)
        self._announce = SYSTEM.join('paced sender')
        self._changed = threading.Condition()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name='paced sender', daemon=True)

    @property
    def overruns(self) -> int:
        """Return how often too many samples were pending, so that all were sent at once."""
        return self._queue.overruns

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Send all pending samples and end the thread."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        if self._thread.ident is not None:
            self._thread.join(CLOSE_TIMEOUT)

    def put(self, batch: Sequence[TireSample]) -> None:
        """Queue the samples of one batch of one wheel; may be called from any thread."""
        with self._changed:
            self._queue.put(batch, self._clock())
            self._announce(self._queue.due_ns())
            self._changed.notify()

    def _run(self) -> None:
        while (samples := self._next()) is not None:
            for sample in samples:
                self._send(sample)

    def _next(self) -> list[TireSample] | None:
        """Wait until samples are due and return them; None after ``stop``."""
        with self._changed:
            while True:
                due_ns = self._queue.due_ns()
                self._announce(due_ns)
                if due_ns is None:
                    if self._stopping:
                        return None
                    self._changed.wait()
                    continue
                now_ns = self._clock()
                if now_ns >= due_ns:
                    return self._queue.take(now_ns)
                self._changed.wait((due_ns - now_ns) * 1e-9)
