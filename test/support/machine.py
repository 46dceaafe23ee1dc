# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Locks that let some tests have all cores of this machine, while others share them."""

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
def shared_cores() -> Iterator[None]:
    """Wait until no other test process has all cores, and let none take them."""
    with _locked('gate', fcntl.LOCK_SH):
        pass  # held by a process that waits for all cores: no other one enters meanwhile
    with _locked('room', fcntl.LOCK_SH):
        yield


@contextmanager
def exclusive_cores() -> Iterator[None]:
    """Wait until no other test process computes, and let none start."""
    with _locked('gate', fcntl.LOCK_EX), _locked('room', fcntl.LOCK_EX):
        yield
