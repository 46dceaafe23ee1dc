# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Benchmark of the wheel speed steps: scores, rows and tables."""

from __future__ import annotations

from benchmarks.control import wheel_steps as bench
from benchmarks.control.wheel_tables import line_table, wheel_steps_table
from benchmarks.tables import markdown
import numpy as np
import pytest

TIME = np.arange(-0.5, 3.0, 0.001)


def test_a_first_order_response_has_the_known_rise_and_settling():
    speed = np.where(TIME < 0.0, 2.0, 2.0 + 4.0 * (1.0 - np.exp(-np.maximum(TIME, 0.0) / 0.1)))
    step = bench._score(TIME, speed, 2.0, 6.0)
    assert step.rise == pytest.approx(0.1 * np.log(9.0), abs=2e-3)
    assert step.settling == pytest.approx(0.1 * np.log(20.0), abs=2e-3)
    assert step.overshoot == 0.0 and step.settled


@pytest.mark.parametrize(('before', 'after'), [(2.0, 6.0), (3.0, -1.0)])
def test_overshoot_is_a_share_of_the_step_in_its_direction(before, after):
    share = np.where(TIME < 0.0, 0.0, 1.0) + 0.2 * ((TIME > 0.3) & (TIME < 0.5))
    step = bench._score(TIME, before + share * (after - before), before, after)
    assert step.overshoot == pytest.approx(0.2)
    assert step.settling == pytest.approx(0.5, abs=2e-3)


def test_an_oscillation_does_not_settle():
    speed = np.where(TIME < 0.0, 0.0, 6.0 + np.sin(20.0 * TIME))
    assert not bench._score(TIME, speed, 0.0, 6.0).settled


def test_at_low_rates_the_new_controller_overshoots_less_and_settles_earlier(monkeypatch):
    monkeypatch.setattr(bench, 'READINGS', (bench.Readings(4.0, 16.0),))
    monkeypatch.setattr(bench, 'SET_POINTS', (6.0, 0.0))
    rows = bench.wheel_steps([101])
    assert [(row.ground, row.controller) for row in rows] == [
        (ground, controller) for ground in bench.GROUNDS for controller in bench.CONTROLLERS]
    before, new = rows[:2]
    assert len(new.steps) == 8  # two steps of four wheels
    assert new.worst('overshoot') < 0.05 < 0.5 < before.worst('overshoot')
    assert new.worst('settling') < 1.0 < before.mean('settling')
    text = markdown(wheel_steps_table(rows))
    assert text.count('| concrete, 4 Hz | 16 |') == 4
    mean, worst = (100.0 * value for value in (new.mean('overshoot'), new.worst('overshoot')))
    assert f'| {mean:.1f} | {worst:.1f} |' in text


@pytest.mark.parametrize('lateness', [0.0, 0.015])
@pytest.mark.parametrize('rate', [50.0, 100.0, 200.0])
def test_frequent_readings_settle_no_later_than_those_at_16_hz_although_they_are_late(
        rate, lateness):
    slow, fast = (
        bench.Row('concrete', readings, bench.NEW, bench.responses(
            'concrete', readings, bench.NEW, seed=31))
        for readings in (bench.Readings(16.0, 16.0), bench.Readings(rate, rate, lateness)))
    assert fast.mean('settling') <= slow.mean('settling') < 0.45
    assert fast.worst('overshoot') < 0.07


def test_the_line_of_the_boards_permits_199_polls_at_115200_baud():
    assert '| 115200 | 5.0 | 199 |' in markdown(line_table())
