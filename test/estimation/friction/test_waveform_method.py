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

"""Waveform method with and without the slip of the slip estimator."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.contact.records import CrossingSamples, Detection, PatchCrossing
from smart_tire.estimation.friction.motion_history import WheelMotion
from smart_tire.estimation.friction.output import OutputBuilder
from smart_tire.estimation.friction.waveform_method import WaveformMethod
from smart_tire.models.tire import strain_charge
from smart_tire.parameters import build, FrictionEstimatorParams, RobotParams
from smart_tire.uncertain import Uncertain, UNKNOWN
from support.crossings import crossing_samples, WHEEL

ROBOT = RobotParams()
L, FILM = ROBOT.tire.contact_length, ROBOT.film.length
SPEED = 0.546


def patch_crossing(samples, change=0.0):
    return PatchCrossing(0, 1, SPEED, 0.001, change, 0.1, 0, 1, samples)


def simulated(rng, *, robot=ROBOT, slip=0.1, normalized_slip=0.18, change=0.0, **options):
    return patch_crossing(crossing_samples(
        rng, robot, slip=slip, normalized_slip=normalized_slip, **options), change)


def evaluate(crossing, *, slip=UNKNOWN, robot=ROBOT, **motion):
    return WaveformMethod(WHEEL, robot).evaluate(
        crossing, WheelMotion(slip=Uncertain(*slip), **motion))


def normalized_error(fit, normalized_slip=0.18):
    return (fit.normalized_slip - normalized_slip) / fit.normalized_slip_sigma


def test_the_films_only_result_is_independent_of_the_slip_estimate():
    crossing = simulated(np.random.default_rng(0))
    without, near, far = (evaluate(crossing, slip=slip)
                          for slip in (UNKNOWN, (0.1, 0.002), (0.2, 0.002)))
    assert without.films_only.slip == near.films_only.slip == far.films_only.slip
    assert without.fused is without.films_only


def test_film_slip_and_adhesion_ratio_are_published_independently_of_the_slip_estimate():
    crossing = simulated(np.random.default_rng(0))
    params = FrictionEstimatorParams(robot=ROBOT)
    records = [OutputBuilder(WHEEL, params).build(
        crossing, WheelMotion(Uncertain(slip, 0.002), Uncertain(0.0, 0.01), Uncertain(26.7, 0.5)))
        for slip in (0.1, 0.2)]
    for name in ('film_slip', 'adhesion_ratio', 'adhesion_length'):
        assert records[0].quantity(name) == records[1].quantity(name)
    assert records[0].slip != records[1].slip
    assert abs(records[0].adhesion_ratio.value - 0.82) < 3.0 * records[0].adhesion_ratio.sigma


@pytest.mark.parametrize('slip, normalized_slip', [(0.1, 0.18), (-0.25, 0.45)])
def test_film_slip_and_normalized_slip_have_consistent_sigmas_and_correlation(
        slip, normalized_slip):
    rng, errors, correlations = np.random.default_rng(8), [], []
    for _ in range(150):
        found = evaluate(simulated(rng, slip=slip, normalized_slip=normalized_slip))
        fit = found.films_only
        errors.append(((fit.slip - slip) / fit.slip_sigma,
                       -normalized_error(fit, normalized_slip)))
        correlations.append(found.film_correlation)
    assert np.all(np.abs(np.mean(np.square(errors), axis=0) - 1.0) < 0.3)
    assert np.corrcoef(np.transpose(errors))[0, 1] == pytest.approx(
        float(np.mean(correlations)), abs=0.25)


def test_a_slip_estimate_reduces_the_sigma_and_a_contradiction_increases_it():
    crossing = simulated(np.random.default_rng(1))
    without, near, far = (evaluate(crossing, slip=slip)
                          for slip in (UNKNOWN, (0.1, 0.002), (0.15, 0.002)))
    assert near.fused.slip_sigma < min(without.films_only.slip_sigma, 0.002)
    assert far.fused.slip_sigma > 3.0 * near.fused.slip_sigma


def test_with_a_film_aided_slip_estimate_the_gains_are_not_used_twice():
    not_aided, aided = (build(RobotParams, {'slip.film_aided': one}) for one in (False, True))
    crossing, slip = simulated(np.random.default_rng(1)), (0.1, 0.004)
    independent, dependent = (evaluate(crossing, slip=slip, robot=robot)
                              for robot in (not_aided, aided))
    assert dependent.films_only.slip == independent.films_only.slip
    assert independent.fused.slip_sigma < 0.8 * slip[1]
    assert dependent.fused.slip_sigma == pytest.approx(slip[1], rel=0.02)


def test_slip_and_normalized_slip_are_within_their_sigmas():
    rng, errors = np.random.default_rng(2), []
    for _ in range(80):
        slip = 0.1 + 0.005 * rng.standard_normal()
        fit = evaluate(simulated(rng), slip=(slip, 0.005)).fused
        errors.append(((fit.slip - 0.1) / fit.slip_sigma, normalized_error(fit)))
    assert np.all(np.abs(np.mean(np.square(errors), axis=0) - 1.0) < 0.45)


def test_the_peaks_are_those_of_the_model_with_either_release():
    x_m = float(strain_charge.peak_position((1.0 - 0.18) * L, FILM, L))
    for release in ('fig8', 'state'):
        robot, rng = build(RobotParams, {'film.release': release}), np.random.default_rng(3)
        top = robot.film.gains(WHEEL)[0] * float(
            strain_charge.overlap_integral(x_m, 0.1, 0.1, 0.1 / 0.18, FILM, L))
        for name, truth in (('stretch_voltage', top), ('peak_interval', (L - x_m) / SPEED)):
            errors = []
            for _ in range(40):
                value, sigma = getattr(evaluate(
                    simulated(rng, robot=robot, gain_error=0.0), slip=(0.1, 1e-4), robot=robot),
                    name)
                assert sigma < 0.05 * truth
                errors.append((value - truth) / sigma)
            assert np.mean(np.square(errors)) < 1.6, (release, name)


def test_there_are_no_peaks_when_braking_or_with_a_film_longer_than_the_patch():
    rng = np.random.default_rng(4)
    braking = evaluate(simulated(rng, slip=-0.1), slip=(-0.1, 0.002))
    assert braking.stretch_voltage == braking.peak_interval == UNKNOWN
    robot = build(RobotParams, {'film.length': 0.05})
    long = evaluate(simulated(rng, robot=robot), slip=(0.1, 0.002), robot=robot)
    assert long.stretch_voltage == long.peak_interval == UNKNOWN
    assert long.fused.normalized_slip == pytest.approx(0.18, rel=0.15)


def test_without_film_1_there_are_no_peaks_but_friction():
    result = evaluate(simulated(np.random.default_rng(5), films=(1,)), slip=(0.1, 0.002))
    assert result.stretch_voltage == result.peak_interval == UNKNOWN
    assert result.fused.normalized_slip == pytest.approx(0.18, rel=0.15)


def test_the_shift_is_from_the_detection_to_the_fitted_center():
    rng = np.random.default_rng(6)
    for _ in range(10):
        crossing = simulated(rng)
        detected = np.mean([one.center for one in crossing.samples.detections])
        assert detected + evaluate(crossing).shift == pytest.approx(0.015, abs=1e-4)


def test_two_surfaces_in_one_crossing_have_a_sigma_that_spans_them():
    rng = np.random.default_rng(7)
    for other in (0.1, 0.45):
        fit = evaluate(simulated(rng, other_normalized_slip=other), slip=(0.1, 1e-4)).fused
        assert min(other, 0.18) < fit.normalized_slip < max(other, 0.18)
        assert fit.normalized_slip_sigma > 0.3 * abs(other - 0.18)


@pytest.mark.parametrize('slip', [0.1, -0.1])
@pytest.mark.parametrize(('first', 'other'), [(0.18, 0.42), (0.42, 0.18)])
def test_at_a_surface_edge_the_result_is_one_surface_or_has_a_large_sigma(slip, first, other):
    rng, neither = np.random.default_rng(17), 0
    for _ in range(60):
        crossing = simulated(rng, slip=slip, normalized_slip=first, other_normalized_slip=other,
                             edge=rng.uniform(-0.035, 0.065))
        fit = evaluate(crossing, slip=(slip, 1e-3)).fused
        neither += min(abs(normalized_error(fit, first)), abs(normalized_error(fit, other))) > 3.0
    assert neither <= 3


def test_a_change_of_speed_increases_the_sigma_of_film_slip():
    crossing = simulated(np.random.default_rng(8))
    steady, changing = (evaluate(one).films_only
                        for one in (crossing, patch_crossing(crossing.samples, 0.25)))
    assert changing.slip_sigma > 3.0 * steady.slip_sigma


def test_a_nonlinear_change_of_slip_increases_the_sigma_of_normalized_slip():
    crossing, slip = simulated(np.random.default_rng(9)), (0.1, 1e-4)
    linear, nonlinear = (evaluate(crossing, slip=slip, slip_residual=residual).fused
                         for residual in (0.0, 0.02))
    assert nonlinear.normalized_slip_sigma > 1.5 * linear.normalized_slip_sigma


def test_a_wrong_slip_rate_does_not_bias_the_result():
    rng, errors = np.random.default_rng(14), []
    for _ in range(40):  # 0.04 in a contact length
        errors.append(normalized_error(
            evaluate(simulated(rng), slip=(0.1, 1e-4), slip_rate=0.5).fused))
    assert np.mean(np.square(errors)) < 1.5


def test_a_change_of_slip_at_the_estimated_rate_does_not_bias_the_result():
    rng, errors = np.random.default_rng(10), []
    for _ in range(60):
        growth = 0.15 * rng.standard_normal()  # relative, over a contact length
        errors.append(normalized_error(evaluate(
            simulated(rng, growth=growth), slip=(0.1, 1e-4),
            slip_rate=0.1 * growth * SPEED / L).fused))
    assert np.mean(np.square(errors)) < 1.5


@pytest.mark.parametrize(('growth', 'spread'), [(0.15, 0.05), (0.15, 0.15), (-0.15, 0.0)])
def test_an_independent_change_of_lateral_slip_does_not_bias_the_result(growth, spread):
    rng, errors = np.random.default_rng(15), []
    lateral = Uncertain(0.083 * SPEED, 1e-4)  # total slip 1.3 times the longitudinal one
    for _ in range(60):
        errors.append(normalized_error(evaluate(
            simulated(rng, growth=growth, spread=spread), slip=(0.1, 1e-4),
            lateral_velocity=lateral, slip_rate=0.1 * growth * SPEED / L).fused))
    assert np.mean(np.square(errors)) < 1.5


def test_samples_that_do_not_resemble_a_crossing_have_no_result():
    rng = np.random.default_rng(11)
    samples = simulated(rng, films=(0,)).samples
    film = samples.films[0]
    film.volts[:] = rng.normal(0.0, 0.005, len(film.volts))
    assert evaluate(patch_crossing(samples)) is None
    assert evaluate(patch_crossing(None)) is None


def test_above_the_critical_slip_the_films_alone_do_not_determine_slip():
    result = evaluate(simulated(np.random.default_rng(12), slip=0.5, normalized_slip=1.5),
                      slip=(0.5, 0.005))
    assert result.films_only.slip_sigma > 0.2
    assert (abs(result.fused.normalized_slip - 1.5)
            < 3.0 * result.fused.normalized_slip_sigma < 0.3)


def test_at_full_sliding_the_slip_estimate_determines_normalized_slip():
    errors = []
    for seed in range(20):
        crossing = simulated(np.random.default_rng(seed), slip=-0.27, normalized_slip=1.6,
                             change=0.05)
        fit = evaluate(crossing, slip=(-0.27, 0.02)).fused
        errors.append(((fit.slip + 0.27) / fit.slip_sigma, (fit.normalized_slip - 1.6) / 1.6))
    slip, normalized_slip = np.array(errors).T
    assert np.sqrt(np.mean(slip**2)) < 1.5
    assert np.median(np.abs(normalized_slip)) < 0.1


def test_the_result_does_not_depend_on_errors_of_the_detection():
    samples = simulated(np.random.default_rng(13)).samples
    shifted = tuple(Detection(one.center + 0.002, one.bending, -one.slip, one.normalized_slip,
                              one.coverage) for one in samples.detections)
    exact, other = (evaluate(patch_crossing(CrossingSamples(samples.films, detections, 0.0)),
                             slip=(0.1, 1e-4)) for detections in (samples.detections, shifted))
    assert other.fused.normalized_slip == pytest.approx(exact.fused.normalized_slip, rel=0.01)
    assert math.isclose(other.films_only.slip, exact.films_only.slip, rel_tol=0.02)
