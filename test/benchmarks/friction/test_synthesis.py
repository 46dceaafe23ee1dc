# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Synthesized crossings: consistent with their case, and random."""

from benchmarks.friction.grid import Case, LOAD
from benchmarks.friction.synthesis import CrossingSynthesizer
import numpy as np
import pytest
from smart_tire.estimation.friction.waveform_fit import WaveformFitter
from smart_tire.estimation.friction.waveform_model import Shared
from smart_tire.models.tire import brush_tire
from support.crossings import known_shape


def volts(crossing):
    return [film.volts for film in crossing.samples.films]


@pytest.mark.parametrize('case', [Case(slip=0.1), Case(slip=-0.2, mu=0.2, combined=1.3)])
def test_the_normalized_slip_of_a_case_agrees_with_the_brush_tire(case):
    ratio = brush_tire.adhesion_ratio(
        case.total_slip, case.mu, LOAD, case.robot.tire.longitudinal_stiffness)
    assert 1.0 - case.normalized_slip == pytest.approx(float(ratio))


def test_crossings_are_reproducible_by_seed():
    first, again, other = (volts(CrossingSynthesizer(Case(slip=0.1), seed).crossing())
                           for seed in (1, 1, 2))
    assert all(np.array_equal(a, b) for a, b in zip(first, again))
    assert not any(np.array_equal(a[:40], b[:40]) for a, b in zip(first, other))


@pytest.mark.parametrize('slip', [0.15, -0.15])
def test_without_noise_the_model_fits_a_crossing_of_quantized_samples(slip):
    case = Case(slip=slip, noise=0.0, combined=1.3)
    film = case.robot.film
    fitter = WaveformFitter(case.robot, film.gains('front_right'), film.bending('front_right'),
                            known_shape())
    crossing = CrossingSynthesizer(case, 3, gain_error=0.0).crossing()
    for one in volts(crossing):
        codes = (one + film.rest_voltage) / film.code_voltage
        assert codes == pytest.approx(np.rint(codes), abs=1e-6)
    assert 0 < crossing.begin_ns < crossing.end_ns
    fit = fitter.fit(crossing.samples)
    assert fit.residual_rms < film.code_voltage
    assert fit.shared(Shared.SLIP)[0] == pytest.approx(case.slip, rel=0.02)
    assert fit.shared(Shared.NORM_SLIP)[0] == pytest.approx(case.normalized_slip, rel=0.02)
