# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Wheel drive: the torque balance, and signs of currents."""

import numpy as np
import pytest
from smart_tire.models.vehicle import drive
from smart_tire.parameters.robot import MotorParams

LOSSES = MotorParams(viscous_friction=0.02)
RADIUS = 0.087


def states(count=200):
    """Return random torques [N m], speeds [rad/s], accelerations [rad/s2] and loads [N]."""
    rng = np.random.default_rng(4)
    return (rng.normal(0.0, 1.0, count), rng.normal(0.0, 10.0, count),
            rng.normal(0.0, 20.0, count), rng.uniform(0.0, 60.0, count))


def test_the_torque_balance_is_that_of_the_wheel():
    torque, speed, acceleration, load = states()
    force = drive.traction_force(torque, speed, acceleration, load, LOSSES, RADIUS)
    friction = drive.friction_torque(speed, load, LOSSES, RADIUS)
    np.testing.assert_allclose(RADIUS * force + friction + LOSSES.inertia * acceleration, torque)


def test_traction_reverses_with_torque_speed_and_acceleration():
    torque, speed, acceleration, load = states()
    forward = drive.traction_force(torque, speed, acceleration, load, LOSSES, RADIUS)
    reverse = drive.traction_force(-torque, -speed, -acceleration, load, LOSSES, RADIUS)
    np.testing.assert_array_equal(reverse, -forward)


def test_friction_dissipates_energy_and_is_continuous_at_standstill():
    _, speed, _, load = states()
    assert np.all(drive.friction_torque(speed, load, LOSSES, RADIUS) * speed > 0.0)
    near = np.linspace(-0.5, 0.5, 2001)
    steps = np.diff(drive.friction_torque(near, 26.7, LOSSES, RADIUS))
    assert np.all(steps > 0.0) and steps.max() < 1e-3


def test_without_load_only_the_gear_rubs():
    gear = drive.friction_torque(10.0, 0.0, MotorParams(), RADIUS)
    assert gear == pytest.approx(0.15)
    loaded = drive.friction_torque(10.0, 26.7, MotorParams(), RADIUS)
    assert loaded - gear == pytest.approx(0.015 * 26.7 * RADIUS)


@pytest.mark.parametrize(('current', 'duty', 'speed', 'sign', 'torque'), [
    (2.0, 0.5, 5.0, 'draw', 2.4), (2.0, -0.5, -5.0, 'draw', -2.4),
    (-1.0, 0.1, 9.0, 'draw', -1.2), (-1.0, -0.1, -9.0, 'draw', 1.2),
    (1.0, 0.0, 5.0, 'draw', -1.2), (-1.0, 0.0, 5.0, 'draw', -1.2),
    (1.0, 0.0, -5.0, 'draw', 1.2), (1.0, 0.0, 0.0, 'draw', 0.0),
    (2.0, -0.5, 5.0, 'signed', 2.4), (-2.0, 0.0, 0.0, 'signed', -2.4)])
def test_the_sign_of_the_torque_follows_from_the_convention(current, duty, speed, sign, torque):
    assert drive.measured_torque(current, duty, speed, torque_constant=1.2,
                                 current_sign=sign) == pytest.approx(torque)
