# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The benchmark scenarios have the described properties."""

from dataclasses import replace

from benchmarks.events import FOLDER_VARIABLE
from benchmarks.scenarios import DROPOUTS, SCENARIOS, STANDSTILL
import pytest
from smart_tire.samples import NS_PER_S


def short(name, duration=3.5):
    """Return the start of a scenario."""
    return replace(SCENARIOS[name], duration=duration)


def of(events, topic):
    """Return the samples of ``topic``."""
    return [sample for _, name, sample in events if name == topic]


@pytest.mark.parametrize('scenario', SCENARIOS.values(), ids=list(SCENARIOS))
def test_a_run_starts_at_standstill_with_a_robot_that_differs_by_biases_only(scenario):
    starts = [leg[0] for leg in scenario.legs]
    assert starts[0] == STANDSTILL
    assert starts == sorted(starts)
    assert starts[-1] < scenario.duration
    assert any(leg[1:] != (0.0, 0.0) for leg in scenario.legs)
    nominal, true = scenario.robot, scenario.simulator(1).robot
    assert replace(true, imu=nominal.imu, film=nominal.film) == nominal
    assert true.imu.gyro_bias == pytest.approx(scenario.bias_scale * nominal.imu.gyro_bias)
    assert true.imu.accel_bias == pytest.approx(scenario.bias_scale * nominal.imu.accel_bias)
    assert true.imu.gyro_noise == nominal.imu.gyro_noise


def test_events_are_reproducible_by_seed(monkeypatch):
    monkeypatch.delenv(FOLDER_VARIABLE)  # each is simulated
    first, again, other = (of(short('gaps', 0.5).events(seed), 'imu/data') for seed in (1, 1, 2))
    assert first == again != other


def test_late_wheels_are_stamped_and_received_late():
    prompt, late = (short(name).events(1) for name in ('degraded', 'late_wheels'))
    turning = [next(sample.stamp_ns for sample in of(events, 'wheel_states')
                    if max(sample.velocity) > 0.1) for events in (prompt, late)]
    assert turning[1] - turning[0] == pytest.approx(0.2 * NS_PER_S, abs=0.01 * NS_PER_S)
    assert all(received >= sample.stamp_ns for received, name, sample in late
               if name == 'wheel_states')


def test_dropouts_do_not_affect_the_ground_truth(monkeypatch):
    monkeypatch.setitem(DROPOUTS, 'imu/data', ((1.0, 2.0),))
    run = short('gaps')
    whole, events = replace(run, fault=None).events(1), run.events(1)
    assert of(events, 'ground_truth/odom') == of(whole, 'ground_truth/odom')
    times = [(received - events[0][0]) / NS_PER_S for received, name, _ in events
             if name == 'imu/data']
    assert max(times) > 3.0 and not any(1.03 < time < 2.0 for time in times)
