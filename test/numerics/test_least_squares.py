# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Delay and gain between a signal and its echo: correct within their sigmas, or refused."""

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from smart_tire.calibration.recording import Signal
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay import fit_delay
from smart_tire.numerics.least_squares import (
    anticorrelated, Errors, least_costs, nonlinear_fit, Prior, regression, Rows,
    sandwich_covariance, solve_with_prior)

pytestmark = pytest.mark.slow

DELAYS = np.arange(-1.0, 1.01, 0.05)
STEP = 0.1  # s between rows


def echo(seed, *, delay=0.13, slope=2.0, noise=0.05, correlation=0.0, outliers=0, seconds=60.0,
         signal=None):
    """Return the problem of a signal and its echo, ``delay`` later, ``slope`` times as large."""
    rng = np.random.default_rng(seed)
    fine = np.arange(-2.0, seconds + 2.0, 0.01)
    if signal is None:
        signal = gaussian_filter1d(rng.standard_normal(len(fine)), 30.0)
        signal = signal / signal.std()
    source = Signal(fine, signal)
    begin = np.arange(0.0, seconds, STEP)
    end = begin + STEP
    errors = rng.standard_normal(len(begin))
    for index in range(1, len(errors)):
        errors[index] = correlation * errors[index - 1] + np.sqrt(
            1.0 - correlation ** 2) * errors[index]
    received = slope * source.mean(begin - delay, end - delay) + noise * errors
    received[rng.integers(len(received), size=outliers)] += 30.0 * noise

    def rows(delay):
        emitted = source.mean(begin - delay, end - delay)
        return Rows(end, np.column_stack([emitted, np.ones(len(emitted))]), received,
                    np.zeros(len(begin)))

    return rows, Prior.of(None, None)


OPTIONS = {}, {'correlation': 0.8}, {'outliers': 20}, {'noise': 0.5}


@pytest.mark.parametrize(('cases', 'seeds'), [(OPTIONS, 10), *(
    pytest.param([options], 40, marks=pytest.mark.long) for options in OPTIONS)])
def test_errors_agree_with_the_reported_standard_errors(cases, seeds):
    fits = [fit_delay(*echo(seed, **options), DELAYS)
            for options in cases for seed in range(seeds)]
    delays = np.array([(fit.delay - 0.13) / fit.estimate(-1).sigma for fit in fits])
    slopes = np.array([(fit.values[0] - 2.0) / fit.estimate(0).sigma for fit in fits])
    for errors in (delays, slopes):
        assert 0.7 < np.sqrt(np.mean(errors ** 2)) < 1.4
        assert abs(errors.mean()) < 0.6


def test_the_delay_of_a_periodic_signal_is_ambiguous():
    fine = np.arange(-2.0, 62.0, 0.01)
    with pytest.raises(EstimatorError, match='fit equally well'):
        fit_delay(*echo(0, signal=np.sin(4.0 * np.pi * fine), seconds=60.0),
                  np.arange(-1.0, 1.01, 0.02))


def test_a_delay_beyond_the_range_is_refused():
    with pytest.raises(EstimatorError, match='outside of -1 to 1 s'):
        fit_delay(*echo(0, delay=1.15), DELAYS)


def test_too_few_rows_are_refused():
    with pytest.raises(EstimatorError, match='10 samples in motion, expected at least 12'):
        fit_delay(*echo(0, seconds=1.0), DELAYS)


def test_an_unobserved_coefficient_has_a_large_variance():
    jacobian = np.column_stack([np.ones(50), np.zeros(50)])
    covariance = sandwich_covariance(jacobian, np.full(50, 0.1), np.full(2, np.inf), 0)
    assert covariance[0, 0] < 0.01 and covariance[1, 1] > 1e6


def line(seed, *, noise=0.1, outliers=0, n=200):
    """Return the rows of the line 2 x + 1 with outliers."""
    rng, x = np.random.default_rng(seed), np.linspace(0.0, 1.0, n)
    y = 2.0 * x + 1.0 + noise * rng.standard_normal(n)
    y[rng.integers(n, size=outliers)] += 30.0 * noise
    return Rows(x, np.column_stack([x, np.ones(n)]), y, np.zeros(n))


def test_linear_and_nonlinear_fits_agree_and_are_consistent():
    errors, prior = [], Prior.of(None, None)
    for seed in range(30):
        rows = line(seed, outliers=20 * (seed % 2))
        fit = regression(rows, prior)
        other = nonlinear_fit(lambda p, rows=rows: rows.target - rows.matrix @ p, np.zeros(2),
                              prior, lambda p, rows=rows: rows.sigma)
        assert other.values == pytest.approx(fit.values, abs=0.02)
        assert other.estimate(0).sigma == pytest.approx(fit.estimate(0).sigma, rel=0.2)
        errors.append((fit.values[0] - 2.0) / fit.estimate(0).sigma)
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.4


def test_a_prior_counts_like_a_measurement():
    noise = np.random.default_rng(1).standard_normal(100)
    rows = Rows(np.arange(100.0), np.ones((100, 1)), noise - noise.mean(), np.zeros(100))
    fit = regression(rows, Prior.of((0.3, 0.1)))  # a hundred measurements of sigma 1: 0.1 as well
    assert fit.values[0] == pytest.approx(0.15, abs=0.03)
    assert fit.estimate(0).sigma == pytest.approx(0.07, rel=0.15)
    other = nonlinear_fit(lambda p: rows.target - rows.matrix @ p, np.zeros(1),
                          Prior.of((0.3, 0.1)), lambda p: rows.sigma)
    assert other.values == pytest.approx(fit.values, abs=1e-3)


def test_the_costs_of_many_systems_are_those_of_each():
    systems = np.random.default_rng(3).standard_normal((4, 20, 3))  # two columns and the target
    systems[1, :, 1] = 2.0 * systems[1, :, 0]  # dependent
    systems[2, :, 0] = 0.0
    for prior in (Prior.of(None, None), Prior.of((0.4, 0.1), None)):
        assert least_costs(systems, prior) == pytest.approx(
            [solve_with_prior(one[:, :2], one[:, 2], prior)[1] for one in systems], rel=1e-9)


def test_displacements_between_noisy_poses_are_as_good_as_the_poses():
    errors, contiguous = [], np.append(False, np.ones(99, bool))
    for seed in range(40):
        rng = np.random.default_rng(seed)
        length = rng.uniform(0.5, 1.5, 100) * np.where(np.arange(100) % 20 < 10, 1.0, -1.0)
        noise = np.diff(0.1 * rng.standard_normal(101))
        fit = regression(Rows(np.arange(100.0), length[:, None], length + noise, np.zeros(100)),
                         Prior.of(None), Errors(correlation=anticorrelated(contiguous)))
        errors.append(fit.values[0] - 1.0)
    assert np.sqrt(np.mean(np.square(errors))) < 0.7 * 0.1 * math.sqrt(2.0 / 100.0)
