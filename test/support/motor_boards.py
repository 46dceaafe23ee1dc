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
Two RoboClaws with motors and encoders, emulated from the manual; time is an argument.

Unlike the boards of the simulator, they have all faults listed in ``docs/safety.md``, and they
record the duties at the motors and the bytes on the line with their times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
import math

from smart_tire.protocol import roboclaw

ADDRESSES = (128, 129)
COUNTS_PER_RAD = 2000 / math.tau
STALL_TORQUE = 5.0       # N m, as in the simulator
FREE_SPEED = 22.0        # rad/s
TORQUE_CONSTANT = 1.2    # N m/A
INERTIA = 0.04           # kg m2 of a wheel with its share of the robot's mass
FRICTION = 0.15          # N m
RATE = STALL_TORQUE / FREE_SPEED / INERTIA  # 1/s, with which a speed approaches its end value
SUPPLY_VOLTAGE_CODE = 148  # 0.1 V
STILL = (0.0, 0.0, 0.0, 0.0)
MOVED = (roboclaw.READ_ENCODERS, roboclaw.READ_CURRENTS, roboclaw.SET_DUTY)  # need speeds of now


@dataclass
class Faults:
    """Faults of the boards; they may be changed at run time."""

    mute: set[int] = field(default_factory=set)       # addresses whose replies are lost
    garbled: set[int] = field(default_factory=set)    # addresses whose replies are damaged
    drop: int = 0                      # number of further replies that are lost, not of currents
    dips: int = 0                                     # number of further low supply readings
    deaf: bool = False                                # requests are not received
    flood: bool = False                               # the host gets a flood of bytes
    frozen: set[int] = field(default_factory=set)     # wheels whose counts do not change
    # wheels whose encoder counts backwards
    reversed: set[int] = field(default_factory=set)  # noqa: A003
    toggling: set[int] = field(default_factory=set)   # wheels with one encoder channel open
    blocked: set[int] = field(default_factory=set)    # wheels that cannot turn
    losing: dict[int, float] = field(default_factory=dict)    # wheel -> share of lost counts
    ignoring_duties: set[int] = field(default_factory=set)    # addresses that ignore duties
    status: dict[int, int] = field(default_factory=dict)  # address -> status, if not normal
    supply: dict[int, int] = field(default_factory=dict)  # address -> 0.1 V, if not full
    without_currents: set[int] = field(default_factory=set)  # addresses that ignore command 49
    garbled_currents: set[int] = field(default_factory=set)  # addresses, only these replies
    late_currents: dict[int, float] = field(default_factory=dict)  # address -> delay [s]
    currents: dict[int, int] = field(default_factory=dict)  # wheel -> code, if not measured
    load: float = 0.0  # N m, against the forward rotation of each wheel, as gravity on a slope


@dataclass
class State:
    """Present state of the boards."""

    duty: tuple[float, ...] = STILL      # at the motors
    speeds: tuple[float, ...] = STILL    # rad/s
    timeouts: tuple[int, ...] = (0, 0)   # configured, in 0.1 s
    changed: float = 0.0                 # time of the latest change of duty, monotonic clock [s]
    stalls: int = 0                      # times at which the emulation was not run

    @property
    def still(self) -> bool:
        """Return whether no motor has a duty."""
        return self.duty == STILL


@dataclass
class Record:
    """Record of requests, bytes and duties; times are of the monotonic clock [s]."""

    requests: list[tuple[float, roboclaw.Request]] = field(default_factory=list)
    bytes_at: list[float] = field(default_factory=list)  # times of bytes from the host
    duties: list[tuple[float, tuple[float, ...]]] = field(default_factory=list)  # changes

    def after(self, since: float) -> Record:
        """Return the record after ``since``; its first duty is the one at that time."""
        before = [(since, duty) for when, duty in self.duties if when <= since][-1:]
        return Record([item for item in self.requests if item[0] > since],
                      [when for when in self.bytes_at if when > since],
                      before + [item for item in self.duties if item[0] > since])

    def driven(self, until: float = math.inf) -> bool:
        """Return whether any motor had a duty."""
        return any(duty != STILL for when, duty in self.duties if when < until)

    def always_driven(self) -> bool:
        """Return whether a motor had a duty at all times."""
        return bool(self.duties) and all(duty != STILL for _, duty in self.duties)

    def first_zero(self) -> float:
        """Return the first time at which all motors had zero duty."""
        return min(when for when, duty in self.duties if duty == STILL)

    def first_duty(self) -> float:
        """Return the first time at which a motor had a duty."""
        return min(when for when, duty in self.duties if duty != STILL)

    def times(self, command: roboclaw.Command, address: int) -> list[float]:
        """Return the times at which ``command`` was sent to the board at ``address``."""
        return [when for when, request in self.requests
                if request.command == command and request.address == address]


