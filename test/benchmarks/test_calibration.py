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

"""Benchmark of the calibration: consistency on few seeds, refusals, and its scores."""

from __future__ import annotations

from benchmarks.calibration.recordings import demo, TOPICS
from benchmarks.calibration.run import print_runs, table
from benchmarks.calibration.scoring import calibrated_run, parameters, Run, score
import pytest


def test_the_demo_identifies_what_it_shows_and_refuses_what_two_grounds_hide():
    runs = [calibrated_run('demo', seed, films=False) for seed in (1, 2)]
    for run in runs:
        assert run.errors.keys() >= {'imu.gyro_noise', 'imu.accel_noise', 'encoder.stamp_jitter',
                                     'icr_x'}
        for name in ('effective_track', 'tire.longitudinal_stiffness'):
            assert 'several grounds' in run.kept[name]
        assert 'expected at most' in run.kept['encoder.latency']
        assert 'requires starts and stops' in run.kept['motor.torque_constant']
    pooled = score(runs)
    assert pooled.within >= 0.75 and pooled.nees < 2.0


@pytest.mark.slow
def test_the_guided_recordings_are_accepted_and_consistent():
    run = calibrated_run('guided', 1, films=False)
    assert run.errors.keys() >= {
        'imu.gyro_noise', 'encoder.latency', 'encoder.stamp_jitter', 'effective_track', 'icr_x',
        'tire.longitudinal_stiffness', 'motor.torque_constant'}
    assert all(abs(error) < 3.5 for errors in run.errors.values() for error in errors)
    assert run.relative['tire.longitudinal_stiffness'][0] < 0.1
    assert run.relative['effective_track'][0] < 0.02


def test_ground_truth_is_not_in_the_recordings():
    events = demo(3, films=False).events['mixed']
    assert any(topic.startswith('ground_truth/') for _, topic, _ in events)
    assert not any(topic.startswith('ground_truth/') for topic in TOPICS)


RUNS = [Run('demo', 1, {'a': (1.0, -3.0), 'b': (0.5,)}, {}, {'c': 'too short'}),
        Run('demo', 2, {'a': (2.0, 0.0)}, {}, {'b': 'one ground only', 'c': 'too short'})]


def test_scores_pool_all_values_and_count_runs():
    assert parameters(RUNS) == ['a', 'b', 'c'] and score(RUNS, 'c') is None
    of_a, pooled = score(RUNS, 'a'), score(RUNS)
    assert (of_a.runs, of_a.within, of_a.nees, of_a.mean) == (2, 0.75, 3.5, 0.0)
    assert pooled.within == 0.8 and pooled.nees == pytest.approx(14.25 / 5)
    assert score(RUNS, 'b').runs == 1


def test_the_table_has_acceptance_and_refusals(capsys):
    assert table('demo', RUNS).row_count == 4
    print_runs(RUNS)
    text = capsys.readouterr().out
    assert 'c: kept in 2 of 2: too short' in text and '0 / 2' in text and '1 / 2' in text
