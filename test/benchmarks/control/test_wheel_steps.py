# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Benchmark of the wheel speed steps: responses and their scores."""

from benchmarks.control import wheel_steps as bench
import numpy as np
import pytest

TIME = np.arange(-0.5, 3.0, 0.001)


def test_a_first_order_response_has_the_known_rise_and_settling():
    speed = np.where(TIME < 0.0, 2.0, 2.0 + 4.0 * (1.0 - np.exp(-np.maximum(TIME, 0.0) / 0.1)))
    rise, overshoot, settling, settled = bench._response(TIME, speed, 2.0, 6.0)
    assert rise == pytest.approx(0.1 * np.log(9.0), abs=2e-3)
    assert settling == pytest.approx(0.1 * np.log(20.0), abs=2e-3)
    assert overshoot == 0.0 and settled


@pytest.mark.parametrize(('before', 'after'), [(2.0, 6.0), (3.0, -1.0)])
def test_overshoot_is_a_share_of_the_step_in_its_direction(before, after):
    share = np.where(TIME < 0.0, 0.0, 1.0) + 0.2 * ((TIME > 0.3) & (TIME < 0.5))
    response = bench._response(TIME, before + share * (after - before), before, after)
    assert response[1:3] == pytest.approx((0.2, 0.5), abs=2e-3)


def test_an_oscillation_does_not_settle():
    speed = np.where(TIME < 0.0, 0.0, 6.0 + np.sin(20.0 * TIME))
    assert not bench._response(TIME, speed, 0.0, 6.0)[3]


def test_readings_at_4_hz_hardly_overshoot(monkeypatch):
    monkeypatch.setattr(bench, 'SET_POINTS', (6.0, 0.0))
    run = bench.wheel_steps('concrete', bench.Readings(4.0, 16.0), 101)
    assert run.row == 'concrete, 4 Hz' and len(run.errors['rise'].error) == 8
    assert run.figures['overshoot']['max'] < 0.05
    assert run.figures['settling']['max'] < 1.0


@pytest.mark.parametrize('rate, lateness, steps', [(100.0, 0.015, 1), *(
    pytest.param(rate, lateness, 5, marks=pytest.mark.long)
    for rate in (50.0, 100.0, 200.0) for lateness in (0.0, 0.015))])
def test_frequent_readings_settle_no_later_than_those_at_16_hz_although_they_are_late(
        rate, lateness, steps, monkeypatch):
    monkeypatch.setattr(bench, 'SET_POINTS', bench.SET_POINTS[:steps])
    slow, fast = (
        bench.wheel_steps('concrete', readings, seed=31).figures
        for readings in (bench.Readings(16.0, 16.0), bench.Readings(rate, rate, lateness)))
    assert fast['settling']['mean'] <= slow['settling']['mean'] < 0.45
    assert fast['overshoot']['max'] < 0.07
