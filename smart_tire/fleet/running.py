# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Calls of a function with each of many items, in processes of this machine or on a cluster."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import (
    CancelledError, FIRST_COMPLETED, Future, ProcessPoolExecutor, wait as wait_for)
from concurrent.futures.process import BrokenProcessPool
import logging
import multiprocessing
import os
from pathlib import Path
import signal
from threading import Lock
from typing import Any, TypeVar

from smart_tire.errors import BagError, ParameterError, SmartTireError
from smart_tire.fleet.sources import FLEET_EXTRA, Wait

MEMORY_PER_BAG = 900e6  # bytes of a process that reads an hour, of benchmarks.offline
CONNECT_TIMEOUT = 10.0  # s, for scheduler and first worker of a cluster, assumed
CONNECT_TRIES = 6       # after a scheduler was lost, for a restart of a minute
TASKS_PER_THREAD = 2    # on a cluster: the next one waits where it will run

Item = TypeVar('Item')
Value = TypeVar('Value')
Outcome = tuple[Item, Value | BaseException]
_END: Any = object()
_one_at_a_time = Lock()  # of the threads of a worker: output is redirected per process


def run_each(function: Callable[[Item], Value], items: Iterable[Item], *, jobs: int = 0,
             cluster: str = '', wait: Wait) -> Generator[Outcome[Item, Value], None, None]:
    """
    Yield each of ``items`` with what ``function`` returns or raises, in order of completion.

    With ``cluster``, the address of a scheduler of dask.distributed, workers there call it; else
    ``jobs`` processes, or this one if ``jobs`` is 0. Function, items and results are pickled. An
    item whose process dies is tried once more, alone, if there were others. No more items than
    are running are taken. Closing the iterator ends all that runs. Raises ParameterError if a
    cluster is not reached; what it had computed has been yielded. This process waits by ``wait``.
    """
    if cluster:
        yield from _on_cluster(function, iter(items), cluster, wait)
    elif jobs:
        yield from _in_processes(function, iter(items), jobs)
    else:
        for item in items:
            try:
                value: Value | BaseException = function(item)
            except SmartTireError as error:
                value = error
            yield item, value


def jobs_for(count: int, wanted: int | None = None) -> int:
    """Return the number of processes for ``count`` bags, by cores and free memory."""
    cores = len(os.sched_getaffinity(0))
    return max(1, min(count, wanted or min(cores, int(_free_memory() // MEMORY_PER_BAG))))


def _free_memory() -> float:
    """Return the bytes that new processes may use."""
    lines = Path('/proc/meminfo').read_text(encoding='ascii').splitlines()
    return next(float(line.split()[1]) * 1024.0 for line in lines
                if line.startswith('MemAvailable'))


def _in_processes(function: Callable[[Item], Value], items: Iterator[Item],
                  jobs: int) -> Iterator[Outcome[Item, Value]]:
    pool, running = _pool(jobs), dict[Future[Value], Item]()
    try:
        while True:
            while len(running) < jobs and (item := next(items, _END)) is not _END:
                running[pool.submit(_call, function, item)] = item
            if not running:
                return
            done, _ = wait_for(running, return_when=FIRST_COMPLETED)
            broken = any(isinstance(one.exception(), BrokenProcessPool) for one in done)
            suspects: list[Item] = []  # it is not known in which process it was
            for future in list(running) if broken else done:
                item, error = running.pop(future), future.exception()
                if isinstance(error, BrokenProcessPool):
                    suspects.append(item)
                else:
                    yield item, error or future.result()
            if broken:
                pool.shutdown()
                for item in suspects:
                    if jobs == 1:
                        yield item, BagError('the process that read it has died; out of memory?')
                    else:
                        yield from _in_processes(function, iter([item]), 1)
                pool = _pool(jobs)
    finally:
        _end(pool)


def _pool(jobs: int) -> ProcessPoolExecutor:
    # forked, as the other processes: a new interpreter takes longer than most bags
    return ProcessPoolExecutor(jobs, multiprocessing.get_context('fork'), _ignore_signals)


def _end(pool: ProcessPoolExecutor) -> None:
    """End the calls that run, which delete what is not complete, and the processes."""
    for process in multiprocessing.active_children():
        process.terminate()
    pool.shutdown(cancel_futures=True)


def _ignore_signals() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # between two calls


def _call(function: Callable[[Item], Value], item: Item) -> Value:
    """Call ``function`` in a process of a pool; SIGTERM interrupts it."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return function(item)
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


def _call_on_worker(function: Callable[[Item], Value], item: Item) -> Value:
    with _one_at_a_time:
        return function(item)


def _on_cluster(function: Callable[[Item], Value], items: Iterator[Item], address: str,
                wait: Wait) -> Iterator[Outcome[Item, Value]]:
    """Yield as ``run_each``; what a lost scheduler had not returned is submitted again."""
    try:
        from distributed import as_completed
    except ModuleNotFoundError as error:
        raise ParameterError(f'--dask needs dask.distributed ({FLEET_EXTRA})') from error
    logging.getLogger('distributed.client').setLevel(logging.CRITICAL)  # it is handled here
    again: deque[Item] = deque()
    tries = 1
    while True:
        client = _connected(address, tries, wait)
        running: dict[Any, Item] = {}
        finished = as_completed(loop=client.loop)

        def submit() -> None:
            """Give enough to the workers, which may have become more."""
            slots = TASKS_PER_THREAD * max(1, sum(client.nthreads().values()))  # noqa: B023
            while len(running) < slots:  # noqa: B023
                item = again.popleft() if again else next(items, _END)
                if item is _END:
                    return
                future = client.submit(_call_on_worker, function, item, pure=False)  # noqa: B023
                running[future] = item   # noqa: B023
                finished.add(future)     # noqa: B023

        try:
            submit()
            for future in finished:
                if future.status not in ('finished', 'error'):  # the scheduler is lost
                    break
                value = future.exception() or future.result()
                item = running.pop(future)
                del future
                yield item, value
                submit()
            else:
                return
        except (OSError, CancelledError):  # the link to the scheduler has failed meanwhile
            pass
        finally:
            again.extend(running.values())
            client.close(timeout=CONNECT_TIMEOUT)
        tries = CONNECT_TRIES


def _connected(address: str, tries: int, wait: Wait) -> Any:
    """Return a client of a cluster with workers; raise ParameterError after some tries."""
    from distributed import Client
    for attempt in range(tries):
        if attempt:
            wait(CONNECT_TIMEOUT)
        client = None
        try:
            client = Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
            client.wait_for_workers(1, timeout=CONNECT_TIMEOUT)
        except (OSError, ValueError, asyncio.TimeoutError) as failure:  # the last: Python 3.10
            reason = str(failure).partition('\n')[0] or type(failure).__name__
            if client is not None:
                client.close(timeout=CONNECT_TIMEOUT)
        else:
            return client
    raise ParameterError(f'cluster {address}: not reached in {tries * CONNECT_TIMEOUT:.0f} s '
                         f'({reason}); what was computed is kept')
