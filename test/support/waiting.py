"""Waiting for something to happen, as long as even a very busy machine may need."""

from __future__ import annotations

from collections.abc import Callable
import os
import time

# s, only ever used up by a failure; the mutation test, where failures are the rule, sets less
PATIENCE = float(os.environ.get('TEST_PATIENCE', '60'))


def wait_for(condition: Callable[[], object], do: Callable[[], object] | None = None) -> None:
    """Return when ``condition`` is true, doing ``do`` meanwhile; fail if it never is."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, f'still not true: {condition}'
        if do is None:
            time.sleep(0.005)
        else:
            do()
