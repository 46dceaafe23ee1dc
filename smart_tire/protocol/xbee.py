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
XBee API mode 2 (AP = 2, escaped) and its frames with received data.

Frame: 0x7E, length u16 (big-endian), body, checksum: 0xFF minus the low byte of the body's sum.
After the start byte, 0x7E, 0x7D, 0x11 and 0x13 are sent as 0x7D and the byte XOR 0x20, so 0x7E on
the wire always starts a frame. In mode 1 (AP = 1) nothing is escaped; it is named, not read.
Digi, "XBee/XBee-PRO ZigBee RF Modules User Guide", API operation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import re
import struct

from smart_tire.errors import FrameError
from smart_tire.protocol.deframer import Deframer

START = 0x7E
RECEIVE_PACKET = 0x90  # frame type
EXPLICIT_PACKET = 0x91  # the same with endpoints, cluster and profile (AO = 1)
STATUS_TYPES = frozenset((0x88, 0x8A, 0x8B))  # of commands, of the module, of transmissions
MAX_BODY_LENGTH = 512  # bytes; a ZigBee module sends up to 12 + 255

OF_MODE_1 = 'frames are not escaped: set AP = 2 of the coordinator'

_ESCAPE = 0x7D
_ESCAPE_XOR = 0x20
_SPECIAL = re.compile(rb'[\x7e\x7d\x11\x13]')
_ESCAPED = re.compile(rb'\x7d(.?)', re.DOTALL)
_HEADER = struct.Struct('>BQHB')  # frame type, 64-bit source, 16-bit source, options
_EXPLICIT = struct.Struct('>BQHBBHHB')  # endpoints, cluster and profile before the options


@dataclass(frozen=True, slots=True)
class ReceivePacket:
    """Data received from a remote module, frame type 0x90 or 0x91."""

    source: int   # 64-bit address
    network: int  # 16-bit address, 0xFFFE if unknown
    options: int  # bit 0 acknowledged, bit 1 broadcast
    data: bytes


def escape(data: bytes) -> bytes:
    """Return ``data`` with its special bytes escaped, as sent after the start byte."""
    return _SPECIAL.sub(lambda found: bytes((_ESCAPE, found[0][0] ^ _ESCAPE_XOR)), data)


def unescape(raw: bytes) -> bytes:
    """Return ``raw`` with its escapes resolved; an escape byte at the end is left out."""
    if _ESCAPE not in raw:
        return raw
    return _ESCAPED.sub(lambda found: bytes(byte ^ _ESCAPE_XOR for byte in found[1]), raw)


def encode_frame(body: bytes) -> bytes:
    """Return the escaped frame with ``body``; raise FrameError if its length is not allowed."""
    if not 1 <= len(body) <= MAX_BODY_LENGTH:
        raise FrameError(f'XBee body has {len(body)} bytes, expected 1 to {MAX_BODY_LENGTH}')
    checksum = 0xFF - (sum(body) & 0xFF)
    return bytes((START,)) + escape(struct.pack('>H', len(body)) + body + bytes((checksum,)))


def encode_receive_packet(packet: ReceivePacket) -> bytes:
    """Return the body for ``decode_receive_packet``."""
    header = _HEADER.pack(RECEIVE_PACKET, packet.source, packet.network, packet.options)
    return header + packet.data


def decode_receive_packet(body: bytes) -> ReceivePacket:
    """Return the packet in ``body``; raise FrameError if it is too short or of another type."""
    header = _EXPLICIT if body[:1] == bytes((EXPLICIT_PACKET,)) else _HEADER
    if len(body) < header.size:
        raise FrameError(f'XBee body has {len(body)} bytes, expected at least {header.size}')
    kind, source, network, *_, options = header.unpack_from(body)
    if kind not in (RECEIVE_PACKET, EXPLICIT_PACKET):
        raise FrameError(f'XBee frame type is {kind:#04x}, expected {RECEIVE_PACKET:#04x}')
    return ReceivePacket(source, network, options, body[header.size:])


def is_status(body: bytes) -> bool:
    """Return whether ``body`` is a status of the module, without received data."""
    return body[0] in STATUS_TYPES


class XBeeDeframer(Deframer):
    """
    Extracts API mode 2 frames from a byte stream; a body starts with its frame type.

    States::

        +-----------+             0x7E               +------------+
        | searching | -----------------------------> | incomplete |
        +-----------+ <----------------------------- +------------+
                       body yielded, or bad frame

    A frame ends after the bytes that its length demands. It is bad if the length is out of range,
    the checksum wrong, or if another 0x7E precedes its end; that one starts the next frame.

    An intact frame with bytes that mode 2 escapes is named in ``damage``, until one has escapes.
    """

    def __init__(self) -> None:
        super().__init__()
        self._needed = 0  # bytes in the buffer, with fewer the frame cannot be complete

    def _bodies(self) -> Iterator[bytes]:
        while (start := self._buffer.find(START)) >= 0:
            self._discard(start)
            end = self._buffer.find(START, 1)
            latest = end == -1
            if latest and len(self._buffer) < self._needed:
                return
            end = len(self._buffer) if latest else end
            content = unescape(bytes(self._buffer[1:end]))
            length = int.from_bytes(content[:2], 'big') if len(content) >= 2 else 0
            size = 2 + length + 1 if len(content) >= 2 else 2
            if latest and len(content) < size and length <= MAX_BODY_LENGTH:
                self._needed = len(self._buffer) + size - len(content)
                return
            self._needed = 0
            body = content[2:2 + length]
            if 1 <= length <= MAX_BODY_LENGTH and _intact(body, content[2 + length:size]):
                self.skipped_bytes += len(content) - size
                if len(content) < end - 1:
                    self.damage = ''
                elif _SPECIAL.search(content[:size]):
                    self.damage = OF_MODE_1
                del self._buffer[:end]
                yield body
            else:
                self.bad_frames += 1
                self._discard(end)  # no frame starts before the next 0x7E
        self._discard(len(self._buffer))


def _intact(body: bytes, checksum: bytes) -> bool:
    return len(checksum) == 1 and (sum(body) + checksum[0]) & 0xFF == 0xFF
