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
Payload of one radio packet of a tire sensor node: a batch of samples with the node's timer.

Little-endian: u8 version | u8 flags | u16 sequence | u32 timer of the first sample [us] |
u16 sample period [us] | u8 channels | u8 samples n | n * channels u16 | u16 battery [mV].
Sequence and timer wrap; the receiver unwraps them.
"""

from __future__ import annotations

from dataclasses import dataclass
import struct

from smart_tire.errors import FrameError

VERSION = 1             # of this layout
SATURATED = 0x01        # flag: a sample of this batch is at a limit of the converter
MAX_CODE = 1023         # highest reading of the 10-bit converter
FULL_SCALE = 3.3        # V at MAX_CODE
SEQUENCE_WRAP = 1 << 16  # batches, modulus of the sequence number
TIMER_WRAP_US = 1 << 32  # us, modulus of the timer

_HEADER = struct.Struct('<BBHIHBB')
_BATTERY = struct.Struct('<H')


@dataclass(frozen=True, slots=True)
class TireBatch:
    """One batch of a sensor node, in the quantities of the payload."""

    flags: int
    sequence: int                       # batches since power-up, modulo SEQUENCE_WRAP
    timer_us: int                       # of the first sample, modulo TIMER_WRAP_US
    period_us: int                      # between samples, of the node's timer
    codes: tuple[tuple[int, ...], ...]  # samples x channels
    battery_mv: int

    @property
    def saturated(self) -> bool:
        """Return whether a sample is at a limit of the converter."""
        return bool(self.flags & SATURATED)


def volts(code: int) -> float:
    """Return the amplifier output [V] for a reading of the converter."""
    return code * FULL_SCALE / MAX_CODE


def encode_batch(batch: TireBatch) -> bytes:
    """Return the payload of ``batch``; raise FrameError if ``decode_batch`` would refuse it."""
    samples = len(batch.codes)
    channels = len(batch.codes[0]) if samples else 0
    if any(len(row) != channels for row in batch.codes) or samples > 255:
        raise FrameError(f'tire batch is not a table of up to 255 samples: {batch}')
    codes = [code for row in batch.codes for code in row]
    _check(channels, samples, batch.period_us, codes)
    header = _HEADER.pack(VERSION, batch.flags, batch.sequence, batch.timer_us, batch.period_us,
                          channels, samples)
    return header + struct.pack(f'<{len(codes)}H', *codes) + _BATTERY.pack(batch.battery_mv)


def decode_batch(payload: bytes) -> TireBatch:
    """Return the batch in ``payload``; raise FrameError if it does not have the layout."""
    if len(payload) < 1 or payload[0] != VERSION:
        raise FrameError(f'tire payload has version {payload[:1].hex() or "none"}, '
                         f'expected {VERSION:02x}')
    if len(payload) < _HEADER.size + _BATTERY.size:
        raise FrameError(f'tire payload has {len(payload)} bytes, '
                         f'expected at least {_HEADER.size + _BATTERY.size}')
    _, flags, sequence, timer, period, channels, samples = _HEADER.unpack_from(payload)
    count = samples * channels
    size = _HEADER.size + 2 * count + _BATTERY.size
    if len(payload) != size:
        raise FrameError(f'tire payload has {len(payload)} bytes, expected {size} for '
                         f'{samples} samples of {channels} channels')
    codes = struct.unpack_from(f'<{count}H', payload, _HEADER.size)
    _check(channels, samples, period, codes)
    (battery,) = _BATTERY.unpack_from(payload, size - _BATTERY.size)
    rows = tuple(codes[start:start + channels] for start in range(0, count, channels))
    return TireBatch(flags, sequence, timer, period, rows, battery)


def _check(channels: int, samples: int, period_us: int, codes: tuple[int, ...] | list[int]
           ) -> None:
    if channels not in (1, 2):
        raise FrameError(f'tire payload has {channels} channels, expected 1 or 2')
    if samples == 0 or period_us == 0:
        raise FrameError(f'tire payload has {samples} samples with a period of {period_us} us, '
                         'expected at least 1 sample and 1 us')
    if max(codes) > MAX_CODE or min(codes) < 0:
        raise FrameError(f'tire payload has readings {min(codes)} to {max(codes)}, '
                         f'expected 0 to {MAX_CODE}')
