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
Two RoboClaws with motors and encoders on a pseudo-terminal, emulated from the manual.

Unlike the boards of the simulator, they have all faults listed in ``docs/safety.md``, and they
record the duties at the motors and the bytes on the line with their times. They run in a separate
process, so that they reply in time during any test.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import math
import multiprocessing
from multiprocessing.connection import Connection
from pathlib import Path
import time
from typing import Any

from smart_tire.protocol import roboclaw
from support.pty_port import PtyPort

ADDRESSES = (128, 129)
COUNTS_PER_RAD = 2000 / math.tau
STALL_TORQUE = 5.0       # N m, as in the simulator
FREE_SPEED = 22.0        # rad/s
TORQUE_CONSTANT = 1.2    # N m/A
INERTIA = 0.04           # kg m2 of a wheel with its share of the robot's mass
FRICTION = 0.15          # N m
STEP = 0.001             # s
MAX_STEP = 0.03          # s, more: the emulation was not run, and its replies are late
SUPPLY_VOLTAGE_CODE = 148  # 0.1 V
STILL = (0.0, 0.0, 0.0, 0.0)


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
    stalls: int = 0                      # steps longer than ``MAX_STEP``

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

    def silence(self) -> float:
        """Return the longest time between two bytes from the host [s]."""
        return max((late - early for early, late in zip(self.bytes_at, self.bytes_at[1:])),
                   default=math.inf)

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


class MotorRig:
    """The boards in a separate process, with the port at ``path``; a context."""

    def __init__(self, path: Path) -> None:
        self.path = path
        context = multiprocessing.get_context('spawn')
        self._pipe, far = context.Pipe()
        self._process = context.Process(target=_emulate, args=(path, far), daemon=True)

    def __enter__(self) -> MotorRig:
        self._process.start()
        self._call('faults', Faults())
        return self

    def __exit__(self, *_: object) -> None:
        self._call('end')
        self._process.join()

    def _call(self, what: str, value: Any = None) -> Any:
        self._pipe.send((what, value))
        return self._pipe.recv()

    def fail(self, **faults: Any) -> float:
        """Set the faults of the boards, replacing previous ones; return the time."""
        return float(self._call('faults', Faults(**faults)))

    def restart(self, address: int) -> float:
        """Restart a board as after a supply dip: without time-out and counts; return the time."""
        return float(self._call('restart', address))

    def unplug(self) -> float:
        """Remove the port; return the time."""
        return float(self._call('unplug'))

    def plug_in(self) -> float:
        """Create the port again; return the time."""
        return float(self._call('plug_in'))

    def state(self) -> State:
        """Return the present state of the boards."""
        state: State = self._call('state')
        return state

    def record(self, since: float) -> Record:
        """Return the record after ``since``."""
        record: Record = self._call('record', since)
        return record


def _emulate(path: Path, pipe: Connection) -> None:
    _Boards(PtyPort(path).plug_in(), pipe).serve()


@dataclass
class _Board:
    timeout: int = 0
    duty: tuple[float, float] = (0.0, 0.0)


