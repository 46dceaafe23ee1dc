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
Serial protocol of a charge amplifier with its converter, one frame per conversion.

Little-endian: 0xA5 | 0x46 | u8 flags | u32 timer [us] of the conversion, wraps | i32 charge
[0.1 pC] at the output of the amplifier | CRC-16/XMODEM (big-endian) of all before it but the 0xA5.
Flags: bit 0, the output is at a limit of the converter; bit 1, the amplifier has lost charge since
the frame before (reset or overload). Other bits are zero. 500 frames/s take 65 kbaud.
"""

from __future__ import annotations

from binascii import crc_hqx
import struct

from smart_tire.errors import FrameError
from smart_tire.protocol.deframer import HeaderDeframer, NOT_A_FRAME
from smart_tire.samples import FilmCharge

KIND = 0x46                     # of the frames
SATURATED, DISCHARGED = 1, 2    # flags
CHARGE_LSB = 1e-13              # C
TIMER_WRAP_NS = 1000 * (1 << 32)  # ns, modulus of the timer
LAYOUT = struct.Struct('<BBIi')
SIZE = 1 + LAYOUT.size + 2      # bytes of a frame


class FilmDeframer(HeaderDeframer):
    """Extracts frames from a byte stream; a body is a frame without start byte and CRC."""

    START = b'\xa5'

    def _size(self, start: int) -> int | None:
        kind = self._buffer[start + 1:start + 2]
        return SIZE if kind == bytes((KIND,)) else NOT_A_FRAME if kind else None

    def _body(self, frame: bytes) -> bytes | None:
        return frame[1:-2] if crc_hqx(frame[1:], 0) == 0 else None


def encode_frame(body: bytes) -> bytes:
    """Return the frame with ``body``."""
    return FilmDeframer.START + body + struct.pack('>H', crc_hqx(body, 0))


def decode_charge(body: bytes, stamp_ns: int = 0) -> tuple[int, FilmCharge]:
    """Return the device time [ns] and the sample with ``stamp_ns``; FrameError if invalid."""
    if len(body) != LAYOUT.size:
        raise FrameError(f'film frame has {len(body)} bytes, expected {LAYOUT.size}')
    kind, flags, timer_us, charge = LAYOUT.unpack(body)
    if kind != KIND or flags & ~(SATURATED | DISCHARGED):
        raise FrameError(f'film frame has kind {kind:#04x} and flags {flags:#04x}, expected '
                         f'{KIND:#04x} and bits 0 and 1 only')
    return 1000 * timer_us, FilmCharge(stamp_ns, charge * CHARGE_LSB, bool(flags & SATURATED),
                                       bool(flags & DISCHARGED))


def encode_charge(device_ns: int, sample: FilmCharge) -> bytes:
    """Return the body that ``decode_charge`` reads; FrameError if the charge is out of range."""
    flags = SATURATED * sample.saturated | DISCHARGED * sample.discharged
    try:
        return LAYOUT.pack(KIND, flags, device_ns % TIMER_WRAP_NS // 1000,
                           round(sample.charge / CHARGE_LSB))
    except (struct.error, OverflowError, ValueError) as error:
        raise FrameError(f'a charge of {sample.charge} C is out of range') from error
