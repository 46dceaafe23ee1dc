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

"""Mean slip, lateral velocity and load of a wheel during a patch crossing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.friction.motion_history import MotionHistory
from smart_tire.models.vehicle.skid_steer import normal_loads
from smart_tire.parameters import RobotParams
from smart_tire.samples import GroundState, Odometry, WheelSlip
from smart_tire.uncertain import Uncertain, UNKNOWN
from support.rolling import stamp

ROBOT = RobotParams()
TWIST = [0.0] * 36
TWIST[7], TWIST[11], TWIST[31], TWIST[35] = 4e-6, 1e-6, 1e-6, 1e-4


def history(*, v_x=lambda t: 1.0, v_y=0.05, rate=0.8, slip=lambda t: 0.11, until=1.0):
    motion = MotionHistory(ROBOT, 0.02)
    for t in np.arange(0.0, until, 0.008):
        motion.add_odometry(Odometry(
            stamp(t), (0.0,) * 3, (0.0, 0.0, 0.0, 1.0), (v_x(t), v_y, 0.0), (0.0, 0.0, rate),
            (0.0,) * 36, tuple(TWIST)))
        motion.add_slip(WheelSlip(stamp(t), (slip(t), -0.1, 0.12, -0.1), (0.1,) * 4,
                                  (0.003, 0.004, 0.005, 0.006)))
    return motion


def test_means_are_taken_over_the_crossing():
    motion = history(slip=lambda t: 0.1 + 0.2 * (t - 0.5))
    mean = motion.mean('front_left', stamp(0.49), stamp(0.53))
    assert mean.slip == (pytest.approx(0.102, abs=2e-4), pytest.approx(0.003))
    assert mean.slip_rate == pytest.approx(0.2, rel=0.01)


def test_the_residual_of_the_slip_is_that_from_a_linear_change():
    linear = history(slip=lambda t: 0.1 + 0.2 * (t - 0.5))
    quadratic = history(slip=lambda t: 0.1 + 5.0 * (t - 0.51)**2)
    linear, quadratic = (motion.mean('front_left', stamp(0.49), stamp(0.53))
                         for motion in (linear, quadratic))
    assert linear.slip_residual < 1e-6
    assert quadratic.slip_residual == pytest.approx(5.0 * 0.07**2 * 0.298, rel=0.15)
    assert quadratic.slip_rate == pytest.approx(0.0, abs=0.02)


def test_the_lateral_velocity_and_its_sigma_are_those_of_the_wheel_center():
    lateral = history().mean('rear_right', stamp(0.5), stamp(0.54)).lateral_velocity
    assert lateral.value == pytest.approx(0.05 - 0.13 * 0.8)
    assert lateral.sigma == pytest.approx(math.sqrt(4e-6 - 2 * 0.13e-6 + 0.13**2 * 1e-4))


def test_the_load_follows_from_acceleration_and_turning():
    load = history(v_x=lambda t: 0.5 + 1.5 * t).mean('front_left', stamp(0.5), stamp(0.54)).load
    expected = normal_loads(
        ROBOT.mass, ROBOT.center_of_mass, ROBOT.wheelbase, ROBOT.track_width, 1.5 - 0.8 * 0.05,
        0.8 * (0.5 + 1.5 * 0.52), radius=ROBOT.wheel_radius)[0]
    assert load.value == pytest.approx(float(expected), rel=0.005)
    assert 0.02 < load.sigma / load.value < 0.04


def test_without_samples_the_motion_is_unknown():
    assert MotionHistory(ROBOT, 0.02).mean('front_left', stamp(0.5), stamp(0.6)).slip == UNKNOWN
    silent = history(until=0.3).mean('front_left', stamp(0.5), stamp(0.54))
    assert silent.slip == silent.lateral_velocity == silent.load == UNKNOWN
    stationary = history(slip=lambda t: math.nan if t < 0.51 else 0.1)
    assert stationary.mean('front_left', stamp(0.5), stamp(0.54)).slip == UNKNOWN


def ground(time, stiffness):
    """Return the state of the ground at ``time`` [s]."""
    return GroundState(stamp(time), Uncertain(stiffness, 1.5), UNKNOWN, (-0.9, 0.4))


@pytest.mark.parametrize('wheel', ['front_left', 'front_right', 'rear_left', 'rear_right'])
def test_the_ground_is_the_latest_one_at_the_end_of_the_crossing(wheel):
    motion = history()
    for time, stiffness in ((0.448, 50.0), (0.512, 40.0), (0.576, 30.0)):
        motion.add_ground(ground(time, stiffness))
    for end, stiffness in ((0.511, 50.0), (0.512, 40.0), (0.55, 40.0)):
        mean = motion.mean(wheel, stamp(0.49), stamp(end))
        assert mean.stiffness == (stiffness, 1.5)
        assert mean.slip_correlation == (-0.9 if wheel.endswith('left') else 0.4)


def test_without_ground_states_the_stiffness_is_the_calibrated_one():
    motion = history()
    motion.add_ground(ground(0.56, 30.0))
    mean = motion.mean('front_left', stamp(0.5), stamp(0.54))
    assert mean.stiffness == (52.7, pytest.approx(5.27))
    assert mean.slip_correlation == 0.0


def test_the_history_is_bounded():
    motion = history(until=30.0)
    assert motion.mean('front_left', stamp(1.0), stamp(1.1)).slip == UNKNOWN
    recent = motion.mean('front_left', stamp(29.0), stamp(29.1)).slip
    assert recent.value == pytest.approx(0.11)
