# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Robots drawn at random: what is drawn, errors of odometry, and runs of two controllers."""

from bisect import bisect
from dataclasses import replace
import math

from benchmarks.control import drawn
from benchmarks.control.closed_loop import run_closed_loop
from benchmarks.control.drawn import (
    CALIBRATED, CONTROLLERS, draw_robot, DrawnRobot, driven, OdometryErrors, PURSUIT, run_drawn,
    SlopeStack, stack_params)
from benchmarks.control.paths import two_cusps
from benchmarks.control.run import DRAWN, tables
from benchmarks.control.scenarios import OURS, SHORT
from benchmarks.control.tracking import path_errors
from benchmarks.grounds import ground
from benchmarks.robots.plant import DrawnPlant, plant_with, Traits
from benchmarks.scoring import combined
import numpy as np
import pytest
from smart_tire.control.path_library import line, planned
from smart_tire.control.trajectory_control import PathState
from smart_tire.parameters.robot import RobotParams, TreadFilmParams
from smart_tire.parameters.simulation import DriveParams, SimulatorParams
from smart_tire.samples import GRAVITY, ImuSample, NAN, NS_PER_S, WheelSlip
from smart_tire.simulation.plant import SurfaceMap
from support.ideal_robot import odometry

ROBOTS = [draw_robot(seed) for seed in range(201, 241)]


def test_robots_have_the_spread_of_the_issue_and_half_of_them_two_grounds():
    def spread(values):
        return min(values), max(values)
    low, high = spread([one.simulator.robot.mass for one in ROBOTS])
    assert 8.0 <= low < 9.0 and 15.0 < high <= 16.0
    low, high = spread([x for one in ROBOTS for x in one.simulator.robot.center_of_mass[:2]])
    assert -0.02 <= low < -0.015 and 0.015 < high <= 0.02
    low, high = spread([one.traits.stiffness_ratio for one in ROBOTS])
    assert 0.6 <= low < 0.7 and 1.3 < high <= 1.4
    low, high = spread([radius for one in ROBOTS for radius in one.traits.radius_scale])
    assert 0.99 <= low < 0.992 and 1.008 < high <= 1.01
    low, high = spread([math.degrees(one.traits.slope) for one in ROBOTS])
    assert 0.0 <= low < 0.5 and 3.5 < high <= 4.0
    low, high = spread([mu for one in ROBOTS for mu in one.simulator.ground.friction])
    assert 0.2 <= low < 0.25 and 0.75 < high <= 0.8
    low, high = spread([one.rate for one in ROBOTS])
    assert 16.0 <= low < 22.0 and 90.0 < high <= 100.0
    assert 10 < sum(bool(one.simulator.ground.patches) for one in ROBOTS) < 30
    assert draw_robot(201) == ROBOTS[0] != ROBOTS[1]


