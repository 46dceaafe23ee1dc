# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motors of the simulated robot: torque balance, errors of currents, and random streams."""

import math

import numpy as np
import pytest

from smart_tire.models.tire import brush_tire
from smart_tire.models.vehicle import drive
from smart_tire.parameters import build, SimulatorParams
from smart_tire.samples import LEFT, NS_PER_S, RIGHT
from smart_tire.simulation.offline import EPOCH_NS, simulate
from smart_tire.simulation.plant import Plant, SurfaceMap, TIME_STEP
from smart_tire.simulation.robot import Motors

CONCRETE = {'ground.base': 'concrete', 'ground.patches.names': []}
EXACT = {'errors.torque_constant': 0.0, 'errors.torque_constant_spread': 0.0,
         'errors.torque_offset': 0.0, 'errors.torque_noise': 0.0, 'errors.motor_friction': 0.0}
SCHEDULE = [(0.5, 120, 60), (2.5, 120, 0), (3.5, -60, -90)]


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
