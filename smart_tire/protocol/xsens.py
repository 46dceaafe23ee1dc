"""
Xsens MTi: the MTData2 message (0x36) of the Xbus protocol.

The device's default axes are those of REP-103 (x forward, y left, z up), its accelerometer
reads +9.8 m/s2 on z at rest and its default orientation is in ENU: nothing is turned here.

Message: 0xFA, bus 0xFF, message u8, length u8 (0xFF: a u16 follows), data, checksum; all but
the 0xFA sum to 0. MTData2 data: packets of identifier u16, size u8, content; big-endian.
Xsens, "MT Low Level Communication Protocol Documentation" MT0101P.
"""

from __future__ import annotations

from enum import IntEnum
import struct

from smart_tire.errors import FrameError
from smart_tire.protocol.axes import checked_sample
from smart_tire.protocol.deframer import HeaderDeframer, IMPOSSIBLE, NO_CLAIM
from smart_tire.samples import ImuSample

PREAMBLE = 0xFA
BUS = 0xFF
MTDATA2 = 0x36
MAX_DATA = 2048                           # bytes of an extended message
TICK_NS = 100_000                         # SampleTimeFine counts at 10 kHz
SAMPLE_TIME_WRAP_NS = TICK_NS * (1 << 32)

PACKET_COUNTER = 0x1020                   # u16
SAMPLE_TIME_FINE = 0x1060                 # u32, TICK_NS
QUATERNION = 0x2010                       # w, x, y, z
ACCELERATION = 0x4020                     # x, y, z, m/s2
RATE_OF_TURN = 0x8020                     # x, y, z, rad/s

_KIND = 0xFFF0                            # of an identifier: what it is
_FORMAT = 0x0003                          # of an identifier: how its numbers are written
_AXES = 0x000C                            # of an identifier: 0 ENU, 4 NED, 8 NWU


class Precision(IntEnum):
    """How a packet writes its numbers."""

    FLOAT32 = 0
    FP12_20 = 1  # i32 in units of 2**-20
    FP16_32 = 2  # u32 in units of 2**-32, then i16 whole
    FLOAT64 = 3


class XsensDeframer(HeaderDeframer):
    """Cut intact messages out of a byte stream; a body is the message's number and its data."""

    START = bytes((PREAMBLE,))

    def _size(self, start: int) -> int | None:
        header = bytes(self._buffer[start + 1:start + 6])
        if header and header[0] != BUS:
            return NO_CLAIM
        if len(header) < 3 or header[2] == 0xFF and len(header) < 5:
            return None
        if header[2] < 0xFF:
            return 5 + header[2]
        size = int.from_bytes(header[3:5], 'big')
        return 7 + size if 0xFF <= size <= MAX_DATA else IMPOSSIBLE

    def _body(self, frame: bytes) -> bytes | None:
        if sum(frame[1:]) & 0xFF:
            return None
        return frame[2:3] + frame[6 if frame[3] == 0xFF else 4:-1]


def encode_message(body: bytes) -> bytes:
    """Return the message around ``body``, which starts with the message's number."""
    size = len(body) - 1
    if not 0 <= size <= MAX_DATA:
        raise FrameError(f'Xsens data has {size} bytes, expected 0 to {MAX_DATA}')
    length = bytes((size,)) if size < 0xFF else b'\xff' + struct.pack('>H', size)
    content = bytes((BUS,)) + body[:1] + length + body[1:]
    return bytes((PREAMBLE,)) + content + bytes((-sum(content) & 0xFF,))


def decode_packets(body: bytes) -> dict[int, bytes]:
    """Return identifier -> content; raise FrameError if this is no MTData2 or a packet is cut."""
    if body[:1] != bytes((MTDATA2,)):
        raise FrameError(f'Xsens message is {body[:1].hex()}, expected {MTDATA2:02x}')
    packets: dict[int, bytes] = {}
    start = 1
    while start < len(body):
        end = start + 3 + body[start + 2] if start + 2 < len(body) else len(body) + 1
        if end > len(body):
            raise FrameError(f'Xsens packet {body[start:start + 3].hex()} at {start} goes beyond '
                             f'the {len(body)} bytes of its message')
        packets[int.from_bytes(body[start:start + 2], 'big')] = body[start + 3:end]
        start = end
    return packets


