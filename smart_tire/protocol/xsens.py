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
Xsens MTi: the MTData2 message (0x36) of the Xbus protocol.

The default device axes are those of REP-103 (x forward, y left, z up), the accelerometer measures
+9.8 m/s2 on z when stationary, and the default orientation is in ENU: no conversion is needed.

Message: 0xFA, bus 0xFF, message u8, length u8 (0xFF: a u16 follows), data, checksum; all bytes but
the 0xFA sum to 0 modulo 256. MTData2 data: packets of identifier u16, size u8, content;
big-endian. Xsens, "MT Low Level Communication Protocol Documentation" MT0101P.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
import struct

from smart_tire.errors import FrameError
from smart_tire.protocol.axes import checked_sample
from smart_tire.protocol.deframer import HeaderDeframer, INVALID_HEADER, NOT_A_FRAME
from smart_tire.samples import ImuSample

PREAMBLE = 0xFA
BUS = 0xFF
MTDATA2 = 0x36
MAX_DATA_LENGTH = 2048                    # bytes, of an extended message
TICK_NS = 100_000                         # ns per count of SampleTimeFine (10 kHz)
SAMPLE_TIME_WRAP_NS = TICK_NS * (1 << 32)  # ns, modulus of the device time

PACKET_COUNTER = 0x1020                   # u16
SAMPLE_TIME_FINE = 0x1060                 # u32, in units of TICK_NS
QUATERNION = 0x2010                       # w, x, y, z
ACCELERATION = 0x4020                     # x, y, z, m/s2
RATE_OF_TURN = 0x8020                     # x, y, z, rad/s

_QUANTITY_MASK = 0xFFF0                   # bits of an identifier: quantity
_PRECISION_MASK = 0x0003                  # bits of an identifier: Precision
_AXES_MASK = 0x000C                       # bits of an identifier: 0 ENU, 4 NED, 8 NWU


class Precision(IntEnum):
    """Number format of a packet."""

    FLOAT32 = 0
    FP12_20 = 1  # i32, in units of 2**-20
    FP16_32 = 2  # u32, in units of 2**-32, then i16 integer part
    FLOAT64 = 3


_NUMBERS = {
    Precision.FLOAT32: struct.Struct('>f'), Precision.FP12_20: struct.Struct('>i'),
    Precision.FP16_32: struct.Struct('>Ih'), Precision.FLOAT64: struct.Struct('>d')}


class XsensDeframer(HeaderDeframer):
    """Extracts messages from a byte stream; a body is the message identifier and the data."""

    START = bytes((PREAMBLE,))

    def _size(self, start: int) -> int | None:
        header = bytes(self._buffer[start + 1:start + 6])
        if header and header[0] != BUS:
            return NOT_A_FRAME
        if len(header) < 3 or header[2] == 0xFF and len(header) < 5:
            return None
        if header[2] < 0xFF:
            return 5 + header[2]
        size = int.from_bytes(header[3:5], 'big')
        return 7 + size if 0xFF <= size <= MAX_DATA_LENGTH else INVALID_HEADER

    def _body(self, frame: bytes) -> bytes | None:
        if sum(frame[1:]) & 0xFF:
            return None
        return frame[2:3] + frame[6 if frame[3] == 0xFF else 4:-1]


def encode_message(body: bytes) -> bytes:
    """Return the message with ``body``, which starts with the message identifier."""
    size = len(body) - 1
    if not 0 <= size <= MAX_DATA_LENGTH:
        raise FrameError(f'Xsens data has {size} bytes, expected 0 to {MAX_DATA_LENGTH}')
    length = bytes((size,)) if size < 0xFF else b'\xff' + struct.pack('>H', size)
    content = bytes((BUS,)) + body[:1] + length + body[1:]
    return bytes((PREAMBLE,)) + content + bytes((-sum(content) & 0xFF,))


def decode_packets(body: bytes) -> dict[int, bytes]:
    """Return identifier -> content; raise FrameError if ``body`` is not a complete MTData2."""
    if body[:1] != bytes((MTDATA2,)):
        raise FrameError(f'Xsens message is {body[:1].hex()}, expected {MTDATA2:02x}')
    packets: dict[int, bytes] = {}
    start = 1
    while start < len(body):
        end = start + 3 + body[start + 2] if start + 2 < len(body) else len(body) + 1
        if end > len(body):
            raise FrameError(f'Xsens packet {body[start:start + 3].hex()} at {start} exceeds '
                             f'the {len(body)} bytes of its message')
        packets[int.from_bytes(body[start:start + 2], 'big')] = body[start + 3:end]
        start = end
    return packets


