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

"""Torques of wheel samples can be removed and scaled."""

from __future__ import annotations

import math

from benchmarks.efforts import has_efforts, scaled_efforts, without_efforts
import pytest
from smart_tire.samples import ImuSample, WheelSample

IMU = ImuSample(1, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0))
WHEELS = WheelSample(2, (1.0,) * 4, (3.0,) * 4, (0.1, 0.2, -0.3, math.nan))
SILENT = WheelSample(3, (1.0,) * 4, (3.0,) * 4)


def test_samples_have_efforts_if_any_torque_was_measured():
    assert has_efforts([IMU, SILENT, WHEELS])
    assert not has_efforts([IMU, SILENT, WheelSample(2, (1.0,) * 4, None, (math.nan,) * 4)])


def test_only_the_efforts_are_removed():
    assert without_efforts([IMU, WHEELS, SILENT]) == [
        IMU, WheelSample(2, WHEELS.velocity, WHEELS.position), SILENT]


def test_efforts_are_scaled_where_measured():
    events = [(5, 'imu/data', IMU), (6, 'wheel_states', WHEELS), (7, 'wheel_states', SILENT)]
    scaled = scaled_efforts(events, 2.0)
    assert scaled[1][2].effort == pytest.approx((0.2, 0.4, -0.6, math.nan), nan_ok=True)
    assert scaled[1][2].position == WHEELS.position
    assert [scaled[0], scaled[2]] == [events[0], events[2]]
