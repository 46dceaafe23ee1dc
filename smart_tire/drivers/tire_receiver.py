# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Receiver of the tire radio: bytes in, samples with the host time of their conversion out."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping

from smart_tire.drivers.clock_sync import ClockSync, MAX_LATE_ARRIVAL
from smart_tire.drivers.sample_stream import FrameReceiver
from smart_tire.errors import FrameError
from smart_tire.protocol.tire_payload import (
    decode_batch, MAX_CODE, SEQUENCE_WRAP, TIMER_WRAP_US, TireBatch, volts)
from smart_tire.protocol.xbee import decode_receive_packet, is_status, XBeeDeframer
from smart_tire.samples import BatterySample, NS_PER_S, TireSamples

VOLTS_OF_CODE = tuple(volts(code) for code in range(MAX_CODE + 1))
NS_PER_US = 1000
REORDER_WINDOW = 16               # batches within which duplicates and late batches are recognized
MAX_REORDER_GAP_NS = 200_000_000  # since the latest batch; a sensor node takes longer to restart
BATTERY_PERIOD_NS = NS_PER_S      # between two reports of a battery


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