def encode_packets(packets: dict[int, bytes]) -> bytes:
    """Return the MTData2 body for ``decode_packets``."""
    return bytes((MTDATA2,)) + b''.join(
        struct.pack('>HB', identifier, len(content)) + content
        for identifier, content in packets.items())


def decode_imu(body: bytes, stamp_ns: int = 0) -> tuple[int | None, ImuSample]:
    """
    Return the device time [ns] (None without SampleTimeFine) and the sample with ``stamp_ns``.

    The device time wraps at ``SAMPLE_TIME_WRAP_NS``. An orientation in axes other than ENU is left
    out. Raise FrameError if acceleration or rate of turn is missing, or if a value is one that no
    sensor measures.
    """
    packets = decode_packets(body)
    found = {identifier & _QUANTITY_MASK: identifier for identifier in packets}
    if ACCELERATION not in found or RATE_OF_TURN not in found:
        raise FrameError('MTData2 has packets ' + ', '.join(map('{:#06x}'.format, packets))
                         + ', expected acceleration and rate of turn among them')
    acceleration, rate = (_numbers(found[quantity], packets[found[quantity]], 3)
                          for quantity in (ACCELERATION, RATE_OF_TURN))
    orientation = None
    if QUATERNION in found and not found[QUATERNION] & _AXES_MASK:
        w, x, y, z = _numbers(found[QUATERNION], packets[found[QUATERNION]], 4)
        orientation = (x, y, z, w)
    time = None
    if SAMPLE_TIME_FINE in packets:
        time = TICK_NS * _integer(SAMPLE_TIME_FINE, packets[SAMPLE_TIME_FINE], 4)
    return time, checked_sample(stamp_ns, (acceleration[0], acceleration[1], acceleration[2]),
                                (rate[0], rate[1], rate[2]), orientation)


def packet_counter(body: bytes) -> int | None:
    """Return the packet counter, modulo 65536; None if it is not sent."""
    content = decode_packets(body).get(PACKET_COUNTER)
    return None if content is None else _integer(PACKET_COUNTER, content, 2)


def encode_imu(device_time_ns: int, sample: ImuSample, counter: int = 0,
               precision: Precision = Precision.FLOAT32) -> bytes:
    """Return the body for ``decode_imu``, with values rounded to the resolution of the format."""
    ticks = device_time_ns // TICK_NS
    packets = {PACKET_COUNTER: struct.pack('>H', counter & 0xFFFF),
               SAMPLE_TIME_FINE: struct.pack('>I', ticks & 0xFFFFFFFF)}
    if sample.orientation is not None:
        x, y, z, w = sample.orientation
        packets[QUATERNION | precision] = encode_numbers((w, x, y, z), precision)
    packets[ACCELERATION | precision] = encode_numbers(sample.acceleration, precision)
    packets[RATE_OF_TURN | precision] = encode_numbers(sample.rate, precision)
    return encode_packets(packets)


def decode_numbers(content: bytes, precision: Precision) -> tuple[float, ...]:
    """Return the numbers in ``content``, whose length must be a multiple of their size."""
    values = _NUMBERS[precision].iter_unpack(content)
    if precision == Precision.FP16_32:
        return tuple(whole + fraction * 2.0**-32 for fraction, whole in values)
    scale = 2.0**-20 if precision == Precision.FP12_20 else 1.0
    return tuple(value * scale for value, in values)


def encode_numbers(numbers: tuple[float, ...], precision: Precision) -> bytes:
    """Return ``numbers`` encoded; raise FrameError if one is out of the range of the format."""
    values: Iterable[tuple[float, ...]] = ((number,) for number in numbers)
    if precision == Precision.FP12_20:
        values = ((round(number * 2.0**20),) for number in numbers)
    elif precision == Precision.FP16_32:
        scaled = (round(number * 2.0**32) for number in numbers)
        values = ((value & 0xFFFFFFFF, value >> 32) for value in scaled)
    try:
        return b''.join(_NUMBERS[precision].pack(*value) for value in values)
    except (struct.error, OverflowError) as error:
        raise FrameError(f'{numbers} are out of range for {precision.name}') from error


def _numbers(identifier: int, content: bytes, count: int) -> tuple[float, ...]:
    precision = Precision(identifier & _PRECISION_MASK)
    _check_size(identifier, content, count * _NUMBERS[precision].size)
    return decode_numbers(content, precision)


def _integer(identifier: int, content: bytes, size: int) -> int:
    _check_size(identifier, content, size)
    return int.from_bytes(content, 'big')


def _check_size(identifier: int, content: bytes, size: int) -> None:
    if len(content) != size:
        raise FrameError(f'Xsens packet {identifier:#06x} has {len(content)} bytes, '
                         f'expected {size}')
