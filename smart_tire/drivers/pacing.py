"""
Spread the samples of radio batches over time before they are published.

A batch arrives as a burst of 16 samples. A reliable subscriber whose history keeps the last 10,
which is the default of ROS 2 and of ``ros2 bag record``, loses what it has not taken when the
next ones arrive. Samples about 1 ms apart give it several milliseconds to be scheduled.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
import heapq
import threading
import time

from smart_tire.samples import TireSample

SPACING_NS = 1_000_000   # between two samples, of whatever wheels, while there is time for it
SPREAD_SHARE = 0.8       # of the sampling period: the most between two samples of one wheel, so
#                          that a batch is out before the next one comes and no sample gets older
#                          than the first one of its batch
TICK_NS = 2_000_000      # between two wake-ups: each costs CPU time, here and in each subscriber
MAX_AT_ONCE = 4          # samples per wake-up; 2000/s are more than four wheels send at 400 Hz
MAX_PENDING = 128        # samples; two batches of 16 from each of four wheels
CLOSE_TIMEOUT = 2.0      # s that the thread may take to send the rest and end


class PacingQueue:
    """
    Samples that wait to be sent, and when; without a clock or a thread.

    Each sample gets a slot when its batch arrives: the first one at once, the others after it at
    a spacing that suits the number of instrumented ``wheels``. A batch that arrives while slots
    of the former one are left adds its own, so that no backlog grows. The samples of a wheel keep
    their order. All times are of a steady clock [ns].
    """

    def __init__(self, wheels: int) -> None:
        self.overruns = 0   # times at which more than MAX_PENDING samples waited
        self._wheels = wheels
        self._slots: list[tuple[int, str]] = []  # a heap: when, and a sample of which wheel
        self._waiting: dict[str, deque[TireSample]] = {}
        self._next_tick_ns = 0

    def put(self, batch: Sequence[TireSample], now_ns: int) -> None:
        """Add the samples of one batch of one wheel, all of which arrived at ``now_ns``."""
        wheel, spacing_ns = batch[0].wheel, self._spacing_ns(batch)
        self._waiting.setdefault(wheel, deque()).extend(batch)
        for index in range(len(batch)):
            heapq.heappush(self._slots, (now_ns + index * spacing_ns, wheel))
        self.overruns += len(self._slots) > MAX_PENDING

    def due_ns(self) -> int | None:
        """Return when to take samples next, None while there are none."""
        return max(self._slots[0][0], self._next_tick_ns) if self._slots else None

    def take(self, now_ns: int) -> list[TireSample]:
        """Return the samples to send at ``now_ns``; all of them if too many wait."""
        due_ns = self.due_ns() or now_ns
        count, horizon_ns = MAX_AT_ONCE, now_ns + TICK_NS - SPACING_NS
        if len(self._slots) > MAX_PENDING:
            count, horizon_ns = len(self._slots), max(self._slots)[0]
        samples: list[TireSample] = []
        # The count limits the burst of a thread that was woken too late.
        while self._slots and len(samples) < count and self._slots[0][0] <= horizon_ns:
            _, wheel = heapq.heappop(self._slots)
            samples.append(self._waiting[wheel].popleft())
        # Small delays of the thread do not add up; a long one is not made up for.
        self._next_tick_ns = max(due_ns + TICK_NS, now_ns + TICK_NS // 2)
        return samples

    def _spacing_ns(self, batch: Sequence[TireSample]) -> int:
        period_ns = (batch[-1].stamp_ns - batch[0].stamp_ns) / max(1, len(batch) - 1)
        return max(0, min(SPACING_NS * self._wheels, int(SPREAD_SHARE * period_ns)))


class PacedSender:
    """
    Sends samples from a thread of its own, so that pacing never delays the reading of a port.

    ``stop`` returns when the samples that still wait are sent.
    """

    def __init__(self, send: Callable[[TireSample], None], wheels: int,
                 clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._send, self._clock = send, clock
        self._queue = PacingQueue(wheels)
        self._changed = threading.Condition()
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name='paced sender', daemon=True)

    @property
    def overruns(self) -> int:
        """Return how often so many samples waited that they were sent at once."""
        return self._queue.overruns

    def start(self) -> None:
        """Begin to send."""
        self._thread.start()

    def stop(self) -> None:
        """Send what still waits and return when that is done."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        if self._thread.ident is not None:
            self._thread.join(CLOSE_TIMEOUT)

    def put(self, batch: Sequence[TireSample]) -> None:
        """Take the samples of one batch of one wheel, from any thread."""
        with self._changed:
            self._queue.put(batch, self._clock())
            self._changed.notify()

    def _run(self) -> None:
        while (samples := self._next()) is not None:
            for sample in samples:
                self._send(sample)

    def _next(self) -> list[TireSample] | None:
        """Wait for the next samples and return them when they are due; None at the end."""
        with self._changed:
            while True:
                due_ns = self._queue.due_ns()
                if due_ns is None:
                    if self._stopping:
                        return None
                    self._changed.wait()
                    continue
                now_ns = self._clock()
                if now_ns >= due_ns:
                    return self._queue.take(now_ns)
                self._changed.wait((due_ns - now_ns) * 1e-9)
