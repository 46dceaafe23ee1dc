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

"""Time that one poll of all motor boards takes on their common line."""

from __future__ import annotations

from collections import defaultdict, deque
from statistics import median

from smart_tire.protocol.roboclaw import Command, READ_CURRENTS, READ_ENCODERS, SET_DUTY
from smart_tire.samples import NS_PER_S

POLL = (READ_ENCODERS, READ_CURRENTS, SET_DUTY)  # to each board
BOARDS = 2
MAX_EXCHANGES = 41     # latest ones of a command, whose median counts: a busy host adds outliers
MIN_EXCHANGES = 16     # of a command, before the time is known
BITS_PER_BYTE = 10     # with start and stop bit


class LineTiming:
    """
    Median durations of the exchanges on the line, and the poll rate that they permit.

    A poll is encoders, currents and duty of each board; without replies to requests for currents
    it is the rest. ``record`` is called from one thread.
    """

    def __init__(self) -> None:
        self._durations: defaultdict[Command, deque[int]] = defaultdict(
            lambda: deque(maxlen=MAX_EXCHANGES))
        self.poll_time: float | None = None  # s, None until it is known

    def record(self, command: Command, duration_ns: int) -> None:
        """Record a request with its good reply, which took ``duration_ns``."""
        self._durations[command].append(duration_ns)
        if command == SET_DUTY and all(
                len(self._durations[one]) >= MIN_EXCHANGES for one in (READ_ENCODERS, SET_DUTY)):
            self.poll_time = BOARDS / NS_PER_S * sum(
                median(self._durations[one]) for one in POLL if self._durations[one])

    @property
    def max_rate(self) -> float | None:
        """Return the maximum rate of polls [Hz], None until it is known."""
        return None if self.poll_time is None else 1.0 / self.poll_time

    def excess(self, rate: float) -> str:
        """Return why the ``rate`` of polls [Hz] is too high, '' if it is not or not known."""
        if self.max_rate is None or rate <= self.max_rate:
            return ''
        return f'rate is {rate:g} Hz, expected less; {self}'

    def __str__(self) -> str:
        """Return poll time and maximum rate as text, '' until they are known."""
        if self.poll_time is None:
            return ''
        return (f'{BOARDS} boards on the line: one poll takes {1e3 * self.poll_time:.1f} ms, '
                f'at most {int(1.0 / self.poll_time)} Hz')


def least_poll_time(baud_rate: int) -> float:
    """Return the time [s] that the bytes of one poll need on a line with ``baud_rate``."""
    size = BOARDS * sum(command.request_size + command.reply_size for command in POLL)
    return size * BITS_PER_BYTE / baud_rate
