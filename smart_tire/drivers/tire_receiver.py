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
Receiver of the tire radio: bytes in, samples with the host time of their conversion out.

A batch arrives as a burst of 16 samples. A reliable subscriber with a history depth of 10, the
default of ROS 2 and of ``ros2 bag record``, loses the samples that it has not taken before the
next ones arrive. So they are sent about 1 ms apart, which gives it several milliseconds to be
scheduled.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
import heapq
import math
import threading

from smart_tire.drivers.clock import SYSTEM
from smart_tire.drivers.clock_sync import ClockSync, MAX_LATE_ARRIVAL
from smart_tire.drivers.sample_stream import FrameReceiver
from smart_tire.errors import FrameError
from smart_tire.protocol.tire_payload import (
    decode_batch, MAX_CODE, SEQUENCE_WRAP, TIMER_WRAP_US, TireBatch, volts)
from smart_tire.protocol.xbee import decode_receive_packet, is_status, XBeeDeframer
from smart_tire.samples import BatterySample, NS_PER_S, TireSample, TireSamples

VOLTS_OF_CODE = tuple(volts(code) for code in range(MAX_CODE + 1))
NS_PER_US = 1000
REORDER_WINDOW = 16               # batches within which duplicates and late batches are recognized
MAX_REORDER_GAP_NS = 200_000_000  # since the latest batch; a sensor node takes longer to restart
BATTERY_PERIOD_NS = NS_PER_S      # between two reports of a battery
SAMPLE_SPACING_NS = 1_000_000  # between two samples of any wheels, if the sampling period permits
MAX_SPACING_SHARE = 0.8        # of the sampling period: a batch is sent before the next arrives
WAKE_PERIOD_NS = 2_000_000     # between wake-ups, which cost CPU time here and in each subscriber
MIN_WAKE_PERIOD_NS = 250_000   # however high the rate: four wake-ups per ms; assumed
MIN_BURST_SAMPLES = 4          # per wake-up that are permitted: four wheels at 400 Hz
MAX_BURST_SAMPLES = 8          # less than the history of 10; above, wake-ups are more frequent
MAX_PENDING_SAMPLES = 128      # two batches of 16 from each of four wheels
CLOSE_TIMEOUT = 2.0            # s for the thread to send the remaining samples and end


