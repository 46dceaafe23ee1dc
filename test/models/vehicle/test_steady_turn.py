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

"""Slip velocities of steady turns, compared with the dynamics of the simulated robot."""

from __future__ import annotations

import pytest
from smart_tire.models.vehicle.steady_turn import MAX_SLIDING, steady_turn, TurnModel
from smart_tire.parameters import SimulatorParams
from smart_tire.parameters.simulation import GroundParams
from smart_tire.simulation.plant import Plant
from smart_tire.simulation.surfaces import SurfaceMap

WHEELBASE, TRACK, LOAD = 0.26, 0.38, 10.9 * 9.81 / 4.0
CONCRETE, SAND = (0.47, 52.7, 0.01), (0.25, 25.0, 0.11)  # mu, C_x [N], drag over load
MODEL = TurnModel(WHEELBASE, TRACK, 0.7)


def driven(ground, left, right, duration=1.5):
    """Return (v_x, yaw rate) of the simulated robot with rolling speeds [m/s] of the sides."""
    friction, stiffness, drag = ground
    params = SimulatorParams(ground=GroundParams(
        names=('ground',), friction=(friction,), stiffness=(stiffness,), drag=(drag,),
        base='ground', patches=()))
    plant = Plant(params.robot, params.drive, SurfaceMap(params.ground))
    radius, integral = params.robot.wheel_radius, [0.0] * 4
    for _ in range(round(1000 * duration)):
        errors = [(left, right)[i % 2] / radius - plant.wheel_speed[i] for i in range(4)]
        integral = [one + 0.02 * error for one, error in zip(integral, errors)]
        plant.step([min(max(0.5 * error + one, -1.0), 1.0)
                    for error, one in zip(errors, integral)])
    return plant.v_x, plant.yaw_rate


@pytest.mark.parametrize('ground', [CONCRETE, SAND])
@pytest.mark.parametrize('v_x, yaw_rate', [
    (0.5, 0.0), (0.5, 0.5), (0.4, -0.8), (0.0, 1.0), (-0.5, 0.4), (-0.3, -0.5)])
def test_the_simulated_robot_moves_as_wanted_with_the_slip_of_the_model(ground, v_x, yaw_rate):
    friction, stiffness, drag = ground
    model = TurnModel(WHEELBASE, TRACK, 3.0 * friction * LOAD / stiffness)
    resistance = drag * LOAD / stiffness
    turn = steady_turn(model, v_x, yaw_rate, (resistance, resistance))
    half = 0.5 * TRACK * yaw_rate
    reached = driven(ground, v_x - half + turn.left, v_x + half + turn.right)
    assert reached == (pytest.approx(v_x, rel=0.02, abs=0.005),
                       pytest.approx(yaw_rate, rel=0.03, abs=0.005))


@pytest.mark.parametrize('v_x, yaw_rate', [(0.5, 0.4), (0.0, 0.7), (0.3, 1.0)])
def test_turns_to_both_sides_and_in_reverse_are_mirror_images(v_x, yaw_rate):
    turn = steady_turn(MODEL, v_x, yaw_rate, (0.05, 0.1))
    mirrored = steady_turn(MODEL, v_x, -yaw_rate, (0.1, 0.05))
    assert (mirrored.left, mirrored.right) == pytest.approx((turn.right, turn.left))
    reverse = steady_turn(MODEL, -v_x, -yaw_rate, (0.05, 0.1))
    assert (reverse.left, reverse.right) == pytest.approx((-turn.left, -turn.right))


def test_slip_scales_with_the_speed():
    slow, fast = (steady_turn(MODEL, k * 0.2, k * 0.3, (0.02, 0.02)) for k in (1.0, 3.0))
    assert (fast.left, fast.right) == pytest.approx((3.0 * slow.left, 3.0 * slow.right), rel=1e-6)


def test_gentle_turns_widen_the_track_by_the_square_of_the_wheelbase_over_the_track():
    turn = steady_turn(MODEL, 0.5, 0.01, (0.0, 0.0))
    assert (turn.right - turn.left) / 0.01 == pytest.approx(WHEELBASE ** 2 / TRACK, rel=0.02)
    half = steady_turn(MODEL, 0.5, 0.01, (0.0, 0.0), scrub=0.5)
    assert (half.right - half.left) / 0.01 == pytest.approx(
        0.5 * WHEELBASE ** 2 / TRACK, rel=0.02)


@pytest.mark.parametrize('v_x', [0.5, -0.5])
def test_straight_driving_needs_the_resistance_of_each_side_and_the_thrust(v_x):
    sign = 1.0 if v_x > 0.0 else -1.0
    turn = steady_turn(MODEL, v_x, 0.0, (0.01, 0.05), thrust=0.02)
    # brush model: force over C_x = s (1 - t + t^2 / 3)
    for sliding, resistance in ((turn.left, 0.01), (turn.right, 0.05)):
        slip = sliding / abs(v_x + sliding)
        t = abs(slip) / 0.7
        assert slip * (1.0 - t + t * t / 3.0) == pytest.approx(
            sign * resistance + 0.02, rel=1e-3)


def test_demands_beyond_the_friction_are_limited():
    ice = TurnModel(WHEELBASE, TRACK, 0.05)
    turn = steady_turn(ice, 0.5, 1.0, (0.3, 0.3), scrub=3.0)
    assert max(abs(turn.left), abs(turn.right)) == pytest.approx(
        MAX_SLIDING * (0.5 + 0.5 * TRACK))


def test_at_standstill_nothing_slips():
    turn = steady_turn(MODEL, 0.0, 0.0, (0.1, 0.1))
    assert (turn.left, turn.right) == (0.0, 0.0)
    assert turn.lateral_compliance > 0.0
