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
from scipy.signal import lfilter
from smart_tire.errors import EstimatorError, ParameterError
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.models.film.hysteresis import DuhemParams, respond
from smart_tire.papers.film_bench import identify
from smart_tire.papers.film_measurement import smoothed
from support.film_bench import several_loops, TRUE
from support.identifying import assert_agrees, assert_consistent

PRODUCTS = ('alpha_gain', 'a_gain', 'b_gain')
OPERATOR = DuhemParams(alpha=5.0, a=2.0, b=1.1)
VALUES = OPERATOR.alpha, OPERATOR.a, OPERATOR.b
TIME = np.arange(3000) / 500.0
INPUT = 0.5 * (1.0 - np.cos(2.0 * np.pi * TIME)) * np.repeat([1.0, 0.7, 0.4], 1000)


def fitted(output, **options):
    return identify(TIME, INPUT, output, **options)


def values(fit):
    return [getattr(fit, name).value for name in PRODUCTS]


@pytest.mark.parametrize('drift, rel', [(0.0, 1e-5), (0.01, 1e-4)])
def test_without_noise_the_operator_is_identified_exactly(drift, rel):
    fit = fitted(respond(INPUT, OPERATOR, start=(0.0, 0.1)) + 3.0 + drift * TIME)
    assert values(fit) == pytest.approx(VALUES, rel=rel)
    assert fit.valid and fit.rms < 1e-5 and abs(fit.low_corner.value) < 1e-5
    assert all(getattr(fit, name).determined for name in PRODUCTS)


def test_the_amplifier_is_separated_from_the_film():
    output, corner = respond(INPUT, OPERATOR), 2.0 * np.pi * 0.02
    passed = lfilter([1.0, -1.0], [1.0 + 0.001 * corner, 0.001 * corner - 1.0], output)
    fit = fitted(passed + 0.7)
    assert values(fit) == pytest.approx(VALUES, rel=1e-3)
    assert fit.low_corner.value == pytest.approx(0.02, rel=1e-2)


def test_no_amplifier_is_assumed_if_its_corner_is_negative():
    output = respond(INPUT, OPERATOR)
    grown = output + 0.1 * np.cumsum(output) / 500.0
    fit = fitted(grown)
    assert fit.low_corner.value == 0.0 and fit.low_corner.sigma == np.inf


@pytest.mark.parametrize('seeds', [3, pytest.param(10, marks=pytest.mark.long)])
def test_errors_agree_with_the_standard_errors(seeds):
    exact = respond(INPUT, OPERATOR)
    fits = [fitted(exact + 0.01 * np.random.default_rng([seed, 6]).standard_normal(exact.size))
            for seed in range(seeds)]
    for name, true in zip(PRODUCTS, VALUES):
        assert_consistent([getattr(fit, name) for fit in fits], true, 0.6, 1.5)


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
        assert_agrees(getattr(fit, name), true)
        assert getattr(fit, name).sigma < 0.01 * true
    assert fit.low_corner.value == pytest.approx(0.001, rel=0.5)


def test_a_small_loop_makes_only_b_observable():
    rng, small = np.random.default_rng(9), 0.01 * INPUT
    output = respond(small, OPERATOR) + 5e-4 * rng.standard_normal(TIME.size)
    fit = identify(TIME, small, output)
    assert fit.b_gain.determined and not fit.alpha_gain.determined
    assert not fit.a_gain.determined
    assert_agrees(fit.b_gain, OPERATOR.b, 4.0)


def test_untrusted_samples_have_no_weight():
    output = respond(INPUT, OPERATOR)
    trusted = np.ones(output.size, dtype=bool)
    trusted[500:900] = False
    output[500:900] += 1.0
    assert values(fitted(output, trusted=trusted, amplifier=False)) == pytest.approx(
        VALUES, rel=1e-4)


@pytest.mark.parametrize('deflection, output, error, reason', [
    (np.linspace(0.0, 1.0, 3000), INPUT, EstimatorError, 'never falls .* requires both branches'),
    (np.linspace(1.0, 0.0, 3000), INPUT, EstimatorError, 'never rises .* requires both branches'),
    (np.full(3000, 0.4), INPUT, EstimatorError, 'input is constant .0.4.'),
    (INPUT, np.full(3000, 2.0), EstimatorError, 'output is constant .2.0.'),
    (INPUT, np.zeros(2999), ParameterError, '2999 outputs')])
def test_a_recording_without_a_loop_is_refused_with_the_reason(deflection, output, error, reason):
    with pytest.raises(error, match=reason):
        identify(TIME, deflection, output)
