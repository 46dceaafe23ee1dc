# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a calibration writes, of what its recordings show."""

from __future__ import annotations

from pathlib import Path

import pytest
from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.calibration.sequence import Calibration, STIFFNESS, STRAIGHT, TURNS
from smart_tire.identification import calibrate
from smart_tire.parameters.calibration_file import Identified


@pytest.fixture
def robots(monkeypatch):
    """Replace reading, identification and trial; return the robots that are calibrated."""
    seen = []

    def identified(inputs, robot, gains):
        seen.append(robot)
        made = Calibration(robot)
        made.accept(STRAIGHT, Identified(STIFFNESS, 60.0, 2.0))
        made.accept(TURNS, Identified('icr_x', 0.3, 0.01), Identified('effective_track', 0.6, 0.1))
        return made
    monkeypatch.setattr(calibrate, 'calibrate', identified)
    monkeypatch.setattr(calibrate, 'has_films', lambda *_: False)
    for name in ('read_recording', 'read_recorded'):
        monkeypatch.setattr(calibrate, name, lambda *_, **__: None)
    monkeypatch.setattr(calibrate, 'refusals', lambda params, found, recorded: {
        'icr_x': f'worse on {len(recorded)}'})
    return seen


BAGS = {'mixed': [Path('drive')], 'rest': [Path('rest')]}


def test_what_makes_the_estimates_worse_is_kept_with_the_reason(robots):
    made = calibrate.calibrate_bags(BAGS, EstimatorParams(), 'today')
    assert list(made.calibration.found) == [STIFFNESS, 'effective_track']
    assert made.calibration.kept == {'icr_x': 'worse on 1'}  # not on that at rest
    assert 'kept: icr_x: 0.0  (worse on 1)' in made.text and 'icr_x: 0.3' not in made.text
    assert robots[0] == EstimatorParams().robot


def test_without_a_mass_there_is_no_stiffness_and_an_imu_that_is_not_placed_is_unknown(robots):
    made = calibrate.calibrate_bags(BAGS, EstimatorParams(), 'today', given={'wheel_radius'})
    assert STIFFNESS not in made.calibration.found
    assert 'the mass, which is not given' in made.calibration.kept[STIFFNESS]
    assert robots[0].imu.position_sigma == 1.0
