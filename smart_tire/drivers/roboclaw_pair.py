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
Two RoboClaws on one line: encoder counts and currents in, duties out, zero duty on every fault.

```
  preparing ---- all replies good ----> serving
   ^     ^                                 |
   |     |                                 | reply missing or damaged (also while preparing)
   |     |                                 v
   |     +--- last one acknowledged --- zero duty to both boards, for 0.2 s
   |                                       |
   |                                       | not acknowledged
   |                                       v
   +---- both reply ---- probing <----- silence, for the board time-out + 0.1 s
```

During the silence the watchdogs of the boards stop the motors, even if the boards did not receive
any valid request: any byte on the line could restart these watchdogs.
"""

from __future__ import annotations

from collections.abc import Callable
import itertools
import math
import threading
from typing import Any

from smart_tire.control.duty_gate import DutyGate
from smart_tire.drivers.clock import Clock, SYSTEM
from smart_tire.drivers.motor_board import Board, CurrentReader, MotionCheck, WheelEncoder
from smart_tire.drivers.roboclaw_line import RoboclawLine
from smart_tire.errors import FrameError
from smart_tire.parameters.hardware import MotorDriverParams
from smart_tire.protocol.roboclaw import (
    ACKNOWLEDGE, BATTERY_RESOLUTION, duty_code, duty_from_code, READ_BATTERY, READ_ENCODERS,
    READ_STATUS, READ_TIMEOUT, SET_DUTY, SET_TIMEOUT, STATUS_NORMAL, timeout_code,
    TIMEOUT_RESOLUTION)
from smart_tire.samples import four, NS_PER_S, STOPPED, WHEELS, WheelSample

MAX_POLL_PERIOD = 0.0625           # s between encoder readings, for the checks at low sample rates
KEEP_ALIVE_PERIOD_NS = 30_000_000  # between duties, a fraction of any board time-out
HEALTH_PERIOD_NS = 75_000_000      # between checks of status, time-out and supply, per board
MIN_LOW_READINGS = 2               # consecutive; one may be a voltage dip of a starting motor
ZERO_DUTY_TIME = 0.2               # s for which zero duty is repeated if a board does not reply
ZERO_DUTY_PERIOD = 0.01            # s between these requests
SILENCE_MARGIN = 0.1               # s of silence beyond the board time-out
MAX_SPEED_GAP_NS = 250_000_000     # between readings; a longer mean speed is outdated
MIN_ZERO_REPLIES = 2               # consecutive; one may be a late reply to another duty
AXLES = ('front', 'rear')
LINE_HOLD = 'line'                 # name of the hold while the boards are not served
NOT_READY = 'motor boards are not ready'


class RoboclawPair:
    """
    Polls both boards, sends the duties that ``gate`` permits, and supervises boards and wheels.

    ``run`` is the work of a ``SerialPort``; all other methods may be called from any thread.
    ``deliver`` is called with one sample per period, ``watch`` after each exchange with the boards
    and each fault, from the thread of the port. A fault stops the motors through ``gate``,
    which reports it.
    """

    def __init__(self, params: MotorDriverParams, gate: DutyGate,
                 deliver: Callable[[WheelSample], None], watch: Callable[[], None] = lambda: None,
                 clock: Clock = SYSTEM) -> None:
        self._params, self._gate, self._deliver, self._watch = params, gate, deliver, watch
        self._clock = clock
        self._boards = []
        for name, address, *signs in zip(AXLES, params.addresses, *[iter(params.signs)] * 2):
            encoders = [WheelEncoder(sign, params.robot.encoder.counts_per_revolution)
                        for sign in signs]
            checks = [MotionCheck(params, encoder.resolution) for encoder in encoders]
            self._boards.append(Board(
                address, f'{name} board {address} (0x{address:x})', encoders, checks))
        self._encoders = [encoder for board in self._boards for encoder in board.encoders]
        self._period_ns = round(NS_PER_S / params.rate)
        polls = math.ceil(self._period_ns / (MAX_POLL_PERIOD * NS_PER_S))  # per sample
        self._poll_ns = self._period_ns // polls
        self._timeout_code = timeout_code(params.board_timeout)
        self._silence = self._timeout_code * TIMEOUT_RESOLUTION + SILENCE_MARGIN
        self._next_to_check = itertools.cycle(self._boards)
        self._changed = threading.Event()
        self._lock = threading.Lock()          # of the acknowledgements of zero duty
        self.confirmed = threading.Event()     # both boards have acknowledged it
        self._since_ns = clock.now_ns()        # when the port was opened
        self._sample_ns = 0                    # due time of the next sample
        self.line = RoboclawLine(clock)
        self.currents = CurrentReader(params, self._boards, self.line, self._poll_ns / NS_PER_S,
                                      clock)
        self.faults = 0  # missing or unexpected replies that stopped the motors
        gate.hold(LINE_HOLD, NOT_READY, report=False)

    def wake(self) -> None:
        """Apply a change at the gate immediately."""
        self._changed.set()

    def await_zero(self, seconds: float) -> list[str]:
        """Return the boards that did not acknowledge zero duty within ``seconds`` from now."""
        self.expect_zero()
        self._clock.wait(self.confirmed, seconds)
        return self.unconfirmed()

    def expect_zero(self) -> None:
        """Send the duty at once, and set ``confirmed`` when both boards acknowledged zero."""
        with self._lock:
            self.confirmed.clear()
            for board in self._boards:
                board.zero_replies = 0
        self._changed.set()

    def unconfirmed(self) -> list[str]:
        """Return the boards that have not acknowledged zero duty."""
        return [board.name for board in self._boards if board.zero_replies < MIN_ZERO_REPLIES]

    def reading_ages(self) -> dict[str, float]:
        """Return the time since the latest encoder reading of each board [s], by board name."""
        now_ns = self._clock.now_ns()
        return {board.name: (now_ns - max(board.read_ns, self._since_ns)) / NS_PER_S
                for board in self._boards}

    def supply_voltage(self) -> float:
        """Return the lower supply voltage of the boards [V], NaN before both are read."""
        readings = [board.supply_voltage for board in self._boards]
        return math.nan if any(map(math.isnan, readings)) else min(readings)

    def run(self, port: Any, stopping: threading.Event) -> None:
        """Serve the boards until ``stopping`` is set; the motors are stopped before it returns."""
        self.line.use(port)
        self._since_ns = self._clock.now_ns()
        try:
            while not stopping.is_set():
                try:
                    self._prepare()
                    self._gate.clear(LINE_HOLD)
                    self._serve(stopping)
                except FrameError as error:
                    self.faults += 1
                    self._gate.hold(LINE_HOLD, str(error))
                    self._watch()
                    self._make_safe(stopping)
        finally:  # at the end, or when the port is lost
            self._gate.hold(LINE_HOLD, NOT_READY, report=False)
            self._watch()
        self._repeat_zero()

    def _prepare(self) -> None:
        """Stop both boards, set their time-outs, and read these back."""
        for board in self._boards:
            self.line.exchange(board.address, SET_DUTY, 0, 0)
            board.duty = (0.0, 0.0)
        for board in self._boards:
            self.line.exchange(board.address, SET_TIMEOUT, self._timeout_code)
            for _ in range(MIN_LOW_READINGS):
                self._check_health(board)
            board.reset()
        self._sample_ns = self._clock.now_ns()

    def _serve(self, stopping: threading.Event) -> None:
        poll_ns = health_ns = drive_ns = self._clock.now_ns()
        while not stopping.is_set():
            self._watch()
            now_ns = self._clock.now_ns()
            if self._changed.is_set() or now_ns >= self._drive_due(drive_ns):
                self._drive()
                drive_ns = now_ns + KEEP_ALIVE_PERIOD_NS
            elif now_ns >= poll_ns and poll_ns <= health_ns:  # the one that is due for longer,
                self._poll(now_ns)                            # on a line too slow for all polls
                poll_ns = max(poll_ns + self._poll_ns, now_ns)
            elif now_ns >= health_ns:
                self._check_health(next(self._next_to_check))
                health_ns = now_ns + HEALTH_PERIOD_NS
            else:
                next_ns = min(poll_ns, health_ns, self._drive_due(drive_ns))
                self._clock.wait(self._changed, (next_ns - now_ns) / NS_PER_S)

    def _drive_due(self, drive_ns: int) -> int:
        """Return when a duty must be sent: as keep-alive, or because the command expires."""
        expiry_ns = self._gate.expiry_ns
        return drive_ns if expiry_ns is None else min(drive_ns, expiry_ns + 1)

    def _drive(self) -> None:
        self._changed.clear()
        duty = self._gate.output(self._clock.now_ns())
        codes = [duty_code(encoder.sign * value)
                 for encoder, value in zip(self._encoders, duty)]
        for axle, board in enumerate(self._boards):
            first, second = codes[2 * axle:2 * axle + 2]
            self.line.exchange(board.address, SET_DUTY, first, second)
            board.duty = duty_from_code(first), duty_from_code(second)
            self._count_zero(board, first == second == 0)
        if duty == STOPPED and self.unconfirmed():
            self._changed.set()

    def _drive_if_changed(self) -> None:
        if self._changed.is_set():  # a new duty does not wait for currents
            self._drive()

    def _count_zero(self, board: Board, acknowledged: bool) -> None:
        with self._lock:
            board.zero_replies = board.zero_replies + 1 if acknowledged else 0
            if not self.unconfirmed():
                self.confirmed.set()

    def _poll(self, now_ns: int) -> None:
        """Read encoders and currents, check the wheels, and deliver a sample when one is due."""
        read = [self._read(board) for board in self._boards]  # both, even if the first fails
        if not all(read):
            return
        self.currents.read(before_each=self._drive_if_changed)
        self._check_motion()
        if now_ns >= self._sample_ns - self._poll_ns // 2:
            self._sample_ns = max(self._sample_ns + self._period_ns, now_ns)
            self._deliver(self._sample())

    def _read(self, board: Board) -> bool:
        """Read the encoders of ``board``; return whether the speed of its wheels is known."""
        asked_ns = self._clock.now_ns()
        board.driven = board.forward_duty()  # a new one may be sent before currents are read
        counts = self.line.exchange(board.address, READ_ENCODERS)
        if self.line.retried:  # the reply may belong to either request: its time is uncertain
            return False
        mean_ns = (asked_ns + self._clock.now_ns()) // 2
        elapsed_ns = mean_ns - board.read_ns if board.read_ns else 0
        board.read_ns = mean_ns
        board.span_ns += elapsed_ns
        for encoder, count in zip(board.encoders, counts):
            encoder.add_count(count, elapsed_ns / NS_PER_S)
        if any(encoder.jumped for encoder in board.encoders):
            self._check_timeout(board)  # a restarted board has lost its counts
        if elapsed_ns > MAX_SPEED_GAP_NS:
            board.reset()
        return board.span_ns > 0

    def _check_motion(self) -> None:
        found = [board.check_motion() for board in self._boards]
        if not any(found):
            return
        problems = [problem for axle in found for problem in axle or ('', '')]
        checks = [check for board in self._boards for check in board.checks]
        for wheel, problem in enumerate(problems):
            if problem := problem or checks[wheel].lag(checks[wheel - 2]):
                self._gate.trip(f'{WHEELS[wheel]} {problem}')
                self._changed.set()
                checks[wheel].reset()

    def _check_health(self, board: Board) -> None:
        """Hold the motors while a board reports a fault; raise FrameError if it has restarted."""
        (status,) = self.line.exchange(board.address, READ_STATUS)
        abnormal = status & ~self._params.tolerated_status
        self._hold_if(abnormal != STATUS_NORMAL, f'status of {board.name}',
                      f'{board.name} reports status {status:#06x}, expected 0 (normal)')
        self._check_timeout(board)
        self._check_supply(board)

    def _check_timeout(self, board: Board) -> None:
        (code,) = self.line.exchange(board.address, READ_TIMEOUT)
        if code != self._timeout_code:
            raise FrameError(f'{board.name} has restarted: its time-out is '
                             f'{code * TIMEOUT_RESOLUTION:.1f} s, expected '
                             f'{self._timeout_code * TIMEOUT_RESOLUTION:.1f} s')

    def _check_supply(self, board: Board) -> None:
        (code,) = self.line.exchange(board.address, READ_BATTERY)
        board.supply_voltage, lowest = code * BATTERY_RESOLUTION, self._params.low_battery
        board.low_readings = board.low_readings + 1 if board.supply_voltage < lowest else 0
        self._hold_if(board.low_readings >= MIN_LOW_READINGS, f'supply of {board.name}',
                      f'supply of {board.name} is low: {board.supply_voltage:.1f} V, '
                      f'expected at least {lowest:g} V')

    def _hold_if(self, wrong: bool, name: str, reason: str) -> None:
        if wrong:
            self._gate.hold(name, reason, latch=True)
            self._changed.set()
        else:
            self._gate.clear(name)

    def _make_safe(self, stopping: threading.Event) -> None:
        """Stop both boards, by their watchdogs if they do not reply; wait until both reply."""
        self.line.discard()
        if not self._repeat_zero():
            self._clock.wait(stopping, self._silence)
            self._probe(stopping)

    def _repeat_zero(self) -> bool:
        """Send zero duty for ``ZERO_DUTY_TIME``; return whether both acknowledged the last one."""
        for board in self._boards:
            self.line.post(board.address, SET_DUTY, 0, 0)
        acknowledged = False
        end_ns = self._clock.now_ns() + round(ZERO_DUTY_TIME * NS_PER_S)
        while self._clock.now_ns() < end_ns:
            replies = [self._post_zero(board) for board in self._boards]
            acknowledged = all(replies)
        return acknowledged

    def _post_zero(self, board: Board) -> bool:
        self._clock.sleep(ZERO_DUTY_PERIOD)  # the reply to the previous request may still arrive
        self.line.receive()
        self.line.post(board.address, SET_DUTY, 0, 0)
        self._clock.sleep(ZERO_DUTY_PERIOD)
        acknowledged = self.line.receive() == ACKNOWLEDGE
        self._count_zero(board, acknowledged)
        return acknowledged

    def _probe(self, stopping: threading.Event) -> None:
        """Probe one board at a time, at intervals above their time-out, until both reply."""
        replied: dict[int, bool] = {}
        for board in itertools.cycle(self._boards):
            replied[board.address] = self.line.probe(board.address, READ_TIMEOUT)
            if stopping.is_set() or len(replied) == len(self._boards) and all(replied.values()):
                return
            self._clock.wait(stopping, self._silence)

    def _sample(self) -> WheelSample:
        """Return the wheel states at the mean time of the readings of both boards."""
        mean_ns = sum(board.read_ns for board in self._boards) // len(self._boards)
        position, velocity, effort = list[float](), list[float](), list[float]()
        for board in self._boards:
            delay = (mean_ns - board.read_ns) / NS_PER_S
            for encoder, speed in zip(board.encoders, board.mean_speeds()):
                velocity.append(speed)
                position.append(encoder.position + speed * delay)
            effort += board.torques
            board.begin_span()
        stamp_ns = self._clock.time_ns() - (self._clock.now_ns() - mean_ns)
        return WheelSample(stamp_ns, four(velocity), four(position),
                           None if all(map(math.isnan, effort)) else four(effort))
