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
from smart_tire.models.tire import brush_tire
from smart_tire.models.vehicle import drive
from smart_tire.parameters import build, SimulatorParams
from smart_tire.samples import GRAVITY, LEFT, NS_PER_S, RIGHT
from smart_tire.simulation.offline import EPOCH_NS, simulate
from smart_tire.simulation.plant import Plant, SurfaceMap, TIME_STEP
from smart_tire.simulation.robot import encoder_counts, ImuModel, Motors, wheel_angles

PERFECT = {'imu.gyro_noise': 1e-6, 'imu.accel_noise': 1e-6, 'imu.gyro_bias': 0.0,
           'imu.accel_bias': 0.0, 'errors.imu_tilt': 0.0}
CONCRETE = {'ground.base': 'concrete', 'ground.patches.names': []}
EXACT = {'errors.torque_constant': 0.0, 'errors.torque_constant_spread': 0.0,
         'errors.torque_offset': 0.0, 'errors.torque_noise': 0.0, 'errors.motor_friction': 0.0}
SCHEDULE = [(0.5, 120, 60), (2.5, 120, 0), (3.5, -60, -90)]


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


def params_of(**values):
    return build(SimulatorParams, {**CONCRETE, **values})


def plant_of(params, motors=None):
    scale = motors.friction_scale if motors else (1.0,) * 4
    return Plant(params.robot, params.drive, SurfaceMap(params.ground), (0.0, 0.0, 0.0), scale)


@pytest.mark.parametrize('viscous', [0.0, 0.03])
def test_motor_torques_and_wheel_speeds_give_the_traction_of_the_brush_tire(viscous):
    params = params_of(**{'motor.viscous_friction': viscous})
    robot, plant = params.robot, plant_of(params)
    for step in range(4000):
        before, v_x = list(plant.wheel_speed), list(plant.wheel_v_x)
        v_y, load = list(plant.wheel_v_y), list(plant.load)
        plant.step([0.6, 0.3, 0.6, 0.3] if step < 2000 else [-0.2] * 4)
        speed = np.array(plant.wheel_speed)
        force = drive.traction_force(plant.motor_torque, speed, (speed - before) / TIME_STEP,
                                     load, robot.motor, robot.wheel_radius)
        rolling = robot.wheel_radius * speed
        if step % 2000 > 300 and np.abs(rolling).min() > 0.1:  # implicit steps lag transients
            s_x, s_y = brush_tire.slip_vector(rolling, v_x, v_y)
            brush, _ = brush_tire.brush_force(s_x, s_y, 0.47, load, 52.7)
            np.testing.assert_allclose(force, brush, atol=0.05)


def efforts(params, **options):
    """Return torques [N m] (n, 4) and times [s] of the wheel samples of a simulation."""
    samples = [sample for _, topic, sample in simulate(params, SCHEDULE, 5.0, **options)
               if topic == 'wheel_states']
    times = np.array([(sample.stamp_ns - EPOCH_NS) / NS_PER_S for sample in samples])
    return [sample.effort for sample in samples], times


def test_without_errors_the_reported_torque_is_that_of_the_motor():
    params = params_of(**EXACT)
    motors, plant = Motors(params), plant_of(params)
    for duty in (0.5, -0.3, 0.5, 0.02):
        for _ in range(300):
            plant.step([duty, 0.5 * duty] * 2)
        torques = motors.torques(plant, (duty, 0.5 * duty) * 2, tuple(plant.wheel_speed))
        assert torques == pytest.approx(plant.motor_torque, abs=0.5 * 0.01 * 1.2 + 1e-12)
        codes = np.array(motors.currents(plant)) / 0.01
        np.testing.assert_allclose(codes, np.round(codes), atol=1e-9)


@pytest.mark.parametrize('sign', ['draw', 'signed'])
def test_reported_torques_are_signed_by_direction_in_both_conventions(sign):
    found, times = efforts(params_of(**EXACT, **{'motor.current_sign': sign, 'film.wheels': []}))
    torque = np.array(found)
    steady, reverse = (times > 1.6) & (times < 2.4), times > 4.3
    assert np.all(torque[np.ix_(steady, LEFT)] > 0.2)   # the outer wheels drive
    assert np.all(torque[reverse].mean(axis=0)[list(RIGHT)] < -0.2)


def test_errors_are_those_of_the_parameters():
    drawn = [Motors(params_of(seed=seed)) for seed in range(400)]
    plant = plant_of(params_of())
    plant.motor_torque = [3.0] * 4
    readings = np.array([1.2 * np.mean([motors.currents(plant) for _ in range(20)], axis=0)
                         for motors in drawn])
    ratio = readings / 3.0
    offset = 0.015 / 3.0
    noise = 0.05 / math.sqrt(20) / 3.0
    assert ratio.mean(axis=1).std() == pytest.approx(0.04, rel=0.12)
    apart = (ratio - ratio.mean(axis=1, keepdims=True)).std() * math.sqrt(4.0 / 3.0)
    assert apart == pytest.approx(math.sqrt(0.01**2 + offset**2 + noise**2), rel=0.1)
    friction = np.array([motors.friction_scale for motors in drawn])
    assert friction.std() == pytest.approx(0.1, rel=0.1)
    assert abs(friction.mean() - 1.0) < 0.02
