# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Waiting for a condition, with a time-out for a very busy machine."""

from __future__ import annotations

from collections.abc import Callable
import os
import time

# s, which only a hang exceeds: ten nodes on two busy cores take more than 60 s to start. The
# mutation test, in which most runs fail, sets a shorter one.
PATIENCE = float(os.environ.get('TEST_PATIENCE', '300'))


def wait_for(condition: Callable[[], object], do: Callable[[], object] | None = None) -> None:
    """Return when ``condition`` is true, calling ``do`` meanwhile; fail after PATIENCE."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, f'still not true: {condition}'
        if do is None:
            time.sleep(0.005)
        else:
            do()
