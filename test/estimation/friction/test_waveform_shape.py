# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The shape of bumps and release is learned: unbiased with any shape, robust, and causal."""

from copy import deepcopy
from functools import cache
from itertools import cycle, product
import math

from benchmarks.friction.grid import Case, OTHER_SHAPES, WHEEL
from benchmarks.friction.synthesis import CrossingSynthesizer
import numpy as np
import pytest
from smart_tire.estimation.friction.constants import MAX_OUTLIERS
from smart_tire.estimation.friction.waveform_method import WaveformMethod
from smart_tire.estimation.friction.waveform_model import Release
from smart_tire.estimation.friction.waveform_shape import initial_covariance, ShapeEstimator

pytestmark = pytest.mark.slow

SIZE = len(initial_covariance())
SETTLED = 15  # crossings after which the shape is learned
USUAL = Case(slip=0.06)
RELEASES = (0.1, 0.5, 'fig8'), (-0.1, 0.7, 'state')


def results(case, count, seed, method=None):
    """Return the results of ``count`` crossings by one method."""
    source = CrossingSynthesizer(case, seed)
    method = method or WaveformMethod(WHEEL, case.robot)
    return [method.measure(source.crossing()) for _ in range(count)]


def normalized_slips(found):
    return np.array([one.slips.normalized_slip for one in found])


def normalized_errors(found, case):
    """Return the normalized errors of normalized slip and slip (n, 2)."""
    return [((one.slips.normalized_slip - case.normalized_slip) / one.slips.normalized_slip_sigma,
             (one.slips.slip - case.slip) / one.slips.slip_sigma) for one in found]


@cache
def settled_slips(slip, seed, shape=None):
    """Return the normalized slips of crossings with a shape of ``OTHER_SHAPES``, or the own."""
    case = Case(slip=slip, **(OTHER_SHAPES[shape] if shape else {}))
    return normalized_slips(results(case, SETTLED + 20, seed))[SETTLED:]


@cache
def experienced():
    """Return a method after usual crossings."""
    method = WaveformMethod(WHEEL, USUAL.robot)
    results(USUAL, 25, 5, method)
    return method


@cache
def slips_after(shape=None):
    """Return normalized slips after usual crossings and one with another shape, if it is given."""
    method = deepcopy(experienced())
    if shape:
        results(Case(slip=USUAL.slip, **OTHER_SHAPES[shape]), 1, 6, method)
    return normalized_slips(results(USUAL, 15, 7, method))


@pytest.mark.parametrize('seeds', [(11,), pytest.param((11, 12, 13), marks=pytest.mark.long)])
@pytest.mark.parametrize(('title', 'slip'), [*zip(OTHER_SHAPES, cycle((0.05, -0.07)))])
def test_another_shape_does_not_bias_normalized_slip(title, slip, seeds):
    differences = [np.mean(settled_slips(slip, seed, title) - settled_slips(slip, seed))
                   for seed in seeds]  # the same noise with both shapes
    assert abs(np.mean(differences)) < 0.015 * Case(slip=slip).normalized_slip


@pytest.mark.parametrize(('titles', 'seeds'), [([*OTHER_SHAPES], 6), *(
    pytest.param([title], 30, marks=pytest.mark.long) for title in OTHER_SHAPES)])
def test_sigmas_are_consistent_from_the_first_crossing_on(titles, seeds):
    cases = [Case(slip=0.06, **OTHER_SHAPES[title]) for title in titles]
    errors = [error for number, case in enumerate(cases) for seed in range(seeds)
              for error in normalized_errors(results(case, 4, 100 + 30 * number + seed), case)]
    squares = np.mean(np.square(errors), axis=0)
    assert np.all((squares > 0.5) & (squares < 1.4))


@pytest.mark.parametrize(('slip', 'share', 'release'), [
    pytest.param(*case, marks=() if case in RELEASES else pytest.mark.long)
    for case in product((0.1, -0.1), (0.2, 0.5, 0.7), ('fig8', 'state'))])
def test_a_release_between_the_conventions_is_learned(slip, share, release):
    case = Case(slip=slip, release=release, release_share=share)
    method = WaveformMethod(WHEEL, case.robot)
    errors = normalized_errors(results(case, 20, 3, method), case)
    assert method.shape.prior.value[Release.SHARE] == pytest.approx(share, abs=0.03)
    assert np.all(np.mean(np.square(errors), axis=0) < 2.0)


@pytest.mark.parametrize('title', OTHER_SHAPES)
def test_one_crossing_with_another_shape_hardly_changes_the_following_estimates(title):
    change = slips_after(title) - slips_after()
    assert abs(np.mean(change)) < 0.015 * USUAL.normalized_slip


def test_a_lasting_change_of_the_shape_is_learned():
    other = Case(slip=USUAL.slip, **OTHER_SHAPES['Gaussian bumps at 16 mm, 5 mm wide'])
    found, expected = (normalized_slips(results(other, SETTLED + 20, 7, method))[SETTLED:]
                       for method in (deepcopy(experienced()), None))
    assert abs(np.mean(found - expected)) < 0.015 * USUAL.normalized_slip


def test_an_estimate_is_weighted_by_its_information():
    rng = np.random.default_rng(1)
    shape, truth = ShapeEstimator(), np.linalg.cholesky(
        initial_covariance()) @ rng.standard_normal(SIZE)
    information = np.eye(SIZE) / 0.05**2
    for _ in range(60):
        measured = truth + 0.05 * rng.standard_normal(SIZE)
        prior = shape.prior
        posterior = prior.value + np.linalg.solve(
            prior.precision + information, information @ (measured - prior.value))
        shape.correct(posterior, information)
    error = shape.prior.value - truth
    assert np.sqrt(np.mean(error**2)) < 0.02
    # sigmas are too large, because only a share of the information is used
    assert 0.1 < error @ shape.prior.precision @ error / SIZE < 1.0


def test_a_crossing_without_information_changes_nothing():
    shape = ShapeEstimator()
    shape.correct(shape.prior.value, np.zeros((SIZE, SIZE)))
    assert np.all(shape.prior.value == 0.0)
    np.testing.assert_allclose(
        np.linalg.inv(shape.prior.precision), initial_covariance(), rtol=1e-4, atol=1e-6)


def test_outliers_have_less_weight_until_they_persist():
    shape, exact = ShapeEstimator(), np.eye(SIZE) / 0.01**2
    zero = np.zeros(SIZE)
    for _ in range(10):
        shape.correct(zero, exact)
    far = zero.copy()
    far[Release.SHARE] = 0.2
    for count in range(1, MAX_OUTLIERS):
        shape.correct(shape.prior.value + far, exact)
        assert abs(shape.prior.value[Release.SHARE]) < 0.1 * count
    wide = 1.0 / math.sqrt(shape.prior.precision[Release.SHARE, Release.SHARE])
    assert wide < 0.02
    shape.correct(shape.prior.value + far, exact)
    assert 1.0 / math.sqrt(shape.prior.precision[Release.SHARE, Release.SHARE]) > 5.0 * wide
