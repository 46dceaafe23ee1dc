"""Requests and replies on the serial line shared by several RoboClaws."""

from __future__ import annotations

import time
from typing import Any

from smart_tire.errors import FrameError
from smart_tire.protocol.roboclaw import Command, decode_reply, encode_request

REPLY_TIMEOUT = 0.035       # s; a board replies within a few ms, a busy host reads later
WRITE_TIMEOUT = 0.2         # s; a line that accepts no bytes for this long counts as lost
MAX_ATTEMPTS = 2            # per request, both within one period of 16 Hz
MAX_UNREQUESTED_BYTES = 20  # between two requests: two late replies of maximum length


class RoboclawLine:
    """
    Host side of the line: one request at a time, each with its reply before the next.

    A request is repeated once if its reply is missing or damaged; then FrameError is raised. The
    counters continue when the port is reopened.
    """

    def __init__(self) -> None:
        self._port: Any = None
        self.frames_ok = 0
        self.last_ok_ns = 0      # host clock, when the latest good reply arrived
        self.frames_bad = 0      # missing or damaged replies
        self.bytes_skipped = 0   # bytes that were not part of a good reply in time
        self.last_error = ''
        self.retried = False     # whether the latest exchange needed more than one attempt

    def use(self, port: Any) -> None:
        """Use an open port from now on."""
        self._port = port
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

    def _attempt(self, address: int, command: Command, *values: int) -> tuple[int, ...]:
        self._flush()  # a late reply would be mistaken for the reply to this request
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
