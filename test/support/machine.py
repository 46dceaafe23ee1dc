"""The cores of this machine, which tests share but for those that need all of them."""

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
        fcntl.flock(lock, how)  # ends with the file
        yield


@contextmanager
def beside_others() -> Iterator[None]:
    """Wait until no other process of tests is alone, and let none become so."""
    with _locked('gate', fcntl.LOCK_SH):
        pass  # who wants to be alone holds it: nobody else comes in meanwhile
    with _locked('room', fcntl.LOCK_SH):
        yield


@contextmanager
def alone() -> Iterator[None]:
    """Wait until no other process of tests computes, and keep them from it."""
    with _locked('gate', fcntl.LOCK_EX), _locked('room', fcntl.LOCK_EX):
        yield
