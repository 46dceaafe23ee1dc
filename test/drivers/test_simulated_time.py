# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A simulated time shared by processes: it stands at its limit, for all of its readers."""

from __future__ import annotations

import threading

import pytest
from smart_tire.drivers import clock as clock_module
from smart_tire.drivers.clock import Clock, LAG_NS
from smart_tire.drivers.serial_port import open_port, SYSTEM
from smart_tire.drivers.simulated_time import (
    HEADER, LIMIT, NEVER, OFFSET, SimulatedTime, VARIABLE)
from smart_tire.errors import LinkError, ParameterError
from smart_tire.samples import NS_PER_S

START_NS = 5_000 * NS_PER_S


class Real:
    """The real time, and a simulated one with a second reader of its file."""

    def __init__(self, path):
        self.ns = START_NS
        self.shared = SimulatedTime.create(path, lambda: self.ns)
        self.other = SimulatedTime(path, lambda: self.ns)


@pytest.fixture
def real(tmp_path):
    return Real(tmp_path / 'ports' / 'clock')


def simulated_clock(shared):
    clock = Clock()
    clock.simulated = shared
    return clock


def test_it_passes_as_real_time_until_its_limit_and_goes_on_with_an_offset(real):
    real.ns += 7
    assert real.other.now_ns() == START_NS + 7
    real.shared.words[LIMIT] = START_NS + 10
    real.ns += 100
    assert real.other.now_ns() == real.shared.now_ns() == START_NS + 10
    real.shared.words[OFFSET] = 97
    assert real.other.now_ns() == START_NS + 10  # until the limit is another one
    real.shared.words[LIMIT] = START_NS + 1000
    real.ns += 5
    assert real.other.now_ns() == START_NS + 15


def test_the_time_since_1970_is_that_of_the_beginning(real):
    clock = simulated_clock(real.other)
    assert clock.time_ns() - clock.now_ns() == real.shared.epoch_ns
    real.shared.words[LIMIT] = START_NS
    real.ns += NS_PER_S
    assert clock.time_ns() == real.shared.epoch_ns + START_NS


def test_participants_have_names_until_their_process_leaves(real):
    first, second = real.shared.join('one'), real.other.join('two')
    first.permit(3)
    second.permit(4)
    assert [real.shared.name(index) for index in range(3)] == ['one', 'two', '']
    assert list(real.other.words[HEADER:HEADER + 3]) == [3, 4, NEVER]
    real.other.leave()
    assert [real.shared.name(index) for index in range(2)] == ['one', '']
    assert list(real.shared.words[HEADER:HEADER + 2]) == [3, NEVER]
    real.other.join('x' * 99)
    assert real.shared.name(1) == 'x' * 48


def test_a_time_that_was_freed_passes_without_a_limit(real):
    real.shared.words[LIMIT] = START_NS
    real.ns += 100
    real.other.free()
    assert real.shared.now_ns() == START_NS + 100


def test_without_its_file_the_variable_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path / 'none'))
    with pytest.raises(ParameterError, match='no simulated robot runs there; unset SMART_TIRE_'):
        Clock().follow_environment()
    (tmp_path / 'none').write_bytes(b'')
    with pytest.raises(ParameterError, match='no simulated robot runs there'):
        Clock().follow_environment()
    monkeypatch.delenv(VARIABLE)
    Clock().follow_environment()


class Event:
    """An event that nobody sets; while it is waited for, real time passes."""

    def __init__(self, real, do=lambda: None):
        self._real, self._do, self.waits = real, do, []

    def wait(self, seconds):
        self.waits.append(seconds)
        self._real.ns += round(seconds * NS_PER_S)
        self._do()
        return False

    def is_set(self):
        return False


def test_a_wait_ends_when_the_simulated_time_has_passed(real):
    def go_on():
        if len(event.waits) == 5:
            real.shared.words[OFFSET] = real.ns - real.shared.now_ns()
            real.shared.words[LIMIT] = NEVER

    real.shared.words[LIMIT] = START_NS + NS_PER_S // 100
    event = Event(real, go_on)
    assert not simulated_clock(real.other).wait(event, 0.1)
    assert real.other.now_ns() >= START_NS + NS_PER_S // 10
    assert real.ns > START_NS + 2 * NS_PER_S // 10
    assert event.waits[0] == 0.1 and event.waits[1] == pytest.approx(0.09)


def test_a_thread_that_acts_is_awaited_after_each_of_its_waits_until_it_ends(real, monkeypatch):
    clock = simulated_clock(real.shared)
    monkeypatch.setattr(Clock, '_of_thread', threading.local())
    clock.wait(Event(real), 0.5)
    assert not real.shared.name(0)  # it has announced nothing: nobody waits for it
    clock.act(START_NS)
    assert real.shared.words[HEADER] == START_NS + LAG_NS
    before_ns = real.shared.now_ns()
    clock.wait(Event(real), 0.5)
    assert real.shared.words[HEADER] == before_ns + NS_PER_S // 2 + LAG_NS
    clock.act(None)
    assert real.shared.words[HEADER] == NEVER
    assert real.shared.name(0) == threading.current_thread().name


def test_in_real_time_nothing_is_announced():
    clock = Clock()
    clock.act(0)
    clock.join('anybody')(0)
    clock.leave()
    assert clock.simulated is None and clock_module.SYSTEM.simulated is None


def test_the_port_of_a_real_robot_is_not_opened_in_simulated_time(real, tmp_path, monkeypatch):
    """Its time-outs would not end while the simulation waits."""
    device = tmp_path / 'ttyUSB0'
    device.write_bytes(b'')
    monkeypatch.setattr(SYSTEM, 'simulated', real.shared)
    with pytest.raises(LinkError, match='SMART_TIRE_CLOCK is set, for a simulated robot only'):
        open_port(str(device), 115200)
    with pytest.raises(LinkError, match='no such port'):
        open_port(str(tmp_path / 'none'), 115200)
