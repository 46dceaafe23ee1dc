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

"""Runs of tests against a mutant, in a copy of the checkout."""

from __future__ import annotations

from collections.abc import Iterable
import compileall
from dataclasses import dataclass
import os
from pathlib import Path
from py_compile import PycInvalidationMode
import re
import resource
import shutil
import signal
import subprocess
import sys
import time

from support.mutants import Mutant

NOT_COPIED = ('.*', '__pycache__', '*.egg-info', '*_output', 'build', 'install', 'log')
OPTIONS = ('-x', '-q', '-rfE', '--tb=line', '-p', 'no:cacheprovider', '-p', 'no:randomly')
MAX_SHARED_TIME = 3.0      # s; faster test files share one process
TIMEOUT_FACTOR = 3.0       # time-out of the tests with a mutant over their time without it
PATIENCE = '15'            # s, of the tests (support/waiting.py): most mutants cause time-outs
MAX_MEMORY = 2 << 30       # bytes per process; an endless loop may fill a list
FAILED = re.compile(r'^(?:FAILED|ERROR) (.*?)(?: - .*)?$', re.MULTILINE)

Tests = tuple[str, ...]  # arguments of pytest


@dataclass(frozen=True)
class Run:
    """One run of pytest."""

    status: int | None  # of the process, None after a time-out
    seconds: float
    output: str


@dataclass(frozen=True)
class Verdict:
    """Result of the tests for a mutant."""

    mutant: Mutant
    result: str  # killed, timed out, survived
    seconds: float
    killer: str = ''  # the first test that failed


class Workplace:
    """A copy of the checkout ``root`` in ``folder``, for one test run at a time."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.tree = folder / 'tree'
        self._folder = folder
        self._closed = False
        self._mark = f'MUTANT_TREE={self.tree}'
        shutil.copytree(root, self.tree, ignore=shutil.ignore_patterns(*NOT_COPIED))
        # A mutant may have the size and the modification time of the original: bytecode must be
        # checked by a hash of the source.
        compileall.compile_dir(self.tree, quiet=2,
                               invalidation_mode=PycInvalidationMode.CHECKED_HASH)

    def run(self, arguments: Tests, timeout: float | None = None) -> Run:
        """Run Python with ``arguments`` in the copy, and end all processes that it started."""
        name, _, value = self._mark.partition('=')
        path = os.pathsep.join(filter(None, [str(self.tree), os.environ.get('PYTHONPATH')]))
        environment = {**os.environ, name: value, 'PYTHONPATH': path, 'TEST_PATIENCE': PATIENCE,
                       'PYTHONDONTWRITEBYTECODE': '1'}
        log = self._folder / 'output'
        begin = time.monotonic()
        with log.open('wb') as output:
            process = subprocess.Popen(
                [sys.executable, *arguments], cwd=self.tree, env=environment,
                stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
                start_new_session=True)
        resource.prlimit(process.pid, resource.RLIMIT_DATA, (MAX_MEMORY, MAX_MEMORY))
        if self._closed:
            self.end_processes()
        status: int | None = None
        try:
            status = process.wait(timeout)
        except subprocess.TimeoutExpired:
            pass
        finally:
            self.end_processes()
            process.wait()
        return Run(status, time.monotonic() - begin, log.read_text(errors='replace'))

    def test(self, tests: Tests, timeout: float | None = None) -> Run:
        """Run pytest in the copy."""
        return self.run(('-m', 'pytest', *OPTIONS, f'--basetemp={self._folder / "tmp"}', *tests),
                        timeout)

    def evaluate(self, mutant: Mutant, stages: list[tuple[Tests, float]],
                 grace: float) -> Verdict:
        """Run the tests stage by stage until one fails because of the mutant."""
        path = self.tree / mutant.file
        original = path.read_bytes()
        begin = time.monotonic()
        path.write_text(mutant.source, encoding='utf-8')
        try:
            for tests, seconds in stages:
                run = self.test(tests, TIMEOUT_FACTOR * seconds + grace)
                if run.status != 0:
                    failed = FAILED.search(run.output)
                    return Verdict(mutant, 'timed out' if run.status is None else 'killed',
                                   time.monotonic() - begin,
                                   failed[1] if failed else f'{tests[0]}: exit {run.status}')
            return Verdict(mutant, 'survived', time.monotonic() - begin)
        finally:
            path.write_bytes(original)

    def end_processes(self) -> None:
        """End all processes started here, including those in their own session."""
        while sum(self._end(path) for path in Path('/proc').iterdir() if path.name.isdigit()):
            time.sleep(0.01)

    def close(self) -> None:
        """End running tests, and those that a thread is about to start."""
        self._closed = True
        self.end_processes()

    def _end(self, path: Path) -> bool:
        try:
            process = os.pidfd_open(int(path.name))  # the id cannot be reused before the signal
        except OSError:
            return False
        try:
            if self._mark.encode() not in (path / 'environ').read_bytes().split(b'\0'):
                return False
            signal.pidfd_send_signal(process, signal.SIGKILL)
        except OSError:
            return False  # ended, or another user's process
        finally:
            os.close(process)
        return True


def stages(times: dict[Tests, float], likely: Iterable[str] = ()) -> list[tuple[Tests, float]]:
    """
    Return test runs with their times [s]: fast files together, ``likely`` tests, slow files.

    Likely tests are those of slow files that killed similar mutants; they save time.
    """
    fast = {tests: seconds for tests, seconds in times.items()
            if seconds < MAX_SHARED_TIME and len(tests) == 1}
    slow = sorted((item for item in times.items() if item[0] not in fast),
                  key=lambda item: item[1])
    early = tuple(test for test in likely if any(test.startswith(tests[0]) for tests, _ in slow))
    runs = [(tuple(sorted(name for name, in fast)), sum(fast.values())),
            (early, sum(seconds for _, seconds in slow)), *slow]
    return [(tests, seconds) for tests, seconds in runs if tests]
