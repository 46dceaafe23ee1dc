# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Nodes of a robot whose time is simulated: timers, and the input without which it stands."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from smart_tire.drivers.clock import SYSTEM
from smart_tire.drivers.simulated_time import HEADER, LIMIT, NEVER, OFFSET, SimulatedTime
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.timers import paced, TIMER_LAG_NS, Timers
from smart_tire.samples import NS_PER_S

START_NS = 5_000 * NS_PER_S
MS = 1_000_000


class Machine:
    """A machine whose simulated time may stand, and the loop that spins a node on it."""

    def __init__(self, path):
        self.real_ns = START_NS
        self.shared = SimulatedTime.create(path, lambda: self.real_ns)
        self.timers = Timers()

    def run(self, milliseconds):
        """Let real time pass, and call the timers every millisecond."""
        for _ in range(milliseconds):
            self.real_ns += MS
            self.timers.handle()

    def stand(self, milliseconds):
        """Let simulated time stand while real time passes, and go on there."""
        self.shared.words[LIMIT] = self.shared.now_ns()
        self.run(milliseconds)
        self.shared.words[OFFSET] = self.real_ns - self.shared.now_ns()
        self.shared.words[LIMIT] = NEVER

    @property
    def passed_ms(self):
        return (self.shared.now_ns() - START_NS) / MS


@pytest.fixture
def machine(tmp_path, monkeypatch):
    made = Machine(tmp_path / 'clock')
    monkeypatch.setattr(SYSTEM, 'simulated', made.shared)
    return made


def test_a_timer_keeps_its_period_of_simulated_time_while_this_stands(machine):
    calls = []
    machine.timers.add(0.1, lambda: calls.append(machine.passed_ms))
    machine.run(250)
    machine.stand(330)
    machine.run(400)
    assert calls == [100 * k for k in range(1, 7)]
    machine.stand(70)
    machine.run(60)
    assert calls[6:] == [700]


def test_calls_that_were_missed_are_left_out(machine):
    calls = []
    machine.timers.add(0.1, lambda: calls.append(machine.passed_ms))
    machine.real_ns += 349 * MS  # the node had no core, and nobody waited for it
    machine.run(100)
    assert calls == [350, 400]


def test_what_does_not_wake_the_node_is_called_when_it_is_awake_at_most_once_in_a_period(machine):
    calls = []
    machine.timers.add(0.1, lambda: calls.append(machine.passed_ms), wakes=False)
    machine.timers.add(0.25, lambda: None)
    assert machine.timers.handle() == pytest.approx(0.25)
    for milliseconds in (250, 250, 30, 70):  # the loop is awake after each
        machine.real_ns += milliseconds * MS
        machine.timers.handle()
    assert calls == [250, 500, 600]


def test_an_elastic_timer_is_called_early_if_the_node_is_awake_and_never_late(machine):
    calls = []
    machine.timers.add(0.1, lambda: calls.append(machine.passed_ms), elastic=True)
    for milliseconds in (40, 20, 40, 20):
        machine.real_ns += milliseconds * MS
        left = machine.timers.handle()
    assert calls == [60, 120] and left == pytest.approx(0.1)


def test_a_timer_ends_when_it_is_canceled_and_begins_again(machine):
    calls = []
    timer = machine.timers.add(0.1, lambda: (calls.append(machine.passed_ms), timer.cancel()))
    machine.run(1000)
    assert calls == [100] and timer.is_canceled()
    timer.reset()
    machine.run(150)
    assert calls == [100, 1100]


def test_the_loop_waits_until_the_next_timer_is_due(machine):
    assert machine.timers.handle() == math.inf
    timer = machine.timers.add(0.1, lambda: None)
    machine.timers.add(0.25, lambda: None)
    machine.run(130)
    assert machine.timers.handle() == pytest.approx(0.07)
    timer.cancel()
    assert machine.timers.handle() == pytest.approx(0.12)


def test_time_passes_until_the_next_timer_is_due_of_a_node_that_is_paced_by_them(machine):
    machine.timers.participant = machine.shared.join('node')
    timers = [machine.timers.add(period, lambda: None) for period in (0.1, 0.07)]
    permitted = machine.shared.words
    assert permitted[HEADER] == NEVER  # it does not spin yet
    machine.run(75)
    assert permitted[HEADER] - START_NS == 100 * MS + TIMER_LAG_NS
    machine.run(30)
    assert permitted[HEADER] - START_NS == 140 * MS + TIMER_LAG_NS
    for timer in timers:
        timer.cancel()
    machine.run(1)
    assert permitted[HEADER] == NEVER


def test_a_node_in_simulated_time_makes_no_timer_of_rclpy_which_its_callback_had_to_reset(machine):
    node = SimpleNamespace(loop_timers=machine.timers, paced_timers=True,
                           get_name=lambda: 'node')
    for _ in range(2):
        SmartTireNode.call_every(node, 0.1, lambda: None)
    machine.run(100)
    assert machine.shared.words[HEADER] - START_NS == 200 * MS + TIMER_LAG_NS
    assert machine.shared.words[HEADER + 1] == NEVER  # one participant


def test_time_passes_until_the_next_sample_is_due_by_the_longest_of_the_latest_periods(machine):
    shared, taken = machine.shared, []
    handle = paced(taken.append, shared.join('node'), 30 * MS)

    def permitted(milliseconds):
        handle(SimpleNamespace(stamp_ns=shared.epoch_ns + START_NS + round(milliseconds * MS)))
        return (shared.words[HEADER] - START_NS) / MS

    assert permitted(0) > 1e9  # its period is not known
    assert permitted(10) == 10 + 10 + 30
    assert permitted(40) == 40 + 30 + 30  # two samples were lost
    assert permitted(50) == 50 + 27 + 30
    assert len(taken) == 4


def test_a_sample_that_is_refused_does_not_stop_the_time(machine):
    def refuse(sample):
        raise ValueError

    handle = paced(refuse, machine.shared.join('node'), 30 * MS)
    for milliseconds in (0, 10):
        with pytest.raises(ValueError):
            handle(SimpleNamespace(
                stamp_ns=machine.shared.epoch_ns + START_NS + milliseconds * MS))
    assert machine.shared.words[HEADER] == START_NS + 50 * MS
