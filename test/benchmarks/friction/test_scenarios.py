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

from dataclasses import replace

from benchmarks.friction.scenarios import FILM, FRICTION_SCENARIOS
import numpy as np
import pytest


def of(events, topic):
    """Return the samples of ``topic``."""
    return [sample for _, name, sample in events if name == topic]


@pytest.mark.parametrize(
    'scenario', FRICTION_SCENARIOS.values(), ids=list(FRICTION_SCENARIOS))
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
    scenario = FRICTION_SCENARIOS[name]
    assert scenario.robot.tire.longitudinal_stiffness == nominal
    ground = scenario.simulator(1).ground
    assert ground.stiffness[ground.names.index(ground.base)] == 30.0


def test_the_noisy_run_has_noise_lost_batches_and_a_low_wheel_rate():
    plain, noisy = (replace(FRICTION_SCENARIOS[name], duration=5.0).events(1)
                    for name in ('figure_eight', 'noisy'))
    for wheel in FILM.wheels:
        heard = [sum(sample.wheel == wheel for sample in of(events, 'tire_samples'))
                 for events in (plain, noisy)]
        assert heard[1] / heard[0] == pytest.approx(0.925, abs=0.05)
        baseline = [np.std([sample.volts for sample in of(events, 'tire_samples')
                            if sample.wheel == wheel][:300], axis=0) for events in (plain, noisy)]
        assert baseline[0] == pytest.approx([0.005] * 2, rel=0.15)
        assert baseline[1] == pytest.approx([0.02] * 2, rel=0.15)
    assert len(of(noisy, 'wheel_states')) == pytest.approx(20, abs=2)
