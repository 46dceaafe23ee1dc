# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Plant: conservation laws, symmetry, stability, and the slips of paper B, Fig. 10."""

import math

import numpy as np
import pytest
from smart_tire.models.tire import brush_tire
from smart_tire.parameters import build, SimulatorParams
from smart_tire.samples import GRAVITY
from smart_tire.simulation.plant import Plant, SurfaceMap, TIME_STEP

EVERYWHERE = {'concrete': {'ground.base': 'concrete', 'ground.patches.names': []},
              'sand': {'ground.base': 'sand', 'ground.patches.names': []}}
ICE = {'ground.names': ['ice'], 'ground.friction': [0.0], 'ground.stiffness': [52.7],
       'ground.drag': [0.0], 'ground.base': 'ice', 'ground.patches.names': []}
FREE_SPEED = 22.0  # rad/s
OFF_CENTER = {'center_of_mass': [0.03, -0.02, 0.023]}


def new_plant(start=(0.0, 0.0, 0.0), **values):
    params = build(SimulatorParams, values)
    return Plant(params.robot, params.drive, SurfaceMap(params.ground), start)


def patches(**rectangles):
    """Return the parameters of patches, surface -> (x limits, y limits) [m], in this order."""
    values = {'ground.patches.names': list(rectangles)}
    for surface, (x, y) in rectangles.items():
        values |= {f'ground.patches.{surface}.surface': surface,
                   f'ground.patches.{surface}.x': x, f'ground.patches.{surface}.y': y}
    return values


def drive(plant, left_rpm, right_rpm, seconds):
    """Control the wheel speeds by feed-forward and a proportional loop with high gain."""
    set_points = [rpm * math.tau / 60.0 for rpm in (left_rpm, right_rpm)] * 2
    for _ in range(round(seconds / TIME_STEP)):
        plant.step([set_point / FREE_SPEED + 1.5 * (set_point - speed)
                    for set_point, speed in zip(set_points, plant.wheel_speed)])


def coast(plant, seconds, duty=(0.0, 0.0, 0.0, 0.0)):
    for _ in range(round(seconds / TIME_STEP)):
        plant.step(duty)


def slips(plant, radius=0.087):
    return [(radius * w - v) / abs(radius * w)
            for w, v in zip(plant.wheel_speed, plant.wheel_v_x)]


def momentum(plant, com=(0.03, -0.02)):
    """Return the velocity of the center of mass over ground, in world axes."""
    v_x = plant.v_x - plant.yaw_rate * com[1]
    v_y = plant.v_y + plant.yaw_rate * com[0]
    cos, sin = math.cos(plant.yaw), math.sin(plant.yaw)
    return cos * v_x - sin * v_y, sin * v_x + cos * v_y


def test_the_scalar_tire_force_agrees_with_the_brush_tire_model():
    rng = np.random.default_rng(2)
    total = rng.uniform(0.0, 2.0, 500)
    mu, load = rng.uniform(0.0, 1.0, 500), rng.uniform(0.0, 50.0, 500)
    force, _ = brush_tire.brush_force(total, 0.0, mu, load, 52.7)
    scalar = [Plant.tire_slope(*row, 52.7) * row[0] for row in zip(total, mu, load)]
    np.testing.assert_allclose(scalar, force, rtol=1e-12, atol=1e-12)
    assert Plant.tire_slope(0.0, 0.47, 26.7, 52.7) == pytest.approx(52.7)
    assert Plant.tire_slope(0.0, 0.0, 26.7, 52.7) == 0.0


@pytest.mark.parametrize('surface, sides', [('concrete', ((0.10, 0.12), (-0.12, -0.10))),
                                            ('sand', ((0.25, 0.35), (0.05, 0.12)))])
def test_slips_agree_with_fig_10(surface, sides):
    plant = new_plant(**EVERYWHERE[surface])
    drive(plant, 120, 60, 3.0)
    assert all(low < slip < high for slip, (low, high) in zip(slips(plant), sides * 2))
    assert plant.yaw_rate < 0.0 < plant.v_x


def test_left_and_right_turns_are_mirror_images():
    right, left = (new_plant(**EVERYWHERE['concrete']) for _ in range(2))
    drive(right, 120, 60, 1.0)
    drive(left, 60, 120, 1.0)
    assert (left.x, left.y, left.yaw) == pytest.approx((right.x, -right.y, -right.yaw), abs=1e-9)
    assert left.load == pytest.approx([right.load[i] for i in (1, 0, 3, 2)])


