"""Two RoboClaws on one port: encoders in, duties out, and a stop when nobody commands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
import threading
import time
from typing import Any

from smart_tire.errors import FrameError
from smart_tire.protocol.roboclaw import (
    Command, count_step, decode_reply, duty_code, duty_from_code, encode_request, READ_ENCODERS,
    SET_DUTY, SET_TIMEOUT, timeout_code)
from smart_tire.samples import Four, NS_PER_S, WheelSample

REPLY_TIMEOUT = 0.1   # s; a board answers within a few ms, a busy host reads later
MAX_SPEED = 100.0     # rad/s; a count that went further means that the board lost its counts
MAX_PERIODS = 4       # a mean speed over more of them is none of now and not worth telling
NEVER_NS = -1 << 62
AXLES = ('front', 'rear')
STOPPED: Four = (0.0, 0.0, 0.0, 0.0)


@dataclass
class _Wheel:
    """One encoder, unwrapped."""

    sign: int
    radians_per_count: float
    count: int | None = None
    position: float = 0.0  # rad
    velocity: float = 0.0  # rad/s, mean over the last period

    def update(self, count: int, elapsed: float) -> None:
        """Follow the encoder to ``count``, ``elapsed`` seconds after the last one."""
        if self.count is not None and elapsed > 0.0:
            step = self.sign * count_step(count, self.count) * self.radians_per_count
            if abs(step) <= MAX_SPEED * elapsed:
                self.position += step
                self.velocity = step / elapsed
        self.count = count


class _Board:
    """One board: the wheels of an axle, and what was said to it."""

    def __init__(self, address: int, left: _Wheel, right: _Wheel) -> None:
        self.address = address
        self.wheels = (left, right)
        self.prepared = False    # the serial time-out is set
        self.read_ns: int | None = None
        self.duty = (0.0, 0.0)   # that the board acknowledged


class MotorBoards:
    """
    Poll both boards at a fixed rate and pass duties on at once.

    ``run`` is the work of a link; ``command`` may be called from any thread. A board that does
    not answer, or answers with a wrong CRC, is counted and asked again in the next cycle.
    """

    def __init__(self, addresses: tuple[int, ...], signs: tuple[int, ...],
                 counts_per_revolution: float, rate: float, command_timeout: float,
                 deliver: Callable[[WheelSample], None], report: Callable[[str], None]) -> None:
        wheels = [_Wheel(sign, math.tau / counts_per_revolution) for sign in signs]
        self._boards = [_Board(address, *wheels[2 * axle:2 * axle + 2])
                        for axle, address in enumerate(addresses)]
        self._wheels = wheels
        self._period_ns = round(NS_PER_S / rate)
        self._timeout = command_timeout
        self._timeout_ns = round(command_timeout * NS_PER_S)
        self._deliver, self._report = deliver, report
        self._changed = threading.Event()
        self._command: tuple[Four, int] = (STOPPED, NEVER_NS)  # duty, steady clock [ns]
        self._silent = True
        self._since_ns = time.monotonic_ns()  # when the boards were first asked
        self.frames_ok = 0
        self.last_ok_ns = 0   # host clock, when the latest good reply came
        self.frames_bad = 0   # replies that did not come or were damaged
        self.bytes_skipped = 0  # that were no good reply, or came too late for one
        self.timeouts = 0     # times that the commands ceased
        self.last_error = ''

    def command(self, duty: Four) -> None:
        """Apply ``duty`` now and until ``command_timeout`` has passed without another one."""
        self._command = (duty, time.monotonic_ns())
        self._changed.set()

    def run(self, port: Any, stopping: threading.Event) -> None:
        """Work on an open port until told to stop; the motors are stopped before it returns."""
        port.timeout = REPLY_TIMEOUT
        for board in self._boards:
            board.prepared = False
        self._since_ns = due_ns = time.monotonic_ns()
        while not stopping.is_set():
            self._cycle(port)
            due_ns = max(due_ns + self._period_ns, time.monotonic_ns())
            while not stopping.is_set() and time.monotonic_ns() < due_ns:
                self._changed.wait((self._next_ns(due_ns) - time.monotonic_ns()) / NS_PER_S)
                if self._changed.is_set() or self._expired() != self._silent:
                    self._drive(port)
        self._command = (STOPPED, NEVER_NS)
        self._drive(port)

    def unread(self) -> dict[str, float]:
        """Return for how long each board has not told its encoders [s], by its name."""
        now_ns = time.monotonic_ns()
        return {f'{axle} board {board.address} (0x{board.address:x})':
                (now_ns - max(board.read_ns or self._since_ns, self._since_ns)) / NS_PER_S
                for axle, board in zip(AXLES, self._boards)}

    def _expired(self) -> bool:
        return time.monotonic_ns() > self._command[1] + self._timeout_ns

    def _next_ns(self, due_ns: int) -> int:
        """Return when to look again if no command comes: the next cycle, or to stop the motors."""
        return due_ns if self._silent else min(due_ns, self._command[1] + self._timeout_ns + 1)

    def _cycle(self, port: Any) -> None:
        read = [self._prepare(port, board) and self._read(port, board) for board in self._boards]
        if all(read):
            self._deliver(self._sample())
        self._drive(port)

    def _prepare(self, port: Any, board: _Board) -> bool:
        """Set the board's own time-out, which stops it when this program does not."""
        if not board.prepared:
            answer = self._exchange(port, board, SET_TIMEOUT, timeout_code(self._timeout))
            board.prepared = answer is not None
        return board.prepared

    def _read(self, port: Any, board: _Board) -> bool:
        asked_ns = time.monotonic_ns()
        counts = self._exchange(port, board, READ_ENCODERS)
        if counts is None:
            return False
        middle_ns = (asked_ns + time.monotonic_ns()) // 2
        elapsed_ns = 0 if board.read_ns is None else middle_ns - board.read_ns
        board.read_ns = middle_ns
        for wheel, count in zip(board.wheels, counts):
            wheel.update(count, elapsed_ns / NS_PER_S)
        return 0 < elapsed_ns <= MAX_PERIODS * self._period_ns

    def _sample(self) -> WheelSample:
        """Return the wheels at the middle between the boards' readings."""
        times = [board.read_ns or 0 for board in self._boards for _ in board.wheels]
        middle_ns = sum(times) // len(times)
        position = [wheel.position + wheel.velocity * (middle_ns - read_ns) / NS_PER_S
                    for wheel, read_ns in zip(self._wheels, times)]
        velocity = [wheel.velocity for wheel in self._wheels]
        duty = [value for board in self._boards for value in board.duty]
        effort = [wheel.sign * value for wheel, value in zip(self._wheels, duty)]
        stamp_ns = time.time_ns() - (time.monotonic_ns() - middle_ns)
        return WheelSample(stamp_ns, _four(velocity), _four(position), _four(effort))

    def _drive(self, port: Any) -> None:
        self._changed.clear()
        duty, silent = self._command[0], self._expired()
        if silent and not self._silent:
            self.timeouts += 1
            self._report(f'no motor command for {self._timeout:g} s: motors stopped')
        self._silent = silent
        codes = [duty_code(wheel.sign * value)
                 for wheel, value in zip(self._wheels, STOPPED if silent else duty)]
        for axle, board in enumerate(self._boards):
            pair = codes[2 * axle:2 * axle + 2]
            if board.prepared and self._exchange(port, board, SET_DUTY, *pair) is not None:
                board.duty = (duty_from_code(pair[0]), duty_from_code(pair[1]))

    def _exchange(self, port: Any, board: _Board, command: Command,
                  *values: int) -> tuple[int, ...] | None:
        """Return what the board answers, None if it does not answer well."""
        self.bytes_skipped += port.in_waiting
        port.reset_input_buffer()  # a reply that came too late would be taken for this one
        port.write(encode_request(board.address, command, *values))
        reply = port.read(command.reply_size)
        try:
            answer = decode_reply(board.address, command, reply)
        except FrameError as error:
            self.frames_bad += 1
            self.bytes_skipped += len(reply)
            self.last_error = str(error)
            board.prepared = False
            return None
        self.frames_ok += 1
        self.last_ok_ns = time.time_ns()
        return answer


def _four(values: list[float]) -> Four:
    front_left, front_right, rear_left, rear_right = values
    return front_left, front_right, rear_left, rear_right
