# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The guided sequence: which step is next, recorded, repeated or skipped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import Enum

from smart_tire.calibration.procedure.sequence import LIFTED, REST, STRAIGHT, TURNS
from smart_tire.calibration.procedure.watches import Progress, Watch, WATCHES
from smart_tire.samples import Sample

INSTRUCTIONS: Mapping[str, str] = {
    REST: 'Leave the robot at rest on level ground, motors on, nobody touches it.',
    STRAIGHT: 'On firm, level ground: start and stop straight ahead and straight back, some '
              'firmly and some gently, with a stop of one second after each.',
    TURNS: 'On the same ground: turn left and right at two speeds, and in place; a full circle '
           'in each direction or more, each turn at constant speed for five seconds.',
    LIFTED: 'Put the robot on blocks, all wheels off the ground, and turn the wheels at several '
            'speeds in both directions.'}


class Key(Enum):
    """What the user may ask for; the value is the line to type."""

    GO = ''        # start the step, or end it before it is complete
    REPEAT = 'r'   # discard what is recorded of the step, and start again
    SKIP = 's'     # continue without this step
    QUIT = 'q'     # identify from the steps recorded so far


class Action(Enum):
    """What the program has to do."""

    RECORD = 'start a recording of the step'
    KEEP = 'end the recording'
    DISCARD = 'end the recording and delete it'


class Guide:
    """State of the sequence: waiting for the user, or recording a step."""

    def __init__(self, steps: Sequence[str]) -> None:
        self._steps, self._index = tuple(steps), 0
        self.watch: Watch | None = None  # of the step while it is recorded
        self.recorded: list[str] = []

    @property
    def step(self) -> str | None:
        """Return the present step, None after the last one."""
        return self._steps[self._index] if self._index < len(self._steps) else None

    @property
    def number(self) -> str:
        """Return the number of the step and of all steps."""
        return f'{min(self._index + 1, len(self._steps))}/{len(self._steps)}'

    @property
    def progress(self) -> Progress | None:
        """Return the progress of the step while it is recorded."""
        return None if self.watch is None else self.watch.progress

    def update(self, sample: Sample) -> list[Action]:
        """Take a sample; a complete step ends."""
        if self.watch is None:
            return []
        self.watch.update(sample)
        return self.finish() if self.watch.progress.done else []

    def key(self, key: Key) -> list[Action]:
        """Take a request of the user; return what has to be done, in order."""
        if self.step is None:
            return []
        if key is Key.GO:
            return self._start() if self.watch is None else self.finish()
        recording = [Action.DISCARD] if self.watch is not None else []
        if key is Key.REPEAT:
            return [*recording, *self._start()]
        self.watch = None
        self._index = self._index + 1 if key is Key.SKIP else len(self._steps)
        return recording

    def restart_watch(self) -> None:
        """Forget what has been seen of the step: its recording begins now."""
        if self.step is not None and self.watch is not None:
            self.watch = WATCHES[self.step]()

    def finish(self) -> list[Action]:
        """End the recording of the step and continue with the next one."""
        if self.watch is None or self.step is None:
            return []
        self.recorded.append(self.step)
        self.watch, self._index = None, self._index + 1
        return [Action.KEEP]

    def _start(self) -> list[Action]:
        assert self.step is not None
        self.watch = WATCHES[self.step]()
        return [Action.RECORD]