def encode_packets(packets: dict[int, bytes]) -> bytes:
    """Return the MTData2 body that ``decode_packets`` reads back."""
    return bytes((MTDATA2,)) + b''.join(
        struct.pack('>HB', identifier, len(content)) + content
        for identifier, content in packets.items())


def decode_imu(body: bytes, stamp_ns: int = 0) -> tuple[int | None, ImuSample]:
    """
    Return the device's time [ns], None without SampleTimeFine, and the sample.

    The time wraps at ``SAMPLE_TIME_WRAP_NS``. Raise FrameError without acceleration and rate;
    an orientation in other axes than ENU is left out.
    """
    packets = decode_packets(body)
    found = {identifier & _KIND: identifier for identifier in packets}
    if ACCELERATION not in found or RATE_OF_TURN not in found:
        raise FrameError('MTData2 has packets ' + ', '.join(f'{known:#06x}' for known in packets)
                         + ', expected acceleration and rate of turn among them')
    acceleration, rate = (_numbers(found[kind], packets[found[kind]], 3)
                          for kind in (ACCELERATION, RATE_OF_TURN))
    orientation = None
    if QUATERNION in found and not found[QUATERNION] & _AXES:
        w, x, y, z = _numbers(found[QUATERNION], packets[found[QUATERNION]], 4)
        orientation = (x, y, z, w)
    time = None
    if SAMPLE_TIME_FINE in packets:
        time = TICK_NS * _integer(SAMPLE_TIME_FINE, packets[SAMPLE_TIME_FINE], 4)
    return time, checked_sample(stamp_ns, (acceleration[0], acceleration[1], acceleration[2]),
                                (rate[0], rate[1], rate[2]), orientation)


def packet_counter(body: bytes) -> int | None:
    """Return the message's number modulo 65536, None if it is not sent."""
    content = decode_packets(body).get(PACKET_COUNTER)
    return None if content is None else _integer(PACKET_COUNTER, content, 2)


def encode_imu(device_time_ns: int, sample: ImuSample, counter: int = 0,
               precision: Precision = Precision.FLOAT32) -> bytes:
    """Return the body that ``decode_imu`` reads back, rounded to the wire's resolution."""
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
    """Return the numbers in ``content``, which has a whole number of them."""
    if precision == Precision.FLOAT32:
        return struct.unpack(f'>{len(content) // 4}f', content)
    if precision == Precision.FLOAT64:
        return struct.unpack(f'>{len(content) // 8}d', content)
    if precision == Precision.FP12_20:
        return tuple(value * 2.0**-20 for (value,) in struct.iter_unpack('>i', content))
    return tuple(whole + part * 2.0**-32 for part, whole in struct.iter_unpack('>Ih', content))


def encode_numbers(numbers: tuple[float, ...], precision: Precision) -> bytes:
    """Return the content that ``decode_numbers`` reads back; raise FrameError beyond its range."""
    try:
        if precision == Precision.FLOAT32:
            return struct.pack(f'>{len(numbers)}f', *numbers)
        if precision == Precision.FLOAT64:
            return struct.pack(f'>{len(numbers)}d', *numbers)
        if precision == Precision.FP12_20:
            return b''.join(struct.pack('>i', round(number * 2.0**20)) for number in numbers)
        scaled = (round(number * 2.0**32) for number in numbers)
        return b''.join(struct.pack('>Ih', value & 0xFFFFFFFF, value >> 32) for value in scaled)
    except (struct.error, OverflowError) as error:
        raise FrameError(f'{numbers} do not fit into {precision.name}') from error


_SIZES = {Precision.FLOAT32: 4, Precision.FP12_20: 4, Precision.FP16_32: 6, Precision.FLOAT64: 8}


def _numbers(identifier: int, content: bytes, count: int) -> tuple[float, ...]:
    precision = Precision(identifier & _FORMAT)
    if len(content) != count * _SIZES[precision]:
        raise FrameError(f'Xsens packet {identifier:#06x} has {len(content)} bytes, '
                         f'expected {count * _SIZES[precision]}')
    return decode_numbers(content, precision)


def _integer(identifier: int, content: bytes, size: int) -> int:
    if len(content) != size:
        raise FrameError(f'Xsens packet {identifier:#06x} has {len(content)} bytes, '
                         f'expected {size}')
    return int.from_bytes(content, 'big')
