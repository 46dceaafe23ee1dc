"""
Smoothed sliding at the time at which it was measured.

A wheel reading is a mean over a period that has passed, often for long. The filter takes it for
the present, and where the sliding changes it lags by half a period and all of the latency. Who
looks back knows better: what a reading told of the sliding belongs to the middle of its period.
Speeds over ground do not lag, so that slips are in time, too.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace

from smart_tire.estimation.slip.rts_smoother import Smoothed
from smart_tire.estimation.slip.state import SLIP_VELS

LONGEST = 3.0  # s without a wheel reading; beyond, the sliding stays as the filter has it

ROWS = list(SLIP_VELS)
Knot = tuple[float, list[float]]  # s, m/s of both sides


def timed(states: Iterable[Smoothed]) -> Iterator[Smoothed]:
    """Yield ``states``, in their order, with their sliding moved between the readings."""
    waiting: deque[Smoothed] = deque()  # for the reading after them
    last: Knot | None = None
    stretch = 0
    for state in states:
        if state.stretch != stretch:
            yield from waiting
            waiting.clear()
            last, stretch = None, state.stretch
        knot = state.seen.wheels_at, [state.x[row] for row in ROWS]
        if last is None or knot[0] > last[0]:
            while waiting and waiting[0].seen.time < knot[0]:
                earlier = waiting.popleft()
                yield earlier if last is None else _between(last, knot, earlier)
            last = knot
        waiting.append(state)
        while waiting[0].seen.time < state.seen.time - LONGEST:
            yield waiting.popleft()
    yield from waiting


def _between(last: Knot, knot: Knot, state: Smoothed) -> Smoothed:
    """
    Return ``state`` with the sliding between two readings.

    When it changed between them is not known: a step at any time, each as likely, is off the
    line by this variance.
    """
    share = min(max((state.seen.time - last[0]) / (knot[0] - last[0]), 0.0), 1.0)
    x, P = list(state.x), state.P.copy()
    for row, before, after in zip(ROWS, last[1], knot[1]):
        x[row] = (1.0 - share) * before + share * after
        P[row, row] += share * (1.0 - share) * (after - before) ** 2
    return replace(state, x=x, P=P)