class _Boards:
    """Both boards and their four motors."""

    def __init__(self, port: PtyPort, pipe: Connection) -> None:
        self.faults = Faults()
        self.record = Record()
        self.state = State()
        self._port, self._pipe = port, pipe
        self._plugged = True
        self._boards = {address: _Board() for address in ADDRESSES}
        self._speeds = [0.0] * 4
        self._stalls = 0
        self._turned = [0.0] * 4  # rad
        self._angles = [0.0] * 4  # rad, as seen by the encoders
        self._byte_time = time.monotonic()
        self._late: list[tuple[float, int, bytes]] = []  # times, addresses and replies

    def serve(self) -> None:
        """Emulate the boards until the test ends."""
        deframer, moved = roboclaw.RequestDeframer(), time.monotonic()
        while self._execute():
            if self._plugged:
                chunk = self._port.read(STEP)
            else:
                chunk = b''
                time.sleep(STEP)
            now = time.monotonic()
            self._stalls += now - moved > MAX_STEP
            while moved < now:
                self._move()
                moved += STEP
            if chunk:
                self._byte_time = now  # any byte may restart the time-out, by the manual
                self.record.bytes_at.append(now)
            if not self.faults.deaf:
                for request in map(roboclaw.decode_request, deframer.extract(chunk)):
                    self.record.requests.append((now, request))
                    self._reply(request)
            if self.faults.flood and self._plugged:
                self._port.write(bytes(64))
            while self._late and self._late[0][0] <= now and self._plugged:
                self._port.write(self._late.pop(0)[2])
            self._time_out(now)
            self._update_state(now)
        if self._plugged:
            self._port.unplug()

    def _execute(self) -> bool:
        while self._pipe.poll():
            what, value = self._pipe.recv()
            answer: Any = time.monotonic()
            if what == 'faults':
                self.faults = value
            elif what == 'restart':
                self._boards[value] = _Board()
                first = 2 * ADDRESSES.index(value)
                self._angles[first] = self._angles[first + 1] = 0.0
                self._update_state(answer)
            elif what == 'unplug':
                self._port.unplug()
                self._plugged = False
            elif what == 'plug_in':
                self._port.plug_in()
                self._plugged = True
            elif what == 'record':
                answer = self.record.after(value)
            elif what == 'state':
                answer = self.state
            self._pipe.send(answer)
            if what == 'end':
                return False
        return True

    def _reply(self, request: roboclaw.Request) -> None:
        board = self._boards.get(request.address)
        if board is None:
            return
        values = self._values(request, board)
        reads_currents = request.command == roboclaw.READ_CURRENTS
        if self.faults.drop and not reads_currents or request.address in self.faults.mute:
            self.faults.drop -= bool(self.faults.drop and not reads_currents)
            return
        reply = roboclaw.encode_reply(request.address, request.command, *values)
        if reads_currents and request.address in self.faults.without_currents:
            return
        if request.address in self.faults.garbled or (
                reads_currents and request.address in self.faults.garbled_currents):
            reply = bytes(byte ^ 0x55 for byte in reply)
        late = [when for when, address, _ in self._late if address == request.address]
        if reads_currents and self.faults.late_currents:
            late.append(time.monotonic() + self.faults.late_currents.get(request.address, 0.0))
        if late:  # a board replies in the order of the requests
            self._late.append((max(late), request.address, reply))
        else:
            self._port.write(reply)

    def _values(self, request: roboclaw.Request, board: _Board) -> tuple[int, ...]:
        faults, address, command = self.faults, request.address, request.command
        first = 2 * ADDRESSES.index(address)
        if command == roboclaw.SET_DUTY and address not in faults.ignoring_duties:
            board.duty = (roboclaw.duty_from_code(request.values[0]),
                          roboclaw.duty_from_code(request.values[1]))
        elif command == roboclaw.SET_TIMEOUT:
            (board.timeout,) = request.values
        elif command == roboclaw.READ_BATTERY and faults.dips:
            faults.dips -= 1
            return (0,)
        return {
            roboclaw.READ_ENCODERS: tuple(
                self._count(wheel) % roboclaw.COUNT_WRAP for wheel in (first, first + 1)),
            roboclaw.READ_CURRENTS: tuple(
                faults.currents.get(wheel, self._current_code(wheel, duty))
                for wheel, duty in zip((first, first + 1), board.duty)),
            roboclaw.READ_TIMEOUT: (board.timeout,),
            roboclaw.READ_STATUS: (faults.status.get(address, 0),),
            roboclaw.READ_BATTERY: (faults.supply.get(address, SUPPLY_VOLTAGE_CODE),),
        }.get(command, ())

    def _count(self, wheel: int) -> int:
        count = math.floor(self._angles[wheel] * COUNTS_PER_RAD)
        if wheel in self.faults.toggling:
            count += math.floor(self._turned[wheel] * COUNTS_PER_RAD) % 2
        return count

    def _current_code(self, wheel: int, duty: float) -> int:
        """Return the current of a motor, positive along its duty."""
        torque = STALL_TORQUE * (duty - self._speeds[wheel] / FREE_SPEED)
        return roboclaw.current_code(math.copysign(1.0, duty) * torque / TORQUE_CONSTANT)

    def _time_out(self, now: float) -> None:
        for board in self._boards.values():
            timeout = board.timeout * roboclaw.TIMEOUT_RESOLUTION
            if timeout and now - self._byte_time > timeout:
                board.duty = (0.0, 0.0)

    def _update_state(self, now: float) -> None:
        duty = tuple(value for board in self._boards.values() for value in board.duty)
        if not self.record.duties or self.record.duties[-1][1] != duty:
            self.record.duties.append((now, duty))
        self.state = State(duty, tuple(self._speeds), tuple(
            board.timeout for board in self._boards.values()), self.record.duties[-1][0],
            self._stalls)

    def _move(self) -> None:
        duties = (value for board in self._boards.values() for value in board.duty)
        for wheel, duty in enumerate(duties):
            torque = STALL_TORQUE * (duty - self._speeds[wheel] / FREE_SPEED)
            free = self._speeds[wheel] + (torque - self.faults.load) / INERTIA * STEP
            friction = min(FRICTION / INERTIA * STEP, abs(free))
            speed = free - math.copysign(friction, free)
            self._speeds[wheel] = speed
            self._turned[wheel] += speed * STEP
            self._angles[wheel] += self._share(wheel) * speed * STEP

    def _share(self, wheel: int) -> float:
        """Return the counts of an encoder over those of the wheel."""
        if wheel in self.faults.frozen | self.faults.toggling:
            return 0.0
        return -1.0 if wheel in self.faults.reversed else 1.0 - self.faults.losing.get(wheel, 0.0)
