"""Locks for tests that need all cores of the machine while no other test runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import fcntl
import os
from pathlib import Path
import tempfile


@contextmanager
def _locked(name: str, how: int) -> Iterator[None]:
    with (Path(tempfile.gettempdir()) / f'smart_tire_test_{name}_{os.getuid()}').open('a') as lock:
        fcntl.flock(lock, how)  # released when the file is closed
        yield


@contextmanager
def shared() -> Iterator[None]:
    """Wait until no test process runs exclusively, and prevent it meanwhile."""
    with _locked('gate', fcntl.LOCK_SH):
        pass  # held by a process that waits for exclusive use: others must not start meanwhile
    with _locked('room', fcntl.LOCK_SH):
        yield


@contextmanager
def exclusive() -> Iterator[None]:
    """Wait until no other test process runs, and prevent others from starting."""
    with _locked('gate', fcntl.LOCK_EX), _locked('room', fcntl.LOCK_EX):
        yield
