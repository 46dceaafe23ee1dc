# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Legs of the demo: how long they last, also if a busy host stops the wheels."""

from __future__ import annotations

from dataclasses import asdict
from types import SimpleNamespace

import pytest

from smart_tire.cli import demo
from smart_tire.cli._drive_session import Session
from smart_tire.cli.demo import DASHBOARD_PERIOD, Leg, LEG_DURATION, MAX_LEG_DURATION
from smart_tire.host_load import HostLoad
from smart_tire.samples import NS_PER_S
from support.ideal_robot import odometry

TURN = Leg('turn', 120.0, 60.0)
TRANSFER = Leg('transfer', 120.0, 120.0, evaluated=False)


class Runner:
    """A runner whose time passes; the wheels turn, or are silent, except in ``pause`` [s]."""

    def __init__(self, pause=(0.0, 0.0), silent=False):
        self.time, self._pause, self._silent, self.node = 0.0, pause, silent, self
        self.wheels = SimpleNamespace(stamp_ns=0, velocity=(0.0,) * 4)
        self.odometry = odometry(0)

    def now_ns(self):
        return round(self.time * NS_PER_S)

    def drive(self, left, right):
        self.commanded = left, right

    def spin(self, seconds):
        self.time += seconds
        turning = not self._pause[0] <= self.time < self._pause[1]
        if turning or not self._silent:
            self.wheels = SimpleNamespace(stamp_ns=self.now_ns(), velocity=(9.0 * turning,) * 4)
        self.odometry = odometry(0, x=self.time)


def duration(monkeypatch, leg, limit, **pause):
    """Return how long a leg lasts [s]."""
    runner = Runner(**pause)
    monkeypatch.setattr(demo.time, 'monotonic', lambda: runner.time)
    session = Session(SimpleNamespace(check_alive=lambda: None), runner)
    demo._drive_leg(session, SimpleNamespace(show=lambda *_: None), leg, limit)
    assert runner.commanded == (leg.left, leg.right)
    return runner.time


@pytest.mark.parametrize('silent', [False, True])
def test_a_turn_lasts_until_the_wheels_have_turned_for_its_duration(monkeypatch, silent):
    near = 2.5 * DASHBOARD_PERIOD  # also until silence is noticed
    assert duration(monkeypatch, TURN, LEG_DURATION) == pytest.approx(LEG_DURATION, abs=near)
    assert duration(monkeypatch, TURN, LEG_DURATION, pause=(3.0, 10.0), silent=silent) == (
        pytest.approx(LEG_DURATION + 7.0, abs=near))
    assert duration(monkeypatch, TURN, LEG_DURATION, pause=(3.0, 1e3), silent=silent) == (
        pytest.approx(MAX_LEG_DURATION, abs=near))


def test_a_transfer_ends_on_the_sand_and_a_standstill_after_its_duration(monkeypatch):
    assert 6.2 < duration(monkeypatch, TRANSFER, 60.0) <= 6.5
    assert duration(monkeypatch, TRANSFER, 3.0) == 3.0
    assert duration(monkeypatch, Leg('standstill', 0.0, 0.0), 2.5) == 2.5


@pytest.mark.parametrize(('typical', 'reason'), [(0.001, ''), (
    0.031, 'host late: timers late by 31 ms (99%), load 36.0 on 2 cores: end other programs; ')])
def test_the_error_of_a_path_that_was_not_driven_names_a_late_host(
        typical, reason, tmp_path, capsys):
    host = HostLoad(typical, 0.4, 36.0, 2)
    summary = {'silent': [], 'against_truth': None, 'duration_s': 60.0, 'messages': {'odom': 10},
               'radio': {'sent': 1, 'dropped': 0, 'missing': 0}, 'stamps': {}, 'tracking': {},
               'host': {'late': host.late, **asdict(host)},
               'late_host': {'times': 0, 'longest_s': 0.0, 'resumed': 0}}
    assert demo._report(tmp_path, summary) == 1
    assert capsys.readouterr().err == (
        f'demo: {reason}the robot did not arrive: to the border, figure-eight\n')
    assert (tmp_path / 'summary.json').exists()
