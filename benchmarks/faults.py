# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Transport faults between sensors and estimators: late, repeated and missing messages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smart_tire.samples import NS_PER_S
from smart_tire.simulation.offline import Event


def delayed(events: Sequence[Event], topic: str, delay: float) -> list[Event]:
    """Return ``events`` with those of ``topic`` received ``delay`` [s] later, sorted."""
    late_ns = round(delay * NS_PER_S)
    return _in_order([(received + (late_ns if name == topic else 0), name, sample)
                      for received, name, sample in events])


def interrupted(events: Sequence[Event], topic: str,
                spans: Sequence[tuple[float, float]]) -> list[Event]:
    """Return ``events`` without those of ``topic`` received in ``spans`` [s] since the start."""
    start = min(received for received, _, _ in events)

    def outside(received: int) -> bool:
        time = (received - start) / NS_PER_S
        return not any(begin <= time < end for begin, end in spans)
    return [event for event in events if event[1] != topic or outside(event[0])]


def reordered(events: Sequence[Event], topics: Sequence[str], *, duplicate_share: float,
              late_share: float, max_delay: float, seed: int) -> list[Event]:
    """
    Return ``events`` with duplicate and late messages of ``topics``, sorted by time of reception.

    Late messages and duplicates have delays up to ``max_delay`` [s], uniformly distributed, so
    that messages arrive out of order.
    """
    rng = np.random.default_rng(seed)
    result: list[Event] = []
    for received, topic, sample in events:
        delays = [0.0]
        if topic in topics:
            late, repeated = rng.random(2) < (late_share, duplicate_share)
            delays = [rng.uniform(0.0, max_delay) if late else 0.0]
            delays += [rng.uniform(0.0, max_delay)] * bool(repeated)
        result += [(received + round(delay * NS_PER_S), topic, sample) for delay in delays]
    return _in_order(result)


def stalled(events: Sequence[Event], spans: Sequence[tuple[float, float]]) -> list[Event]:
    """
    Return ``events`` as recorded by an overloaded recorder that stalls in ``spans`` [s].

    It takes the messages queued during a span at its end, one topic after the other, so that whole
    topics are late relative to others.
    """
    start = min(received for received, _, _ in events)

    def taken(event: Event) -> tuple[int, bool, str]:
        time = (event[0] - start) / NS_PER_S
        for begin, end in spans:
            if begin <= time < end:
                return start + round(end * NS_PER_S), False, event[1]
        return event[0], True, ''  # after the queued ones
    return [(taken(event)[0], *event[1:]) for event in sorted(events, key=taken)]


def _in_order(events: list[Event]) -> list[Event]:
    return sorted(events, key=lambda event: event[0])
