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

"""Parallel execution of benchmark jobs with one line of progress per job."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
import sys
from typing import TypeVar

from smart_tire.errors import ParameterError

MAX_WORKERS = 2  # parallel processes

Result = TypeVar('Result')


def make_folder(path: Path) -> None:
    """Create the output folder; raise ParameterError if that fails."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f'{path}: cannot be written ({error.strerror})') from error


def run_jobs(jobs: Sequence[Callable[[], Result]],
             label: Callable[[Result], str]) -> Iterator[Result]:
    """Yield the results of ``jobs`` in order of completion; print progress to stderr."""
    if len(jobs) == 1:
        yield jobs[0]()
        return
    # spawn, not fork: this process may have threads
    with ProcessPoolExecutor(MAX_WORKERS, get_context('spawn')) as pool:
        futures = [pool.submit(job) for job in jobs]
        try:
            for count, future in enumerate(as_completed(futures), 1):
                result = future.result()
                print(f'{count:3}/{len(jobs)}  {label(result)}', file=sys.stderr, flush=True)
                yield result
        finally:
            pool.shutdown(cancel_futures=True)
