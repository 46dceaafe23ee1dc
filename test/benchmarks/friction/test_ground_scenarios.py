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

"""The scenarios on several grounds have the described properties."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.friction.counting import COUNTED_FROM, revolutions_on_ground
from benchmarks.friction.forces import inputs_of, NO_TORQUE, TORQUE
from benchmarks.friction.ground_scenarios import (
    GROUND_SCENARIOS, HEAVY_SURFACES, s_curves, TORQUE_RATIO)
from benchmarks.friction.methods import ground_truth
from benchmarks.friction.records import match_rows, true_crossings
from benchmarks.scenarios import STANDSTILL
import numpy as np
import pytest
from smart_tire.samples import WheelSample

MIN_REVOLUTIONS = 15  # of each instrumented wheel on each ground

every_scenario = pytest.mark.parametrize(
    'scenario', GROUND_SCENARIOS.values(), ids=list(GROUND_SCENARIOS))


@every_scenario
def test_a_run_starts_at_standstill_with_the_stiffness_of_concrete(scenario):
    assert scenario.legs[0][0] == STANDSTILL
    assert scenario.legs[-1][0] < scenario.duration
    ground = scenario.simulator(1).ground
    assert scenario.robot.tire.longitudinal_stiffness == ground.stiffness[
        ground.names.index('concrete')]


@every_scenario
def test_gains_and_motors_of_the_simulated_robot_are_not_those_of_the_estimator(scenario):
    true = [scenario.simulator(seed).robot for seed in (1, 2)]
    assert len({one.film.stretch_gain for one in (*true, scenario.robot)}) == 3
    nominal = scenario.robot
    for one in true:  # motor errors are drawn by the simulator
        assert replace(one, film=nominal.film, center_of_mass=nominal.center_of_mass) == nominal


@pytest.mark.parametrize('name', ['tour', 'torque_constant', 'heavy'])
def test_every_ground_lasts_for_fifteen_revolutions(name):
    scenario = GROUND_SCENARIOS[name]
    records = ground_truth(scenario.events(1))
    for wheel in scenario.film.wheels:
        rows = match_rows(true_crossings(records, scenario.robot, wheel), [], wheel)
        index = revolutions_on_ground(rows)
        lasts = index[np.append(np.diff(index) < 0, True)]
        lasts = lasts[lasts > 1]  # one crossing may be on two grounds
        assert len(lasts) == 1 + len(scenario.ground.patches) + (name == 'tour')
        assert lasts.min() >= MIN_REVOLUTIONS - 1  # the first is incomplete
        assert lasts.min() > 2 * COUNTED_FROM


def test_the_center_of_mass_is_off_by_the_given_distance():
    scenario = GROUND_SCENARIOS['center_of_mass']
    off = np.subtract(scenario.simulator(1).robot.center_of_mass, scenario.robot.center_of_mass)
    assert off == pytest.approx([0.020, -0.010, 0.0])


def test_wrong_torque_constants_scale_the_efforts():
    scenario = replace(GROUND_SCENARIOS['torque_constant'], duration=4.0)
    wrong, right = (np.array([sample.effort for sample in inputs_of(one.events(1), TORQUE)
                              if isinstance(sample, WheelSample)])
                    for one in (scenario, replace(scenario, torque_ratio=1.0)))
    known = np.isfinite(wrong)  # not at standstill
    assert np.abs(wrong[known]).max() > 0.3
    assert right[known] == pytest.approx(TORQUE_RATIO * wrong[known])
    assert np.array_equal(known, np.isfinite(right))


def test_without_torque_no_wheel_sample_has_an_effort():
    events = replace(GROUND_SCENARIOS['tour'], duration=3.5).events(1)
    torques = {variant: [sample.effort for sample in inputs_of(events, variant)
                         if isinstance(sample, WheelSample)] for variant in (NO_TORQUE, TORQUE)}
    assert set(torques[NO_TORQUE]) == {None}
    assert None not in torques[TORQUE]


def test_the_heavy_robot_has_stiffer_tires_and_one_rear_film():
    scenario = GROUND_SCENARIOS['heavy']
    assert scenario.film.wheels == ('rear_left',)
    assert scenario.robot.mass == 30.0
    assert {HEAVY_SURFACES[name][1] for name in HEAVY_SURFACES} == {400.0, 200.0}


def test_s_curves_turn_both_ways_and_keep_the_mean_heading():
    legs, end = s_curves(2, 120.0, 70.0, 6.0)
    spans = np.diff([*(leg[0] for leg in legs), end])
    rates = [right - left for _, left, right in legs]
    assert spans @ rates == pytest.approx(0.0)
    assert end == pytest.approx(STANDSTILL + 12.0)
    assert min(rates) == -50.0 and max(rates) == 50.0
