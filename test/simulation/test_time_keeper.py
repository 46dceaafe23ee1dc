# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How far the simulated time passes: until the simulation or a participant permits no more."""

from __future__ import annotations

import pytest

from smart_tire.drivers.simulated_time import SimulatedTime
from smart_tire.samples import NS_PER_S
from smart_tire.simulation.time_keeper import LAG_NS, PATIENCE_NS, POLL_TIME, TimeKeeper

START_NS = 5_000 * NS_PER_S
MS = 1_000_000


class Machine:
    """Real time, which passes by the wait times of the keeper and while the machine is busy."""

    def __init__(self, path):
        self.real_ns = START_NS
        self.shared = SimulatedTime.create(path, lambda: self.real_ns)
        self.keeper = TimeKeeper(self.shared, 'simulator')

    @property
    def passed_ms(self):
        return (self.shared.now_ns() - START_NS) / MS

    def work(self, milliseconds, next_ms=1000.0):
        """Let the keeper work for a real time, with an event of the simulation at ``next_ms``."""
        end_ns = self.real_ns + round(milliseconds * MS)
        while self.real_ns < end_ns:
            seconds = self.keeper.wait_time(
                self.shared.epoch_ns + START_NS + round(next_ms * MS))
            self.real_ns = min(end_ns, self.real_ns + round(seconds * NS_PER_S))


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path / 'clock')


def test_without_anybody_behind_it_is_the_real_time(machine):
    machine.shared.join('idle')
    machine.work(200.0)
    assert machine.passed_ms == 200.0
    assert not machine.keeper.waited_ns and not machine.keeper.given_up


def test_it_stands_until_the_one_who_is_behind_permits_more_and_goes_on_there(machine):
    node = machine.shared.join('node')
    node.permit(START_NS + 20 * MS)
    machine.work(100.0)
    assert machine.passed_ms == 20.0
    node.permit(START_NS + 500 * MS)
    machine.work(10.0)
    assert machine.passed_ms == pytest.approx(30.0, abs=1e3 * POLL_TIME)
    waited_ns = machine.keeper.waited_ns
    assert set(waited_ns) == {'node'}
    assert waited_ns['node'] == pytest.approx(80 * MS, abs=POLL_TIME * NS_PER_S)
    assert machine.real_ns - machine.shared.now_ns() == waited_ns['node']


def test_the_one_who_is_furthest_behind_counts(machine):
    machine.shared.join('fast').permit(START_NS + 70 * MS)
    slow = machine.shared.join('slow')
    slow.permit(START_NS + 30 * MS)
    machine.work(50.0)
    assert machine.passed_ms == 30.0
    slow.permit(START_NS + 90 * MS)
    machine.work(100.0)
    assert machine.passed_ms == 70.0
    assert set(machine.keeper.waited_ns) == {'slow'}  # the other one is still awaited


def test_it_does_not_pass_the_next_event_of_a_simulation_that_is_late(machine):
    machine.work(5.0, next_ms=10.0)
    machine.real_ns += 200 * MS
    assert machine.passed_ms == 10.0 + LAG_NS / MS
    machine.work(10.0, next_ms=300.0)
    assert machine.passed_ms == pytest.approx(22.0, abs=1e3 * POLL_TIME)
    assert set(machine.keeper.waited_ns) == {'simulator'}


def test_a_dead_node_is_given_up_and_counts_again_when_it_goes_on(machine):
    node = machine.shared.join('node')
    node.permit(START_NS + 20 * MS)
    machine.work(PATIENCE_NS / MS - 1.0)
    assert machine.passed_ms == 20.0 and not machine.keeper.given_up
    machine.work(1000.0, next_ms=100_000.0)
    assert machine.passed_ms > 900.0
    assert machine.keeper.given_up == {'node': 1}
    node.permit(machine.shared.now_ns() + 10 * MS)
    machine.work(1000.0, next_ms=100_000.0)
    assert machine.passed_ms == pytest.approx(
        (machine.shared.now_ns() - START_NS) / MS) and machine.keeper.given_up == {'node': 1}
    before_ms = machine.passed_ms
    machine.work(1000.0, next_ms=100_000.0)
    assert machine.passed_ms == before_ms


def test_a_simulation_that_is_late_is_never_given_up(machine):
    machine.work(2 * PATIENCE_NS / MS, next_ms=10.0)
    assert machine.passed_ms == 10.0 + LAG_NS / MS
    assert not machine.keeper.given_up


class Port:
    """A port whose host has read all bytes or not."""

    unread = False


def test_it_waits_for_the_reader_of_a_port(machine):
    port = Port()
    machine.keeper.await_reader('driver', port)
    machine.work(5.0, next_ms=10.0)
    port.unread = True
    machine.work(50.0, next_ms=20.0)
    assert machine.passed_ms == 10.0 + LAG_NS / MS
    port.unread = False
    machine.work(5.0, next_ms=20.0)
    assert machine.passed_ms == pytest.approx(17.0, abs=1e3 * POLL_TIME)
    assert set(machine.keeper.waited_ns) == {'driver'}


def test_at_the_end_nobody_is_awaited(machine):
    machine.shared.join('node').permit(START_NS + 20 * MS)
    machine.work(100.0)
    machine.keeper.close()
    machine.work(100.0)
    assert machine.passed_ms == 200.0
