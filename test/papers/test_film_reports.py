# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Figures of paper A: properties of the results of test stand, models and identification."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest

from smart_tire.models.film.buckling_film import FILMS
from smart_tire.models.film.elastica import TOUCHING_STROKE
from smart_tire.models.film.hysteresis import DuhemParams, TABLE_I, TABLE_I_GAIN
from smart_tire.papers import film_experiments, paper_a
from smart_tire.simulation.film import FilmTestStand


@pytest.fixture(scope='module')
def trace():
    return film_experiments.buckling_test()


@pytest.fixture(scope='module')
def rate():
    return film_experiments.rate_independence()


@pytest.fixture(scope='module')
def amplitude():
    return film_experiments.proportionality()


@pytest.fixture(scope='module')
def identified():
    return film_experiments.identification()


def test_table_one_is_for_its_film_and_others_keep_the_shape_of_the_loop():
    assert FilmTestStand.of(FILMS['25x3']).gain == TABLE_I_GAIN
    assert FilmTestStand.of(FILMS['25x3']).hysteresis == TABLE_I
    for name in ('32x3', '10x1'):
        film = FilmTestStand.of(FILMS[name])
        assert film.hysteresis.alpha * film.gain == pytest.approx(TABLE_I.alpha * TABLE_I_GAIN)
    # K is proportional to width times thickness squared over length
    ratio = FilmTestStand.of(FILMS['10x1']).gain / FilmTestStand.of(FILMS['25x3']).gain
    assert ratio == pytest.approx(1.0 / 3.0 * (28.0 / 110.0)**2 * 25.0 / 10.0)


def test_the_charge_lags_and_the_loop_is_open(trace):
    assert 0.0 < trace.loop.lag < 0.5
    assert 0.05 < trace.loop.height < 0.5
    # two cycles of 4 (-1 + sin): from the center through flat to the most buckled
    np.testing.assert_allclose(trace.deflection[[0, 50, 100, 150]], [4e-3, 0.0, 4e-3, 8e-3],
                               atol=3e-5)
    assert trace.time[-1] == pytest.approx(0.4, abs=0.002)


def test_loops_at_two_frequencies_are_the_same_within_noise(rate):
    assert 0.7 < rate.difference < 1.3  # rms over its standard error, of 200 points


def test_peaks_are_constant_from_one_to_ten_hertz(rate):
    np.testing.assert_array_equal(rate.frequency, np.arange(1.0, 11.0))
    assert abs(rate.slope) < 3.0 * rate.slope_sigma
    assert rate.slope_sigma < 0.005 and rate.spread < 0.02
    chi2 = float(np.sum(((rate.peak - rate.peak.mean()) / rate.sigma)**2))
    assert chi2 < 28.0  # 9 degrees of freedom, 0.1 %


def test_peaks_are_those_of_the_operator_without_noise(rate):
    exact = film_experiments.asymptotic_peak(FilmTestStand.of(FILMS['10x1']), 4e-3, 'exact')
    np.testing.assert_allclose(rate.peak, exact, atol=4.0 * float(rate.sigma.max()))


def test_the_asymptotic_peak_agrees_with_the_closed_form():
    # between the reversals of a symmetric loop: y = a u -+ g tanh(alpha U) at its ends, u = +-U
    film = FilmTestStand.of(FILMS['10x1'])
    span = 0.5 * abs(float(film.charge(np.array([3e-3]))[0]))
    p = film.hysteresis
    expected = p.a * span - p.band * math.tanh(p.alpha * span)
    found = film_experiments.asymptotic_peak(film, 3e-3, 'exact')
    assert found == pytest.approx(expected, rel=1e-9)


def test_peaks_over_amplitude_are_nearly_linear_and_convex(amplitude):
    assert amplitude.determination > 0.97
    exact = amplitude.models['exact']
    assert np.all(np.diff(exact, 2) > 0.0)  # charge per amplitude grows
    assert 0.0 < amplitude.curvature < 0.06
    rise, sigma = amplitude.rise
    assert abs(rise - amplitude.exact_rise()) < 3.0 * sigma
    assert rise > 5.0 * sigma


def test_small_strokes_are_proportional(amplitude):
    assert amplitude.exact_rise(0.2) < 0.05 < amplitude.exact_rise(0.5) < amplitude.exact_rise()


def test_the_printed_second_order_is_more_convex_and_the_linear_one_less(amplitude):
    exact, printed, linear = (amplitude.models[name] for name in ('exact', 'printed', 'linear'))
    assert np.all(printed > exact) and np.all(exact > linear)
    # stroke 1/2: 1/4 + 7/128 + 15/1024 and more, against 1/4
    assert amplitude.elastica_rise > (7 / 128 + 15 / 1024) / 0.25
    assert amplitude.elastica_rise < 0.31


def test_identification_recovers_the_products_within_its_error_bars(identified):
    pulls = np.abs(identified.pulls)
    assert pulls.shape == (10, 3)
    assert pulls.max() < 3.0
    assert np.mean(pulls < 1.0) > 0.5 and np.mean(pulls < 2.0) > 0.85
    assert np.sqrt(np.mean(pulls**2)) > 0.4  # nor are the bars far too long
    for estimates in identified.estimates:
        assert all(estimate.determined for estimate in estimates.values())


def test_constants_at_the_gain_of_the_table_agree_with_the_table(identified):
    alpha, a, b = np.mean([identified.constants(i) for i in range(10)], axis=0)
    assert alpha == pytest.approx(TABLE_I.alpha, rel=0.03)
    assert a == pytest.approx(TABLE_I.a, rel=0.01)
    assert b == pytest.approx(TABLE_I.b, rel=0.01)


def test_the_estimate_converges_to_the_loop_with_slope_one(identified):
    first = identified.first
    assert first.estimated[0] == pytest.approx(0.0, abs=1e-10)
    assert abs(first.measured[0] - first.estimated[0]) > 10.0 * first.rms
    assert 0.0 < first.settled < 1.0
    assert first.slope == pytest.approx(1.0, abs=0.005)
    assert first.rms < 0.03e-9  # noise of the bench: 0.02 nC


def test_the_film_touches_itself_at_the_printed_stroke(identified):
    assert identified.printed_stroke == pytest.approx(0.96)
    assert identified.printed_stroke > TOUCHING_STROKE
    assert identified.geometric_gain == pytest.approx(TABLE_I_GAIN / 105.0, rel=0.01)


def test_statements_depend_on_the_numbers(identified, rate):
    section = paper_a.table_section(identified)
    assert any('within their error bars' in text for text in section.agrees)
    true = identified.true
    wrong = replace(identified, true={**true, 'a_gain': 2.0 * true['a_gain']})
    section = paper_a.table_section(wrong)
    assert not section.agrees and any('outside its error bar' in text for text in section.differs)
    section = paper_a.rate_section(replace(rate, slope=0.2))
    assert not any('are constant' in text for text in section.agrees)


@pytest.mark.long
def test_another_operator_on_the_test_stand_is_detected(monkeypatch):
    bench = film_experiments.bench

    def changed_film(film, *motion):
        changed = DuhemParams(alpha=2.0 * film.hysteresis.alpha, a=0.54, b=0.28)
        return bench(replace(film, hysteresis=changed), *motion)
    monkeypatch.setattr(film_experiments, 'bench', changed_film)
    assert np.abs(film_experiments.identification().pulls[:, 0]).min() > 3.0
