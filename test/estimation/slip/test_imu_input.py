# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Means of IMU samples over prediction steps."""

import math

import pytest
from smart_tire.estimation.slip.inputs import ImuInput
from smart_tire.parameters import build, RobotParams
from smart_tire.samples import ImuSample

PERIOD = 0.01  # s
MOTION = 0.8   # m/s2, forward, begins after a second


def last_forces(amplitude):
    """Return the forces [m/s2] of two periods of a 5 Hz vibration on all axes."""
    imu, forces, last = ImuInput(build(RobotParams, {'imu.rotation': [0.0, 0.0, 0.0]})), [], None
    for i in range(240):
        time = i * PERIOD
        shake = amplitude * math.sin(2.0 * math.pi * 5.0 * time)
        sample = ImuSample(round(1e9 * time),
                           (MOTION * (time > 1.0) + shake, 0.0, 9.81 + shake), (0.0, 0.0, 0.0))
        reading = imu.add_sample(time, sample)
        if last is not None:
            forces.append(imu.step(last[0], [last, (time, reading)]).mean.force_x)
        last = time, reading
    return forces[-40:]


def test_a_smooth_ride_is_not_delayed():
    assert last_forces(0.0) == pytest.approx([MOTION] * 40, abs=1e-3)


def test_vibration_is_not_integrated():
    forces = last_forces(2.0)
    assert max(forces) - min(forces) < 0.5 * 4.0
    assert sum(forces) / len(forces) == pytest.approx(MOTION, abs=0.1)
