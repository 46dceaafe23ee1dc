# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A known scale of the gyroscope has no effect on any estimate."""

from dataclasses import replace

from benchmarks.scenarios import sequence
import numpy as np
import pytest
from smart_tire.analysis.dead_reckoning import baselines, GYRO_WHEELS
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.parameters import (
    build, FrictionEstimatorParams, SimulatorParams, SlipEstimatorParams)
from smart_tire.recording import SampleArrays
from smart_tire.samples import GroundState, ImuSample, Odometry, TireSample, WheelSample
from smart_tire.simulation.offline import simulate

SCALE = 1.02
LEGS, END = sequence((6.0, 120.0, 60.0))
pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def samples():
    return [sample for _, _, sample in simulate(SimulatorParams(seed=1), LEGS, END)
            if isinstance(sample, (ImuSample, WheelSample, TireSample))]


@pytest.fixture(scope='module')
def scaled(samples):
    return [replace(one, rate=tuple(SCALE * rate for rate in one.rate))
            if isinstance(one, ImuSample) else one for one in samples]


def params(kind, scale):
    return build(kind, {'imu.gyro_scale': scale})


def test_of_the_slip_estimator(samples, scaled):
    def last(given, scale):
        estimator = SlipEstimator(params(SlipEstimatorParams, scale))
        return [one for sample in given if not isinstance(sample, TireSample)
                for one in estimator.update(sample) if isinstance(one, Odometry)][-1]
    assert last(scaled, SCALE).orientation == pytest.approx(
        last(samples, 1.0).orientation, abs=1e-9)
    assert last(scaled, 1.0).orientation != pytest.approx(
        last(samples, 1.0).orientation, abs=1e-2)


def test_of_the_window(samples, scaled):
    def last(given, scale):
        estimator = FrictionEstimator(params(FrictionEstimatorParams, scale))
        state = [one for sample in given for one in estimator.update(sample)
                 if isinstance(one, GroundState)][-1]
        return [state.lateral_stiffness_ratio.value, state.imu_x.value]
    assert last(scaled, SCALE) == pytest.approx(last(samples, 1.0), rel=1e-6)
    assert last(scaled, 1.0) != pytest.approx(last(samples, 1.0), rel=1e-4)


def test_of_gyroscope_and_wheels(samples, scaled):
    def last(given, scale):
        return baselines(SampleArrays(given), params(SlipEstimatorParams, scale).robot)[
            GYRO_WHEELS].pose[-1]
    assert last(scaled, SCALE) == pytest.approx(last(samples, 1.0), abs=1e-9)
    assert last(scaled, 1.0)[2] == pytest.approx(SCALE * last(samples, 1.0)[2], rel=1e-3)


def test_the_simulated_gyroscope_has_that_of_the_true_robot(samples):
    legs = simulate(SimulatorParams(seed=1, robot=params(SlipEstimatorParams, SCALE).robot),
                    LEGS, END)
    found = np.array([one.rate[2] for _, _, one in legs if isinstance(one, ImuSample)])
    exact = np.array([one.rate[2] for one in samples if isinstance(one, ImuSample)])
    assert np.ptp(exact) > 0.5
    assert np.ptp(found - exact) == pytest.approx((SCALE - 1.0) * np.ptp(exact), rel=0.1)
