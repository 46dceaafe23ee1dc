# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The scenarios of the friction benchmark have the described properties."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.events import truth_of
from benchmarks.friction.crossings import (
    COUNTED_FROM, match_rows, revolutions_on_ground, true_crossings)
from benchmarks.friction.scenarios import (
    FILM, GROUND_SCENARIOS, s_curves, SURFACE_SCENARIOS, TORQUE_RATIO)
from benchmarks.scenarios import STANDSTILL
import numpy as np
import pytest
from smart_tire.samples import WheelSample

every_scenario = pytest.mark.parametrize(
    'scenario', SURFACE_SCENARIOS.values(), ids=list(SURFACE_SCENARIOS))


def short(name, duration):
    """Return the start of a scenario."""
    return replace(SURFACE_SCENARIOS[name], duration=duration)


def of(events, topic):
    """Return the samples of ``topic``."""
    return [sample for _, name, sample in events if name == topic]


@every_scenario
def test_only_the_gains_of_the_films_differ_by_their_tolerance(scenario):
    nominal = scenario.robot.film
    errors = np.array([[np.divide(film.gains(wheel), nominal.gains(wheel)) - 1.0
                        for wheel in nominal.wheels]
                       for film in (scenario.simulator(seed).robot.film for seed in range(200))])
    assert np.all(np.abs(np.mean(errors, axis=0)) < 0.01)
    assert np.std(errors, axis=0) == pytest.approx(nominal.stretch_gain_tolerance, rel=0.2)
    true = scenario.simulator(1).robot.film
    assert replace(true, stretch_gain=nominal.stretch_gain) == nominal


@pytest.mark.parametrize(('name', 'nominal'), [('sand', 52.7), ('sand_given', 30.0)])
def test_on_sand_the_estimator_has_the_stiffness_of_concrete_or_the_true_one(name, nominal):
    scenario = SURFACE_SCENARIOS[name]
    assert scenario.robot.tire.longitudinal_stiffness == nominal
    ground = scenario.simulator(1).ground
    assert ground.stiffness[ground.names.index(ground.base)] == 30.0


def test_the_noisy_run_has_noise_lost_batches_and_a_low_wheel_rate():
    plain, noisy = (short(name, 12.0).events(1) for name in ('figure_eight', 'noisy'))
    for wheel in FILM.wheels:
        heard = [sum(sample.wheel == wheel for sample in of(events, 'tire_samples'))
                 for events in (plain, noisy)]
        assert heard[1] / heard[0] == pytest.approx(0.925, abs=0.05)
        baseline = [np.std([sample.volts for sample in of(events, 'tire_samples')
                            if sample.wheel == wheel][:300], axis=0) for events in (plain, noisy)]
        assert baseline[0] == pytest.approx([0.005] * 2, rel=0.15)
        assert baseline[1] == pytest.approx([0.02] * 2, rel=0.15)
    assert len(of(noisy, 'wheel_states')) == pytest.approx(48, abs=2)


@pytest.mark.parametrize('scenario', GROUND_SCENARIOS.values(), ids=list(GROUND_SCENARIOS))
def test_the_grounds_are_unknown_to_the_estimator_and_only_gains_and_mass_center_differ(scenario):
    assert scenario.legs[0][0] == STANDSTILL and scenario.legs[-1][0] < scenario.duration
    ground, nominal = scenario.simulator(1).ground, scenario.robot
    assert nominal.tire.longitudinal_stiffness == ground.stiffness[ground.names.index('concrete')]
    true = [scenario.simulator(seed).robot for seed in (1, 2)]
    assert len({one.film.stretch_gain for one in (*true, nominal)}) == 3
    for one in true:  # motor errors are drawn by the simulator
        assert replace(one, film=nominal.film, center_of_mass=nominal.center_of_mass) == nominal


@pytest.mark.parametrize('name', ['tour', 'torque_constant', 'heavy'])
def test_every_ground_lasts_for_fifteen_revolutions(name):
    scenario = GROUND_SCENARIOS[name]
    records = truth_of(scenario.events(1))
    for wheel in scenario.film.wheels:
        index = revolutions_on_ground(
            match_rows(true_crossings(records, scenario.robot, wheel), [], wheel))
        lasts = index[np.append(np.diff(index) < 0, True)]
        lasts = lasts[lasts > 1]  # one crossing may be on two grounds
        assert len(lasts) == 1 + len(scenario.ground.patches) + (name == 'tour')
        assert lasts.min() >= 14 > 2 * COUNTED_FROM  # the first is incomplete


def test_wrong_torque_constants_scale_the_efforts():
    scenario = replace(GROUND_SCENARIOS['torque_constant'], duration=4.0)
    wrong, right = (np.array([sample.effort for _, _, sample in one.events(1)
                              if isinstance(sample, WheelSample)])
                    for one in (scenario, replace(scenario, torque_ratio=1.0)))
    known = np.isfinite(wrong)  # not at standstill
    assert np.abs(wrong[known]).max() > 0.3
    assert right[known] == pytest.approx(TORQUE_RATIO * wrong[known])


def test_s_curves_turn_both_ways_and_keep_the_mean_heading():
    parts = np.array(s_curves(2, 120.0, 70.0, 6.0))
    assert parts[:, 0].sum() == pytest.approx(12.0)
    assert parts[:, 0] @ (parts[:, 2] - parts[:, 1]) == pytest.approx(0.0)
    assert set(parts[:, 2] - parts[:, 1]) == {-50.0, 50.0}
