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

"""Robust EKF: Kalman update, outliers, shape guard and record of transitions."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.errors import EstimatorError
from smart_tire.estimation.slip.robust_ekf import Measurement, OUTLIER_SIGMAS, RobustEkf

H = np.array([[1.0, 0.0]])


def new_filter(recorder=None):
    return RobustEkf(np.array([1.0, 2.0]), np.diag([4.0, 1.0]), recorder)


def scalar(z, variance=4.0):
    return Measurement(np.array([z]), np.array([1.0]), H, np.array([[variance]]))


def test_correction_weights_prior_and_measurement_by_their_variances():
    ekf = new_filter()
    assert ekf.correct(scalar(3.0)) == pytest.approx(4.0 / 8.0)
    assert ekf.x == pytest.approx([2.0, 2.0])
    assert np.allclose(ekf.P, np.diag([2.0, 1.0]))


def correlated():
    """Return a filter whose first state (to be considered) determines the second in part."""
    return RobustEkf(np.array([1.0, 2.0, 0.0]), np.array(
        [[1.0, 0.5, 0.0], [0.5, 2.0, 0.3], [0.0, 0.3, 1.0]]))


def second(z):
    H = np.array([[1.0, 1.0, 0.0]])
    return Measurement(np.array([z]), np.array([3.0]), H, np.array([[0.5]]))


def test_a_considered_state_keeps_mean_and_variance_but_not_its_correlations():
    ekf = correlated()
    before = ekf.P.copy()
    ekf.correct(second(4.0), considered=[0])
    assert ekf.x[0] == 1.0 and ekf.P[0, 0] == before[0, 0]
    assert ekf.x[1] > 2.0 and ekf.P[1, 1] < before[1, 1]
    assert ekf.P[0, 1] < before[0, 1]  # an error of the first now shows in the second
    assert np.linalg.eigvalsh(ekf.P).min() > 0.0


def test_considered_errors_are_part_of_the_covariance_of_the_others():
    # over many draws the covariance of the corrected states is the reported one
    rng = np.random.default_rng(0)
    P = correlated().P
    ekf, errors = correlated(), []
    for row in rng.multivariate_normal([0.0] * 3, P, 2000):
        ekf = correlated()
        z = 3.0 + row[0] + row[1] + np.sqrt(0.5) * rng.standard_normal()
        # without gating, which is for outliers
        if abs(z - 3.0) < OUTLIER_SIGMAS * np.sqrt(1.0 + 1.0 + 2.0 + 0.5):
            ekf.correct(second(z), considered=[0])
            errors.append(ekf.x - np.array([1.0, 2.0, 0.0]) - row)
    assert np.cov(np.array(errors).T) == pytest.approx(ekf.P, abs=0.12)


def test_considering_no_state_is_the_kalman_filter_and_all_of_them_changes_nothing():
    plain, none, every = correlated(), correlated(), correlated()
    plain.correct(second(4.0))
    none.correct(second(4.0), considered=[])
    every.correct(second(4.0), considered=[0, 1, 2])
    assert np.array_equal(plain.P, none.P) and np.array_equal(plain.x, none.x)
    assert np.allclose(every.P, correlated().P) and np.array_equal(every.x, correlated().x)
    S = second(0.0).H @ correlated().P @ second(0.0).H.T + 0.5
    gain = (correlated().P @ second(0.0).H.T / S)[:, 0]
    assert plain.x == pytest.approx(correlated().x + gain)


def test_innovations_beyond_the_limit_change_the_state_less_and_less():
    limit, changes = OUTLIER_SIGMAS * np.sqrt(8.0), []
    for innovation in (limit, 2.0 * limit, 10.0 * limit):
        ekf = new_filter()
        ekf.correct(scalar(1.0 + innovation))
        changes.append(ekf.x[0] - 1.0)
    assert changes[0] == pytest.approx(0.5 * limit)
    assert changes[0] > changes[1] > changes[2] > 0.0


def test_prediction_sets_state_and_covariance_and_is_recorded():
    recorded = []

    class Recorder:

        def record_transition(self, *transition):
            recorded.append([part.copy() for part in transition])
    ekf, F = new_filter(Recorder()), np.array([[1.0, 0.5], [0.0, 1.0]])
    ekf.predict(np.array([2.0, 2.0]), F, 0.1 * np.eye(2))
    expected = F @ np.diag([4.0, 1.0]) @ F.T + 0.1 * np.eye(2)
    assert ekf.x == pytest.approx([2.0, 2.0]) and np.allclose(ekf.P, expected)
    (x, P, recorded_F, next_x, next_P), = recorded
    assert x == pytest.approx([1.0, 2.0]) and np.allclose(P, np.diag([4.0, 1.0]))
    assert np.array_equal(recorded_F, F) and np.array_equal(next_x, ekf.x)
    assert np.array_equal(next_P, ekf.P)


def test_direct_measurements_and_set_states():
    ekf = new_filter()
    ekf.correct_states([1], np.array([3.0]), np.array([1.0]))
    assert ekf.x == pytest.approx([1.0, 2.5])
    ekf.predict(ekf.x, np.array([[1.0, 0.5], [0.0, 1.0]]), np.zeros((2, 2)))
    ekf.set_states([0], 0.0, 0.1)
    assert ekf.x == pytest.approx([0.0, 2.5])
    assert np.allclose(ekf.P, np.diag([0.01, 0.5]))


def test_a_state_of_wrong_shape_is_an_error():
    with pytest.raises(EstimatorError, match=r'state \(3, 1\)'):
        new_filter().predict(np.zeros(3), np.eye(2), np.zeros((2, 2)))
