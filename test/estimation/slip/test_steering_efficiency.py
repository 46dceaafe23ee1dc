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

"""Steering efficiency: yaw rate from wheel speeds alone."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.steering_efficiency import SteeringEfficiency

T = 0.0625  # s, 16 Hz


def drive(steering, efficiency, duration, seed=0, noise=0.02):
    rng = np.random.default_rng(seed)
    for time in np.arange(0.0, duration, T):
        odometry_rate = 1.5 * np.sin(time)
        yaw_rate = efficiency * odometry_rate + noise * rng.standard_normal()
        steering.update(odometry_rate, yaw_rate, T)


def test_the_prior_is_an_efficiency_of_one():
    rate, sigma = SteeringEfficiency().predict(1.0)
    assert rate == 1.0
    assert sigma == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize('seed', range(5))
def test_efficiency_is_learned_within_seconds(seed):
    steering = SteeringEfficiency()
    drive(steering, 0.55, 5.0, seed)
    rate, sigma = steering.predict(-1.2)
    assert abs(rate + 0.66) < 2.0 * sigma
    assert sigma < 0.2


def test_a_change_of_surface_is_learned():
    steering = SteeringEfficiency()
    drive(steering, 0.55, 60.0)
    drive(steering, 0.8, 120.0)
    assert steering.efficiency == pytest.approx(0.8, abs=0.02)


def test_straight_driving_leaves_the_efficiency_unchanged():
    steering = SteeringEfficiency()
    drive(steering, 0.55, 20.0)
    before = steering.efficiency
    for _ in range(1000):
        steering.update(0.0, 0.01, T)
    assert steering.efficiency == before
    assert steering.predict(0.0)[1] > 0.0
