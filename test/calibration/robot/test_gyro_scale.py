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

"""Scale factor of the gyro against a pose reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from smart_tire.calibration.robot.gyro_scale import fit_gyro_scale, usable_reference
from smart_tire.errors import EstimatorError
from support.identifying import recorded, turning_run


def test_scale_and_delay_are_correct_within_their_standard_errors():
    scales, delays = [], []
    for seed in range(10):
        recording = recorded(turning_run(seed), 0.01, seed)
        imu = replace(recording.imu, rate=0.97 * recording.imu.rate)
        late = replace(recording.reference, time=recording.reference.time + 0.1)
        check = fit_gyro_scale(replace(recording, imu=imu, reference=late))
        scales.append((check.scale.value - 0.97) / check.scale.sigma)
        delays.append((check.latency.value - 0.1) / check.latency.sigma)
        assert check.scale.sigma < 0.01
    for errors in (scales, delays):
        assert 0.4 < np.sqrt(np.mean(np.square(errors))) < 1.6


def test_it_needs_a_reference():
    with pytest.raises(EstimatorError, match='no pose reference'):
        fit_gyro_scale(recorded(turning_run(0, 20.0)))


def test_a_reference_without_yaw_is_refused():
    recording = recorded(turning_run(0), 0.01)
    poses = replace(recording.reference, yaw=0.0 * recording.reference.yaw)
    with pytest.raises(EstimatorError, match='the reference has no yaw'):
        usable_reference(replace(recording, reference=poses))


def test_it_needs_turns():
    with pytest.raises(EstimatorError):
        fit_gyro_scale(recorded(turning_run(0, turn=1e-4), 0.01))
