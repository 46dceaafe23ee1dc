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
Two RoboClaws with motors and encoders on a pseudo-terminal, with the faults of ``MotorBoards``.

They run in a separate process, so that they reply in time during any test.
"""

from __future__ import annotations

from dataclasses import replace
import multiprocessing
from multiprocessing.connection import Connection
from pathlib import Path
import time
from typing import Any

from support.motor_boards import Faults, MotorBoards, Record, State
from support.pty_port import PtyPort

STEP = 0.001     # s
MAX_STEP = 0.03  # s, more: the emulation was not run, and its replies are late


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

    @property
    def pid(self) -> int:
        """Return the identifier of the process."""
        assert self._process.pid is not None
        return self._process.pid

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
    _Server(PtyPort(path).plug_in(), pipe).serve()


class _Server:
    """Serves the port of the boards in real time."""

    def __init__(self, port: PtyPort, pipe: Connection) -> None:
        self._port, self._pipe = port, pipe
        self._plugged, self._stalls = True, 0
        self._late: list[tuple[float, bytes]] = []  # times and replies
        self._boards = MotorBoards(self._send, time.monotonic())

    def serve(self) -> None:
        """Emulate the boards until the test ends."""
        served = time.monotonic()
        while self._execute():
            if self._plugged:
                chunk = self._port.read(STEP)
            else:
                chunk = b''
                time.sleep(STEP)
            now = time.monotonic()
            self._stalls += now - served > MAX_STEP
            served = now
            if chunk:
                self._boards.receive(chunk, now)
            self._boards.advance(now)
            if self._plugged:
                if self._boards.faults.flood:
                    self._port.write(bytes(64))
                while self._late and self._late[0][0] <= now:
                    self._port.write(self._late.pop(0)[1])
        if self._plugged:
            self._port.unplug()

    def _send(self, data: bytes, delay: float) -> None:
        if delay:
            self._late.append((time.monotonic() + delay, data))
        else:
            self._port.write(data)

    def _execute(self) -> bool:
        while self._pipe.poll():
            what, value = self._pipe.recv()
            answer: Any = time.monotonic()
            if what == 'faults':
                self._boards.fail(value, answer)
            elif what == 'restart':
                self._boards.restart(value, answer)
            elif what == 'unplug':
                self._port.unplug()
                self._plugged = False
            elif what == 'plug_in':
                self._port.plug_in()
                self._plugged = True
            elif what == 'record':
                answer = self._boards.record.after(value)
            elif what == 'state':
                answer = replace(self._boards.state(), stalls=self._stalls)
            self._pipe.send(answer)
            if what == 'end':
                return False
        return True
