# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Identified film gains as parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from smart_tire.calibration.film_gains import identify_gains
from smart_tire.identification.films import gain_parameters
from smart_tire.parameters import build, RobotParams
from smart_tire.parameters.calibration_file import identified_text
from support.gains import recording

NOMINAL = RobotParams()
WHEELS = ('front_left', 'front_right')


def parameters(found, given):
    return {item.name: item for item in gain_parameters(found, given)}


def test_a_film_without_result_keeps_its_gain_and_is_named():
    given = replace(NOMINAL, film=replace(NOMINAL.film, wheels=WHEELS))
    rng = np.random.default_rng(1)
    found = identify_gains([[*recording(rng, NOMINAL, films=(0,), wheel='front_left'),
                             *recording(rng, NOMINAL)]], given)
    written = parameters(found, given)
    gains = written['film.stretch_gain']
    assert len(gains.value) == 4
    assert gains.value[1] == NOMINAL.film.stretch_gain[1]
    assert gains.note == 'film 2 of front_left unchanged'
    assert written['film.stretch_gain_tolerance'].value == pytest.approx(
        max(sigma / value for value, sigma in zip(gains.value, gains.sigma)))
    build(RobotParams, {name: item.value for name, item in written.items()}
          | {'film.wheels': list(WHEELS)})
    assert 'contact_length' in identified_text([], written.values())


def test_lengths_are_written_if_gains_are_not_observable():
    found = identify_gains([recording(np.random.default_rng(2), NOMINAL, turns=(0.003, -0.004))],
                           NOMINAL)
    written = parameters(found, NOMINAL)
    assert set(written) == {'film.bending_peak', 'film.spacing', 'tire.contact_length'}


def test_identified_positions_replace_given_positions():
    given = replace(NOMINAL, film=replace(NOMINAL.film, positions=(0.01, 0.04)))
    found = identify_gains([recording(np.random.default_rng(3), NOMINAL)], given)
    written = parameters(found, given)
    assert written['film.positions'].value == pytest.approx((0.01, 0.04), abs=4e-4)
    assert 'film.spacing' not in written
