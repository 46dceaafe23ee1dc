# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Mean and covariance that the members of the branch filter represent."""

import numpy as np
import pytest
from smart_tire.estimation.film.branch_filter import _moments, COLUMNS, MEMBER_STEP


def test_the_moments_of_a_quadratic_function_of_normal_variables_are_exact():
    rng = np.random.default_rng(0)
    constant, slope, curvature = (rng.standard_normal((3, n)) for n in (1, COLUMNS, COLUMNS))
    members = MEMBER_STEP * np.hstack(
        [np.zeros((COLUMNS, 1)), np.eye(COLUMNS), -np.eye(COLUMNS)])
    mean, root = _moments(constant + slope @ members + curvature @ members**2)
    # independent standard normal variables: the mean of the squares is 1, their variance is 2,
    # and they are uncorrelated with the variables
    assert mean == pytest.approx(constant[:, 0] + curvature.sum(axis=1))
    assert root @ root.T == pytest.approx(slope @ slope.T + 2.0 * curvature @ curvature.T)
