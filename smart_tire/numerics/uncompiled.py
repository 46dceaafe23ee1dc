# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the compiled modules name of Cython, as plain Python that does nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

T = TypeVar('T')

compiled = False
double, int = float, int  # noqa: A001 - names of Cython


def ccall(decorated: T) -> T:
    """Return what is decorated."""
    return decorated


cclass = cfunc = ccall


def declare(*_: object, **__: object) -> None:
    """Declare nothing."""


def exceptval(check: bool) -> Callable[[T], T]:
    """Return a decorator that does nothing."""
    return ccall
