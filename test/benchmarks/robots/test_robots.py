# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Robots drawn at random: their plant, their reproducibility, and a run of the benchmark."""

from __future__ import annotations

from dataclasses import replace
import json

from benchmarks.events import has_efforts, without_efforts
from benchmarks.robots import run
from benchmarks.robots.draws import (
    DISTRIBUTIONS, Draw, draw, FILMS, ROWS, TORQUES, TUNING_SEED)
from benchmarks.robots.plant import Lift, MIN_LOAD, plant_with, Push, Traits
from benchmarks.robots.scoring import MU, QUANTITIES, run_robot
import numpy as np
import pytest
from smart_tire.analysis.pipeline import Pipeline
from smart_tire.parameters import RobotParams
from smart_tire.parameters.simulation import DriveParams, SurfaceParams
from smart_tire.samples import GRAVITY, Odometry, TireSample
from smart_tire.simulation.plant import Plant, SurfaceMap, TIME_STEP

CONCRETE = SurfaceParams(base='concrete', patches=())


def driven(kind: type[Plant], duty=(0.4, 0.3, 0.4, 0.3), seconds=0.4):
    """Return a plant after some time with constant duties."""
    plant = kind(RobotParams(), DriveParams(), SurfaceMap(CONCRETE))
    for _ in range(round(seconds / TIME_STEP)):
        plant.step(duty)
    return plant


def motion(plant):
    """Return the state of a plant."""
    return [plant.x, plant.y, plant.yaw, plant.v_x, plant.v_y, plant.yaw_rate,
            *plant.wheel_speed, *plant.load]


def test_without_traits_the_plant_is_that_of_the_simulator():
    assert motion(driven(plant_with(Traits()))) == pytest.approx(motion(driven(Plant)), rel=1e-9)


@pytest.mark.parametrize('trait', [
    {'resistance_share': 0.0}, {'stiffness_ratio': 0.6}, {'relaxation_length': 0.03},
    {'load_transfer_time': 0.06}, {'stiffness_scale': (1.05, 1.0, 1.0, 1.0)}, {'slope': 0.03},
    {'pushes': (Push(0.1, 0.4, (10.0, 0.0), 0.0),)}, {'lifts': (Lift(0.1, 0.5, 0),)}])
def test_each_trait_changes_the_motion(trait):
    assert motion(driven(plant_with(Traits(**trait)))) != pytest.approx(
        motion(driven(Plant)), rel=1e-4)


def test_friction_falls_with_the_slip_from_that_of_the_surface():
    plant = driven(plant_with(Traits(fall=0.4)))
    (mu,) = {surface.friction for surface in SurfaceMap(CONCRETE).surfaces.values()
             if surface.name == 'concrete'}
    assert [one.friction for one in plant.surface] == [mu] * 4
    plant._slip = [(5.0, 0.0)] * 4
    plant._update_wheels()
    assert all(0.6 * mu < one.friction < 0.7 * mu for one in plant.surface)


def test_a_lifted_wheel_has_no_load_and_the_weight_remains():
    plant = driven(plant_with(Traits(lifts=(Lift(0.0, 1.0, 1),))), duty=(0.0,) * 4)
    assert plant.load[1] == MIN_LOAD
    assert sum(plant.load) == pytest.approx(RobotParams().mass * GRAVITY, rel=0.01)


def test_gravity_rolls_the_robot_downhill():
    class Downhill(plant_with(Traits(slope=0.01))):

        def _vertical(self):
            return -0.3, 0.0
    assert driven(Downhill, duty=(0.0,) * 4).v_x > 0.01


