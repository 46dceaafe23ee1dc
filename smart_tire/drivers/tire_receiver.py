"""From the bytes of the tire radio to samples that carry the instant of their conversion."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping

from smart_tire.drivers.clock_sync import ClockSync, MAX_LATE
from smart_tire.errors import FrameError
from smart_tire.protocol.tire_payload import (
    decode_batch, MAX_CODE, SEQUENCE_WRAP, TIMER_WRAP_US, TireBatch, volts)
from smart_tire.protocol.xbee import decode_receive_packet, XBeeDeframer
from smart_tire.samples import BatterySample, NS_PER_S, TireSample

VOLTS = tuple(volts(code) for code in range(MAX_CODE + 1))
NS_PER_US = 1000
REMEMBERED = 16           # batches, for what a radio might send twice or later than the next
OVERTAKEN_NS = 200_000_000  # a late batch comes while others flow; a unit takes longer to start
BATTERY_NS = NS_PER_S     # between two reports of a battery


class SensorNode:
    """
    One wheel unit: follows its sequence and its timer.

    The timer decides: where it goes on as the host's clock does, nothing has happened but the
    loss of what fits into the time between. A batch that was overtaken by the next ones is told
    when it comes, with the stamps that it always had.

    Stamps are earlier than the arrival by the constant ``latency_ns``, which is the least time
    from the conversion of a batch's last sample to the arrival of its last byte.
    """

    def __init__(self, wheel: str, latency_ns: int = 0) -> None:
        self.wheel = wheel
        self.clock = ClockSync()
        self.batches = 0     # that carried something new
        self.last_ns = 0     # host clock, when the latest of them came
        self.lost = 0        # by sequence, as many as the timer allows
        self.late = 0        # that came after a younger one
        self.duplicates = 0
        self.resets = 0      # of the unit, or of the clocks
        self.saturated = 0   # batches with a converter at its rail
        self._latency_ns = latency_ns
        self._timer_us = 0   # of the youngest batch, unwrapped
        self._last: TireBatch | None = None  # the youngest
        self._missing: dict[int, int] = {}   # sequence that may still come -> 1 if it is in lost
        self._recent: deque[TireBatch] = deque(maxlen=REMEMBERED)
        self._battery_due_ns = 0

    def update(self, batch: TireBatch, receive_ns: int) -> list[TireSample]:
        """Return the samples of ``batch``, none if it came before."""
        if self._known(batch):
            self.duplicates += 1
            return []
        behind_us = self._behind(batch, receive_ns)
        if behind_us:
            self.late += 1
            self.lost -= self._missing.pop(batch.sequence)
        else:
            self._follow(batch, receive_ns)
        self._recent.append(batch)
        self.batches += 1
        self.last_ns = receive_ns
        self.saturated += batch.saturated
        start = (self._timer_us - behind_us) * NS_PER_US
        period = batch.period_us * NS_PER_US
        return [TireSample(self.clock.host_ns(start + index * period) - self._latency_ns,
                           self.wheel, tuple([VOLTS[code] for code in row]))
                for index, row in enumerate(batch.codes)]

    def battery(self, batch: TireBatch, receive_ns: int) -> BatterySample | None:
        """Return the state of the battery if it is time to report it again."""
        if abs(receive_ns - self._battery_due_ns) < BATTERY_NS:
            return None
        self._battery_due_ns = receive_ns
        return BatterySample(receive_ns, self.wheel, batch.battery_mv * 1e-3)

    def _known(self, batch: TireBatch) -> bool:
        return batch in self._recent or self._last is not None and (
            (batch.sequence, batch.timer_us) == (self._last.sequence, self._last.timer_us))

    def _behind(self, batch: TireBatch, receive_ns: int) -> int:
        """Return how far ``batch`` is behind the youngest one [us], 0 if it is none of before."""
        last = self._last
        if (last is None or batch.sequence not in self._missing
                or receive_ns - self.last_ns > OVERTAKEN_NS):
            return 0
        behind_us = (last.timer_us - batch.timer_us) % TIMER_WRAP_US
        return behind_us if behind_us <= REMEMBERED * _span_us(last, batch) else 0

    def _follow(self, batch: TireBatch, receive_ns: int) -> None:
        """Unwrap the timer, count what was lost, and start anew if the unit did."""
        last, self._last = self._last, batch
        if last is None:
            self._restart(batch)
        else:
            elapsed_us = (batch.timer_us - last.timer_us) % TIMER_WRAP_US
            excess = self.clock.excess(_end_ns(self._timer_us + elapsed_us, batch), receive_ns)
            # off for long, so that its timer has passed the old one; or back at its beginning
            if excess > MAX_LATE or excess < -MAX_LATE and batch.timer_us < last.timer_us:
                self.resets += 1
                self._restart(batch)
            else:
                self._timer_us += elapsed_us
                most = max(round(elapsed_us / _span_us(last, batch)) - 1, 0)
                self._miss(batch, min((batch.sequence - last.sequence - 1) % SEQUENCE_WRAP, most))
        self.clock.update(_end_ns(self._timer_us, batch), receive_ns)

    def _miss(self, batch: TireBatch, lost: int) -> None:
        self.lost += lost
        kept = {}
        for back in range(1, REMEMBERED + 1):
            sequence = (batch.sequence - back) % SEQUENCE_WRAP
            if back <= lost or sequence in self._missing:
                kept[sequence] = 1 if back <= lost else self._missing[sequence]
        self._missing = kept

    def _restart(self, batch: TireBatch) -> None:
        self.clock.reset()
        self._timer_us = batch.timer_us
        self._missing = {(batch.sequence - back) % SEQUENCE_WRAP: 0
                         for back in range(1, REMEMBERED + 1)}


def _span_us(last: TireBatch, batch: TireBatch) -> int:
    """Return the unit's time [us] from a batch to the next one, of the shorter of two."""
    return min(len(one.codes) * one.period_us for one in (last, batch))


