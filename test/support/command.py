"""Processes that a test starts, listens to, and ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import os
import subprocess
import sys
import threading
import time


class Python:
    """A running Python with ``words`` on its command line; a context that ends it."""

    def __init__(self, environment: Mapping[str, str], *words: object) -> None:
        self.lines: list[str] = []
        self._process = subprocess.Popen(
            [sys.executable, *map(str, words)], text=True, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, env={
                **environment, 'PYTHONUNBUFFERED': '1', 'PYTHONPATH': os.pathsep.join(
                    [entry for entry in sys.path if entry])})
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> Python:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self._reader.join()
        self._process.stdout.close()

    @property
    def said(self) -> str:
        """Return all that it printed."""
        return '\n'.join(self.lines)

    def wait_for(self, text: str, seconds: float = 20.0) -> None:
        """Wait until it has printed ``text``."""
        wait_until(lambda: text in self.said, f'{text!r} in\n{self.said}', seconds)

    def signal(self, number: int) -> None:
        """Send it a signal."""
        self._process.send_signal(number)

    def end(self, seconds: float = 30.0) -> int:
        """Wait until it ends by itself and return its exit status."""
        status = self._process.wait(seconds)
        self._reader.join()
        return status

    def _read(self) -> None:
        for line in self._process.stdout:
            self.lines.append(line.rstrip())


def command(environment: Mapping[str, str], *words: object) -> Python:
    """Return a running ``smart_tire VERB ...``."""
    return Python(environment, '-m', 'smart_tire.cli.main', *words)


def wait_until(true: Callable[[], bool], what: str, seconds: float = 20.0) -> None:
    """Wait until ``true``; fail with ``what`` was waited for."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, f'waited in vain for {what}'
        time.sleep(0.02)
