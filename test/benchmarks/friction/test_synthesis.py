# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Synthesized crossings: detectable, consistent with their case, and random."""

from __future__ import annotations

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


@pytest.mark.parametrize('case', [Case(slip=0.02), Case(slip=0.3), Case(slip=-0.3),
                                  Case(slip=0.1, rpm=200.0), Case(slip=0.1, noise=0.02),
                                  Case(slip=0.1, release='state')])
def test_both_films_are_detected_near_their_positions(case):
    source = CrossingSynthesizer(case, 1)
    for _ in range(20):
        crossing = source.crossing()
        assert [film.film for film in crossing.samples.films] == [0, 1]
        for detection, position in zip(crossing.samples.detections,
                                       (0.0, case.robot.film.spacing)):
            assert abs(detection.center - position) < 0.004
        assert 0 < crossing.begin_ns < crossing.end_ns


def test_crossings_are_reproducible_by_seed():
    first, again, other = (volts(CrossingSynthesizer(Case(slip=0.1), seed).crossing())
                           for seed in (1, 1, 2))
    assert all(np.array_equal(a, b) for a, b in zip(first, again))
    assert not any(np.array_equal(a[:40], b[:40]) for a, b in zip(first, other))


def test_samples_are_quantized():
    film = Case(slip=0.1).robot.film
    for one in volts(CrossingSynthesizer(Case(slip=0.1), 1).crossing()):
        codes = (one + film.rest_voltage) / film.code_voltage
        assert codes == pytest.approx(np.rint(codes), abs=1e-6)


def test_driving_increases_the_signal_and_braking_decreases_it():
    tops = [np.mean([volts(source.crossing())[0].max() for _ in range(20)])
            for source in (CrossingSynthesizer(Case(slip=slip), 1) for slip in (-0.2, 0.0, 0.2))]
    assert tops[0] < tops[1] < tops[2]


def test_without_noise_the_model_fits_a_crossing():
    case = Case(slip=0.15, noise=0.0, combined=1.3)
    film = case.robot.film
    fitter = WaveformFitter(case.robot, film.gains('front_right'), film.bending('front_right'),
                            known_shape())
    fit = fitter.fit(CrossingSynthesizer(case, 3, gain_error=0.0).crossing().samples)
    assert fit.residual_rms < film.code_voltage
    assert fit.shared(Shared.SLIP)[0] == pytest.approx(case.slip, rel=0.02)
    assert fit.shared(Shared.NORM_SLIP)[0] == pytest.approx(case.normalized_slip, rel=0.02)
