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

"""Latency from speed changes, for robots that record one speed for all wheels."""

from __future__ import annotations

import numpy as np
import pytest
from smart_tire.calibration.robot.accelerometer_fit import fit_speed_changes
from smart_tire.errors import EstimatorError
from smart_tire.parameters import build, RobotParams
from support.driving import drive
from support.identifying import random_signal, recorded

FIRM = build(RobotParams, {'tire.longitudinal_stiffness': 2000.0})  # stiff tires, little slip


def straight_run(seed, seconds=60.0, size=0.3, **options):
    rng = np.random.default_rng([seed, 9])
    time = np.arange(round(1e3 * seconds)) * 1e-3
    gate = np.clip(np.minimum(time - 3.0, seconds - 3.0 - time), 0.0, 1.0)
    speed = gate * (0.7 + random_signal(rng, seconds, size, 0.4))
    return drive(np.stack([speed, speed], axis=1), np.zeros((len(time), 2)), seed=seed,
                 robot=FIRM, **options)


@pytest.mark.parametrize('options', [{}, {'wheel_rate': 4.0, 'positions': False}], ids=str)
def test_the_latency_is_correct_within_its_standard_error(options):
    errors, sigmas = [], []
    for seed in range(8):
        late = float(np.random.default_rng(seed).uniform(-0.05, 0.25))
        fit = fit_speed_changes(recorded(straight_run(seed, wheel_latency=late, **options)), FIRM)
        errors.append((fit.latency.value - late) / fit.latency.sigma)
        sigmas.append(fit.latency.sigma)
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 1.6
    assert np.median(sigmas) < 0.01


def test_the_radius_is_rough_and_its_sigma_shows_it():
    radius = fit_speed_changes(recorded(straight_run(1)), FIRM).radius
    assert radius.value == pytest.approx(FIRM.wheel_radius, rel=0.03)
    assert radius.sigma > 0.05 * radius.value


def test_soft_tires_leave_the_latency_uncertain():
    soft = build(RobotParams, {'tire.longitudinal_stiffness': 20.0})
    firm = fit_speed_changes(recorded(straight_run(2)), FIRM).latency.sigma
    try:
        assert fit_speed_changes(recorded(straight_run(2)), soft).latency.sigma >= firm
    except EstimatorError as error:
        assert 'standard error' in str(error)


def test_a_constant_speed_is_refused():
    time = np.arange(60_000) * 1e-3
    steady = np.full((len(time), 2), 0.7)
    with pytest.raises(EstimatorError):
        fit_speed_changes(recorded(drive(steady, 0.0 * steady, robot=FIRM)), FIRM)