def test_true_motion_comes_at_its_rate_late_and_with_noise():
    robot = replace(ROBOTS[0], rate=20.0, odom_delay=0.03)
    errors, received = OdometryErrors(robot), []
    for number in range(1, 201):
        now_ns = number * NS_PER_S // 100
        for one in errors([odometry(now_ns, 1.0, 2.0, 0.5, 0.3, 0.1),
                           WheelSlip(now_ns, (0.0,) * 4, (0.0,) * 4, (0.01,) * 4)]):
            received.append((now_ns - one.stamp_ns, one))
    poses = [one for _, one in received if not isinstance(one, WheelSlip)]
    assert len(poses) == pytest.approx(40, abs=1)
    assert {one.stamp_ns for _, one in received if isinstance(one, WheelSlip)} == {
        one.stamp_ns for one in poses}
    assert {late for late, _ in received} == {NS_PER_S * 3 // 100}
    x = [one.position[0] for one in poses]
    assert np.mean(x) == pytest.approx(1.0, abs=2e-3) and 1e-3 < np.std(x) < 3e-3


def test_only_the_controller_differs_and_knows_the_nominal_robot():
    robot = ROBOTS[0]
    stacks = {one: stack_params(robot, one, estimated=True) for one in CONTROLLERS}
    assert {one.trajectory.robot.mass for one in stacks.values()} == {RobotParams().mass}
    tracks = {name: one.wheels.effective_track for name, one in stacks.items()}
    assert tracks == {OURS: 0.38, SHORT: 0.38, PURSUIT: 0.38,
                      CALIBRATED: pytest.approx(robot.effective_track)}
    assert [name for name, one in stacks.items() if one.trajectory.slip_compensation] == [OURS]


@pytest.mark.parametrize('yaw', [0.0, 1.0])
def test_the_imu_measures_the_weight_along_the_slope(yaw):
    robot = replace(ROBOTS[0], traits=replace(ROBOTS[0].traits, slope=0.05, direction=0.4))
    stack = SlopeStack(stack_params(robot, OURS, estimated=True), line(1.0), robot)
    stack.receive('ground_truth/odom', odometry(NS_PER_S, yaw=yaw), NS_PER_S)
    tilted = stack._tilted(ImuSample(NS_PER_S, (0.0, 0.0, GRAVITY), (0.0, 0.0, 0.0)))
    assert tilted.acceleration == pytest.approx((
        GRAVITY * math.sin(0.05) * math.cos(0.4 - yaw),
        GRAVITY * math.sin(0.05) * math.sin(0.4 - yaw), GRAVITY * math.cos(0.05)))
    # it is what the plant takes away from the forces of the tires
    plant = plant_with(robot.traits)(
        robot.simulator.robot, DriveParams(), SurfaceMap(robot.simulator.ground),
        (0.0, 0.0, yaw))
    assert plant._vertical() == pytest.approx(
        np.array(tilted.acceleration[:2]) / GRAVITY, abs=1e-4)


def test_a_larger_wheel_drives_a_plant_to_the_other_side():
    def end(scale):
        class Driven(DrawnPlant):
            traits = Traits(radius_scale=scale)
        plant = Driven(RobotParams(), DriveParams(), SurfaceMap(ROBOTS[0].simulator.ground))
        for _ in range(3000):
            plant.step((0.3,) * 4)
        return plant.yaw
    assert end((1.01, 1.0, 1.01, 1.0)) < -1e-3 < end((1.0,) * 4) < 1e-3 < end(
        (1.0, 1.01, 1.0, 1.01))


def test_a_cusp_that_is_cut_is_no_error_of_the_way_back():
    """A robot that turns back before the cusp is compared with the way in reverse."""
    path = two_cusps(0.6)
    points = np.array(path.poses)[:, :2]
    cusp = int(np.argmax(points[:, 0]))
    kept = np.delete(points, slice(cusp - 2, cusp + 3), axis=0)  # 4 cm before and after it
    assert path_errors(path, kept).max() < 2e-3


@pytest.mark.slow
def test_all_controllers_follow_a_path_and_are_compared(monkeypatch):
    monkeypatch.setitem(drawn.PATHS, 'straight', line(0.4))
    runs = run_drawn('straight', 202, estimated=False, row=DRAWN)
    values = runs[0].values
    for name in CONTROLLERS:
        assert values[f'{name}.arrived'] == 1.0 and 0.0 < values[f'{name}.true_rms'] < 0.03
        # the noise of the poses that it was given
        assert 1e-3 < values[f'{name}.localization_rms'] < 5e-3
    ratio = values[f'{OURS}.true_rms'] / values[f'{SHORT}.true_rms']
    assert values[f'{SHORT}.ratio'] == ratio and values[f'{SHORT}.lost'] == (ratio < 1.0)
    table, = tables({runs[0].row: combined(runs)}, None)
    assert [str(cell) for cell in table.columns[0].cells] == ['straight']
    stack = driven(draw_robot(202), 'straight', PURSUIT, estimated=False)
    true, followed = stack.drive()
    assert 0.0 <= true[0].stamp_ns - stack.start_ns < 0.1 * NS_PER_S
    assert abs(true[-1].stamp_ns - stack.ended_ns) < 0.1 * NS_PER_S
    assert {one.stamp_ns for one in followed} < {one.stamp_ns for one in true}


def test_a_slide_in_place_is_named_and_the_wheels_do_not_drive_against_it():
    """A robot drives onto ground on which the slope of 8 degrees is more than it can hold."""
    robot = RobotParams(film=TreadFilmParams(wheels=()))
    simulator = SimulatorParams(seed=1, robot=robot, ground=ground('dry', {
        'dry': (0.6, 50.0, 0.01), 'ice': (0.12, 50.0, 0.01)}, [('ice', 0.8, 20.0)]))
    traits = Traits(slope=math.radians(7.5), direction=-0.5 * math.pi)
    slippery = DrawnRobot(simulator, traits, 50.0, 0.02, 0.02)
    path = planned([(0.0, 0.0, NAN), (1.2, 0.0, NAN), (1.2, 1.2, NAN)])
    stack = SlopeStack(stack_params(slippery, OURS, estimated=False), path, slippery)
    run_closed_loop(simulator, stack, 20.0, wheel_rate=50.0, control_rate=50.0,
                    plant=plant_with(traits))
    control = stack.trajectory
    assert control.state == PathState.STOPPED and 'the robot slides' in control.reason
    times = [one.stamp_ns for one in stack.truth]
    sliding = [(command.v_x, truth) for command in stack.commands if (
        command.stamp_ns > stack.ended_ns - NS_PER_S) and (
        truth := stack.truth[bisect(times, command.stamp_ns) - 1])]
    assert len(sliding) >= 19
    for v_x, truth in sliding:
        assert math.hypot(*truth.linear[:2]) > 0.3  # downhill
        assert abs(v_x) < 0.01
