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

"""Monte Carlo trials: scores of given estimates, and one case of each kind."""

from __future__ import annotations

import math

from benchmarks.friction.grid import Case
from benchmarks.friction.methods import EXACT_MAP, PRINTED_MAP, WAVEFORM
from benchmarks.friction.monte_carlo import run_case, trial
from benchmarks.friction.reference_results import REFERENCE_BOUNDS
import numpy as np
import pytest


def test_errors_are_relative_and_normalized_by_sigma():
    rng = np.random.default_rng(1)
    value = 0.5 * (1.02 + 0.04 * rng.standard_normal(20_000))
    found = trial(value, 0.5, 1.0, sigma=np.full(len(value), 0.02))
    assert found.finite == 1.0
    assert found.bias == pytest.approx(0.02, abs=0.002)
    assert found.spread == pytest.approx(0.04, rel=0.03)
    assert found.large == pytest.approx(0.075, rel=0.05)  # Gaussian, biased by half a sigma
    assert found.nees == pytest.approx((0.04**2 + 0.02**2) / 0.04**2, rel=0.05)


def test_missing_estimates_count_as_missing_only():
    value = np.array([0.5, math.nan, 0.5, math.nan])
    found = trial(value, 0.5, 1.0)
    assert (found.finite, found.bias, found.spread) == (0.5, 0.0, 0.0)
    assert math.isnan(found.nees)
    nothing = trial(value[1:2], 0.5, 1.0)
    assert nothing.finite == 0.0
    assert math.isnan(nothing.bias)


def test_only_the_waveform_method_is_near_the_bound():
    found = run_case('slip', Case(slip=0.15), 60)
    own, exact, printed = (found.trials[name] for name in (WAVEFORM, EXACT_MAP, PRINTED_MAP))
    assert (found.crossings, found.found, own.finite) == (60, 1.0, 1.0)
    assert abs(own.bias) < 0.02
    assert 0.6 < own.spread / found.bound < 1.5
    assert exact.spread > 5.0 * own.spread
    assert printed.bias > 0.4


@pytest.mark.parametrize('case', [Case(slip=-0.1), Case(slip=0.1, release='state')])
def test_two_peaks_are_not_applied_where_they_do_not_exist(case):
    assert run_case('some', case, 3).trials.keys() == {WAVEFORM}


@pytest.mark.parametrize('slip', list(REFERENCE_BOUNDS))
def test_the_bound_equals_the_reference_except_for_quantization(slip):
    bound = run_case('slip', Case(slip=slip), 1).bound
    assert bound == pytest.approx(REFERENCE_BOUNDS[slip], rel=0.08)
