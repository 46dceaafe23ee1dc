# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Lateness of timers: only what waiting for a core explains, over a window, and its text."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from io import FileIO
import os
import time

import pytest
from smart_tire import host_load
from smart_tire.host_load import (
    CoreWait, HostLoad, pace_lines, SCHEDSTAT, TimerLateness, worst_of)

pytestmark = pytest.mark.processes

PERIOD = 0.1
counted = pytest.mark.skipif(not SCHEDSTAT.exists(), reason='the kernel counts no waiting')


class Host:
    """A timer of ``PERIOD`` on a host that delays its calls."""

    def __init__(self):
        self.waited, self.now = 5.0, 100.0
        self.timer = TimerLateness(PERIOD, lambda: self.waited)
        self.timer.check(self.now)
        self._due = self.now + PERIOD

    def call(self, late=0.0, waited=None):
        """Call the timer this late, after the thread has waited for a core."""
        self.waited += late if waited is None else waited
        self.now = self._due + late
        self.timer.check(self.now)
        self._due += PERIOD * (1 + (late + 1e-6) // PERIOD)

    @property
    def load(self):
        return self.timer.load


def test_a_punctual_timer_is_not_late():
    host = Host()
    for _ in range(50):
        host.call()
    assert host.load.longest == pytest.approx(0.0, abs=1e-9)
    assert not host.load.late


def test_a_few_late_calls_in_a_window_are_the_longest_two_the_typical_lateness():
    host = Host()
    host.call(0.030)
    for _ in range(99):
        host.call(0.001)
    assert host.load.longest == pytest.approx(0.030)
    assert host.load.typical == pytest.approx(0.001)
    for late in (0.021, 0.022):
        host.call(late)
    assert host.load.typical == pytest.approx(0.021)
    assert host.load.late
    for _ in range(100):
        host.call(0.019)
    assert host.load.longest == pytest.approx(0.019)
    assert not host.load.late


def test_a_node_that_has_slept_is_late_once_for_one_wait():
    host = Host()
    for _ in range(10):
        host.now += 1.0
        host.waited += 0.001
        host.timer.check(host.now)
    host.waited, host.now = host.waited + 0.025, host.now + 1.025
    host.timer.check(host.now)
    assert host.load.longest == pytest.approx(0.025)
    assert not host.load.late


def test_a_long_callback_of_the_thread_itself_is_no_lateness_of_the_host():
    host = Host()
    for _ in range(10):
        host.call(0.080, waited=0.002)
    assert host.load.longest == pytest.approx(0.002)


def test_waiting_without_effect_on_the_timer_is_no_lateness():
    host = Host()
    for _ in range(10):
        host.call(0.003, waited=0.050)
    assert host.load.longest == pytest.approx(0.003)


def test_skipped_calls_are_late_and_keep_the_phase():
    host = Host()
    host.call(0.25)
    host.call(0.0)
    host.call(0.01)
    assert sorted(host.timer._late) == pytest.approx([0.0, 0.0, 0.01, 0.05, 0.15, 0.25], abs=1e-9)


def test_without_the_count_of_the_kernel_nothing_is_late(monkeypatch, tmp_path):
    waited, file = CoreWait(), tmp_path / 'missing'
    monkeypatch.setattr(host_load, 'SCHEDSTAT', file)
    assert waited() == 0.0
    for text, expected in (('', 0.0), ('7\n', 0.0), ('not counted\n', 0.0),
                           ('7 1500000000 3\n', 1.5), ('8 2500000000 4\n', 2.5)):
        file.write_text(text)
        assert waited() == pytest.approx(expected)


@counted
def test_a_thread_that_sleeps_does_not_wait_for_a_core():
    waited = CoreWait()
    begin, now = waited(), time.monotonic()
    time.sleep(0.2)
    assert waited() - begin < time.monotonic() - now - 0.19


@counted
def test_the_file_of_a_thread_remains_open_and_is_opened_again_after_it_was_closed(monkeypatch):
    opened = []

    def open_file(path):
        opened.append(FileIO(path))
        return opened[-1]

    monkeypatch.setattr(host_load, 'FileIO', open_file)
    waited = CoreWait()
    assert 0.0 < waited() <= waited() and len(opened) == 1
    opened[0].close()
    assert waited() == 0.0
    assert waited() > 0.0 and len(opened) == 2


@counted
def test_each_thread_and_a_forked_process_has_its_own_count():
    waited = CoreWait()

    def is_own():
        """Return whether the count is that which the kernel has before and after it."""
        before, count, after = (int(SCHEDSTAT.read_bytes().split()[1]) * 1e-9, waited(),
                                int(SCHEDSTAT.read_bytes().split()[1]) * 1e-9)
        return before <= count <= after

    assert is_own()
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(is_own).result()
    if not (child := os.fork()):
        os._exit(0 if is_own() else 1)
    assert os.waitpid(child, 0)[1] == 0
    assert is_own()


def test_the_load_is_that_of_this_host():
    load = TimerLateness(PERIOD).load
    assert load.cores == os.cpu_count()
    assert load.load == pytest.approx(os.getloadavg()[0], rel=0.3, abs=1.0)
    assert not load.late


def test_the_text_names_lateness_load_and_remedy():
    assert str(HostLoad(0.0314, 0.08, 36.04, 2)) == (
        'timers late by 31 ms (99%), load 36.0 on 2 cores: end other programs')


@pytest.mark.parametrize('typical, late', [(0.020, False), (0.021, True)])
def test_lateness_beyond_the_limit_is_late(typical, late):
    assert HostLoad(typical, 1.0, 9.0, 2).late is late


def test_the_worst_of_the_diagnostics_counts_those_without_values_do_not():
    loads = [HostLoad(0.01, 0.5, 1.0, 2), HostLoad(0.03, 0.04, 3.0, 2)]
    values = [{key: str(value) for key, value in one.values.items()} for one in loads]
    broken = {**values[1], 'host.load': 'high'}
    assert worst_of([values[0], {}, values[1], {'frames_ok': '1'}, broken]) == loads[1]
    assert worst_of([{}, broken]) is None


def test_the_factor_of_a_run_is_that_of_its_whole_time():
    """A second of simulated time at half speed takes two."""
    said = '0.67 x real time: waiting for nodes'
    assert list(pace_lines([{'real_time_factor': '1.0'}, {'real_time_factor': '0.5'},
                            {'other': '1'}])) == [said]
    assert list(pace_lines([{'real_time_factor': '0.96'}])) == []
    assert list(pace_lines([{'host.load': '9'}])) == list(pace_lines([])) == []


def test_a_node_without_which_time_has_passed_is_named():
    values = {'real_time_factor': '1', 'time_passed_without.slip_estimator': '3'}
    assert list(pace_lines([values])) == [
        'starved: simulated time passed without slip_estimator (3 x), so that the results are '
        'worse: end other programs']
