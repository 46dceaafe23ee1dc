# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Errors and their standard deviations: figures of a run and of several."""

import math

from benchmarks.scoring import combined, Errors, part_of, Run
import numpy as np
import pytest


def test_errors_are_scored_with_their_sigmas():
    figures = Errors(np.array([0.1, -0.3, math.nan]), np.array([0.1, 0.1, math.nan])).figures
    assert figures == {name: pytest.approx(value) for name, value in {
        'finite': 2.0 / 3.0, 'mean': -0.1, 'bias': -0.1, 'rms': math.sqrt(0.05), 'median': 0.2,
        'q90': 0.28, 'max': 0.3, 'within_two': 0.5, 'nees': 5.0, 'spread': 2.0 / 1.349}.items()}


def test_without_sigmas_or_errors_the_figures_are_unknown():
    figures = Errors.without_sigma([0.1, 0.2]).figures
    assert figures['rms'] == pytest.approx(math.sqrt(0.025)) and math.isnan(figures['nees'])
    assert math.isnan(figures['within_two'])
    nothing = Errors.without_sigma([math.nan]).figures
    assert nothing['finite'] == 0.0 and math.isnan(nothing['median'])
    assert math.isnan(Errors.without_sigma([]).figures['finite'])


def test_an_infinite_error_is_the_largest_one():
    figures = Errors.without_sigma([1.0, math.inf]).figures
    assert (figures['median'], figures['finite'], figures['max']) == (1.0, 0.5, math.inf)


def test_the_spread_from_quartiles_is_robust_against_outliers():
    errors = 0.1 * np.random.default_rng(1).standard_normal(20_000)
    errors[:100] = 1e6
    assert Errors(errors, np.full(20_000, 0.05)).figures['spread'] == pytest.approx(2.0, rel=0.05)


def test_errors_of_runs_are_pooled_and_their_consistency_is_averaged():
    runs = [Run('row', seed, {'a.mu': Errors(np.full(n, error), np.full(n, 0.1))}, {'load': error})
            for seed, n, error in ((1, 1, 0.1), (2, 3, 0.3))]
    found = combined([*runs, Run('row', 1, {'b.mu': runs[0].errors['a.mu']})])
    assert found['a.mu.rms'] == pytest.approx(math.sqrt((0.01 + 3 * 0.09) / 4))
    assert found['a.mu.nees'] == pytest.approx(0.5 * (1.0 + 9.0))
    assert (found['load'], found['load.max']) == (0.2, 0.3)
    assert part_of(found, 'b')['mu.rms'] == pytest.approx(0.1)
