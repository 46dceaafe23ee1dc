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
VectorNav VN-100, ASCII output: the sentence ``$VNYMR``.

Sentence: ``$``, fields, ``*``, checksum, CR LF. The checksum is the XOR of the characters between
``$`` and ``*`` as two hexadecimal digits, or their CRC-16 as four. VNYMR: yaw, pitch, roll [deg],
magnetic x, y, z [G], acceleration x, y, z [m/s2], angular rate x, y, z [rad/s], in the same axes
as the binary output. VectorNav, "VN-100 User Manual" UM001, sections 3.8 and 7.2.3.
"""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Callable, Iterator
from functools import reduce
import math
import operator

from smart_tire.errors import FrameError
from smart_tire.protocol.axes import flip_quaternion, flip_vector, sample_from_flipped
from smart_tire.protocol.deframer import Deframer
from smart_tire.rotation import euler, quaternion
from smart_tire.samples import ImuSample, Vector3

YMR = b'VNYMR'
MAX_ANGLE = 360.0          # deg; a VN-100 sends -180 to 180
MAX_SENTENCE_LENGTH = 256  # bytes; a VNYMR with counter and status has 147

_START = b'$'
_END = b'\n'
_YMR_FORMAT = ','.join(('{:+08.3f}',) * 3 + ('{:+08.4f}',) * 3 + ('{:+07.3f}',) * 3
                       + ('{:+010.6f}',) * 3)


def checksum(body: bytes) -> bytes:
    """Return the 8-bit checksum of ``body`` as two hexadecimal digits."""
    return b'%02X' % reduce(operator.xor, body, 0)


def crc_digits(body: bytes) -> bytes:
    """Return the 16-bit CRC of ``body`` as four hexadecimal digits."""
    return b'%04X' % crc_hqx(body, 0)


class AsciiDeframer(Deframer):
    """
    Extracts sentences from a byte stream; a body is the text between ``$`` and ``*``.

    States::

        +-----------+               $                +------------+
        | searching | -----------------------------> | incomplete |
        +-----------+ <----------------------------- +------------+
                       body yielded, or bad frame

    A sentence ends at a line feed or before the next ``$``. It is bad if its checksum is wrong, or
    if no end follows within ``MAX_SENTENCE_LENGTH``.
    """

    def _bodies(self) -> Iterator[bytes]:
        while (start := self._buffer.find(_START)) >= 0:
            self._discard(start)
            ends = [end for end in (self._buffer.find(_START, 1, MAX_SENTENCE_LENGTH + 1),
                                    self._buffer.find(_END, 0, MAX_SENTENCE_LENGTH) + 1)
                    if end > 0]
            if not ends and len(self._buffer) <= MAX_SENTENCE_LENGTH:
                return  # incomplete
            end = min(ends, default=MAX_SENTENCE_LENGTH)
            body = _intact(bytes(self._buffer[1:end]).rstrip())
            if body is None:
                self.bad_frames += 1
                self._discard(end)
            else:
                del self._buffer[:end]
                yield body
        self._discard(len(self._buffer))


def _intact(sentence: bytes) -> bytes | None:
    body, star, digits = sentence.rpartition(b'*')
    if not star or digits.upper() not in (checksum(body), crc_digits(body)):
        return None
    return body


def encode_sentence(body: bytes, digits: Callable[[bytes], bytes] = checksum) -> bytes:
    """Return the sentence with ``body`` and its ``checksum`` or ``crc_digits``."""
    return _START + body + b'*' + digits(body) + b'\r\n'


def decode_ymr(body: bytes, stamp_ns: int = 0) -> tuple[None, ImuSample]:
    """
    Return None, as a sentence gives no device time, and the sample with ``stamp_ns``.

    A counter (T...) and a status (S...) may follow the twelve numbers. Raise FrameError if
    ``body`` is another sentence or has values that no sensor measures.
    """
    header, *fields = body.split(b',')
    extra = fields[12:]
    if header != YMR or len(fields) < 12 or any(field[:1] not in (b'T', b'S') for field in extra):
        raise FrameError(f'sentence is {body[:40]!r} with {len(fields)} fields, '
                         f'expected {YMR!r} with 12')
    try:
        numbers = [float(field) for field in fields[:12]]
    except ValueError as error:
        raise FrameError(f'sentence {body!r} has a field that is not a number') from error
    if not all(map(math.isfinite, numbers)):
        raise FrameError(f'sentence {body!r} has a field that is not finite')
    if max(map(abs, numbers[:3])) > MAX_ANGLE:
        raise FrameError(f'yaw, pitch and roll are {numbers[:3]}, '
                         f'expected magnitudes up to {MAX_ANGLE:g} deg')
    yaw, pitch, roll = (math.radians(angle) for angle in numbers[:3])
    acceleration, rate = numbers[6:9], numbers[9:]
    return None, sample_from_flipped(
        stamp_ns, (acceleration[0], acceleration[1], acceleration[2]), (rate[0], rate[1], rate[2]),
        quaternion(roll, pitch, yaw))


def encode_ymr(sample: ImuSample, *, magnetic: Vector3 = (0.0, 0.0, 0.0)) -> bytes:
    """Return the body for ``decode_ymr``; ``magnetic`` [G] is in device axes."""
    attitude = flip_quaternion(sample.orientation or (0.0, 0.0, 0.0, 1.0))
    angles = (math.degrees(angle) for angle in reversed(euler(attitude)))
    numbers = (*angles, *magnetic, *flip_vector(sample.acceleration), *flip_vector(sample.rate))
    return YMR + b',' + _YMR_FORMAT.format(*numbers).encode('ascii')