@pytest.mark.parametrize('name', ROWS)
def test_a_draw_is_reproducible_and_the_estimators_get_the_nominal_robot(name):
    one, other = draw(name, TUNING_SEED), draw(name, TUNING_SEED + 1)
    assert one == draw(name, TUNING_SEED) != other
    assert one.robot == other.robot
    assert one.true.wheel_radius != one.robot.wheel_radius == one.params.robot.wheel_radius
    assert one.known_radius().robot.wheel_radius == one.true.wheel_radius
    assert 40.0 < one.duration < 60.0
    exact = draw(name, TUNING_SEED, tuple(DISTRIBUTIONS))
    drawn = {'film', *{'gears': ('motor',), 'imu_arm': ('imu',)}.get(name, ())}  # by the row
    assert replace(exact.true, **{part: getattr(exact.robot, part) for part in drawn}) == (
        exact.robot)
    assert set(exact.true.film.stretch_gain) == set(exact.robot.film.stretch_gain)
    falls = {'fall': 0.0, 'fall_onset': Traits().fall_onset} if name == 'early_fall' else {}
    assert replace(
        exact.traits, terrain_seed=0, pushes=(), lifts=(), sides=(), **falls) == Traits()


@pytest.mark.long
def test_a_run_writes_a_table_and_results(monkeypatch, tmp_path, capsys):
    whole = draw('no_torque', 1)
    monkeypatch.setattr(run, 'draw', lambda name, seed, nominal=(): Draw(
        name, seed, whole.robot, whole.simulator, whole.traits, whole.legs, 6.0, {}))
    assert run.ROBOTS.main(['--quick', '--runs', 'no_torque', '--out', str(tmp_path)]) == 0
    assert ROWS['no_torque'].title in capsys.readouterr().out
    results = json.loads((tmp_path / 'results.json').read_text())
    assert {name.partition('.')[0] for name in results['rows']['no_torque']['over_seeds']} == {
        *QUANTITIES, 'load'}
    assert ROWS['no_torque'].title in (tmp_path / 'robots.md').read_text()


def test_the_start_of_a_drive_is_cut():
    one = replace(draw('start_in_motion', 1), duration=8.0)
    speeds = [sample.linear[0] for sample in one.truth() if isinstance(sample, Odometry)]
    assert len(speeds) == pytest.approx(200, abs=2)
    assert abs(speeds[0]) > 0.1


def test_inputs_that_other_robots_do_not_have_are_left_out():
    one = replace(draw('concrete', 1), duration=1.0)
    whole = one.inputs()
    plain = replace(one, without=[FILMS, TORQUES]).inputs()
    assert has_efforts(whole) and any(isinstance(sample, TireSample) for sample in whole)
    assert plain == [sample for sample in without_efforts(whole)
                     if not isinstance(sample, TireSample)]
    assert replace(one, without=[FILMS]).inputs() == [
        sample for sample in whole if not isinstance(sample, TireSample)]


@pytest.mark.long
def test_starts_and_stops_with_a_relaxation_length_are_no_changes_of_the_ground():
    one = draw('straight', 502)  # falling friction from the peak, relaxation over 19 mm
    pipeline = Pipeline(one.params)
    speeds = [sample for given in one.inputs() for sample in pipeline.update(given)
              if isinstance(sample, Odometry)]
    truth = {sample.stamp_ns: sample.linear[0] for sample in one.truth()
             if isinstance(sample, Odometry)}
    stamps = sorted(truth)
    true = np.interp([sample.stamp_ns for sample in speeds], stamps,
                     [truth[stamp] for stamp in stamps])
    errors = np.array([sample.linear[0] for sample in speeds]) - true
    variances = np.array([sample.twist_covariance[0] for sample in speeds])
    assert np.sqrt(np.mean(errors ** 2)) < 0.02  # 0.078 without the relaxation
    assert 0.3 < np.mean(errors ** 2 / variances) < 2.0  # 15


@pytest.mark.long
@pytest.mark.parametrize('seed', [9039, 9040, 9045, 9053])
def test_friction_on_straight_starts_and_stops_is_within_four_sigmas(seed):
    """Up to 12 with films that ignore the relaxation of tires; 9040: with a short secant."""
    errors = run_robot(draw('straight', seed)).errors[MU]
    known = np.isfinite(errors.error) & np.isfinite(errors.sigma)
    assert np.abs(errors.error[known] / errors.sigma[known]).max(initial=0.0) < 4.0