@pytest.mark.parametrize('surface', ['concrete', 'sand'])
def test_stationary_wheels_hold_the_robot_without_creep_or_chatter(surface):
    plant = new_plant(**EVERYWHERE[surface])
    drive(plant, 100, 40, 1.0)
    drive(plant, 0, 0, 2.0)
    pose = plant.x, plant.y, plant.yaw
    speeds = []
    for _ in range(3000):
        plant.step((0.0, 0.0, 0.0, 0.0))
        speeds.append(math.hypot(plant.v_x, plant.v_y) + abs(plant.yaw_rate))
    assert (plant.x, plant.y, plant.yaw) == pytest.approx(pose, abs=1e-6)
    assert all(after <= before for before, after in zip(speeds, speeds[1:]))


def test_without_duty_the_energy_decreases_to_zero():
    plant = new_plant(**EVERYWHERE['concrete'])
    plant.v_x, plant.v_y, plant.yaw_rate = 0.8, -0.5, 2.0
    params = SimulatorParams()
    energy = [math.inf]
    for _ in range(3000):
        plant.step((0.0, 0.0, 0.0, 0.0))
        wheels = sum(speed**2 for speed in plant.wheel_speed)
        energy.append(0.5 * params.robot.mass * (plant.v_x**2 + plant.v_y**2)
                      + 0.5 * params.robot.yaw_inertia * plant.yaw_rate**2
                      + 0.5 * params.robot.motor.inertia * wheels)
    assert all(after <= before * (1.0 + 1e-9) for before, after in zip(energy, energy[1:]))
    assert energy[-1] < 1e-6


def test_without_friction_momentum_and_yaw_rate_are_conserved():
    plant = new_plant(**ICE, **OFF_CENTER)
    plant.v_x, plant.v_y, plant.yaw_rate = 0.7, 0.2, 1.5
    before = momentum(plant)
    coast(plant, 3.0, duty=(0.5, -0.2, 0.1, 1.0))
    assert momentum(plant) == pytest.approx(before, rel=1e-9)
    assert plant.yaw_rate == 1.5 and plant.yaw == pytest.approx(4.5)


def test_a_free_body_moves_straight_while_it_rotates():
    plant = new_plant(start=(1.0, -2.0, 0.5), **ICE)
    plant.v_x, plant.yaw_rate = 0.6, 1.2
    coast(plant, 1.0)
    assert (plant.x, plant.y) == pytest.approx(
        (1.0 + 0.6 * math.cos(0.5), -2.0 + 0.6 * math.sin(0.5)), abs=1e-6)
    assert plant.yaw == pytest.approx(1.7)


def test_loads_sum_to_the_weight_and_shift_outwards_in_a_turn():
    plant = new_plant(**EVERYWHERE['concrete'])
    assert plant.load == pytest.approx([10.9 * GRAVITY / 4.0] * 4)
    drive(plant, 60, 120, 3.0)
    assert sum(plant.load) == pytest.approx(10.9 * GRAVITY)
    assert plant.load[1] > plant.load[0] and plant.load[3] > plant.load[2]


def test_each_wheel_has_the_surface_at_its_position():
    plant = new_plant(start=(1.0, 0.0, 0.0), **{
        'ground.base': 'sand', **patches(concrete=((-9, 1), (-9, 9)), sand=((-9, 1), (-9, -0.1)))})
    names = [surface.name for surface in plant.surface]
    assert names == ['sand', 'sand', 'concrete', 'sand']


@pytest.mark.parametrize('values', [
    {'ground.stiffness': [2000.0, 500.0]}, {'mass': 2.0, 'yaw_inertia': 0.02},
    {'motor.inertia': 1e-5}, {'center_of_mass': [0.1, 0.05, 0.3]}])
@pytest.mark.parametrize('duty', [
    (0.5, -0.3, 0.5, -0.3), pytest.param((0.02, 0.0, 0.02, 0.0), marks=pytest.mark.long)])
def test_the_plant_is_stable_with_other_parameters(values, duty):
    plant = new_plant(**{**EVERYWHERE['concrete'], **values})
    coast(plant, 3.0, duty)
    steady, last = plant.yaw_rate, list(plant.wheel_speed)
    for _ in range(200):
        plant.step(duty)
        assert plant.yaw_rate == pytest.approx(steady, rel=0.05, abs=1e-3)
        assert plant.wheel_speed == pytest.approx(last, rel=0.01, abs=1e-3)
        last = list(plant.wheel_speed)
