# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tests of the smoothing against white jerk."""

import numpy as np
import pytest
from smart_tire.numerics import jerk_smoothing
from support.compiled import load_source

RNG = np.random.default_rng(1)
TIMES = np.cumsum(RNG.uniform(0.5, 1.5, 30))
ROWS = jerk_smoothing.jerk_rows(TIMES, 2.0)
PRECISION, RIGHT = RNG.uniform(0.1, 10.0, (2, 3, 30))


@pytest.fixture(params=['as installed', 'as Python'])
def module(request):
    """Return the module, compiled where there is a compiler, and as Python."""
    return jerk_smoothing if request.param == 'as installed' else load_source(jerk_smoothing)


def test_the_equations_are_those_of_the_jerks(module):
    bands = module.jerk_information(ROWS)
    jerks = module.jerks(ROWS, np.eye(30))
    matrix = jerks @ jerks.T
    for k in range(4):
        assert bands[3 - k, k:] == pytest.approx(np.diagonal(matrix, k))
    each = module.solve_smoothed(bands, PRECISION, RIGHT)
    same = module.solve_smoothed(bands, PRECISION[0], RIGHT)
    for i in range(3):
        assert (matrix + np.diag(PRECISION[i])) @ each[i] == pytest.approx(RIGHT[i])
        assert (matrix + np.diag(PRECISION[0])) @ same[i] == pytest.approx(RIGHT[i])


@pytest.mark.parametrize('precision', [-100.0, np.nan])
def test_a_matrix_that_is_not_positive_definite_is_an_error(module, precision):
    with pytest.raises(np.linalg.LinAlgError):
        module.solve_smoothed(module.jerk_information(ROWS), np.full(30, precision), RIGHT)
