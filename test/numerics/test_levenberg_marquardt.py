# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The Levenberg-Marquardt fit converges, with few evaluations of the model."""

import numpy as np
import pytest

from smart_tire.estimation.friction.waveform_model import (
    film_index, PerFilm, Shared, WaveformModel)
from smart_tire.numerics.levenberg_marquardt import (
    gram, inverse_factor, inverse_spd, JointPrior, LevenbergMarquardt)
from smart_tire.parameters import RobotParams
from support.crossings import crossing_samples, WHEEL

ROBOT = RobotParams()
SLIP, NORM_SLIP = 0.1, 0.18


class CountingModel:
    """A model that counts its evaluations."""

    def __init__(self, seen):
        self._model = WaveformModel(ROBOT, ROBOT.film.gains(WHEEL), seen.films, seen.reference)
        self.evaluations = 0

    def linearized(self, p):
        self.evaluations += 1
        return self._model.linearized(p)

    def moved(self, p, step):
        return self._model.moved(p, step)


def prior_of(count, slip_sigma=1e-3):
    """Return a prior for ``count`` films, with fixed contact length and bending shape."""
    value, sigma = np.zeros((2, film_index(count, PerFilm.CENTER)))
    value[[Shared.SLIP, Shared.NORM_SLIP]] = SLIP, 0.3
    sigma[[Shared.SLIP, Shared.NORM_SLIP]] = slip_sigma, 3.0
    for i in range(count):
        block = slice(film_index(i, PerFilm.CENTER), film_index(i + 1, PerFilm.CENTER))
        peak = ROBOT.film.bending(WHEEL)[i]
        value[block] = i * ROBOT.film.spacing, 0.0, peak, 0.12 * peak, 0.12 * peak, 0.0, 0.0
        sigma[block] = 0.005, 0.01, 0.5, 0.1, 0.1, 0.03, 0.5
    free = np.flatnonzero(sigma)
    return JointPrior(value, np.diag(sigma[free]**-2), free)


def setup(seed):
    seen = crossing_samples(
        np.random.default_rng(seed), ROBOT, slip=SLIP, normalized_slip=NORM_SLIP)
    model = CountingModel(seen)
    volts, rail = (np.concatenate([getattr(one, name) for one in seen.films])
                   for name in ('volts', 'rail'))
    return LevenbergMarquardt(model, volts, rail, ROBOT.film.sample_variance), model


@pytest.mark.parametrize('seed', range(4))
def test_it_converges_to_the_minimum_in_few_evaluations(seed):
    fit, model = setup(seed)
    prior = prior_of(2)
    end = fit.run(prior.value, prior)
    assert model.evaluations <= 7
    sigma = np.sqrt(np.diag(np.linalg.inv(end.hessian)))
    assert abs(end.p[Shared.NORM_SLIP] - NORM_SLIP) < 4.0 * sigma[list(prior.free).index(
        Shared.NORM_SLIP)]
    again = fit.run(end.p.copy(), prior)
    assert np.all(np.abs(again.p - end.p)[prior.free] < 0.1 * sigma)


def test_fixed_parameters_stay_and_a_known_point_is_not_evaluated_again():
    fit, model = setup(10)
    end = fit.run(prior_of(2).value, prior_of(2))
    assert end.p[Shared.LENGTH] == end.p[Shared.ALPHA] == 0.0
    before = model.evaluations
    other = fit.run(end.point, prior_of(2, 2e-3))
    assert model.evaluations - before <= 2
    assert other.p[Shared.NORM_SLIP] == pytest.approx(end.p[Shared.NORM_SLIP], abs=0.01)


def test_products_and_inverses_are_those_of_numpy_for_any_size():
    rng = np.random.default_rng(1)
    for count in (3, 1000, 3000):
        jacobian, weight = rng.standard_normal((40, count)), rng.uniform(0.5, 2.0, count)
        product = jacobian * weight @ jacobian.T
        np.testing.assert_allclose(gram(jacobian, weight), product, rtol=1e-9, atol=1e-9)
        regular = product + np.eye(40)
        np.testing.assert_allclose(inverse_spd(regular) @ regular, np.eye(40), atol=1e-8)
        np.testing.assert_allclose(inverse_spd(-regular) @ regular, -np.eye(40), atol=1e-8)
        white = inverse_factor(regular)  # each row by those before it
        np.testing.assert_allclose(white @ regular @ white.T, np.eye(40), atol=1e-8)
        assert not np.triu(white, 1).any() and inverse_factor(white[:0, :0]).shape == (0, 0)
        with pytest.raises(np.linalg.LinAlgError):
            inverse_factor(-regular)
