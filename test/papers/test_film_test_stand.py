# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Simulated test stand: film, amplifier, laser, converter and motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from smart_tire.errors import ParameterError
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.models.film.hysteresis import respond, TABLE_I, TABLE_I_GAIN
from smart_tire.papers.film_experiments import bench
from smart_tire.simulation.film import FilmTestStand
from support.film_bench import sine

IDEAL = FilmTestStand(low_corner=0.0, high_corner=1e6, charge_noise=0.0, laser_noise=0.0, bits=32)
SETTLED = 100  # samples after the step


def test_without_instrument_errors_the_output_is_the_charge_of_the_film():
    moved = sine(0.012, 5.0, 1.0, 1000.0)
    recording = bench(IDEAL, moved, 1000.0, 1)
    np.testing.assert_array_equal(recording.input, moved)
    exact = respond(TABLE_I_GAIN * FILMS['25x3'].normalized_charge(moved), TABLE_I)
    # tolerance: the stage moves at constant speed between samples and cuts the peak of the sine
    np.testing.assert_allclose(recording.output, exact, rtol=0.0, atol=2e-12)
    np.testing.assert_allclose(np.diff(recording.time), 1e-3)


def test_the_noise_depends_on_the_seed_only():
    moved = np.full(20_000, 0.003)
    runs = [bench(FilmTestStand(), moved, 1000.0, seed) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(runs[0].output, runs[1].output)
    assert np.any(runs[0].output != runs[2].output)
    assert (runs[0].input - moved).std() == pytest.approx(5e-6, rel=0.03)
    # stationary film: noise, and the slow drain of the amplifier
    assert np.diff(runs[0].output).std() / 2**0.5 == pytest.approx(0.02e-9, rel=0.05)


def test_a_constant_charge_decays_with_the_lower_corner_frequency():
    moved = np.concatenate([np.zeros(2), np.full(2000, 0.005)])
    output = bench(replace(IDEAL, low_corner=0.5), moved, 1000.0, 1).output
    since = np.arange(1, 1000) / 1000.0
    np.testing.assert_allclose(output[2 + SETTLED:1000] / output[SETTLED], np.exp(
        -np.pi * since[1:1000 - 1 - SETTLED]), rtol=0.02)


def test_a_charge_step_rises_with_the_upper_corner_frequency():
    moved = np.concatenate([np.zeros(10), np.full(2000, 0.005)])
    output = bench(replace(IDEAL, high_corner=5.0), moved, 1000.0, 1).output
    reached = output[10:200] / output[-1]
    since = np.arange(190) / 1000.0
    np.testing.assert_allclose(reached, -np.expm1(-10.0 * np.pi * since), atol=0.02)


def test_the_converter_quantizes_and_saturates():
    coarse = replace(IDEAL, bits=8, full_scale=2e-9)
    output = bench(coarse, sine(0.012, 1.0, 1.0, 1000.0), 1000.0, 1).output
    lsb = 4e-9 / 256.0
    np.testing.assert_allclose(output / lsb, np.round(output / lsb), atol=1e-9)
    assert output.min() == -2e-9


def test_peaks_are_independent_of_the_frequency():
    # Fig. 6(b): 10 mm x 1 mm x 28 um, 2 mm peak amplitude, 1 to 10 Hz
    small = replace(FilmTestStand(), film=FILMS['10x1'])
    peaks = [-bench(small, sine(0.004, frequency, 4.0, 1000.0), 1000.0, 3).output[-2000:].min()
             for frequency in (1.0, 2.0, 5.0, 10.0)]
    assert max(peaks) / min(peaks) < 1.05


def test_a_film_cannot_be_stretched():
    with pytest.raises(ParameterError, match='stretched'):
        bench(FilmTestStand(), np.full(50, -1e-3), 1000.0, 1)
