# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Clocks that were set while a bag was recorded: found by times of reception, stamps and wheels.

If the clock of the host is set, the receive times step. They also pause while nothing is
received; but then the wheels that turn have turned on, at their speed for all of the pause. While
they stand still, both are possible. If the clock of a device is set, its stamps step while its
messages are received as before, and stay apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
import math

import numpy as np

from smart_tire.arrays import Array, Instants
from smart_tire.samples import NS_PER_S, Sample, WheelSample

MIN_STEP_NS = 100_000_000     # smaller ones are within the lateness of messages
MIN_PAUSE_NS = 250_000_000    # between receptions of all topics that may be a step forward
MIN_COUNT = 8                 # messages before and after a step
WINDOW_NS = 2 * NS_PER_S      # before and after it, in which the delays of a device are constant
BURST_SHARE = 1.5             # of the messages of a time, if those that waited are among them
MAX_STEPS = 5                 # more are no clock that was set, but wrong stamps
MIN_TURN = 0.2                # rad that the wheels must turn between the two explanations
CLEAR_SHARE = 0.25            # of that angle, within which it agrees with one of them


@dataclass(frozen=True)
class ClockStep:
    """One step: what is received after ``before_ns`` is of the clock that was set."""

    before_ns: int  # latest time of reception before the step, by the first clock
    step_ns: int    # positive forward


@dataclass(frozen=True)
class Pause:
    """A time in which no topic was received, by the first clock."""

    begin_ns: int  # of the last reception before it
    end_ns: int
    turned: bool   # the wheels turned on; else the clock may have been set forward instead


@dataclass(frozen=True)
class ClockSteps:
    """The steps of the host and of the stamps of topics, each in the order of the recording."""

    host: Sequence[ClockStep] = ()
    pauses: Sequence[Pause] = ()
    stamps: Mapping[str, Sequence[ClockStep]] = field(default_factory=dict)  # by name in the bag

    @property
    def back(self) -> bool:
        """Return whether the clock of the host was set back: the order is that of the file."""
        return any(step.step_ns < 0 for step in self.host)

    def lines(self, start_ns: int) -> Iterable[str]:
        """Yield each step as text, with its time after ``start_ns``."""
        common = {step.before_ns: step for step in self.host}
        for step in self.host:
            yield f'the clock {_text(step, start_ns)}; the recording is continued'
        for topic, steps in self.stamps.items():
            for step in steps:
                near = min((abs(step.before_ns - at) for at in common), default=NS_PER_S)
                if near >= NS_PER_S:  # else its stamps are of the clock of the host
                    yield f'{topic}: the clock of its stamps {_text(step, start_ns)}; they are ' \
                          'continued'


NO_STEPS = ClockSteps()


def _text(step: ClockStep, start_ns: int) -> str:
    return (f'was set {"forward" if step.step_ns > 0 else "back"} by '
            f'{abs(step.step_ns) / NS_PER_S:.3g} s at '
            f'{(step.before_ns - start_ns) / NS_PER_S:.1f} s')


@dataclass(frozen=True, eq=False)
class Times:
    """Receive times and stamps [ns] of a topic, in the order of the file."""

    receive_ns: Instants
    stamp_ns: Instants


@dataclass(frozen=True, eq=False)
class WheelTurns:
    """Receive times [ns] (n,), angles [rad] and speeds [rad/s] (n, 4) of the wheels."""

    receive_ns: Instants
    angle: Array
    speed: Array

    @classmethod
    def of(cls, samples: Iterable[tuple[int, str, Sample]]) -> WheelTurns | None:
        """Return those of wheel samples with their times of reception; None without angles."""
        rows = [(received, sample.position, sample.velocity) for received, _, sample in samples
                if isinstance(sample, WheelSample) and sample.position is not None]
        if not rows:
            return None
        received, angle, speed = zip(*rows)
        return cls(np.array(received, np.int64), np.array(angle), np.array(speed))


class Corrector:
    """Maps times of reception and stamps to the first clock, in the order of the recording."""

    def __init__(self, steps: ClockSteps) -> None:
        self._host = list(steps.host)
        self._stamps = {topic: list(found) for topic, found in steps.stamps.items()}
        self._host_ns, self._newest_ns = 0, 0
        self._stamp_ns = dict.fromkeys(self._stamps, 0)

    def __call__(self, topic: str, receive_ns: int) -> tuple[int, int]:
        """Return the time of reception by the first clock, and what its stamp is ahead [ns]."""
        received = receive_ns - self._host_ns
        while self._host and self._is_after(received, self._host[0]):
            step = self._host.pop(0)
            self._host_ns += step.step_ns
            received = receive_ns - self._host_ns
        self._newest_ns = max(self._newest_ns, received)
        steps = self._stamps.get(topic)
        while steps and received > steps[0].before_ns:
            self._stamp_ns[topic] += steps.pop(0).step_ns
        return received, self._stamp_ns.get(topic, 0)

    def _is_after(self, received: int, step: ClockStep) -> bool:
        """Return whether a message is after a step: nearer to the clock that was set."""
        middle = step.before_ns + step.step_ns // 2
        return received > middle if step.step_ns > 0 else (
            received < middle and self._newest_ns >= step.before_ns)


