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
RoboClaw packet serial with CRC-16/XMODEM: requests of the host and replies of a board.

Write request: address, command, values, CRC of all these bytes; reply: 0xFF.
Read request: address, command; reply: values, CRC of address, command and values.
Values and CRC are big-endian; a text ends with LF and 0 before the CRC. A board discards an
incomplete packet after 10 ms without a byte.
Basicmicro, "RoboClaw Series User Manual", sections "Packet Serial", "Advanced Packet Serial" and
"Encoders".
"""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
import math
import struct

from smart_tire.errors import FrameError
from smart_tire.protocol.deframer import Deframer

ADDRESSES = range(0x80, 0x88)  # packet modes 7 to 14
ACKNOWLEDGE = b'\xff'          # reply to a valid write request
COUNT_WRAP = 1 << 32        # counts, modulus of the encoder counters
MAX_DUTY_CODE = 32767       # 100 % duty
TIMEOUT_RESOLUTION = 0.1    # s per count of the serial time-out
BATTERY_RESOLUTION = 0.1    # V per count of the battery voltage
MAX_CURRENT_CODE = 32767    # largest magnitude: the current may be larger
CURRENT_RESOLUTION = 0.01   # A per count of a motor current
MAX_TEXT_LENGTH = 48        # bytes of a text with its end
TEXT_END = b'\n\0'
STATUS_NORMAL = 0           # status without error or warning bits

_CRC = struct.Struct('>H')


@dataclass(frozen=True)
class Command:
    """One command, with the struct formats of the values in its request and in its reply."""

    code: int
    request: str = '>'
    reply: str = '>'
    text: bool = False  # whether the reply is a text, of any length up to MAX_TEXT_LENGTH

    @cached_property
    def reads(self) -> bool:
        """Return whether the reply holds values; otherwise it is an acknowledgement."""
        return self.text or self.reply != '>'

    @cached_property
    def request_size(self) -> int:
        """Return the size of the whole request in bytes."""
        return 2 + (0 if self.reads else struct.calcsize(self.request) + _CRC.size)

    @cached_property
    def reply_size(self) -> int:
        """Return the size of the whole reply in bytes, the largest one of a text."""
        if self.text:
            return MAX_TEXT_LENGTH + _CRC.size
        return struct.calcsize(self.reply) + _CRC.size if self.reads else len(ACKNOWLEDGE)


SET_TIMEOUT = Command(14, request='>B')      # in TIMEOUT_RESOLUTION; 0 disables the time-out
READ_TIMEOUT = Command(15, reply='>B')
READ_VERSION = Command(21, text=True)        # moves nothing; every board in packet mode replies
READ_BATTERY = Command(24, reply='>H')       # in BATTERY_RESOLUTION
SET_DUTY = Command(34, request='>hh')        # M1, M2, 100 % is MAX_DUTY_CODE
READ_CURRENTS = Command(49, reply='>hh')     # M1, M2, in CURRENT_RESOLUTION
READ_ENCODERS = Command(78, reply='>II')     # M1, M2, counts modulo COUNT_WRAP
READ_SPEEDS = Command(79, reply='>ii')       # M1, M2, counts per second, averaged over 1/300 s
READ_STATUS = Command(90, reply='>H')        # bit field, STATUS_NORMAL if no bit is set
READ_STATUS_32 = Command(90, reply='>I')     # the same since firmware 4.2
WIDE = {READ_STATUS: READ_STATUS_32}         # commands with a longer reply of newer firmware

COMMANDS = {command.code: command for command in (
    SET_TIMEOUT, READ_TIMEOUT, READ_VERSION, READ_BATTERY, SET_DUTY, READ_CURRENTS, READ_ENCODERS,
    READ_SPEEDS, READ_STATUS)}


@dataclass(frozen=True, slots=True)
class Request:
    """One decoded request."""

    address: int
    command: Command
    values: tuple[int, ...]


def encode_request(address: int, command: Command, *values: int) -> bytes:
    """Return the request to the board at ``address``."""
    packet = bytes((address, command.code)) + struct.pack(command.request, *values)
    return packet if command.reads else packet + _CRC.pack(crc_hqx(packet, 0))


def decode_request(packet: bytes) -> Request:
    """Return the request in ``packet``, a body of ``RequestDeframer``."""
    address, code = packet[:2]
    command = COMMANDS[code]
    values = () if command.reads else struct.unpack(command.request, packet[2:-_CRC.size])
    return Request(address, command, values)


def encode_reply(address: int, command: Command, *values: int) -> bytes:
    """Return the reply of the board at ``address``."""
    if not command.reads:
        return ACKNOWLEDGE
    content = struct.pack(command.reply, *values)
    return content + _CRC.pack(crc_hqx(bytes((address, command.code)) + content, 0))


def decode_reply(address: int, command: Command, reply: bytes) -> tuple[int, ...]:
    """Return the values in ``reply``; raise FrameError if it does not answer ``command``."""
    if len(reply) != command.reply_size:
        problem = f'has {len(reply)} bytes, expected {command.reply_size}'
    elif not command.reads and reply != ACKNOWLEDGE:
        problem = f'is {reply.hex()}, expected {ACKNOWLEDGE.hex()}'
    elif command.reads and crc_hqx(bytes((address, command.code)) + reply, 0):
        problem = f'has a wrong CRC: {reply.hex()}'
    else:
        return struct.unpack(command.reply, reply[:-_CRC.size]) if command.reads else ()
    raise FrameError(f'reply of {address:#04x} to command {command.code} {problem}')


def encode_text_reply(address: int, command: Command, text: str) -> bytes:
    """Return the reply of the board at ``address`` with a ``text``."""
    content = text.encode('ascii') + TEXT_END
    return content + _CRC.pack(crc_hqx(bytes((address, command.code)) + content, 0))


def decode_text_reply(address: int, command: Command, reply: bytes) -> str:
    """Return the text in ``reply``; raise FrameError if it does not answer ``command``."""
    text, end, checksum = reply.partition(TEXT_END)
    if not end or len(checksum) != _CRC.size or (
            crc_hqx(bytes((address, command.code)) + reply, 0)):
        raise FrameError(f'reply of {address:#04x} to command {command.code} is no text with a '
                         f'correct CRC: {reply.hex()}')
    return text.decode('ascii', 'replace')


def count_step(new: int, old: int) -> int:
    """Return the signed difference of two encoder counts, across the wrap of the counter."""
    return (new - old + COUNT_WRAP // 2) % COUNT_WRAP - COUNT_WRAP // 2


def duty_code(duty: float) -> int:
    """Return the encoded duty, clipped to [-1, 1]; raise ValueError if it is NaN."""
    if math.isnan(duty):
        raise ValueError('duty is NaN')
    return round(max(-1.0, min(1.0, duty)) * MAX_DUTY_CODE)


def duty_from_code(code: int) -> float:
    """Return the duty in [-1, 1] of an encoded duty."""
    return max(-1.0, code / MAX_DUTY_CODE)


def current_code(current: float) -> int:
    """Return the encoded current [A], clipped to the range of the code."""
    return max(-MAX_CURRENT_CODE, min(MAX_CURRENT_CODE, round(current / CURRENT_RESOLUTION)))


def current_from_code(code: int) -> float:
    """Return the current [A] of an encoded current; NaN if the code is at the end of its range."""
    return code * CURRENT_RESOLUTION if abs(code) < MAX_CURRENT_CODE else math.nan


def timeout_code(seconds: float) -> int:
    """Return the encoded time-out, rounded up and at least 1, as 0 would disable it."""
    counts = round(seconds / TIMEOUT_RESOLUTION, 6)  # 1.1 / 0.1 exceeds 11 by a rounding error
    return max(1, min(255, math.ceil(counts)))


class RequestDeframer(Deframer):
    """
    Extracts requests to any address from a byte stream, as a board does.

    States::

        +-----------+   address and known command    +------------+
        | searching | -----------------------------> | incomplete |
        +-----------+ <----------------------------- +------------+
                       request yielded, or CRC wrong (bad frame)

    Any other byte while searching, and the first byte of a bad frame, is discarded.
    """

    def clear(self) -> None:
        """Discard an incomplete packet, as a board does after a pause."""
        self._discard(len(self._buffer))

    def _bodies(self) -> Iterator[bytes]:
        while len(self._buffer) >= 2:
            command = COMMANDS.get(self._buffer[1])
            if self._buffer[0] not in ADDRESSES or command is None:
                self._discard(1)
                continue
            packet = bytes(self._buffer[:command.request_size])
            if len(packet) < command.request_size:
                return
            if command.reads or crc_hqx(packet, 0) == 0:
                del self._buffer[:len(packet)]
                yield packet
            else:
                self.bad_frames += 1
                self._discard(1)
