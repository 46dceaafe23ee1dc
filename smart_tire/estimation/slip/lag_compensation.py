# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Moves smoothed slip velocities to the time at which they were measured.

A wheel measurement is a mean over a past period. The filter applies it to the present state, so
the estimated slip velocity lags by half a period plus the encoder latency whenever it changes.
Offline this lag is removed: the slip velocity after a measurement belongs to the center of its
period, and is interpolated linearly between these centers. Speeds over ground do not lag, so the
slip ratios are aligned, too.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace

from smart_tire.estimation.slip.rts_smoother import SmoothedState
from smart_tire.estimation.slip.state import SLIP_VELS

MAX_WHEEL_GAP = 3.0  # s without a wheel measurement; states are not interpolated over more

ROWS = list(SLIP_VELS)
Knot = tuple[float, list[float]]  # center of a period [s], slip velocity of both sides [m/s]


def compensate_lag(states: Iterable[SmoothedState]) -> Iterator[SmoothedState]:
    """Yield ``states``, in order, with slip velocities interpolated between measurements."""
    waiting: deque[SmoothedState] = deque()  # for the next measurement
    last: Knot | None = None
    segment = 0
    for state in states:
        if state.segment != segment:
            yield from waiting
            waiting.clear()
            last, segment = None, state.segment
        if state.context.by_forces:  # the slip velocity is that of the state's time
            yield from waiting
            waiting.clear()
            last = None
            yield state
            continue
        knot = state.context.wheel_time, [state.x[row] for row in ROWS]
        if last is None or knot[0] > last[0]:
            while waiting and waiting[0].context.time < knot[0]:
                earlier = waiting.popleft()
                yield earlier if last is None else _interpolate(last, knot, earlier)
            last = knot
        waiting.append(state)
        while waiting[0].context.time < state.context.time - MAX_WHEEL_GAP:
            yield waiting.popleft()
    yield from waiting


def _interpolate(last: Knot, knot: Knot, state: SmoothedState) -> SmoothedState:
    """
    Return ``state`` with the slip velocity interpolated between two measurements.

    When it changed between them is unknown: for a step at a uniformly distributed time, linear
    interpolation has the variance that is added here.
    """
    share = min(max((state.context.time - last[0]) / (knot[0] - last[0]), 0.0), 1.0)
    x, P = list(state.x), state.P.copy()
    for row, before, after in zip(ROWS, last[1], knot[1]):
        x[row] = (1.0 - share) * before + share * after
        P[row, row] += share * (1.0 - share) * (after - before) ** 2
    return replace(state, x=x, P=P)