class SensorNode:
    """
    Sequence, timer and clock model of one sensor node.

    The timer decides whether the node has restarted: if it advanced as the host clock did, only
    batches were lost, at most as many as fit into the elapsed time. A batch that arrives after
    later ones is delivered on arrival, with the timestamps of its own timer.

    ``latency_ns`` is subtracted from the timestamps: the minimum time from the conversion of the
    last sample of a batch to the arrival of its last byte.
    """

    def __init__(self, wheel: str, latency_ns: int = 0) -> None:
        self.wheel = wheel
        self.clock = ClockSync()
        self.batches = 0     # without duplicates
        self.last_ns = 0     # host clock, when the latest of them arrived
        self.lost = 0        # from the sequence numbers, bounded by the elapsed timer
        self.late = 0        # batches that arrived after a later one
        self.duplicates = 0
        self.resets = 0      # of the sensor node or of one of the clocks
        self.saturated = 0   # batches with a saturated converter
        self._latency_ns = latency_ns
        self._timer_us = 0   # of the newest batch, unwrapped
        self._last: TireBatch | None = None  # the newest batch
        self._missing: dict[int, int] = {}   # sequence that may still arrive -> 1 if it is in lost
        self._recent: deque[TireBatch] = deque(maxlen=REORDER_WINDOW)
        self._battery_due_ns = 0

    def samples(self, batch: TireBatch, receive_ns: int) -> TireSamples | None:
        """Return the samples of ``batch``, None if it is a duplicate."""
        if self._is_duplicate(batch):
            self.duplicates += 1
            return None
        behind_us = self._behind(batch, receive_ns)
        if behind_us:
            self.late += 1
            self.lost -= self._missing.pop(batch.sequence)
        else:
            self._advance(batch, receive_ns)
        self._recent.append(batch)
        self.batches += 1
        self.last_ns = receive_ns
        self.saturated += batch.saturated
        start = (self._timer_us - behind_us) * NS_PER_US
        host_ns = self.clock.host_ns(start)
        return TireSamples(
            host_ns - self._latency_ns, self.wheel,
            self.clock.host_ns(start + batch.period_us * NS_PER_US) - host_ns,
            tuple([tuple([VOLTS_OF_CODE[code] for code in row]) for row in batch.codes]),
            batch.saturated)

    def battery(self, batch: TireBatch, receive_ns: int) -> BatterySample | None:
        """Return the battery state if a report is due, once per ``BATTERY_PERIOD_NS``."""
        if abs(receive_ns - self._battery_due_ns) < BATTERY_PERIOD_NS:
            return None
        self._battery_due_ns = receive_ns
        return BatterySample(receive_ns, self.wheel, batch.battery_mv * 1e-3)

    def _is_duplicate(self, batch: TireBatch) -> bool:
        return batch in self._recent or self._last is not None and (
            (batch.sequence, batch.timer_us) == (self._last.sequence, self._last.timer_us))

    def _behind(self, batch: TireBatch, receive_ns: int) -> int:
        """Return how far a late ``batch`` is behind the newest one [us], 0 for a new batch."""
        last = self._last
        if (last is None or batch.sequence not in self._missing
                or receive_ns - self.last_ns > MAX_REORDER_GAP_NS):
            return 0
        behind_us = (last.timer_us - batch.timer_us) % TIMER_WRAP_US
        return behind_us if behind_us <= REORDER_WINDOW * _span_us(last, batch) else 0

    def _advance(self, batch: TireBatch, receive_ns: int) -> None:
        """Unwrap the timer, count lost batches, and reset if the sensor node has restarted."""
        last, self._last = self._last, batch
        if last is None:
            self._restart(batch)
        else:
            elapsed_us = (batch.timer_us - last.timer_us) % TIMER_WRAP_US
            excess = self.clock.excess_delay(
                _end_ns(self._timer_us + elapsed_us, batch), receive_ns)
            # Restarted: off for so long that the timer has passed its old value, or timer reset.
            reset = excess < -MAX_LATE_ARRIVAL and batch.timer_us < last.timer_us
            if excess > MAX_LATE_ARRIVAL or reset:
                self.resets += 1
                self._restart(batch)
            else:
                self._timer_us += elapsed_us
                max_lost = max(round(elapsed_us / _span_us(last, batch)) - 1, 0)
                gap = (batch.sequence - last.sequence - 1) % SEQUENCE_WRAP
                self._count_lost(batch, min(gap, max_lost))
        self.clock.add_arrival(_end_ns(self._timer_us, batch), receive_ns)

    def _count_lost(self, batch: TireBatch, lost: int) -> None:
        self.lost += lost
        kept = {}
        for back in range(1, REORDER_WINDOW + 1):
            sequence = (batch.sequence - back) % SEQUENCE_WRAP
            if back <= lost or sequence in self._missing:
                kept[sequence] = 1 if back <= lost else self._missing[sequence]
        self._missing = kept

    def _restart(self, batch: TireBatch) -> None:
        self.clock.reset()
        self._timer_us = batch.timer_us
        self._missing = {(batch.sequence - back) % SEQUENCE_WRAP: 0
                         for back in range(1, REORDER_WINDOW + 1)}


def _span_us(last: TireBatch, batch: TireBatch) -> int:
    """Return the duration [us] of the shorter of two batches, by the timer of the node."""
    return min(len(one.codes) * one.period_us for one in (last, batch))


def _end_ns(timer_us: int, batch: TireBatch) -> int:
    """Return the time [ns] of the last sample by the timer of the node: the earliest to send."""
    return (timer_us + (len(batch.codes) - 1) * batch.period_us) * NS_PER_US


class TireStream(FrameReceiver):
    """Decodes the byte stream of an XBee coordinator for sensor nodes with 64-bit addresses."""

    def __init__(self, wheel_of: Mapping[int, str], latency_ns: int = 0) -> None:
        super().__init__(XBeeDeframer())
        self.sensor_nodes = {address: SensorNode(wheel, latency_ns)
                             for address, wheel in wheel_of.items()}

    def receive(self, chunk: bytes, receive_ns: int) -> Iterator[TireSamples | BatterySample]:
        """Take bytes that arrived at ``receive_ns`` and yield the batches they complete."""
        for node, batch in self._decoded(chunk, receive_ns, self._decode):
            if (samples := node.samples(batch, receive_ns)) is not None:
                yield samples
            if (battery := node.battery(batch, receive_ns)) is not None:
                yield battery

    def _ignores(self, body: bytes) -> bool:
        return is_status(body)

    def _decode(self, body: bytes) -> tuple[SensorNode, TireBatch]:
        packet = decode_receive_packet(body)
        node = self.sensor_nodes.get(packet.source)
        if node is None:
            known = ', '.join(f'{address:016X}' for address in self.sensor_nodes)
            raise FrameError(f'unknown sensor node {packet.source:016X}, expected one of {known}')
        return node, decode_batch(packet.data)


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
