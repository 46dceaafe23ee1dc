# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How far simulated time passes: until the simulation or a participant permits no more."""

from __future__ import annotations

from collections import Counter

from smart_tire.drivers.simulated_time import (
    FREE, HEADER, LIMIT, OFFSET, Participant, SimulatedTime, SLOTS)
from smart_tire.samples import NS_PER_S
from smart_tire.simulation.pseudo_terminal import PtyPort

SIMULATOR = -1                     # index in place of that of a participant
LAG_NS = 2_000_000                 # ns that time passes after the next event of the simulation
PATIENCE_NS = 60 * NS_PER_S        # real ns, after which time passes without a participant
POLL_TIME = 0.3e-3                 # s, between two looks at participants who are behind


class TimeKeeper:
    """
    Lets simulated time (``drivers/simulated_time``) pass until something does not permit more.

    That is the simulation or a participant.

    A participant for which time has stood for ``PATIENCE_NS`` limits nothing until it permits
    more. ``waited_ns`` is for how long time has stood for each, ``given_up`` how often it has
    passed without it.
    """

    def __init__(self, shared: SimulatedTime, own_name: str) -> None:
        self.waited_ns: Counter[str] = Counter()
        self.given_up: Counter[str] = Counter()
        self._shared, self._own_name = shared, own_name
        self._readers: list[tuple[Participant, PtyPort]] = []
        self._ignored: dict[int, int] = {}  # participant -> time [ns] that it permits
        self._behind = SIMULATOR            # that has permitted least
        self._since_ns = 0                  # real time since when time stands, 0 while it passes

    def await_reader(self, name: str, port: PtyPort) -> None:
        """Let time wait for the host ``name`` that reads the ``port``."""
        self._readers.append((self._shared.join(name), port))

    def wait_time(self, next_ns: int) -> float:
        """
        Let time pass, at most a little beyond the next event of the simulation.

        This is at ``next_ns`` since 1970. Returns the time [s] until the next call.
        """
        shared, words = self._shared, self._shared.words
        next_ns -= shared.epoch_ns
        for reader, port in self._readers:
            if not port.unread:
                reader.permit(next_ns + LAG_NS)
        now_ns, real_ns = shared.now_ns(), shared.real_ns()
        if words[FREE]:
            return max(next_ns - now_ns, 0) / NS_PER_S
        behind, limit_ns = self._first(next_ns + LAG_NS)
        if limit_ns > now_ns:
            if words[LIMIT] <= now_ns:
                self._go_on(real_ns - now_ns)
            self._since_ns = 0
        elif not self._since_ns or behind != self._behind:
            self._since_ns = real_ns
        elif behind != SIMULATOR and real_ns - self._since_ns > PATIENCE_NS:
            self._ignored[behind] = words[HEADER + behind]
            self.given_up[self._name(behind)] += 1
        self._behind = behind
        words[LIMIT] = max(limit_ns, now_ns)
        return max((min(next_ns, limit_ns) - now_ns) / NS_PER_S, POLL_TIME)

    def readings(self) -> tuple[int, int]:
        """Return real and simulated time [ns]."""
        return self._shared.real_ns(), self._shared.now_ns()

    def close(self) -> None:
        """Let time pass without the simulation."""
        self._shared.free()

    def _first(self, limit_ns: int) -> tuple[int, int]:
        """Return the participant that permits least, and how far; at most ``limit_ns``."""
        first = SIMULATOR
        for index, permitted_ns in enumerate(self._shared.words[HEADER:HEADER + SLOTS]):
            if permitted_ns < limit_ns and self._ignored.get(index) != permitted_ns:
                first, limit_ns = index, permitted_ns
        return first, limit_ns

    def _go_on(self, offset_ns: int) -> None:
        """Let time go on where it has stood; set the offset before the limit."""
        words = self._shared.words
        self.waited_ns[self._name(self._behind)] += offset_ns - words[OFFSET]
        words[OFFSET] = offset_ns

    def _name(self, index: int) -> str:
        return self._own_name if index == SIMULATOR else self._shared.name(index)
