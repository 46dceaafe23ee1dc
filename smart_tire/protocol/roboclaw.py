"""
RoboClaw packet serial with CRC-16: what the host asks, what a board answers.

Request that sets something: address, command, values, CRC over all of it; answered by 0xFF.
Request that reads something: address, command and nothing else; answered by the values and a
CRC over address, command and values. Values and CRC are big-endian. A board discards what it
has of a packet after 10 ms of silence. Basicmicro, "RoboClaw Series User Manual", "Packet
Serial", "Advanced Packet Serial" and "Encoders".
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math
import struct

from smart_tire.errors import FrameError
from smart_tire.protocol.crc import crc16

ADDRESSES = range(0x80, 0x88)
ACKNOWLEDGE = b'\xff'
PACKET_GAP_NS = 10_000_000  # silence after which a board discards a packet
COUNT_WRAP = 1 << 32
DUTY_MAX = 32767            # +-100 %
TIMEOUT_UNIT = 0.1          # s
BATTERY_UNIT = 0.1          # V
STATUS_NORMAL = 0

_CRC = struct.Struct('>H')


@dataclass(frozen=True, slots=True)
class Command:
    """One command: the values that go and the values that come back, as struct formats."""

    code: int
    request: str = '>'
    reply: str = '>'

    @property
    def reads(self) -> bool:
        """Return whether the board answers with values; else it acknowledges."""
        return self.reply != '>'

    @property
    def request_size(self) -> int:
        """Return the bytes of the whole request."""
        return 2 + (0 if self.reads else struct.calcsize(self.request) + _CRC.size)

    @property
    def reply_size(self) -> int:
        """Return the bytes of the whole reply."""
        return struct.calcsize(self.reply) + _CRC.size if self.reads else len(ACKNOWLEDGE)


SET_TIMEOUT = Command(14, request='>B')      # TIMEOUT_UNIT; 0 is never
READ_TIMEOUT = Command(15, reply='>B')
RESET_ENCODERS = Command(20)
SET_ENCODER_1 = Command(22, request='>I')    # counts
SET_ENCODER_2 = Command(23, request='>I')
READ_BATTERY = Command(24, reply='>H')       # 0.1 V
SET_DUTY = Command(34, request='>hh')        # M1, M2, DUTY_MAX
READ_ENCODERS = Command(78, reply='>II')     # M1, M2, counts modulo COUNT_WRAP
READ_SPEEDS = Command(79, reply='>ii')       # M1, M2, counts per second, over 1/300 s
READ_STATUS = Command(90, reply='>H')        # bits, 0 is normal

COMMANDS = {command.code: command for command in (
    SET_TIMEOUT, READ_TIMEOUT, RESET_ENCODERS, SET_ENCODER_1, SET_ENCODER_2, READ_BATTERY,
    SET_DUTY, READ_ENCODERS, READ_SPEEDS, READ_STATUS)}


@dataclass(frozen=True, slots=True)
class Request:
    """One request as a board understands it."""

    address: int
    command: Command
    values: tuple[int, ...]


def encode_request(address: int, command: Command, *values: int) -> bytes:
    """Return the bytes for the board at ``address``."""
    packet = bytes((address, command.code)) + struct.pack(command.request, *values)
    return packet if command.reads else packet + _CRC.pack(crc16(packet))


def encode_reply(address: int, command: Command, *values: int) -> bytes:
    """Return the answer of the board at ``address``."""
    if not command.reads:
        return ACKNOWLEDGE
    content = struct.pack(command.reply, *values)
    return content + _CRC.pack(crc16(bytes((address, command.code)) + content))


def decode_reply(address: int, command: Command, reply: bytes) -> tuple[int, ...]:
    """Return the values in ``reply``; raise FrameError if it is no intact answer to this."""
    name = f'reply of {address:#04x} to command {command.code}'
    if len(reply) != command.reply_size:
        raise FrameError(f'{name} has {len(reply)} bytes, expected {command.reply_size}')
    if not command.reads:
        if reply != ACKNOWLEDGE:
            raise FrameError(f'{name} is {reply.hex()}, expected {ACKNOWLEDGE.hex()}')
        return ()
    if crc16(bytes((address, command.code)) + reply):
        raise FrameError(f'{name} has a wrong CRC: {reply.hex()}')
    return struct.unpack(command.reply, reply[:-_CRC.size])


def count_step(new: int, old: int) -> int:
    """Return how far an encoder went from ``old`` to ``new``, across the wrap of its counter."""
    return (new - old + COUNT_WRAP // 2) % COUNT_WRAP - COUNT_WRAP // 2


def duty_code(duty: float) -> int:
    """Return the value on the wire for a duty, clipped to [-1, 1]; raise ValueError for NaN."""
    if math.isnan(duty):
        raise ValueError('duty is NaN')
    return round(max(-1.0, min(1.0, duty)) * DUTY_MAX)


def duty_from_code(code: int) -> float:
    """Return the duty in [-1, 1] for a value on the wire."""
    return max(-1.0, code / DUTY_MAX)


def timeout_code(seconds: float) -> int:
    """Return the value of ``SET_TIMEOUT`` for at least ``seconds``, never 0 (no time-out)."""
    units = round(seconds / TIMEOUT_UNIT, 6)  # 1.1 s is 11 units and not a little more
    return max(1, min(255, math.ceil(units)))


class RequestDeframer:
    """
    What a board does with the bytes on its line: understand requests, to whomever they go.

    A packet with a wrong CRC, an unknown command or an address that none has costs one byte.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.bad_frames = 0
        self.skipped_bytes = 0

    def clear(self) -> None:
        """Discard an incomplete packet, as a board does after ``PACKET_GAP_NS`` of silence."""
        self.skipped_bytes += len(self._buffer)
        self._buffer.clear()

    def feed(self, chunk: bytes) -> Iterator[Request]:
        """Take ``chunk`` and return an iterator over the requests complete with it."""
        self._buffer += chunk
        return self._requests()

    def _requests(self) -> Iterator[Request]:
        while len(self._buffer) >= 2:
            address, code = self._buffer[:2]
            command = COMMANDS.get(code)
            if address not in ADDRESSES or command is None:
                self._skip()
                continue
            packet = bytes(self._buffer[:command.request_size])
            if len(packet) < command.request_size:
                return
            if command.reads:
                values: tuple[int, ...] = ()
            elif crc16(packet) == 0:
                values = struct.unpack(command.request, packet[2:-_CRC.size])
            else:
                self.bad_frames += 1
                self._skip()
                continue
            del self._buffer[:len(packet)]
            yield Request(address, command, values)

    def _skip(self) -> None:
        self.skipped_bytes += 1
        del self._buffer[:1]
