# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The Cramer-Rao bound: reference values and scaling."""

import math

from benchmarks.friction.cramer_rao import friction_bound
import pytest
from smart_tire.parameters import build, RobotParams

ROBOT = RobotParams()
WHEEL = 'front_right'
SPEED = 2.0 * math.pi * ROBOT.wheel_radius  # m/s, at 60 rpm
CRITICAL = 3.0 * 0.47 * 0.25 * ROBOT.mass * 9.80665 / ROBOT.tire.longitudinal_stiffness


def bound(slip, noise=0.005, films=None, speed=SPEED, **values):
    robot = build(RobotParams, {'film.noise': noise, **values})
    return friction_bound(robot, WHEEL, slip=slip, normalized_slip=abs(slip) / CRITICAL,
                          speed=speed, films=films)


@pytest.mark.parametrize(('slip', 'reference'), [(0.05, 0.067), (0.10, 0.018), (0.15, 0.009)])
def test_the_bound_of_two_films_equals_the_reference(slip, reference):
    assert bound(slip) == pytest.approx(reference, rel=0.08)


@pytest.mark.parametrize(('slip', 'reference'), [(0.05, 0.096), (0.1, 0.025), (0.2, 0.008)])
def test_the_bound_of_one_film_is_near_the_reference(slip, reference):
    assert bound(slip, films=(0,)) == pytest.approx(reference, rel=0.15)


def test_for_small_slip_the_bound_is_proportional_to_noise_over_squared_slip():
    assert bound(0.02, 0.02) == pytest.approx(4.0 * bound(0.02, 0.005), rel=0.1)
    assert bound(0.02) == pytest.approx(4.0 * bound(0.04), rel=0.25)


def test_less_noise_more_films_lower_speed_and_exact_gains_lower_the_bound():
    assert bound(0.1, 0.002) < bound(0.1) < bound(0.1, 0.02)
    assert bound(0.1) < bound(0.1, films=(0,)) < bound(0.1, films=(1,))
    assert bound(0.1, speed=0.25 * SPEED) < bound(0.1)
    assert bound(0.1, **{'film.stretch_gain_tolerance': 0.0}) < bound(0.1)


def test_the_bounds_of_braking_and_driving_are_similar():
    assert bound(-0.1) == pytest.approx(bound(0.1), rel=0.2)


def test_without_slip_the_bound_is_infinite():
    assert friction_bound(ROBOT, WHEEL, slip=0.0, normalized_slip=0.3, speed=SPEED) == math.inf
