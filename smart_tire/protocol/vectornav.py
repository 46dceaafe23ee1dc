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
VectorNav VN-100, binary output messages.

The device axes are x forward, y right, z down; its accelerometer measures specific force, about
-9.8 m/s2 on z when stationary. Vectors are converted to REP-103 axes (x forward, y left, z up;
+9.8 m/s2 on z when stationary), the attitude from NED to ENU.

Message: 0xFA, groups u8, one u16 of fields per group, payload (little-endian), CRC-16/XMODEM
(big-endian) of all but the 0xFA. VectorNav, "VN-100 User Manual" UM001, sections 3.8 and 4.3.
"""

from __future__ import annotations

from binascii import crc_hqx
from enum import IntFlag
from functools import lru_cache
import struct

from smart_tire.errors import FrameError
from smart_tire.protocol.axes import flip_quaternion, flip_vector, sample_from_flipped
from smart_tire.protocol.deframer import HeaderDeframer, INVALID_HEADER, NOT_A_FRAME
from smart_tire.samples import ImuSample

SYNC = 0xFA

# Bytes per field: one row per group, one column per bit; 0: undefined. UM001, table before 4.3.7.
FIELD_SIZES = (
    (8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8, 0),
    (8, 8, 8, 2, 8, 8, 8, 4, 4, 1, 1, 0, 0, 0, 0, 0),
    (2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12, 2, 40, 0, 0, 0),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28, 2, 12),
    (2, 12, 16, 36, 12, 12, 12, 12, 12, 12, 28, 24, 0, 0, 0, 0),
    (2, 24, 24, 12, 12, 12, 12, 12, 12, 4, 4, 68, 64, 0, 0, 0),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28, 2, 12),
)


class Field(IntFlag):
    """Fields of binary group 1 that are decoded."""

    TIME_STARTUP = 1 << 0   # u64, ns since power-up
    QUATERNION = 1 << 4     # float x, y, z, w: body to NED
    ANGULAR_RATE = 1 << 5   # float x, y, z, rad/s, compensated
    ACCEL = 1 << 8          # float x, y, z, m/s2, compensated
    IMU = 1 << 9            # float acceleration and rate, uncompensated


DEFAULT_FIELDS = Field.TIME_STARTUP | Field.ANGULAR_RATE | Field.ACCEL

_VECTOR = struct.Struct('<3f')
_QUATERNION = struct.Struct('<4f')
_TIME = struct.Struct('<Q')


@lru_cache(maxsize=64)
def payload_size(header: bytes) -> int:
    """Return the payload size of ``header`` (groups and fields) in bytes, 0 if it is invalid."""
    groups = [group for group in range(7) if header[0] >> group & 1]
    size = 0
    for group, (fields,) in zip(groups, struct.iter_unpack('<H', header[1:])):
        sizes = [FIELD_SIZES[group][bit] for bit in range(16) if fields >> bit & 1]
        if not sizes or 0 in sizes:
            return 0
        size += sum(sizes)
    return size


@lru_cache(maxsize=64)
def _offsets(fields: int) -> dict[int, int]:
    """Return the offset of each field in the payload of group 1."""
    offsets: dict[int, int] = {}
    offset = 0
    for bit in range(16):
        if fields >> bit & 1:
            offsets[1 << bit] = offset
            offset += FIELD_SIZES[0][bit]
    return offsets


class BinaryDeframer(HeaderDeframer):
    """Extracts binary messages from a byte stream; a body is groups, fields and payload."""

    START = bytes((SYNC,))

    def _size(self, start: int) -> int | None:
        groups = self._buffer[start + 1] if start + 1 < len(self._buffer) else None
        if groups is None:
            return None
        if groups == 0 or groups & 0x80:  # no group, or one that a VN-100 does not have
            return NOT_A_FRAME
        header_end = start + 2 + 2 * groups.bit_count()
        if header_end > len(self._buffer):
            return None
        size = payload_size(bytes(self._buffer[start + 1:header_end]))
        return header_end - start + size + 2 if size else INVALID_HEADER

    def _body(self, frame: bytes) -> bytes | None:
        return frame[1:-2] if crc_hqx(frame[1:], 0) == 0 else None


def encode_frame(body: bytes) -> bytes:
    """Return the binary message with ``body``."""
    return bytes((SYNC,)) + body + struct.pack('>H', crc_hqx(body, 0))


def decode_binary(body: bytes, stamp_ns: int = 0) -> tuple[int | None, ImuSample]:
    """
    Return the device time [ns] (None without TimeStartup) and the sample with ``stamp_ns``.

    Acceleration and angular rate are those of the compensated fields, or else of the uncompensated
    field Imu. Raises FrameError if the body has neither, or a value is not finite or out of range.
    """
    if not body or not body[0] & 1:
        raise FrameError(f'VectorNav frame has groups {body[:1].hex()}, expected group 1')
    start = 1 + 2 * body[0].bit_count()
    if len(body) != start + payload_size(body[:start]):
        raise FrameError(f'VectorNav body has {len(body)} bytes, expected '
                         f'{start + payload_size(body[:start])}')
    fields = int.from_bytes(body[1:3], 'little')
    offsets = {field: start + offset for field, offset in _offsets(fields).items()}
    if Field.IMU in offsets:
        offsets.setdefault(Field.ACCEL, offsets[Field.IMU])
        offsets.setdefault(Field.ANGULAR_RATE, offsets[Field.IMU] + _VECTOR.size)
    if Field.ACCEL not in offsets or Field.ANGULAR_RATE not in offsets:
        raise FrameError(f'VectorNav group 1 has fields {fields:#06x}, expected acceleration '
                         'and angular rate among them')
    attitude, time = offsets.get(Field.QUATERNION), offsets.get(Field.TIME_STARTUP)
    sample = sample_from_flipped(
        stamp_ns, _VECTOR.unpack_from(body, offsets[Field.ACCEL]),
        _VECTOR.unpack_from(body, offsets[Field.ANGULAR_RATE]),
        None if attitude is None else _QUATERNION.unpack_from(body, attitude))
    return None if time is None else _TIME.unpack_from(body, time)[0], sample


def encode_binary(device_time_ns: int, sample: ImuSample, fields: int = DEFAULT_FIELDS) -> bytes:
    """
    Return a body of group 1 that ``decode_binary`` reads; fields not in ``Field`` are zero.

    Raises FrameError for undefined fields.
    """
    size = payload_size(struct.pack('<BH', 1, fields))
    if size == 0:
        raise FrameError(f'VectorNav group 1 has undefined fields in {fields:#06x}')
    acceleration, rate = flip_vector(sample.acceleration), flip_vector(sample.rate)
    content: dict[int, bytes] = {
        Field.TIME_STARTUP: _TIME.pack(device_time_ns),
        Field.QUATERNION: _QUATERNION.pack(
            *flip_quaternion(sample.orientation or (0.0, 0.0, 0.0, 1.0))),
        Field.ANGULAR_RATE: _VECTOR.pack(*rate),
        Field.ACCEL: _VECTOR.pack(*acceleration),
        Field.IMU: _VECTOR.pack(*acceleration) + _VECTOR.pack(*rate),
    }
    payload = bytearray(size)
    for field, offset in _offsets(fields).items():
        part = content.get(field, b'')
        payload[offset:offset + len(part)] = part
    return struct.pack('<BH', 1, fields) + payload
