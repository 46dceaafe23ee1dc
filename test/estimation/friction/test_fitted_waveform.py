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

"""Measured and fitted waveforms of a crossing, as they are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.friction.fitted_waveform import CURVE_STEP, fitted_waveforms
from smart_tire.estimation.friction.waveform_fit import WaveformFitter
from smart_tire.estimation.friction.waveform_model import PerFilm
from smart_tire.parameters import build, RobotParams
from support.crossings import crossing_samples, WHEEL

ROBOT = build(RobotParams, {})


@pytest.fixture(scope='module')
def fitted():
    """Return a fitter and its fit of one crossing."""
    fitter = WaveformFitter(ROBOT, ROBOT.film.gains(WHEEL), ROBOT.film.bending(WHEEL))
    return fitter, fitter.fit(crossing_samples(
        np.random.default_rng(0), ROBOT, slip=0.1, normalized_slip=0.2))


def test_curves_pass_through_the_model_at_the_samples(fitted):
    fitter, fit = fitted
    films = fitted_waveforms(fit, ROBOT, WHEEL)
    assert [one.film for one in films] == [0, 1]
    for one, volts in zip(films, fitter.volts(fit)):
        drawn = np.interp(one.position, one.fit_position, one.fit_volts)
        assert np.max(np.abs(drawn - volts)) < 0.01  # V, by the steps of the curve
        assert np.max(np.diff(one.fit_position)) < 1.1 * CURVE_STEP


def test_positions_are_zero_where_film_and_patch_have_the_same_center(fitted):
    _, fit = fitted
    for i, (one, film) in enumerate(zip(fitted_waveforms(fit, ROBOT, WHEEL), fit.samples.films)):
        center = fit.film_parameter(i, PerFilm.CENTER).value
        assert one.position == pytest.approx(film.distance - center)
        assert one.volts is film.volts
        assert (one.fit_position[0], one.fit_position[-1]) == pytest.approx(
            (one.position.min(), one.position.max()))