@dataclass
class _Board:
    timeout: int = 0
    duty: tuple[float, float] = (0.0, 0.0)


class MotorBoards:
    """
    Both boards and their four motors; ``send(data, delay)`` sends a reply after ``delay`` [s].

    All times are of one steady clock [s].
    """

    def __init__(self, send: Callable[[bytes, float], None], now: float,
                 speed: float = 0.0) -> None:
        """Begin with wheels that roll at ``speed`` [rad/s]."""
        self.record = Record()
        self._faults = Faults()
        self._send, self._now, self._byte_time = send, now, now
        self._boards = {address: _Board() for address in ADDRESSES}
        self._deframer = roboclaw.RequestDeframer()
        self._speeds = [speed] * 4
        self._turned = [0.0] * 4  # rad
        self._angles = [0.0] * 4  # rad, as seen by the encoders
        self._late_until = dict.fromkeys(ADDRESSES, -math.inf)  # a board replies in order

    @property
    def faults(self) -> Faults:
        """Return the present faults."""
        return self._faults

    def fail(self, faults: Faults, now: float) -> None:
        """Have these faults from now on."""
        self.advance(now)
        self._faults = faults

    def restart(self, address: int, now: float) -> None:
        """Restart a board as after a supply dip: without time-out and counts."""
        self.advance(now)
        self._boards[address] = _Board()
        first = 2 * ADDRESSES.index(address)
        self._angles[first] = self._angles[first + 1] = 0.0
        self._record_duty(now)

    def state(self) -> State:
        """Return the state at the latest time."""
        duty, speeds = self._duty(), tuple(self._speeds)
        return State(duty, speeds, tuple(board.timeout for board in self._boards.values()),
                     self.record.duties[-1][0] if self.record.duties else 0.0)

    def advance(self, now: float) -> None:
        """Let the motors turn until ``now``, and the watchdogs stop them in time."""
        self._stop_in_time(now)
        self._move(now)

    def _stop_in_time(self, now: float) -> None:
        """Stop the motors of boards that have received no byte for their time-out."""
        ends = [(self._byte_time + board.timeout * roboclaw.TIMEOUT_RESOLUTION, board)
                for board in self._boards.values() if board.timeout and any(board.duty)]
        for end, board in sorted(ends, key=lambda item: item[0]):
            if end < now:
                self._move(end)
                board.duty = (0.0, 0.0)
                self._record_duty(end)

    def receive(self, chunk: bytes, now: float) -> None:
        """Receive bytes from the host."""
        self._stop_in_time(now)
        self._byte_time = now  # any byte may restart the time-out, by the manual
        self.record.bytes_at.append(now)
        if self._faults.deaf:
            return
        for request in map(roboclaw.decode_request, self._deframer.extract(chunk)):
            self.record.requests.append((now, request))
            if request.address in self._boards:
                if request.command in MOVED:
                    self._move(now)
                self._reply(request, self._boards[request.address], now)
        self._record_duty(now)

    def _reply(self, request: roboclaw.Request, board: _Board, now: float) -> None:
        values, faults = self._values(request, board), self._faults
        address, reads_currents = request.address, request.command == roboclaw.READ_CURRENTS
        if faults.drop and not reads_currents:
            faults.drop -= 1
            return
        if address in faults.mute or reads_currents and address in faults.without_currents:
            return
        reply = roboclaw.encode_reply(address, request.command, *values)
        if address in faults.garbled or reads_currents and address in faults.garbled_currents:
            reply = bytes(byte ^ 0x55 for byte in reply)
        if reads_currents and address in faults.late_currents:
            self._late_until[address] = now + faults.late_currents[address]
        self._send(reply, max(self._late_until[address] - now, 0.0))

    def _values(self, request: roboclaw.Request, board: _Board) -> tuple[int, ...]:
        faults, address, command = self._faults, request.address, request.command
        first = 2 * ADDRESSES.index(address)
        wheels = first, first + 1
        if command == roboclaw.SET_DUTY and address not in faults.ignoring_duties:
            board.duty = (roboclaw.duty_from_code(request.values[0]),
                          roboclaw.duty_from_code(request.values[1]))
        elif command == roboclaw.SET_TIMEOUT:
            (board.timeout,) = request.values
        elif command == roboclaw.READ_BATTERY:
            if faults.dips:
                faults.dips -= 1
                return (0,)
            return (faults.supply.get(address, SUPPLY_VOLTAGE_CODE),)
        elif command == roboclaw.READ_ENCODERS:
            return tuple(self._count(wheel) % roboclaw.COUNT_WRAP for wheel in wheels)
        elif command == roboclaw.READ_CURRENTS:
            return tuple(faults.currents.get(wheel, self._current_code(wheel, duty))
                         for wheel, duty in zip(wheels, board.duty))
        elif command == roboclaw.READ_TIMEOUT:
            return (board.timeout,)
        elif command == roboclaw.READ_STATUS:
            return (faults.status.get(address, 0),)
        return ()

    def _count(self, wheel: int) -> int:
        count = math.floor(self._angles[wheel] * COUNTS_PER_RAD)
        if wheel in self._faults.toggling:
            count += math.floor(self._turned[wheel] * COUNTS_PER_RAD) % 2
        return count

    def _current_code(self, wheel: int, duty: float) -> int:
        """Return the current of a motor, positive along its duty."""
        torque = STALL_TORQUE * (duty - self._speeds[wheel] / FREE_SPEED)
        return roboclaw.current_code(math.copysign(1.0, duty) * torque / TORQUE_CONSTANT)

    def _duty(self) -> tuple[float, ...]:
        return tuple(value for board in self._boards.values() for value in board.duty)

    def _record_duty(self, now: float) -> None:
        duty, duties = self._duty(), self.record.duties
        if not duties or duties[-1][1] != duty:
            duties.append((now, duty))

    def _move(self, now: float) -> None:
        elapsed, self._now = now - self._now, max(now, self._now)
        if elapsed <= 0.0:
            return
        for wheel, duty in enumerate(self._duty()):
            if wheel in self._faults.blocked:
                self._speeds[wheel] = 0.0
                continue
            speed, turned = rolled(self._speeds[wheel], STALL_TORQUE * duty - self._faults.load,
                                   elapsed)
            self._speeds[wheel] = speed
            self._turned[wheel] += turned
            self._angles[wheel] += self._share(wheel) * turned

    def _share(self, wheel: int) -> float:
        """Return the counts of an encoder over those of the wheel."""
        faults = self._faults
        if wheel in faults.frozen or wheel in faults.toggling:
            return 0.0
        return -1.0 if wheel in faults.reversed else 1.0 - faults.losing.get(wheel, 0.0)


def rolled(speed: float, torque: float, elapsed: float) -> tuple[float, float]:
    """
    Return speed [rad/s] and angle [rad] of a wheel after ``elapsed`` [s].

    ``torque`` [N m] is that of the motor at standstill, less the load. With dry friction the
    speed approaches an end value exponentially, until the wheel stops or reverses.
    """
    angle = 0.0
    while elapsed > 0.0:
        if not speed and abs(torque) <= FRICTION:
            return 0.0, angle
        direction = math.copysign(1.0, speed or torque)
        end = (torque - direction * FRICTION) * FREE_SPEED / STALL_TORQUE
        until = elapsed
        if direction * end < 0.0:
            until = min(elapsed, math.log((speed - end) / -end) / RATE)
        decay = math.exp(-RATE * until)
        angle += end * until + (speed - end) * (1.0 - decay) / RATE
        speed = end + (speed - end) * decay if until == elapsed else 0.0
        elapsed -= until
    return speed, angle
