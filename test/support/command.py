# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Processes under test: start, output and shutdown."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

from support.waiting import PATIENCE, wait_for


class Python:
    """A running Python process with ``words`` as arguments; a context manager."""

    def __init__(self, *words: object) -> None:
        self.lines: list[str] = []
        self._process = subprocess.Popen(
            [sys.executable, *map(str, words)], text=True, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            env={**os.environ, 'PYTHONUNBUFFERED': '1'})
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> Python:
        return self

    def __exit__(self, *_: object) -> None:
        if self.running:
            self._process.kill()
        self._process.wait()
        self._reader.join()
        self._process.stdout.close()
        self._process.stdin.close()

    @property
    def output(self) -> str:
        """Return the output so far."""
        return '\n'.join(self.lines)

    @property
    def pid(self) -> int:
        """Return the id of the process."""
        return self._process.pid

    @property
    def running(self) -> bool:
        """Return whether the process has not ended."""
        return self._process.poll() is None

    def wait_for(self, text: str) -> None:
        """Wait until ``text`` is printed; fail with the output if the process ends before."""
        wait_for(lambda: text in self.output or not self.running)
        assert text in self.output, self.output

    def write(self, line: object) -> None:
        """Write a line to standard input."""
        self._process.stdin.write(f'{line}\n')
        self._process.stdin.flush()

    def signal(self, number: int) -> None:
        """Send a signal."""
        self._process.send_signal(number)

    def end(self) -> int:
        """Wait until the process ends; return its exit status."""
        status = self._process.wait(PATIENCE)
        self._reader.join()
        return status

    def _read(self) -> None:
        for line in self._process.stdout:
            self.lines.append(line.rstrip())


def command(*words: object) -> Python:
    """Return a running ``smart_tire VERB ...``."""
    return Python('-m', 'smart_tire.cli.main', *words)
