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

"""Horizontal axes of the gyroscope: bias at standstill, noise, and consistency with slopes."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.slope_spread import SlopeResidual
from smart_tire.estimation.slip.state import ImuReading
from smart_tire.estimation.slip.tilt_rates import (
    EXCURSION_SIGMAS, EXCURSION_TIME, TiltConsistency, TiltExcursion, TiltRates)
from smart_tire.parameters.robot import ImuParams

PERIOD = 0.01  # s
BIAS = (0.008, -0.005)  # rad/s


def reading(roll_rate=0.0, pitch_rate=0.0):
    return ImuReading(0.0, 0.0, 0.0, roll_rate, pitch_rate)


def run(rates, duration, seed=0, noise=0.01, stationary=True):
    """Feed ``duration`` [s] at standstill or in motion, in wheel periods of 0.1 s."""
    rng, last = np.random.default_rng(seed), reading(*BIAS)
    for step in range(round(duration / PERIOD)):
        new = reading(*(np.array(BIAS) + noise * rng.standard_normal(2)).tolist())
        rates.add(PERIOD, last, new)
        last = new
        if step % 10 == 9:
            rates.finish_period(0.1, stationary)
    return rates


@pytest.mark.parametrize('seed', range(5))
def test_the_bias_is_learned_at_standstill_only(seed):
    moving = run(TiltRates(ImuParams()), 3.0, seed, stationary=False)
    assert moving.without_bias(reading(*BIAS))[3:] == BIAS
    stationary = run(TiltRates(ImuParams()), 3.0, seed)
    assert stationary.without_bias(reading(*BIAS))[3:] == pytest.approx((0.0, 0.0), abs=2e-3)
    assert stationary.density(0.0, PERIOD) < 0.05 * moving.density(0.0, PERIOD)


def test_noise_and_yaw_rate_raise_the_density():
    quiet = run(TiltRates(ImuParams()), 3.0)
    rough = run(run(TiltRates(ImuParams()), 3.0), 3.0, noise=0.1, stationary=False)
    assert rough.density(0.0, PERIOD) > 20.0 * quiet.density(0.0, PERIOD)
    assert quiet.density(1.0, PERIOD) > quiet.density(0.0, PERIOD) + 3e-4


def slopes(count, seed):
    return np.random.default_rng(seed).normal(0.0, 0.2, (count, 2)).tolist()


def compared(share, count=20, seed=1, noise=1e-4):
    """Return the gain after slopes of which the gyroscope shows ``share``."""
    tilt = TiltConsistency()
    for x, y in slopes(count, seed):
        residuals = SlopeResidual(x, noise, 1.0), SlopeResidual(y, noise, 1.0)
        tilt.update(residuals, (share * x, share * y), noise)
    return tilt.gain


def test_a_gyroscope_is_trusted_if_it_shows_the_slopes():
    assert compared(1.0) > 0.9
    assert compared(0.0) < 0.1
    assert compared(-1.0) == 0.0  # an axis is reversed


def test_noise_is_no_evidence_about_the_gyroscope():
    assert compared(0.0, noise=0.2 ** 2) == pytest.approx(TiltConsistency().gain, abs=0.1)


def test_windows_before_a_stop_are_not_compared_with_those_after_it():
    tilt = TiltConsistency()
    for value in (0.3, -0.3) * 5:
        tilt.restart()
        tilt.update((SlopeResidual(value, 1e-4, 1.0), None), (0.0, 0.0), 1e-4)
    assert tilt.gain == TiltConsistency().gain


# ---- present departure of roll and pitch ----

DENSITY = 1e-5  # (rad/s)^2 s


@pytest.mark.parametrize('axis', ['roll_rate', 'pitch_rate'])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_quick_tilt_about_either_axis_is_an_excursion_that_decays(axis, sign):
    excursion = TiltExcursion()
    for _ in range(20):  # 0.1 rad in 0.2 s
        variance = excursion.update(PERIOD, reading(**{axis: sign * 0.5}), DENSITY)
    assert 0.08 < np.sqrt(variance) <= 0.1
    for _ in range(round(3.0 * EXCURSION_TIME / PERIOD)):
        variance = excursion.update(PERIOD, reading(), DENSITY)
    assert variance == 0.0


def test_noise_of_the_rates_is_no_excursion():
    rng, excursion = np.random.default_rng(1), TiltExcursion()
    noise = np.sqrt(DENSITY / PERIOD) * rng.standard_normal((6000, 2))
    found = [excursion.update(PERIOD, reading(*rates), DENSITY) for rates in noise.tolist()]
    assert max(found) == 0.0
    limit = EXCURSION_SIGMAS * np.sqrt(0.5 * EXCURSION_TIME * DENSITY)  # rad
    for share, expected in (0.9, False), (1.2, True):
        excursion = TiltExcursion()
        found = excursion.update(PERIOD, reading(pitch_rate=share * limit / PERIOD), DENSITY)
        assert (found > 0.0) == expected
