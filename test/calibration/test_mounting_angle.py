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

"""Mounting angle of a film, from readings in many crossings."""

from __future__ import annotations

import math

import numpy as np
import pytest
from smart_tire.calibration.film_gains import film_angle, LATENCY_SIGMA
from smart_tire.errors import EstimatorError

SCATTER = 0.004  # rad


def readings(seed, angle, speeds, latency=0.0):
    """Return angle readings over many revolutions of the wheel."""
    rng = np.random.default_rng(seed)
    speeds = np.asarray(speeds)
    turns = math.tau * np.arange(len(speeds))
    return (angle + turns + latency * speeds + SCATTER * rng.standard_normal(len(speeds)),
            speeds)


@pytest.mark.parametrize('angle', [0.0, 0.001, 3.0, math.tau - 0.001])
def test_angles_near_the_wrap_around_are_correct(angle):
    found = film_angle(*readings(1, angle, [6.0] * 20))
    assert 0.0 <= found.value < math.tau
    assert abs(math.remainder(found.value - angle, math.tau)) < 3.0 * found.sigma


@pytest.mark.parametrize('speeds', [[6.0] * 16, [4.0, 9.0] * 8, [8.0, -8.0] * 8], ids=str)
def test_a_latency_is_estimated_from_several_speeds_or_included_in_the_sigma(speeds):
    deviations = []
    for seed in range(60):
        latency = LATENCY_SIGMA * np.random.default_rng([seed, 1]).standard_normal()
        found = film_angle(*readings(seed, 2.0, speeds, latency))
        deviations.append((found.value - 2.0) / found.sigma)
    assert 0.75 < math.sqrt(np.mean(np.square(deviations))) < 1.3
    assert (found.sigma > 0.01) == (len(set(speeds)) == 1)


def test_an_outlier_is_excluded():
    angles, speeds = readings(3, 2.0, [8.0, -8.0] * 8)
    spoiled = angles.copy()
    spoiled[4] += 0.5
    clean = film_angle(np.delete(angles, 4), np.delete(speeds, 4))
    assert film_angle(spoiled, speeds).value == pytest.approx(clean.value, abs=1e-3)


@pytest.mark.parametrize(('angles', 'reason'), [
    ([1.0, 1.0], '2 crossings'), ([1.0, math.nan, 1.0, 1.0], 'without positions'),
    ([0.2, 1.9, 3.0, 4.4, 5.8, 2.2], 'scatter')])
def test_an_unobservable_angle_is_refused_with_the_reason(angles, reason):
    with pytest.raises(EstimatorError, match=reason):
        film_angle(angles, [6.0] * len(angles))
