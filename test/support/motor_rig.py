"""
Two RoboClaws with motors and encoders on a pseudo-terminal, emulated from the manual.

Unlike the boards of the simulator, these can be made to fail in every way that the list of
hazards names, and they record what the motors got and what was on the line, and when. They run
in a process of their own, so that they answer in time whatever the test does.
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
COUNTS = 2000            # per revolution
STALL_TORQUE = 4.0       # N m, as the simulated motors
FREE_SPEED = 20.0        # rad/s
INERTIA = 0.04           # kg m2 of a wheel with its share of the robot's mass
FRICTION = 0.05          # N m
STEP = 0.001             # s
SUPPLY = 148             # 0.1 V
STILL = (0.0, 0.0, 0.0, 0.0)


@dataclass
class Faults:
    """What is wrong with the boards; everything may be changed while they run."""

    mute: set[int] = field(default_factory=set)       # addresses whose replies are lost
    garbled: set[int] = field(default_factory=set)    # addresses whose replies are damaged
    drop: int = 0                                     # so many replies get lost, no more
    dips: int = 0                                     # so many readings of the supply are low
    deaf: bool = False                                # requests arrive as noise
    flood: bool = False                               # the line is full of bytes for the host
    frozen: set[int] = field(default_factory=set)     # wheels whose encoder stands still
    reversed: set[int] = field(default_factory=set)   # wheels whose encoder counts backwards
    disobedient: set[int] = field(default_factory=set)    # addresses that ignore duties
    status: dict[int, int] = field(default_factory=dict)  # address -> status, if not normal
    supply: dict[int, int] = field(default_factory=dict)  # address -> 0.1 V, if not full


@dataclass
class State:
    """What the boards do now."""

    duty: tuple[float, ...] = STILL      # at the motors
    speeds: tuple[float, ...] = STILL    # rad/s
    timeouts: tuple[int, ...] = (0, 0)   # that are set, in units of 0.1 s
    changed: float = 0.0                 # when the duty changed, monotonic clock [s]

    @property
    def still(self) -> bool:
        """Return whether no motor has a duty."""
        return self.duty == STILL


@dataclass
class Record:
    """What happened at the boards; times are of the monotonic clock [s]."""

    requests: list[tuple[float, roboclaw.Request]] = field(default_factory=list)
    bytes_at: list[float] = field(default_factory=list)  # when bytes came from the host
    duties: list[tuple[float, tuple[float, ...]]] = field(default_factory=list)  # changes

    def after(self, since: float) -> Record:
        """Return what happened after ``since``, with the duty at that time first."""
        before = [(since, duty) for when, duty in self.duties if when <= since][-1:]
        return Record([item for item in self.requests if item[0] > since],
                      [when for when in self.bytes_at if when > since],
                      before + [item for item in self.duties if item[0] > since])

    def driven(self, until: float = math.inf) -> bool:
        """Return whether any motor got a duty."""
        return any(duty != STILL for when, duty in self.duties if when < until)

    def always_driven(self) -> bool:
        """Return whether at no time all motors had zero duty."""
        return bool(self.duties) and all(duty != STILL for _, duty in self.duties)

    def first_zero(self) -> float:
        """Return when all motors first had zero duty."""
        return min(when for when, duty in self.duties if duty == STILL)

    def first_duty(self) -> float:
        """Return when a motor first got a duty."""
        return min(when for when, duty in self.duties if duty != STILL)

    def times(self, command: roboclaw.Command, address: int) -> list[float]:
        """Return when a command was sent to the board at ``address``."""
        return [when for when, request in self.requests
                if request.command == command and request.address == address]


class MotorRig:
    """The boards in their process, with the port at ``path``; a context."""

    def __init__(self, path: Path) -> None:
        self.path = path
        context = multiprocessing.get_context('spawn')
        self._pipe, far = context.Pipe()
        self._process = context.Process(target=_emulate, args=(path, far), daemon=True)

    def __enter__(self) -> MotorRig:
        self._process.start()
        self._ask('faults', Faults())
        return self

    def __exit__(self, *_: object) -> None:
        self._ask('end')
        self._process.join()

    def _ask(self, what: str, value: Any = None) -> Any:
        self._pipe.send((what, value))
        return self._pipe.recv()

    def fail(self, **faults: Any) -> float:
        """Let the boards have these faults and no others; return when that began."""
        return float(self._ask('faults', Faults(**faults)))

    def restart(self, address: int) -> float:
        """Let a board start over as after a dip of its supply: no time-out, no counts."""
        return float(self._ask('restart', address))

    def unplug(self) -> float:
        """Let the port vanish."""
        return float(self._ask('unplug'))

    def plug_in(self) -> float:
        """Let the port appear again."""
        return float(self._ask('plug_in'))

    def state(self) -> State:
        """Return what the boards do now."""
        state: State = self._ask('state')
        return state

    def record(self, since: float) -> Record:
        """Return what has happened after ``since``."""
        record: Record = self._ask('record', since)
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
        self._shown = [0.0] * 4  # rad, that the encoders have followed
        self._heard = time.monotonic()

    def serve(self) -> None:
        """Be the boards until the test ends it."""
        deframer, moved = roboclaw.RequestDeframer(), time.monotonic()
        while self._obey():
            if self._plugged:
                chunk = self._port.read(STEP)
            else:
                chunk = b''
                time.sleep(STEP)
            now = time.monotonic()
            while moved < now:
                self._move()
                moved += STEP
            if chunk:
                self._heard = now  # any byte restarts the time-out: the manual allows that
                self.record.bytes_at.append(now)
            if not self.faults.deaf:
                for request in deframer.feed(chunk):
                    self.record.requests.append((now, request))
                    self._answer(request)
            if self.faults.flood and self._plugged:
                self._port.write(bytes(64))
            self._time_out(now)
            self._note(now)
        if self._plugged:
            self._port.unplug()

    def _obey(self) -> bool:
        while self._pipe.poll():
            what, value = self._pipe.recv()
            answer: Any = time.monotonic()
            if what == 'faults':
                self.faults = value
            elif what == 'restart':
                self._boards[value] = _Board()
                first = 2 * ADDRESSES.index(value)
                self._shown[first] = self._shown[first + 1] = 0.0
                self._note(answer)
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

    def _answer(self, request: roboclaw.Request) -> None:
        board = self._boards.get(request.address)
        if board is None:
            return
        values = self._values(request, board)
        if self.faults.drop or request.address in self.faults.mute:
            self.faults.drop -= bool(self.faults.drop)
            return
        reply = roboclaw.encode_reply(request.address, request.command, *values)
        if request.address in self.faults.garbled:
            reply = bytes(byte ^ 0x55 for byte in reply)
        self._port.write(reply)

    def _values(self, request: roboclaw.Request, board: _Board) -> tuple[int, ...]:
        faults, address, command = self.faults, request.address, request.command
        first = 2 * ADDRESSES.index(address)
        if command == roboclaw.SET_DUTY and address not in faults.disobedient:
            board.duty = (roboclaw.duty_from_code(request.values[0]),
                          roboclaw.duty_from_code(request.values[1]))
        elif command == roboclaw.SET_TIMEOUT:
            (board.timeout,) = request.values
        elif command == roboclaw.READ_BATTERY and faults.dips:
            faults.dips -= 1
            return (0,)
        return {
            roboclaw.READ_ENCODERS: tuple(
                math.floor(self._shown[wheel] * COUNTS / math.tau) % roboclaw.COUNT_WRAP
                for wheel in (first, first + 1)),
            roboclaw.READ_TIMEOUT: (board.timeout,),
            roboclaw.READ_STATUS: (faults.status.get(address, 0),),
            roboclaw.READ_BATTERY: (faults.supply.get(address, SUPPLY),),
        }.get(command, ())

    def _time_out(self, now: float) -> None:
        for board in self._boards.values():
            if board.timeout and now - self._heard > board.timeout * roboclaw.TIMEOUT_RESOLUTION:
                board.duty = (0.0, 0.0)

    def _note(self, now: float) -> None:
        duty = tuple(value for board in self._boards.values() for value in board.duty)
        if not self.record.duties or self.record.duties[-1][1] != duty:
            self.record.duties.append((now, duty))
        self.state = State(duty, tuple(self._speeds), tuple(
            board.timeout for board in self._boards.values()), self.record.duties[-1][0])

    def _move(self) -> None:
        duties = (value for board in self._boards.values() for value in board.duty)
        for wheel, duty in enumerate(duties):
            torque = STALL_TORQUE * (duty - self._speeds[wheel] / FREE_SPEED)
            free = self._speeds[wheel] + torque / INERTIA * STEP
            friction = min(FRICTION / INERTIA * STEP, abs(free))
            speed = free - math.copysign(friction, free)
            self._speeds[wheel] = speed
            if wheel not in self.faults.frozen:
                self._shown[wheel] += (-speed if wheel in self.faults.reversed else speed) * STEP
