# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Skid-steer kinematics and wheel loads."""

from dataclasses import replace

import numpy as np
import pytest
from smart_tire.models.vehicle import skid_steer
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GRAVITY

WHEELBASE, TRACK, RADIUS, MASS = 0.26, 0.38, 0.087, 10.9
COM = (0.02, -0.01, 0.11)
ROBOT = RobotParams(wheelbase=WHEELBASE, track_width=TRACK, wheel_radius=RADIUS, mass=MASS,
                    center_of_mass=COM)
CENTERED = replace(ROBOT, center_of_mass=(0.0, 0.0, 0.1))
STILL = 0.05


@pytest.mark.parametrize('rolling, ground, expected', [
    (1.0, 0.9, 0.1), (-1.0, -0.9, 0.1),     # driving
    (1.0, 1.2, -0.2), (-1.0, -1.2, -0.2),   # braking
    (0.0, 1.0, -1.0), (0.0, -1.0, -1.0),    # locked
    (0.01, 1.0, -1.0), (-0.01, 1.0, -1.0), (0.01, -1.0, -1.0),  # counts as locked
    (1.0, 0.0, 1.0), (1.0, -0.3, 1.0), (-0.5, 1.0, 1.0),        # spinning
    (0.06, 0.03, 0.5), (0.03, 0.06, -1.0), (0.04, 0.05, -0.25)])
def test_slip_is_positive_when_driving_in_both_directions(rolling, ground, expected):
    assert float(skid_steer.slip_ratio(rolling, ground, STILL)) == pytest.approx(expected)


def test_slip_is_undefined_exactly_at_standstill():
    rolling, ground = np.meshgrid(np.linspace(-0.2, 0.2, 81), np.linspace(-0.2, 0.2, 81))
    ratio = skid_steer.slip_ratio(rolling, ground, STILL)
    still = (np.abs(rolling) < STILL) & (np.abs(ground) < STILL)
    np.testing.assert_array_equal(np.isnan(ratio), still)
    assert np.all(np.abs(ratio[~still]) <= 1.0)


def test_left_wheels_are_slower_in_a_left_turn():
    v_x, v_y = skid_steer.wheel_velocities(1.0, 0.0, 0.5, WHEELBASE, TRACK)
    np.testing.assert_allclose(v_x, [0.905, 1.095, 0.905, 1.095])
    np.testing.assert_allclose(v_y, [0.065, 0.065, -0.065, -0.065])


def test_the_velocity_at_the_center_of_rotation_is_zero():
    x, y = skid_steer.icr(0.6, -0.03, 0.5)
    v_x, v_y = 0.6 - y * 0.5, -0.03 + x * 0.5
    assert (float(v_x), float(v_y)) == pytest.approx((0.0, 0.0))
    assert np.isnan(skid_steer.icr(0.6, 0.0, 0.0)).all()


def test_loads_balance_weight_and_moments():
    loads = skid_steer.normal_loads(ROBOT, 1.5, -0.8)
    x = 0.5 * WHEELBASE * skid_steer.AXLE_SIGNS
    y = 0.5 * TRACK * skid_steer.SIDE_SIGNS
    weight = MASS * GRAVITY
    height = COM[2] + RADIUS
    assert loads.sum() == pytest.approx(weight)
    assert (loads * x).sum() == pytest.approx(weight * COM[0] - MASS * height * 1.5)
    assert (loads * y).sum() == pytest.approx(weight * COM[1] + MASS * height * 0.8)


def test_load_transfers_to_the_rear_when_accelerating_and_outward_in_a_turn():
    forward = skid_steer.normal_loads(CENTERED, 1.0, 0.0)
    assert forward[0] == forward[1] < forward[2] == forward[3]
    left_turn = skid_steer.normal_loads(CENTERED, 0.0, 1.0)
    assert left_turn[0] == left_turn[2] < left_turn[1] == left_turn[3]


def test_loads_have_the_shape_of_the_accelerations_and_are_not_negative():
    loads = skid_steer.normal_loads(ROBOT, np.linspace(-30.0, 30.0, 7), 0.0)
    assert loads.shape == (7, 4) and np.all(loads >= 0.0) and np.any(loads == 0.0)