def has_pause(times: Times) -> bool:
    """Return whether there is a pause between receptions that may be a step forward."""
    return bool((np.diff(times.receive_ns) > MIN_PAUSE_NS).any())


def host_steps(topics: Iterable[Times], turns: WheelTurns | None) -> ClockSteps:
    """
    Return the steps of the clock of the host, and the pauses.

    ``turns`` distinguishes a step forward from a pause; without it, or while no wheel turns,
    it is a pause.
    """
    streams = [one for one in topics if len(one.receive_ns) > 2 * MIN_COUNT]
    if not streams:
        return NO_STEPS
    fastest = min(streams, key=lambda one: float(np.median(np.diff(one.receive_ns))))
    period = int(np.median(np.diff(fastest.receive_ns)))
    received, found, pauses, shift = fastest.receive_ns, [], [], 0
    for k in np.flatnonzero(np.abs(np.diff(received) - period) > MIN_STEP_NS):
        begin, end = int(received[k]), int(received[k + 1])
        step, turned = end - begin - period, None
        if step > 0:
            if step <= MIN_PAUSE_NS or _catches_up(received[k + 1:], step, period):
                continue
            turned = turns and _turned_on(turns, begin, end, step)
        if step < 0 or turned is False:
            found.append(ClockStep(begin - shift, step))
            shift += step
        elif not any(((one.receive_ns > begin) & (one.receive_ns < end)).any()
                     for one in streams):
            pauses.append(Pause(begin - shift, end - shift, bool(turned)))
    return ClockSteps(*((found, pauses) if len(found) <= MAX_STEPS else ((), ())))


def _catches_up(received: Instants, pause_ns: int, period: int) -> bool:
    """Return whether messages that waited for ``pause_ns`` are received at once."""
    window = min(pause_ns, WINDOW_NS)
    count = int(np.searchsorted(received, received[0] + window))
    return count > BURST_SHARE * window / period + MIN_COUNT


def _turned_on(turns: WheelTurns, begin: int, end: int, step_ns: int) -> bool | None:
    """
    Return whether the wheels turned on for ``step_ns`` from ``begin`` to ``end``.

    None if their angles agree with neither.
    """
    before = int(np.searchsorted(turns.receive_ns, begin, 'right')) - 1
    after = int(np.searchsorted(turns.receive_ns, end))
    if before < 1 or after + 1 >= len(turns.receive_ns):
        return None
    speed = 0.5 * (turns.speed[before] + turns.speed[after + 1])
    gap = turns.receive_ns[after] - turns.receive_ns[before]
    turned = turns.angle[after] - turns.angle[before]
    full, none = (speed * time / NS_PER_S for time in (gap, gap - step_ns))
    # modulo a turn: angles that wrap are not continued over a pause
    apart, off, rest = (np.abs(np.remainder(one + math.pi, math.tau) - math.pi)
                        for one in (full - none, turned - none, turned - full))
    wheel = int(np.argmax(np.nan_to_num(apart)))
    limit = CLEAR_SHARE * apart[wheel]
    if not apart[wheel] > MIN_TURN or min(off[wheel], rest[wheel]) >= limit:
        return None
    return bool(off[wheel] >= limit)


def stamp_steps(times: Times) -> list[ClockStep]:
    """Return the steps of the stamps of a topic; its receive times have no steps any more."""
    received, stamps = times.receive_ns, times.stamp_ns
    if len(stamps) < 2 * MIN_COUNT or not (stamps > 0).all():
        return []
    period = float(np.median(np.diff(received)))
    delay, found = received - stamps, []
    jumps = np.abs(np.diff(stamps) - period) > MIN_STEP_NS
    jumps &= np.abs(np.diff(delay)) > MIN_STEP_NS
    for k in np.flatnonzero(jumps):
        before = delay[max(np.searchsorted(received, received[k] - WINDOW_NS), 0):k + 1]
        after = delay[k + 1:max(int(np.searchsorted(received, received[k + 1] + WINDOW_NS)),
                                k + 1 + MIN_COUNT)]
        if min(len(before), len(after)) < MIN_COUNT:
            continue
        step = int(np.median(before) - np.median(after))
        if abs(step) > MIN_STEP_NS and max(np.ptp(before), np.ptp(after)) < 0.5 * abs(step):
            found.append(ClockStep(int(received[k]), step))
    return found if len(found) <= MAX_STEPS else []
