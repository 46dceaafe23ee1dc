# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""IMU and encoders, compared with the motion of the plant."""

import math

import numpy as np
import pytest

from smart_tire import rotation
from smart_tire.parameters import build, SimulatorParams
from smart_tire.samples import GRAVITY
from smart_tire.simulation.plant import Plant, SurfaceMap, TIME_STEP
from smart_tire.simulation.robot import encoder_counts, ImuModel, wheel_angles

PERFECT = {'imu.gyro_noise': 1e-6, 'imu.accel_noise': 1e-6, 'imu.gyro_bias': 0.0,
           'imu.accel_bias': 0.0, 'errors.imu_tilt': 0.0}


def new(seed=4, **values):
    params = build(SimulatorParams, values)
    plant = Plant(params.robot, params.drive, SurfaceMap(params.ground))
    return plant, ImuModel(params.robot, params.errors, np.random.default_rng(seed))


@pytest.mark.parametrize('angles', [[0.0, 0.0, 0.0], [0.3, -0.2, 1.1]])
def test_readings_of_gravity_and_yaw_rate_are_rotated_into_imu_link(angles):
    plant, imu = new(**PERFECT, **{'imu.rotation': angles, 'imu.position': [0.0, 0.0, 0.1]})
    plant.yaw_rate = 0.7
    in_base = rotation.matrix(*angles) @ np.array(imu.read(plant)).T
    np.testing.assert_allclose(in_base.T, [[0.0, 0.0, GRAVITY], [0.0, 0.0, 0.7]], atol=1e-4)


def test_the_readings_integrate_to_the_velocity_of_the_imu():
    position = (0.15, -0.1)
    plant, imu = new(**PERFECT, **{'imu.position': [*position, 0.1],
                                   'center_of_mass': [0.02, 0.01, 0.023]})
    v_x = v_y = yaw = 0.0
    for step in range(2000):
        plant.step((0.8, 0.1, 0.8, 0.1) if step < 1200 else (0.0, 0.3, 0.0, 0.3))
        (f_x, f_y, _), (_, _, rate) = imu.read(plant)
        v_x, v_y = (v_x + TIME_STEP * (f_x + rate * v_y), v_y + TIME_STEP * (f_y - rate * v_x))
        yaw += TIME_STEP * rate
    assert yaw == pytest.approx(plant.yaw, abs=2e-3) and abs(yaw) > 0.5
    assert v_x == pytest.approx(plant.v_x - plant.yaw_rate * position[1], abs=5e-3)
    assert v_y == pytest.approx(plant.v_y + plant.yaw_rate * position[0], abs=5e-3)


def test_errors_have_the_configured_standard_deviations():
    plant, _ = new()
    readings = np.array([new(seed=seed)[1].read(plant) for seed in range(200)])
    force_x, rate_z = readings[:, 0, 0], readings[:, 1, 2]
    assert force_x.std() == pytest.approx(math.hypot(0.05, 0.05, GRAVITY * 0.0087), rel=0.2)
    assert rate_z.std() == pytest.approx(math.hypot(0.01, 0.01), rel=0.2)
    _, imu = new(seed=1)
    noise = np.array([imu.read(plant) for _ in range(2000)])
    np.testing.assert_allclose(noise[:, 0].std(axis=0), 0.05, rtol=0.1)
    np.testing.assert_allclose(noise[:, 1].std(axis=0), 0.01, rtol=0.1)


def test_encoder_counts_are_floored_in_both_directions():
    plant, _ = new()
    plant.wheel_angle = [0.0, 0.0011, -0.0011, 3.0 * math.tau + 1e-6]
    counts = encoder_counts(plant, 5000.0)
    assert counts == (0, 0, -1, 15000)
    assert wheel_angles(counts, 5000.0) == pytest.approx(
        (0.0, 0.0, -math.tau / 5000.0, 3.0 * math.tau))
