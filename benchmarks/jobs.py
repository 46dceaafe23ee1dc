"""The jobs of a benchmark: on all cores, with a line for each that is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
import sys
from typing import TypeVar

from smart_tire.errors import ParameterError

WORKERS = 2  # processes at once; each does one job

Result = TypeVar('Result')


def make_folder(path: Path) -> None:
    """Make the folder of the results; raise ParameterError if that can not be."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ParameterError(f'{path}: cannot be written ({error.strerror})') from error


def done(jobs: Sequence[Callable[[], Result]],
         label: Callable[[Result], str]) -> Iterator[Result]:
    """Yield the results of ``jobs`` as they come, and say on standard error which they are."""
    if len(jobs) == 1:
        yield jobs[0]()
        return
    # a process that starts anew, for this one may have threads
    with ProcessPoolExecutor(WORKERS, get_context('spawn')) as pool:
        futures = [pool.submit(job) for job in jobs]
        try:
            for count, future in enumerate(as_completed(futures), 1):
                result = future.result()
                print(f'{count:3}/{len(jobs)}  {label(result)}', file=sys.stderr, flush=True)
                yield result
        finally:
            pool.shutdown(cancel_futures=True)
