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
The node ``robot_simulator`` with ports that fail, and a record of the duties at its motors.

A file ``NAME.fault`` in the folder SOAK_FOLDER has the fault of a port: 'unplugged', or 'held' if
bytes to the host arrive only when the fault ends. ``duties.txt`` there has a line for each change
of the duties: time of the monotonic clock [s] and four duties.
"""

from __future__ import annotations

import os
from pathlib import Path
import sys
import time

from smart_tire.nodes import robot_simulator
from smart_tire.samples import Four
from smart_tire.simulation import realtime
from smart_tire.simulation.device_emulators import RoboclawEmulator
from smart_tire.simulation.pseudo_terminal import PtyPort

FOLDER = Path(os.environ.get('SOAK_FOLDER', '.'))
UNPLUGGED, HELD = 'unplugged', 'held'


class FailingPort(PtyPort):
    """A port that can be unplugged, and whose output can be late."""

    def __init__(self, link: str) -> None:
        super().__init__(link)
        self._file = FOLDER / f'{Path(link).name}.fault'
        self._fault, self._late = '', b''

    def _update(self) -> str:
        before = self._fault
        try:
            self._fault = self._file.read_text()
        except FileNotFoundError:
            self._fault = ''
        if self._fault == UNPLUGGED != before:
            super().close()
        elif before == UNPLUGGED != self._fault:
            super().__init__(self.link)
            self._fault = ''
        return self._fault

    def write(self, data: bytes) -> None:
        fault = self._update()
        if fault == HELD:
            self._late += data
        elif fault != UNPLUGGED:
            data, self._late = self._late + data, b''
            super().write(data)

    def read(self) -> bytes:
        return b'' if self._update() == UNPLUGGED else super().read()

    def wait(self, seconds: float) -> None:
        if self._fault == UNPLUGGED:
            time.sleep(seconds)
        else:
            super().wait(seconds)

    def close(self) -> None:
        if self._fault != UNPLUGGED:
            super().close()


class RecordingBoards(RoboclawEmulator):
    """Motor boards that record the duties at the motors."""

    _before: Four | None = None

    def duty(self, now_ns: int) -> Four:
        duty = super().duty(now_ns)
        if duty != self._before:
            self._before = duty
            with (FOLDER / 'duties.txt').open('a') as file:
                print(time.monotonic(), *duty, file=file)
        return duty


if __name__ == '__main__':
    realtime.PtyPort = FailingPort  # type: ignore[misc]
    realtime.RoboclawEmulator = RecordingBoards  # type: ignore[misc]
    sys.exit(robot_simulator.main())
