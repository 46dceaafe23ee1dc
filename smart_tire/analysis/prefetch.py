"""Work in a process of its own, one step ahead of whoever needs the results."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from multiprocessing import get_context
from multiprocessing.connection import Connection
import os
import signal
from typing import Any, TypeVar

from smart_tire.errors import EstimatorError, SmartTireError

Item = TypeVar('Item')


def ahead(items: Callable[[], Iterator[Item]]) -> Generator[Item, None, None]:
    """
    Yield what ``items()`` yields, computed in a second process where there is a core for it.

    Items must be worth a trip through a pipe: big and few. The errors of this package come
    through; the process ends with the iterator, finished or not.
    """
    if len(os.sched_getaffinity(0)) < 2:
        yield from items()
        return
    context = get_context('fork')  # a fresh interpreter would take longer than most bags
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(items, sender, receiver), daemon=True)
    process.start()
    sender.close()
    try:
        while (item := _received(receiver)) is not None:
            if isinstance(item, SmartTireError):
                raise item
            yield item
    finally:
        receiver.close()
        process.join()


def _received(receiver: Connection) -> Any:
    try:
        return receiver.recv()
    except EOFError as error:
        raise EstimatorError('the process that reads ahead has died') from error


def _send(items: Callable[[], Iterator[Item]], sender: Connection, receiver: Connection) -> None:
    receiver.close()  # or a parent that is gone would not be noticed
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent is told too, and closes the pipe
    try:
        try:
            for item in items():
                sender.send(item)
        except SmartTireError as error:
            sender.send(error)
        sender.send(None)
    except BrokenPipeError:
        pass  # nobody wants the rest
