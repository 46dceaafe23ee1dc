"""Waiting for a condition, with a time-out for a very busy machine."""

from __future__ import annotations

from collections.abc import Callable
import os
import time

# s, reached by failures only; the mutation test, in which most runs fail, sets a shorter one
PATIENCE = float(os.environ.get('TEST_PATIENCE', '60'))


def wait_for(condition: Callable[[], object], do: Callable[[], object] | None = None) -> None:
    """Return when ``condition`` is true, calling ``do`` meanwhile; fail after PATIENCE."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, f'still not true: {condition}'
        if do is None:
            time.sleep(0.005)
        else:
            do()
