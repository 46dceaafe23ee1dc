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

"""Slope monitor: hills are learned from wheels, gyroscope and rests; changes of slip are not."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.slope_monitor import SlopeMonitor
from smart_tire.estimation.slip.state import ImuReading, ImuStep, N, State
from smart_tire.estimation.slip.wheel_odometry import WheelSpeeds
from smart_tire.models.constants import GRAVITY
from smart_tire.parameters import RobotParams

PRIOR = 2e-4        # rad
DT, T = 0.008, 0.064  # s, of prediction steps and wheel samples
SPEED = 1.0         # m/s
SEEDS = range(4)


class Run:
    """Feeds a monitor with steps and wheel samples of a straight run."""

    def __init__(self, seed=0):
        self.monitor = SlopeMonitor(RobotParams(), PRIOR)
        self.time, self._rng, self._pitch = 0.0, np.random.default_rng(seed), 0.0
        self._P = np.zeros((N, N))
        self._P[State.ACCEL_BIAS_X, State.ACCEL_BIAS_X] = 0.003 ** 2
        self._P[State.ACCEL_BIAS_Y, State.ACCEL_BIAS_Y] = 0.003 ** 2

    def drive(self, duration, pitch=lambda time: 0.0, wheel=lambda time: SPEED,
              ground=lambda time: SPEED, stationary=False, with_rates=True):
        """Drive over a slope; ``ground`` is the true speed, which differs by the slip."""
        x, noise = [0.0] * N, self._rng.standard_normal
        for _ in range(round(duration / T)):
            for _ in range(round(T / DT)):
                self.time += DT
                acceleration = (ground(self.time) - ground(self.time - DT)) / DT
                slope = pitch(self.time)
                rate = (slope - self._pitch) / DT * with_rates
                self._pitch = slope
                x[State.V_X] = ground(self.time)
                self.monitor.record_step(self.time, DT, ImuStep(
                    ImuReading(0.0, acceleration - GRAVITY * slope + 0.056 * noise(),
                               0.056 * noise(), 0.01 * noise(), rate + 0.01 * noise()),
                    1e-6, 2.5e-5, PRIOR, 1e-6), x)
            speed = wheel(self.time - 0.5 * T) + 0.01 * noise()
            self.monitor.update(self.time, WheelSpeeds(
                T, (speed,) * 4, (speed,) * 2, 1e-6, from_positions=True), self._P, stationary)
        return self.monitor


def hills(time):
    return 0.03 * np.sin(0.8 * time)


@pytest.mark.parametrize('seed', SEEDS)
def test_level_ground_keeps_the_prior(seed):
    assert Run(seed).drive(60.0).sigma < 1.5 * PRIOR


@pytest.mark.parametrize('seed', SEEDS)
def test_hills_are_learned_within_seconds_with_the_gyroscope(seed):
    monitor = Run(seed).drive(5.0, hills)
    assert 0.008 < monitor.sigma < 0.1
    assert Run(seed).drive(40.0, hills).tilt_gain >= 0.75  # not distrusted


@pytest.mark.parametrize('seed', SEEDS)
def test_a_ramp_is_learned_from_wheels_and_accelerometer_alone(seed):
    run = Run(seed)
    run.drive(4.0)
    monitor = run.drive(10.0, lambda time: 0.03, with_rates=False)
    assert monitor.sigma > 0.008
    monitor = run.drive(40.0, lambda time: 0.03 * np.sin(0.5 * time), with_rates=False)
    assert monitor.tilt_gain < 0.4


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('duration', [0.1, 0.5])
def test_a_change_of_slip_is_not_a_slope(seed, duration):
    run = Run(seed)
    begin = 6.0
    monitor = run.drive(
        20.0, ground=lambda time: SPEED - 0.2 * np.clip((time - begin) / duration, 0.0, 1.0))
    assert monitor.sigma < 2.0 * PRIOR


@pytest.mark.parametrize('seed', SEEDS)
def test_slip_of_a_start_is_not_a_slope(seed):
    def wheel(time):
        return min(SPEED, 2.0 * max(0.0, time - 3.0))
    run = Run(seed)
    run.drive(3.0, wheel=lambda time: 0.0, ground=lambda time: 0.0, stationary=True)
    monitor = run.drive(20.0, wheel=wheel, ground=lambda time: 0.7 * wheel(time - 0.3))
    assert monitor.sigma < 2.0 * PRIOR


@pytest.mark.parametrize('seed', SEEDS)
def test_rests_on_different_slopes_are_learned(seed):
    run, still = Run(seed), {
        'wheel': lambda time: 0.0, 'ground': lambda time: 0.0, 'stationary': True}
    run.drive(3.0, **still)
    assert run.monitor.sigma == PRIOR
    for slope in (0.02, -0.01, 0.015):
        run.drive(6.0)  # level in between
        run.drive(3.0, lambda time, slope=slope: slope, with_rates=False, **still)
    assert run.monitor.sigma > 0.004


def test_a_push_with_locked_wheels_is_not_a_slope():
    monitor = Run().drive(10.0, wheel=lambda time: 0.0, ground=lambda time: 0.2 * time)
    assert monitor.sigma < 1.5 * PRIOR
