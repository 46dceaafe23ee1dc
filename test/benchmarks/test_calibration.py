# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Benchmark of the calibration: consistency on few seeds, refusals, and its scores."""

from benchmarks.calibration import calibrated_run, pooled, TOPICS
from benchmarks.scoring import pooled as pooled_errors
import pytest


@pytest.mark.long
def test_the_demo_identifies_what_it_shows_and_refuses_what_two_grounds_hide():
    runs = calibrated_run('demo', 1)
    for run in runs:
        assert run.errors.keys() >= {'imu.gyro_noise', 'imu.accel_noise', 'encoder.stamp_jitter',
                                     'icr_x'}
        assert run.values['icr_x.identified'] == 1.0
        assert run.values['effective_track.identified'] == 0.0
        for name in ('effective_track', 'tire.longitudinal_stiffness'):
            assert 'several grounds' in run.notes[name]
        assert 'expected at most' in run.notes['encoder.latency']
        assert 'requires starts and stops' in run.notes['motor.torque_constant']
    found = pooled_errors([one for run in runs for one in run.errors.values()]).figures
    assert found['within_two'] >= 0.75 and found['nees'] < 2.0


@pytest.mark.long
def test_the_guided_recordings_are_accepted_and_consistent():
    run, = calibrated_run('guided', 1)
    assert run.errors.keys() >= {
        'imu.gyro_noise', 'encoder.latency', 'encoder.stamp_jitter', 'effective_track', 'icr_x',
        'tire.longitudinal_stiffness', 'motor.torque_constant'}
    assert all(abs(one.error[0]) < 3.5 for one in run.errors.values())
    assert run.values['tire.longitudinal_stiffness.sigma'] < 0.1
    assert run.values['effective_track.sigma'] < 0.02


def test_ground_truth_is_not_in_the_recordings():
    assert not any(topic.startswith('ground_truth/') for topic in TOPICS)


def test_pooled_scores_weigh_a_parameter_by_how_often_it_was_identified():
    parts = [{'identified': 1.0, 'within_two': 0.5, 'nees': 5.0, 'mean': -1.0},
             {'identified': 0.5, 'within_two': 1.0, 'nees': 0.5, 'mean': 0.5},
             {'identified': 0.0}]
    assert pooled(parts) == pytest.approx(
        {'within_two': 2.0 / 3.0, 'nees': 3.5, 'mean': -0.5})
    assert pooled(parts[2:]) == {}
