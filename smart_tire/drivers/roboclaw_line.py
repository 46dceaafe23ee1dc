# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Requests and replies on the serial line shared by several RoboClaws."""

from __future__ import annotations

from collections import deque
from typing import Any

from smart_tire.drivers.clock import Clock, SYSTEM
from smart_tire.errors import FrameError
from smart_tire.protocol.roboclaw import (
    Command, decode_reply, encode_request, READ_CURRENTS, READ_ENCODERS, SET_DUTY, WIDE)
from smart_tire.samples import NS_PER_S

REPLY_TIMEOUT = 0.035       # s; a board replies within a few ms, a busy host reads later
WRITE_TIMEOUT = 0.2         # s; a line that accepts no bytes for this long counts as lost
MAX_ATTEMPTS = 2            # per request, both within one period of 16 Hz
ACKNOWLEDGE_GAP = 0.003     # s without a byte after an acknowledgement that may be a late reply
MAX_UNREQUESTED_BYTES = 20  # between two requests: two late replies of maximum length
POLL = (READ_ENCODERS, READ_CURRENTS, SET_DUTY)  # to each board
BOARDS = 2
MAX_EXCHANGES = 41     # latest ones of a command, whose median counts: a busy host adds outliers
MIN_EXCHANGES = 16     # of a command, before the time is known


class RoboclawLine:
    """
    Host side of the line: one request at a time, each with its reply before the next.

    A request is repeated once if its reply is missing or damaged; then FrameError is raised. The
    counters continue when the port is reopened.
    """

    def __init__(self, clock: Clock = SYSTEM) -> None:
        self._clock = clock
        self._port: Any = None
        self.frames_ok = 0
        self.last_ok_ns = 0      # host clock, when the latest good reply arrived
        self.frames_bad = 0      # missing or damaged replies
        self.bytes_skipped = 0   # bytes that were not part of a good reply in time
        self.unread = b''        # replies are of no other protocol
        self.last_error = ''
        # addresses and read requests, in order, to which a reply may still arrive
        self._late: dict[tuple[int, Command], None] = {}
        # (address, command) -> the same command with the reply of the firmware, once it is known
        self._known: dict[tuple[int, Command], Command] = {}
        self.timing = LineTiming()
        self.retried = False     # whether the latest exchange needed more than one attempt

    def use(self, port: Any) -> None:
        """Use an open port from now on."""
        self._port = port
        self._late.clear()
        port.timeout = REPLY_TIMEOUT
        port.write_timeout = WRITE_TIMEOUT

    def exchange(self, address: int, command: Command, *values: int) -> tuple[int, ...]:
        """Return the values that the board replies; raise FrameError without a good reply."""
        self._refuse_flood()
        for attempt in range(MAX_ATTEMPTS):
            self.retried = attempt > 0
            try:
                return self._attempt(address, command, *values)
            except FrameError as error:
                failure = error
        raise failure

    def ask(self, address: int, command: Command, timeout: float) -> tuple[int, ...] | None:
        """
        Return the values that the board replies within ``timeout`` [s], None without a good reply.

        For values that the motors do not depend on: one attempt, and no error.
        """
        self._refuse_flood()
        try:
            return self._attempt(address, command, timeout=timeout)
        except FrameError:
            return None

    def probe(self, address: int, command: Command) -> bool:
        """Return whether the line was quiet and the board replies to a single read request."""
        quiet = not self._port.in_waiting
        try:
            self._attempt(address, command)
        except FrameError:
            return False
        return quiet

    def post(self, address: int, command: Command, *values: int) -> None:
        """Send a request without waiting for its reply."""
        self._port.write(encode_request(address, command, *values))

    def receive(self) -> bytes:
        """Return all received bytes."""
        return bytes(self._port.read(self._port.in_waiting)) if self._port.in_waiting else b''

    def discard(self) -> None:
        """Discard received bytes and bytes that have not been sent yet."""
        self._port.reset_output_buffer()
        self._flush()

    def _refuse_flood(self) -> None:
        """Raise FrameError if too many bytes arrived without a request to trust any reply."""
        if (waiting := self._port.in_waiting) > MAX_UNREQUESTED_BYTES:
            self._flush()
            self.frames_bad += 1
            self.last_error = f'{waiting} bytes arrived without a request'
            raise FrameError(self.last_error)

    def _attempt(self, address: int, command: Command, *values: int,
                 timeout: float | None = None) -> tuple[int, ...]:
        timeout = REPLY_TIMEOUT if timeout is None else timeout
        if self._port.timeout != timeout:  # pyserial sets up the port for each new one
            self._port.timeout = timeout
        self._flush()  # a late reply would be mistaken for the reply to this request
        asked_ns = self._clock.now_ns()
        self._clock.act(asked_ns)  # the reply is read at once: its time is half-way to then
        self._port.write(encode_request(address, command, *values))
        asked, command = command, self._known.get((address, command), command)
        reply = self._read(command.reply_size)
        if asked in WIDE and (address, asked) not in self._known:
            command, reply = self._with_width(address, asked, reply)
        if self._late and not (command.reads and _answers(address, command, reply)):
            reply = self._behind_late_replies(reply, command.reply_size)
        try:
            answer = decode_reply(address, command, reply)
        except FrameError as error:
            if command.reads:
                self._late[address, command] = None
            self.frames_bad += 1
            self.bytes_skipped += len(reply)
            self.last_error = str(error)
            raise
        if command.reads:
            self._forget_late(address, command)
        if asked in WIDE:
            self._known[address, asked] = command
        self.timing.record(asked, self._clock.now_ns() - asked_ns)
        self.frames_ok += 1
        self.last_ok_ns = self._clock.time_ns()
        return answer

    def _read(self, size: int) -> bytes:
        """Return ``size`` bytes, or those that arrive before the time-out of the port."""
        if self._clock.simulated is None:
            return bytes(self._port.read(size))
        end_ns, data = self._clock.now_ns() + round(self._port.timeout * NS_PER_S), b''
        while len(data) < size and self._clock.now_ns() < end_ns:
            self._clock.act(self._clock.now_ns())
            data += self._port.read(size - len(data))
        return data

    def _with_width(self, address: int, command: Command, reply: bytes
                    ) -> tuple[Command, bytes]:
        """Return the command whose reply this is, by its CRC, and the whole reply."""
        wide = WIDE[command]
        if len(reply) == command.reply_size and not _answers(address, command, reply):
            reply += self._read(wide.reply_size - len(reply))
            if _answers(address, wide, reply):
                return wide, reply
        return command, reply

    def _behind_late_replies(self, reply: bytes, size: int) -> bytes:
        """
        Return the reply of ``size`` bytes that may be behind replies to earlier requests.

        An acknowledgement has no CRC: the first byte of a late reply may equal it.
        """
        self._clock.sleep(ACKNOWLEDGE_GAP)
        reply += self.receive()
        skipped = 0
        for late in tuple(self._late):
            address, command = late
            if _answers(address, command, reply[:command.reply_size]):
                del self._late[late]
                skipped += command.reply_size
                reply = reply[command.reply_size:]
                if len(reply) < size:
                    reply += self._read(size - len(reply))
        self.bytes_skipped += skipped
        return reply[:size] if skipped else reply  # more are the reply to a repetition

    def _forget_late(self, address: int, command: Command) -> None:
        """
        Forget requests before ``command``: a board replies in the order of the requests.

        After a repetition of ``command`` its second reply may still arrive.
        """
        if self._late:
            self._late = {late: None for late in self._late
                          if late[0] != address or late[1] == command}

    def _flush(self) -> None:
        self.bytes_skipped += self._port.in_waiting
        self._port.reset_input_buffer()


