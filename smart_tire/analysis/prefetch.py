# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Run an iterator in a forked process and prefetch its items."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from multiprocessing import get_context
from multiprocessing.connection import Connection
import os
import signal
from typing import Any, TypeVar

from smart_tire.errors import EstimatorError, SmartTireError

Item = TypeVar('Item')


def prefetch(items: Callable[[], Iterator[Item]]) -> Generator[Item, None, None]:
    """
    Yield the items of ``items()``, computed in a second process if a second core is available.

    Every item is pickled and sent through a pipe, so items should be few and large. Errors of
    this package are raised here; the process ends when the iterator is closed.
    """
    if len(os.sched_getaffinity(0)) < 2:
        yield from items()
        return
    context = get_context('fork')  # spawning an interpreter takes longer than most bags
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(items, sender, receiver), daemon=True)
    process.start()
    sender.close()
    try:
        while (item := _receive(receiver)) is not None:
            if isinstance(item, SmartTireError):
                raise item
            yield item
    finally:
        receiver.close()
        process.join()


def _receive(receiver: Connection) -> Any:
    try:
        return receiver.recv()
    except EOFError as error:
        raise EstimatorError('the prefetching process has died') from error


def _send(items: Callable[[], Iterator[Item]], sender: Connection, receiver: Connection) -> None:
    receiver.close()  # otherwise the end of the parent would not be noticed
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # on SIGINT the parent closes the pipe
    try:
        try:
            for item in items():
                sender.send(item)
        except SmartTireError as error:
            sender.send(error)
        sender.send(None)
    except BrokenPipeError:
        pass  # the parent needs no more items
