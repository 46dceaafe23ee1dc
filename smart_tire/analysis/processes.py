# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Stages of a computation, each in a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
import gc
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
import os
import pickle
import signal
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smart_tire.errors import EstimatorError, SmartTireError
from smart_tire.recording import Column, MAX_IN_MEMORY

Stage = Callable[[Iterator[Any]], Iterator[Any]]


def pipelined(first: Callable[[], Iterator[Any]], *stages: Stage) -> Generator[Any, None, None]:
    """
    Yield the items of the last of ``stages``; each computes those of the one before it.

    Each stage has a process of its own if there is a second core, but not in a process or thread
    of several, which read a bag each. Every item is pickled and sent through a pipe, so items
    should be few and large; of arrays no copy is made. Errors of this package are raised here; the
    processes end when the iterator is closed.
    """
    if len(os.sched_getaffinity(0)) < 2 or parent_process() is not None or (
            threading.current_thread() is not threading.main_thread()):
        items = first()
        for stage in stages:
            items = stage(items)
        yield from items
        return
    context = get_context('fork')  # spawning an interpreter takes longer than most bags
    items, processes = first(), []
    receivers: list[Connection] = []  # open here
    for stage in (iter, *stages):
        receiver, sender = context.Pipe(duplex=False)
        processes.append(context.Process(
            target=_send, args=(stage(items), sender, receiver), daemon=True))
        processes[-1].start()
        sender.close()
        for before in receivers:
            before.close()  # the new process has its own
        receivers, items = [receiver], _received(receiver)
    try:
        yield from items
    finally:
        receivers[0].close()
        for process in processes:
            process.join()


def _received(receiver: Connection) -> Iterator[Any]:
    """Yield the items of another process; raise its errors."""
    while (item := _receive(receiver)) is not None:
        if isinstance(item, SmartTireError):
            raise item
        yield item


def _receive(receiver: Connection) -> Any:
    try:
        data, sizes = receiver.recv()
        return pickle.loads(data, buffers=[_received_bytes(receiver, size) for size in sizes])
    except EOFError as error:
        raise EstimatorError('a process of the analysis has died') from error


def _received_bytes(receiver: Connection, size: int) -> NDArray[np.uint8]:
    """Return the next ``size`` bytes, which come in pieces."""
    found = Column(np.empty(0, np.uint8))
    while len(found.rows) < size:
        found.extend(np.frombuffer(bytearray(receiver.recv_bytes()), np.uint8))
    return found.rows


def _send(items: Iterator[Any], sender: Connection, receiver: Connection) -> None:
    gc.freeze()  # a collection would copy the pages that are shared with the parent
    receiver.close()  # otherwise the end of its reader would not be noticed
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # on SIGINT the parent closes the last pipe
    try:
        try:
            for item in items:
                _send_one(sender, item)
        except SmartTireError as error:
            _send_one(sender, error)
        _send_one(sender, None)
    except BrokenPipeError:
        pass  # no more items are needed


def _send_one(sender: Connection, item: Any) -> None:
    """Send an item, and its arrays as they are in memory, without those that are empty."""
    buffers: list[pickle.PickleBuffer] = []

    def is_copied(buffer: pickle.PickleBuffer) -> bool:
        view = buffer.raw()
        if view.nbytes:
            buffers.append(buffer)
        return not view.nbytes  # empty messages cannot be received
    data = pickle.dumps(item, 5, buffer_callback=is_copied)
    sender.send((data, [buffer.raw().nbytes for buffer in buffers]))
    for buffer in buffers:
        for begin in range(0, len(view := buffer.raw()), MAX_IN_MEMORY):
            sender.send_bytes(view[begin:begin + MAX_IN_MEMORY])
