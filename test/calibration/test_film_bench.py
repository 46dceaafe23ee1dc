# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Identification of a Duhem operator: values, standard errors and limits."""

from __future__ import annotations

import numpy as np
import pytest
from smart_tire.calibration.film_bench import identify
from smart_tire.errors import EstimatorError, ParameterError
from smart_tire.estimation.film.measure import smoothed
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.models.film.hysteresis import DuhemParams, respond
from support.film_bench import several_loops, TRUE

PRODUCTS = ('alpha_gain', 'a_gain', 'b_gain')
OPERATOR = DuhemParams(alpha=5.0, a=2.0, b=1.1)
TIME = np.arange(3000) / 500.0
INPUT = 0.5 * (1.0 - np.cos(2.0 * np.pi * TIME)) * np.repeat([1.0, 0.7, 0.4], 1000)


def fitted(output, **options):
    return identify(TIME, INPUT, output, **options)


def values(fit):
    return [getattr(fit, name).value for name in PRODUCTS]


def test_without_noise_the_operator_is_identified_exactly():
    fit = fitted(respond(INPUT, OPERATOR, start=(0.0, 0.1)) + 3.0)
    assert values(fit) == pytest.approx([5.0, 2.0, 1.1], rel=1e-5)
    assert fit.valid and fit.rms < 1e-5
    assert all(getattr(fit, name).determined for name in PRODUCTS)


def test_offset_and_drift_are_separated_from_the_film():
    fit = fitted(respond(INPUT, OPERATOR) + 0.7 + 0.01 * TIME)
    assert values(fit) == pytest.approx([5.0, 2.0, 1.1], rel=1e-4)
    assert abs(fit.low_corner.value) < 1e-5


def test_the_amplifier_is_separated_from_the_film():
    output, corner = respond(INPUT, OPERATOR), 2.0 * np.pi * 0.02
    # the differential equation of the amplifier, integrated step by step
    passed = np.zeros(output.size)
    for k in range(1, output.size):
        passed[k] = ((passed[k - 1] * (1.0 - 0.001 * corner) + output[k] - output[k - 1])
                     / (1.0 + 0.001 * corner))
    fit = fitted(passed + 0.7)
    assert values(fit) == pytest.approx([5.0, 2.0, 1.1], rel=1e-3)
    assert fit.low_corner.value == pytest.approx(0.02, rel=1e-2)


def test_no_amplifier_is_assumed_if_its_corner_is_negative():
    output = respond(INPUT, OPERATOR)
    grown = output + 0.1 * np.cumsum(output) / 500.0
    fit = fitted(grown)
    assert fit.low_corner.value == 0.0 and fit.low_corner.sigma == np.inf


def test_errors_agree_with_the_standard_errors():
    rng, pulls = np.random.default_rng(6), []
    exact = respond(INPUT, OPERATOR)
    for _ in range(25):
        fit = fitted(exact + 0.01 * rng.standard_normal(exact.size))
        pulls.append([(getattr(fit, name).value - true) / getattr(fit, name).sigma
                      for name, true in zip(PRODUCTS, (5.0, 2.0, 1.1))])
    rms = np.sqrt(np.mean(np.square(pulls), axis=0))
    assert np.all((rms > 0.6) & (rms < 1.5)), rms


def test_correlated_noise_increases_the_standard_errors():
    rng, exact = np.random.default_rng(7), respond(INPUT, OPERATOR)
    white = rng.standard_normal(exact.size)
    correlated = np.convolve(rng.standard_normal(exact.size + 19), np.ones(20) / 20**0.5, 'valid')
    one, other = (fitted(exact + 0.01 * noise) for noise in (white, correlated))
    assert one.correlation == pytest.approx(1.0, abs=0.3)
    assert other.correlation > 8.0
    assert other.b_gain.sigma > 2.0 * one.b_gain.sigma


def test_outliers_have_no_weight():
    rng, output = np.random.default_rng(8), respond(INPUT, OPERATOR)
    output = output + 0.005 * rng.standard_normal(output.size)
    clean = fitted(output)
    wrong = rng.choice(output.size, 150, replace=False)
    output[wrong] += rng.choice([-1.0, 1.0, 20.0], wrong.size)
    fit = fitted(output)
    assert not fit.counted[wrong].any()
    for name in PRODUCTS:
        one, other = getattr(fit, name), getattr(clean, name)
        assert abs(one.value - other.value) < 1.5 * other.sigma
        assert one.sigma == pytest.approx(other.sigma, rel=0.2)


def test_table_i_is_recovered_from_the_bench_within_its_error_bars():
    recording = several_loops()
    deflection = np.maximum(smoothed(recording.input)[0], 0.0)
    fit = identify(recording.time, FILMS['25x3'].normalized_charge(deflection), recording.output)
    for name, true in TRUE.items():
        estimate = getattr(fit, name)
        assert abs(estimate.value - true) < 3.0 * estimate.sigma
        assert estimate.sigma < 0.01 * true
    assert fit.low_corner.value == pytest.approx(0.001, rel=0.5)


def test_a_small_loop_makes_only_b_observable():
    rng, small = np.random.default_rng(9), 0.01 * INPUT
    output = respond(small, OPERATOR) + 5e-4 * rng.standard_normal(TIME.size)
    fit = identify(TIME, small, output)
    assert fit.b_gain.determined and not fit.alpha_gain.determined
    assert not fit.a_gain.determined
    assert abs(fit.b_gain.value - 1.1) < 4.0 * fit.b_gain.sigma


def test_untrusted_samples_have_no_weight():
    output = respond(INPUT, OPERATOR)
    trusted = np.ones(output.size, dtype=bool)
    trusted[500:900] = False
    output[500:900] += 1.0
    assert values(fitted(output, trusted=trusted, amplifier=False)) == pytest.approx(
        [5.0, 2.0, 1.1], rel=1e-4)


@pytest.mark.parametrize('deflection, reason', [
    (np.linspace(0.0, 1.0, 3000), 'never falls .* requires both branches'),
    (np.linspace(1.0, 0.0, 3000), 'never rises .* requires both branches'),
    (np.full(3000, 0.4), 'input is constant .0.4.')])
def test_a_recording_without_a_loop_is_refused_with_the_reason(deflection, reason):
    with pytest.raises(EstimatorError, match=reason):
        identify(TIME, deflection, deflection + 0.1 * np.sin(TIME))


def test_a_constant_output_and_wrong_sizes_are_refused():
    with pytest.raises(EstimatorError, match='output is constant .2.0.'):
        fitted(np.full(3000, 2.0))
    with pytest.raises(ParameterError, match='2999 outputs'):
        fitted(np.zeros(2999))