def _answers(address: int, command: Command, reply: bytes) -> bool:
    """Return whether ``reply`` is a good reply of the board to ``command``."""
    try:
        decode_reply(address, command, reply)
    except FrameError:
        return False
    return True


class LineTiming:
    """
    Median durations of the exchanges on the line, and the poll rate that they permit.

    A poll is encoders, currents and duty of each board; without replies to requests for currents
    it is the rest. ``record`` is called from one thread.
    """

    def __init__(self) -> None:
        self._durations: dict[Command, deque[int]] = {
            command: deque(maxlen=MAX_EXCHANGES) for command in POLL}

    def record(self, command: Command, duration_ns: int) -> None:
        """Record a request with its good reply, which took ``duration_ns``."""
        if command in self._durations:
            self._durations[command].append(duration_ns)

    @property
    def poll_time(self) -> float:
        """Return the time of a poll [s], 0 until it is known."""
        durations = {command: tuple(known) for command, known in self._durations.items()}
        if min(len(durations[one]) for one in (READ_ENCODERS, SET_DUTY)) < MIN_EXCHANGES:
            return 0.0
        from statistics import median  # nodes start without
        return BOARDS / NS_PER_S * sum(median(known) for known in durations.values() if known)

    def excess(self, rate: float) -> str:
        """Return why the ``rate`` of polls [Hz] is too high, '' if it is not or not known."""
        if rate * self.poll_time <= 1.0:
            return ''
        return f'rate is {rate:g} Hz, expected less; {self}'

    def __str__(self) -> str:
        """Return poll time and maximum rate, once they are known, as text."""
        return (f'{BOARDS} boards on the line: one poll takes {1e3 * self.poll_time:.1f} ms, '
                f'at most {int(1.0 / self.poll_time)} Hz')
