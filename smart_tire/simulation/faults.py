"""What goes wrong between sensors and estimators: messages that come late, twice or not at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smart_tire.samples import NS_PER_S
from smart_tire.simulation.offline import Event


def delayed(events: Sequence[Event], topic: str, delay: float) -> list[Event]:
    """Return ``events`` with those of ``topic`` received ``delay`` [s] later, in order."""
    late_ns = round(delay * NS_PER_S)
    return _in_order([(received + (late_ns if name == topic else 0), name, sample)
                      for received, name, sample in events])


def silenced(events: Sequence[Event], topic: str,
             spans: Sequence[tuple[float, float]]) -> list[Event]:
    """Return ``events`` without those of ``topic`` received in ``spans`` [s] of the run."""
    start = min(received for received, _, _ in events)

    def heard(received: int) -> bool:
        time = (received - start) / NS_PER_S
        return not any(begin <= time < end for begin, end in spans)
    return [event for event in events if event[1] != topic or heard(event[0])]


def shuffled(events: Sequence[Event], topics: Sequence[str], *, twice: float, held_back: float,
             longest: float, seed: int) -> list[Event]:
    """
    Return ``events``, of ``topics`` a share ``twice`` two times and a share ``held_back`` late.

    What is late or a repetition comes up to ``longest`` [s] after its time, so that messages
    overtake one another.
    """
    rng = np.random.default_rng(seed)
    result: list[Event] = []
    for received, topic, sample in events:
        waits = [0.0]
        if topic in topics:
            late, repeated = rng.random(2) < (held_back, twice)
            waits = [rng.uniform(0.0, longest) if late else 0.0]
            waits += [rng.uniform(0.0, longest)] * bool(repeated)
        result += [(received + round(wait * NS_PER_S), topic, sample) for wait in waits]
    return _in_order(result)


def stalled(events: Sequence[Event], spans: Sequence[tuple[float, float]]) -> list[Event]:
    """
    Return ``events`` as an overloaded recorder has them that takes nothing in ``spans`` [s].

    What has come meanwhile it takes at the end of the span, topic by topic: one queue after the
    other. So whole topics are late against others.
    """
    start = min(received for received, _, _ in events)

    def taken(event: Event) -> tuple[int, bool, str]:
        time = (event[0] - start) / NS_PER_S
        for begin, end in spans:
            if begin <= time < end:
                return start + round(end * NS_PER_S), False, event[1]
        return event[0], True, ''  # behind what has waited
    return [(taken(event)[0], *event[1:]) for event in sorted(events, key=taken)]


def _in_order(events: list[Event]) -> list[Event]:
    return sorted(events, key=lambda event: event[0])
