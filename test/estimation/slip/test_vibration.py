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

"""Vibration level: zero at the noise of the IMU, unbiased above it."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.vibration import VibrationMonitor


def vibration_level(sigma, seconds=5.0, rate=100.0, seed=0, noise=0.05):
    rng, monitor = np.random.default_rng(seed), VibrationMonitor(noise)
    for k in range(round(seconds * rate)):
        monitor.update(k / rate, 9.81 + np.hypot(noise, sigma) * rng.standard_normal())
    return monitor.sigma


@pytest.mark.parametrize('seed', range(5))
def test_noise_of_the_imu_is_not_vibration(seed):
    assert vibration_level(0.0, seed=seed) == 0.0


@pytest.mark.parametrize('rate', [20.0, 100.0, 400.0])
def test_vibration_is_estimated_at_any_sample_rate(rate):
    levels = [vibration_level(1.2, rate=rate, seed=seed) for seed in range(10)]
    assert np.mean(levels) == pytest.approx(1.2, rel=0.15)


def test_a_tilted_imu_does_not_vibrate():
    monitor = VibrationMonitor(0.05)
    for k in range(500):
        monitor.update(k / 100.0, 9.0)
    assert monitor.sigma == 0.0
