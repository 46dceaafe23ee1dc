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

import os
import time

import pytest
from smart_tire import host_load
from smart_tire.host_load import (
    HostLoad, pace_lines, TimerLateness, waited_for_core, worst_of)

pytestmark = pytest.mark.processes

PERIOD = 0.1


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
    monkeypatch.setattr(host_load, 'SCHEDSTAT', tmp_path / 'missing')
    assert waited_for_core() == 0.0
    (tmp_path / 'missing').write_text('')
    assert waited_for_core() == 0.0
    (tmp_path / 'missing').write_text('7 1500000000 3\n')
    assert waited_for_core() == pytest.approx(1.5)


@pytest.mark.skipif(not host_load.SCHEDSTAT.exists(), reason='the kernel counts no waiting')
def test_a_thread_that_sleeps_does_not_wait_for_a_core():
    begin, now = waited_for_core(), time.monotonic()
    time.sleep(0.2)
    assert waited_for_core() - begin < time.monotonic() - now - 0.19


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
