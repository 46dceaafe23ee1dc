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
Time of a simulated robot, shared by its processes on one machine through a mapped file.

It passes as real time does, except that it stands while one of its participants is behind: each
says until when it may pass without it, and the simulator (``simulation/realtime.py``) sets the
least of these times as the limit:

    simulated time = min(steady time of the machine - offset, limit)

After it has stood, the simulator increases the offset, so that time goes on where it stood. So a
machine that is too slow makes the simulation slower, and nothing else: no message is older, and no
time-out expires earlier, than on an idle one.

The file holds 64-bit integers: offset, limit and epoch, whether time is free, then a time and the
hash of a name for each participant. Readers need no lock: they read the limit first, then the
offset, then the steady time, and the writer sets them in the opposite order, so that no reader
sees a time that has not come yet.
"""

from __future__ import annotations

from collections.abc import Callable
import fcntl
import os
from pathlib import Path
import time

from smart_tire.errors import ParameterError

VARIABLE = 'SMART_TIRE_CLOCK'  # of the environment: the file
SLOTS = 32                     # participants at most
NAME_BYTES = 48                # of a participant's name
WORD = 8                       # bytes
OFFSET, LIMIT, EPOCH, FREE, HEADER = range(5)  # words at the begin of the file
NEVER = 2**62                  # ns, of a limit or a participant that limits nothing
SIZE = (HEADER + SLOTS) * WORD + SLOTS * NAME_BYTES


class SimulatedTime:
    """The mapped file; ``NEVER`` is the limit until the simulator sets one."""

    def __init__(self, path: str | os.PathLike[str],
                 real_ns: Callable[[], int] = time.monotonic_ns) -> None:
        import mmap  # nodes of a real robot start without
        self.real_ns = real_ns
        try:
            with open(path, 'r+b') as file:
                self._map = mmap.mmap(file.fileno(), SIZE)
        except (OSError, ValueError) as error:
            raise ParameterError(f'{VARIABLE}={path}: no simulated robot runs there; unset '
                                 f'{VARIABLE}') from error
        self.path = os.fspath(path)
        self.words = memoryview(self._map)[:(HEADER + SLOTS) * WORD].cast('q')
        self._names = (HEADER + SLOTS) * WORD
        self._joined: list[int] = []  # by this process

    @classmethod
    def create(cls, path: Path,
               real_ns: Callable[[], int] = time.monotonic_ns) -> SimulatedTime:
        """Create the file, with the present time; what used an old one keeps it."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        path.write_bytes(bytes(SIZE))
        made = cls(path, real_ns)
        made.words[EPOCH] = time.time_ns() - real_ns()
        made.words[LIMIT] = NEVER
        for index in range(SLOTS):
            made.words[HEADER + index] = NEVER
        return made

    def now_ns(self) -> int:
        """Return the steady time [ns]."""
        words = self.words
        limit_ns, offset_ns = words[LIMIT], words[OFFSET]
        return min(self.real_ns() - offset_ns, limit_ns)

    @property
    def epoch_ns(self) -> int:
        """Return the time since 1970 [ns] at the steady time 0."""
        return self.words[EPOCH]

    def free(self) -> None:
        """Let time pass without the participants from now on, for the end of a run."""
        self.words[FREE] = 1
        self.words[LIMIT] = NEVER

    def join(self, name: str) -> Participant:
        """Return a new participant, which limits nothing yet."""
        with open(self.path, 'rb') as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            index = next((index for index in range(SLOTS) if not self.name(index)), None)
            if index is None:
                raise ParameterError(f'{self.path}: more than {SLOTS} participants')
            begin = self._names + index * NAME_BYTES
            self._map[begin:begin + NAME_BYTES] = name.encode()[:NAME_BYTES].ljust(
                NAME_BYTES, b'\0')
        self._joined.append(index)
        return Participant(self, index)

    def leave(self) -> None:
        """Let time pass without the participants of this process, which ends."""
        for index in self._joined:
            begin = self._names + index * NAME_BYTES
            self._map[begin:begin + NAME_BYTES] = bytes(NAME_BYTES)
            self.words[HEADER + index] = NEVER
        self._joined.clear()

    def name(self, index: int) -> str:
        """Return the name of a participant, '' if there is none."""
        begin = self._names + index * NAME_BYTES
        return self._map[begin:begin + NAME_BYTES].rstrip(b'\0').decode(errors='replace')


class Participant:
    """A thread without which time does not pass beyond what it permits."""

    def __init__(self, shared: SimulatedTime, index: int) -> None:
        self._words, self._index = shared.words, HEADER + index

    def permit(self, until_ns: int) -> None:
        """Let the steady time pass until ``until_ns``; ``NEVER``: limit nothing."""
        self._words[self._index] = until_ns
