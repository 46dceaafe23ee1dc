# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Legs of the demo, how long they last, and what is said of the host."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from smart_tire.cli import demo
from smart_tire.cli._drive_session import Session
from smart_tire.cli.demo import Leg
from smart_tire.drivers.clock import SYSTEM
from smart_tire.samples import NS_PER_S
from support.ideal_robot import odometry

TURN = Leg('turn', 120.0, 60.0)
TRANSFER = Leg('transfer', 120.0, 120.0, evaluated=False)


class Runner:
    """A runner whose time passes."""

    def __init__(self):
        self.time, self.node, self.odometry = 0.0, self, odometry(0)

    def drive(self, left, right):
        self.commanded = left, right

    def spin(self, seconds):
        self.time += seconds
        self.odometry = odometry(0, x=self.time)


def duration(monkeypatch, leg, limit):
    """Return how long a leg lasts [s] of the time of the robot."""
    runner = Runner()
    monkeypatch.setattr(SYSTEM, 'now_ns', lambda: round(runner.time * NS_PER_S))
    session = Session(SimpleNamespace(check_alive=lambda: None), runner)
    demo._drive_leg(session, SimpleNamespace(show=lambda *_: None), leg, limit)
    assert runner.commanded == (leg.left, leg.right)
    return runner.time


def test_a_transfer_ends_on_the_sand_and_a_standstill_after_its_duration(monkeypatch):
    assert 6.2 < duration(monkeypatch, TRANSFER, 60.0) <= 6.5
    assert duration(monkeypatch, TRANSFER, 3.0) == 3.0
    assert duration(monkeypatch, TURN, 9.0) == 9.0
    assert duration(monkeypatch, Leg('standstill', 0.0, 0.0), 2.5) == 2.5


@pytest.mark.parametrize(('simulated', 'reason'), [([], ''), (['starved: x'], 'starved: x; ')])
def test_the_error_of_a_path_that_was_not_driven_names_a_starved_robot(
        simulated, reason, tmp_path, capsys):
    summary = {'silent': [], 'against_truth': None, 'duration_s': 60.0, 'messages': {'odom': 10},
               'radio': {'sent': 1, 'dropped': 0, 'missing': 0}, 'stamps': {}, 'tracking': {},
               'host': None, 'simulated': simulated}
    assert demo._report(tmp_path, summary) == 1
    assert capsys.readouterr().err == (
        f'demo: {reason}the robot did not arrive: to the border, figure-eight\n')
    assert (tmp_path / 'summary.json').exists()
