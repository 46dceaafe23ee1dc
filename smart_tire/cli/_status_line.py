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

"""A line about work in progress: kept current on a terminal, otherwise printed now and then."""

from __future__ import annotations

from collections.abc import Callable
import time
from types import TracebackType

from rich.console import Console
from rich.live import Live
from rich.text import Text

LINE_PERIOD = 10.0  # s between two lines without a terminal
UNITS = 'B', 'kB', 'MB', 'GB', 'TB'


class StatusLine:
    """Shows the latest text; a context manager, after which the line is erased."""

    def __init__(self, console: Console | None = None,
                 clock: Callable[[], float] = time.monotonic) -> None:
        self._console = console or Console()
        self._clock = clock  # s
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        self._next = clock() + LINE_PERIOD

    def __enter__(self) -> StatusLine:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self._console.is_terminal:
            self._live.stop()

    def show(self, text: str) -> None:
        """Replace the line by ``text``; without a terminal, print it after LINE_PERIOD."""
        if self._console.is_terminal:
            self._live.update(Text(text, no_wrap=True, overflow='ellipsis'), refresh=True)
            self._console.file.write('\r')  # so that log lines of ROS replace the line
            self._console.file.flush()
        elif self._clock() >= self._next:
            self._next = self._clock() + LINE_PERIOD
            self._console.print(text, soft_wrap=True, highlight=False, markup=False)


class Rate:
    """Rate of a growing number, between two calls of ``update``."""

    def __init__(self) -> None:
        self._last: tuple[float, float] | None = None

    def update(self, value: float, time: float) -> float | None:
        """Return the rate [1/s] since the previous call, None at the first one."""
        last, self._last = self._last, (value, time)
        return None if last is None or time <= last[1] else (value - last[0]) / (time - last[1])


def duration_text(seconds: float) -> str:
    """Return a duration as minutes and seconds, or hours, minutes and seconds."""
    minutes, second = divmod(max(0, int(seconds)), 60)
    hours, minute = divmod(minutes, 60)
    return f'{hours}:{minute:02}:{second:02}' if hours else f'{minute}:{second:02}'


def size_text(size: float) -> str:
    """Return a number of bytes with a decimal unit."""
    power = 0
    while size >= 999.5 and power < len(UNITS) - 1:  # rounds to 1000
        size /= 1000.0
        power += 1
    digits = 0 if power == 0 or size >= 99.95 else 1
    return f'{size:.{digits}f} {UNITS[power]}'
