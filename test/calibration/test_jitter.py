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

"""Timestamp jitter from wheel positions, separated from changes of speed."""

from __future__ import annotations

import numpy as np
import pytest
from smart_tire.calibration.recording import WheelRecord
from smart_tire.calibration.sensor_noise import fit_jitter
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, RobotParams
from support.identifying import recorded, turning_run


@pytest.mark.parametrize('jitter, rate', [(0.001, 16.0), (0.003, 16.0), (0.001, 50.0)])
def test_the_jitter_is_correct_within_its_standard_error(jitter, rate):
    robot = build(RobotParams, {'encoder.stamp_jitter': jitter})
    errors = []
    for seed in range(8):
        wheels = recorded(turning_run(seed, 40.0, robot=robot, wheel_rate=rate)).wheels
        found = fit_jitter(wheels, robot)
        errors.append((found.value - jitter) / found.sigma)
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) < 1.6


def test_speed_changes_are_not_taken_for_jitter():
    robot = build(RobotParams, {'encoder.stamp_jitter': 0.0})
    with pytest.raises(EstimatorError, match='speed fluctuations exceed the jitter'):
        fit_jitter(recorded(turning_run(1, 40.0, robot=robot, wheel_rate=50.0)).wheels, robot)


def test_a_low_sampling_rate_is_refused():
    with pytest.raises(EstimatorError, match='five samples last 1 s'):
        fit_jitter(recorded(turning_run(1, 40.0, wheel_rate=4.0)).wheels, RobotParams())


def test_velocities_alone_are_refused():
    with pytest.raises(EstimatorError, match='no positions'):
        fit_jitter(recorded(turning_run(1, 10.0, positions=False)).wheels, RobotParams())


def test_standstill_is_refused():
    time = np.arange(0.0, 20.0, 0.06)
    still = np.zeros((len(time), 4))
    with pytest.raises(EstimatorError, match='0 samples with both sides in motion'):
        fit_jitter(WheelRecord(time, still, still), RobotParams())
