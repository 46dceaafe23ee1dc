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

"""Consistency over simulated recordings: NEES of slip and speed is near one."""

from __future__ import annotations

from benchmarks.scenarios import SCENARIOS
import numpy as np
import pytest
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.samples import Odometry, WheelSlip

pytestmark = pytest.mark.slow

SEEDS = range(11, 15)  # not used by a benchmark


def errors(name, seed):
    """Return normalized errors of the slips (n, 2) and of the forward speed (n,)."""
    scenario = SCENARIOS[name]
    estimator = SlipEstimator(build(SlipEstimatorParams, {'encoder.latency': scenario.latency}))
    slips, speeds, truth = {}, {}, []
    for _, topic, sample in scenario.events(seed):
        if topic in ('imu/data', 'wheel_states'):
            for estimate in estimator.update(sample):
                if isinstance(estimate, WheelSlip):
                    slips[estimate.stamp_ns] = estimate.ratio[:2], estimate.sigma[:2]
                elif isinstance(estimate, Odometry):
                    speeds[estimate.stamp_ns] = estimate.linear[0], estimate.twist_covariance[0]
        elif topic.startswith('ground_truth') and isinstance(sample, (Odometry, WheelSlip)):
            truth.append(sample)
    slip, speed = [], []
    for sample in truth:
        at = sample.stamp_ns
        if isinstance(sample, WheelSlip) and at in slips:
            ratio, sigma = (np.array(values) for values in slips[at])
            slip.append((ratio - np.mean([sample.ratio[:2], sample.ratio[2:]], axis=0)) / sigma)
        elif isinstance(sample, Odometry) and at in speeds:
            speed.append((speeds[at][0] - sample.linear[0]) / np.sqrt(speeds[at][1]))
    slip = np.array(slip)
    return slip[np.isfinite(slip).all(axis=1)], np.array(speed)


@pytest.mark.parametrize('name', ['concrete', 'sweep_60', 'spin_reverse'])
def test_normalized_errors_are_consistent_with_the_reported_sigma(name):
    slips, speeds = zip(*(errors(name, seed) for seed in SEEDS))
    slip, speed = np.concatenate(slips), np.concatenate(speeds)
    assert len(slip) > 200 * len(SEEDS) and len(speed) > 200 * len(SEEDS)
    # neither overconfident nor uninformative
    assert 0.05 < np.mean(slip ** 2) < 2.0
    assert 0.05 < np.mean(speed ** 2) < 2.0
    assert np.mean(np.abs(slip) < 2.0) > 0.9
