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

"""Any rate of IMU and wheels."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.parameters import build, SimulatorParams, SlipEstimatorParams
from smart_tire.samples import ImuSample, Odometry, WheelSample, WheelSlip
from smart_tire.simulation.offline import simulate

DRIVE = [(2.0, 100.0, 100.0), (4.0, 100.0, 60.0)]  # start time [s], rpm of both sides
DURATION = 7.0  # s
ROBOT = {'film.wheels': [], 'encoder.stamp_jitter': 2e-4}  # a small part of the shortest period


def drive(imu_rate, wheel_rate):
    params = build(SimulatorParams, {'imu_rate': imu_rate, 'seed': 4, **ROBOT})
    return simulate(params, DRIVE, DURATION, wheel_rate=wheel_rate, torque=False)


def estimates(events):
    estimator = SlipEstimator(build(SlipEstimatorParams, ROBOT))
    return [estimate for _, _, sample in events if isinstance(sample, (ImuSample, WheelSample))
            for estimate in estimator.update(sample)]


def errors(events):
    """Return the final position error [m] and the rms error of the mean slip in the turn."""
    found = estimates(events)
    truth = {kind: [sample for _, topic, sample in events if type(sample) is kind]
             for kind in (Odometry, WheelSlip)}
    end, true = ([item for item in items if isinstance(item, Odometry)][-1].position[:2]
                 for items in (found, truth[Odometry]))
    slip = {item.stamp_ns: item.ratio for item in truth[WheelSlip]}
    pairs = [np.subtract(item.ratio[:2], slip[item.stamp_ns][:2]) for item in found
             if isinstance(item, WheelSlip) and item.stamp_ns in slip]
    late = np.array(pairs[len(pairs) * 2 // 3:])
    return float(np.hypot(*np.subtract(end, true))), float(np.sqrt(np.mean(late ** 2)))


@pytest.mark.parametrize('imu_rate, wheel_rate', [(20.0, 200.0), (1000.0, 4.0)])
def test_slip_and_pose_are_estimated_at_the_slowest_and_fastest_rates(imu_rate, wheel_rate):
    position, slip = errors(drive(imu_rate, wheel_rate))
    assert position < 0.12
    assert slip < 0.085  # braking of 0.1 without a known ground: not to be seen
