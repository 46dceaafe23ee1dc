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

from types import SimpleNamespace

import pytest
from smart_tire.drivers.clock import SYSTEM
from smart_tire.drivers.simulated_time import HEADER, LIMIT, NEVER, OFFSET, SimulatedTime
from smart_tire.nodes.base import MIN_TIMER_NS, SmartTireNode, TIMER_LAG_NS
from smart_tire.samples import NS_PER_S

START_NS = 5_000 * NS_PER_S
MS = 1_000_000


class RealTimer:
    """Timer of rclpy on the real steady clock."""

    def __init__(self, machine, period, callback):
        self.callback, self.timer_period_ns = callback, round(period * NS_PER_S)
        self._machine, self._canceled = machine, False
        self.reset()

    def reset(self):
        self._canceled = False
        self.due_ns = self._machine.real_ns + self.timer_period_ns

    def cancel(self):
        self._canceled = True

    def is_canceled(self):
        return self._canceled


class Machine:
    """A node with one timer on a machine whose simulated time may stand."""

    def __init__(self, path):
        self.real_ns, self.timer = START_NS, None
        self.shared = SimulatedTime.create(path, lambda: self.real_ns)
        self.node = SimpleNamespace(
            steady_ns=self.shared.now_ns, _steady_clock=None, get_name=lambda: 'node',
            now_ns=lambda: self.shared.epoch_ns + self.shared.now_ns(), pace_lag_ns=30 * MS,
            create_timer=self.create_timer, paced_timers=False, _timer_dues={}, _timer_pace=None)

    def create_timer(self, period, callback, clock):
        self.timer = RealTimer(self, period, callback)
        return self.timer

    def run(self, milliseconds):
        """Let real time pass, and call the timer when it is due."""
        end_ns = self.real_ns + milliseconds * MS
        while self.timer.due_ns <= end_ns and not self.timer.is_canceled():
            self.real_ns = max(self.real_ns, self.timer.due_ns)
            self.timer.due_ns += self.timer.timer_period_ns
            self.timer.callback()
        self.real_ns = end_ns

    def stand(self, milliseconds):
        """Let simulated time stand while real time passes, and go on there."""
        self.shared.words[LIMIT] = self.shared.now_ns()
        self.run(milliseconds)
        self.shared.words[OFFSET] = self.real_ns - self.shared.now_ns()
        self.shared.words[LIMIT] = 2**62

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
    SmartTireNode.create_steady_timer(
        machine.node, 0.1, lambda: calls.append(machine.passed_ms))
    machine.run(250)
    machine.stand(330)
    machine.run(400)
    near = pytest.approx
    assert calls == [near(100 * k, abs=MIN_TIMER_NS / MS) for k in range(1, 7)]
    machine.stand(70)
    machine.run(60)
    assert len(calls) == 7 and calls[6] == near(700, abs=MIN_TIMER_NS / MS)


def test_calls_that_were_missed_are_left_out(machine):
    calls = []
    SmartTireNode.create_steady_timer(
        machine.node, 0.1, lambda: calls.append(machine.passed_ms))
    machine.real_ns += 350 * MS  # the node had no core, and nobody waited for it
    machine.run(100)
    assert calls == [350.0, pytest.approx(400.0, abs=MIN_TIMER_NS / MS)]


def test_a_timer_that_its_callback_cancels_ends(machine):
    timer = SmartTireNode.create_steady_timer(machine.node, 0.1, lambda: timer.cancel())
    machine.run(1000)
    assert machine.timer.is_canceled()


def test_time_passes_until_the_next_timer_is_due_of_a_node_that_is_paced_by_them(machine):
    machine.node.paced_timers = True
    for period in (0.1, 0.07):
        timer = SmartTireNode.create_steady_timer(machine.node, period, lambda: None)
    permitted = machine.shared.words
    assert permitted[HEADER] == NEVER  # it does not spin yet
    machine.run(75)  # the later one of 70 ms
    assert (permitted[HEADER] - START_NS) / MS == pytest.approx(
        140 + TIMER_LAG_NS / MS, abs=1.0)
    timer.cancel()
    machine.run(10)
    machine.timer.callback()
    assert machine.node._timer_dues[timer] == NEVER


def test_time_passes_until_the_next_sample_is_due_by_the_longest_of_the_latest_periods(machine):
    node, shared = machine.node, machine.shared
    taken = []
    handle = SmartTireNode._paced(node, taken.append, shared.join('node'))

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

    handle = SmartTireNode._paced(machine.node, refuse, machine.shared.join('node'))
    for milliseconds in (0, 10):
        with pytest.raises(ValueError):
            handle(SimpleNamespace(
                stamp_ns=machine.shared.epoch_ns + START_NS + milliseconds * MS))
    assert machine.shared.words[HEADER] == START_NS + 50 * MS
