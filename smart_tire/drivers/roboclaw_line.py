"""Requests and replies on the line that several RoboClaws share."""

from __future__ import annotations

import time
from typing import Any

from smart_tire.errors import FrameError
from smart_tire.protocol.roboclaw import Command, decode_reply, encode_request

REPLY_TIMEOUT = 0.035  # s; a board answers within a few ms, a busy host reads later
WRITE_TIMEOUT = 0.2    # s; a line that takes nothing for so long is as good as gone
ATTEMPTS = 2           # per request, both within one period of 16 Hz
MAX_STRAY = 20         # bytes between two requests: two late replies of the longest kind


class Line:
    """
    The host's end of the line: one request at a time, each answered before the next.

    A reply that is missing or damaged is asked for once more, then FrameError is raised. Counts
    go on when the port is opened again.
    """

    def __init__(self) -> None:
        self._port: Any = None
        self.frames_ok = 0
        self.last_ok_ns = 0      # host clock, when the latest good reply came
        self.frames_bad = 0      # replies that did not come or were damaged
        self.bytes_skipped = 0   # that were part of no good reply, or came too late for one
        self.last_error = ''
        self.retried = False     # whether the latest exchange took more than one attempt

    def use(self, port: Any) -> None:
        """Work on an open port from now on."""
        self._port = port
        port.timeout = REPLY_TIMEOUT
        port.write_timeout = WRITE_TIMEOUT

    def exchange(self, address: int, command: Command, *values: int) -> tuple[int, ...]:
        """Return the reply of the board at ``address``; raise FrameError if there is none."""
        self._refuse_flood()
        for attempt in range(ATTEMPTS):
            self.retried = attempt > 0
            try:
                return self._attempt(address, command, *values)
            except FrameError as error:
                failure = error
        raise failure

    def probe(self, address: int, command: Command) -> bool:
        """Return whether the line was quiet and the board answers a single request that reads."""
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
        """Return what has arrived."""
        return bytes(self._port.read(self._port.in_waiting)) if self._port.in_waiting else b''

    def discard(self) -> None:
        """Drop what was received and what has not been sent yet."""
        self._port.reset_output_buffer()
        self._flush()

    def _refuse_flood(self) -> None:
        """Raise FrameError where so many bytes came unasked that no reply can be trusted."""
        if (waiting := self._port.in_waiting) > MAX_STRAY:
            self._flush()
            self.frames_bad += 1
            self.last_error = f'{waiting} bytes came without a request'
            raise FrameError(self.last_error)

    def _attempt(self, address: int, command: Command, *values: int) -> tuple[int, ...]:
        self._flush()  # a reply that came too late would be taken for this one
        self._port.write(encode_request(address, command, *values))
        reply = self._port.read(command.reply_size)
        try:
            answer = decode_reply(address, command, reply)
        except FrameError as error:
            self.frames_bad += 1
            self.bytes_skipped += len(reply)
            self.last_error = str(error)
            raise
        self.frames_ok += 1
        self.last_ok_ns = time.time_ns()
        return answer

    def _flush(self) -> None:
        self.bytes_skipped += self._port.in_waiting
        self._port.reset_input_buffer()