def _end_ns(timer_us: int, batch: TireBatch) -> int:
    """Return the unit's time [ns] of the last sample: a batch can not leave before it."""
    return (timer_us + (len(batch.codes) - 1) * batch.period_us) * NS_PER_US


class TireStream:
    """All wheel units behind one coordinator, by their 64-bit addresses."""

    def __init__(self, wheel_of: Mapping[int, str], latency_ns: int = 0) -> None:
        self.units = {address: SensorNode(wheel, latency_ns)
                      for address, wheel in wheel_of.items()}
        self.frames_ok = 0
        self.last_ok_ns = 0    # host clock, when the latest good frame came
        self.rejected = 0      # intact frames that are none of ours, or say what they must not
        self.last_error = ''   # why the latest one was rejected
        self._deframer = XBeeDeframer()

    @property
    def frames_bad(self) -> int:
        """Return how many frames were damaged or rejected."""
        return self._deframer.bad_frames + self.rejected

    @property
    def bytes_skipped(self) -> int:
        """Return how many bytes belonged to no intact frame."""
        return self._deframer.skipped_bytes

    def feed(self, chunk: bytes, receive_ns: int) -> Iterator[list[TireSample] | BatterySample]:
        """Take bytes that arrived at ``receive_ns`` and yield the batches they complete."""
        for body in self._deframer.feed(chunk):
            try:
                unit, batch = self._decode(body)
            except FrameError as error:
                self.rejected += 1
                self.last_error = str(error)
                continue
            self.frames_ok += 1
            self.last_ok_ns = receive_ns
            if samples := unit.update(batch, receive_ns):
                yield samples
            if (battery := unit.battery(batch, receive_ns)) is not None:
                yield battery

    def _decode(self, body: bytes) -> tuple[SensorNode, TireBatch]:
        packet = decode_receive_packet(body)
        unit = self.units.get(packet.source)
        if unit is None:
            known = ', '.join(f'{address:016X}' for address in self.units)
            raise FrameError(f'unknown wheel unit {packet.source:016X}, expected one of {known}')
        return unit, decode_batch(packet.data)
