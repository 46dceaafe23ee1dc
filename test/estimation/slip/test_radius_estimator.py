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

"""Rolling radius: estimated while wheels roll freely, kept while they slip."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.radius_estimator import RadiusEstimator
from smart_tire.parameters import build, RobotParams, SlipEstimatorParams

from support.driving import drive, ramp


@pytest.mark.parametrize('seed', range(5))
def test_radius_error_is_consistent_with_the_reported_variance(seed):
    rng, estimator = np.random.default_rng(seed), RadiusEstimator(build(
        RobotParams, {'wheel_radius_sigma': 0.03}))
    truth = 1.0 + 0.03 * rng.standard_normal()
    for _ in range(20):  # starts from standstill, 5 s of rolling each
        error = 0.02 * rng.standard_normal()
        for _ in range(80):
            slip = (estimator.scale - truth) / estimator.scale + error
            estimator.update(slip, 0.02 ** 2, 1.0, 0.0625)
    assert abs(estimator.scale - truth) < 3.0 * np.sqrt(estimator.variance)
    assert np.sqrt(estimator.variance) < 0.006


def test_soft_ground_and_zero_sigma_leave_the_radius_unchanged():
    estimator = RadiusEstimator(build(RobotParams, {'wheel_radius_sigma': 0.03}))
    estimator.update(0.1, 0.02 ** 2, 0.0, 1.0)
    assert estimator.radius == 0.087
    exact = RadiusEstimator(build(RobotParams, {'wheel_radius_sigma': 0.0}))
    exact.update(0.1, 0.02 ** 2, 1.0, 1.0)
    assert exact.radius == 0.087


def rolled(radius, slip):
    """Return the radius estimated from six starts."""
    knots = [(0.0, 0.0, 0.0)]
    for start in range(3, 63, 10):
        knots += [(start, 0, 0), (start + 1, 0.9, 0.9), (start + 6, 0.9, 0.9), (start + 7, 0, 0)]
    rolling = ramp([*knots, (66, 0, 0)])
    run = drive(rolling, slip * rolling, seed=3)
    estimator = SlipEstimator(build(SlipEstimatorParams, {
        'wheel_radius': radius, 'wheel_radius_sigma': 0.03}))
    for sample in run.samples:
        estimator.update(sample)
    return estimator.status()['rolling_radius']


@pytest.mark.parametrize('radius', [0.0845, 0.087, 0.0895])
def test_starts_and_stops_on_firm_ground_make_the_radius_observable(radius):
    assert rolled(radius, 0.0) == pytest.approx(0.087, rel=0.012)


def test_slip_on_soft_ground_changes_the_radius_by_less_than_its_sigma():
    assert rolled(0.087, 0.15) == pytest.approx(0.087, rel=0.03)
