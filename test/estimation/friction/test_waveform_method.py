# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Waveform method, and mu of a single crossing with the slip of the motion."""

import numpy as np
import pytest

from smart_tire.estimation.contact.records import CrossingSamples, Detection, PatchCrossing
from smart_tire.estimation.friction.constants import CHANGE_SIGMA
from smart_tire.estimation.friction.output import friction_record
from smart_tire.estimation.friction.waveform_method import slip_variation, WaveformMethod
from smart_tire.estimation.ground.estimator import WheelState
from smart_tire.models.tire import strain_charge
from smart_tire.parameters import build, RobotParams
from smart_tire.uncertain import Uncertain, UNKNOWN
from support.crossings import crossing_samples, WHEEL

ROBOT = RobotParams()
L, FILM = ROBOT.tire.contact_length, ROBOT.film.length
SPEED = 0.546
CASES = [(0.1, 0.18), (-0.25, 0.45)]  # slip, normalized slip
EDGES = [(0.1, 0.18, 0.42), (0.1, 0.42, 0.18), (-0.1, 0.18, 0.42), (-0.1, 0.42, 0.18)]


def patch_crossing(samples, change=0.0):
    return PatchCrossing(0, 1, SPEED, 0.001, change, 0.1, 0, 1, samples)


def simulated(rng, *, robot=ROBOT, slip=0.1, normalized_slip=0.18, change=0.0, **options):
    return patch_crossing(crossing_samples(
        rng, robot, slip=slip, normalized_slip=normalized_slip, **options), change)


def measure(crossing, robot=ROBOT):
    return WaveformMethod(WHEEL, robot).measure(crossing)


def wheel_state(slip=0.1, sigma=1e-4, normalized_slip=0.18):
    """Return a state with load and stiffness known exactly, and the friction that follows."""
    total, load, stiffness = 1.3 * abs(slip), 26.7, 52.7
    critical = total / normalized_slip
    return WheelState(
        Uncertain(slip, sigma), Uncertain(normalized_slip, 0.0), Uncertain(load, 0.0),
        UNKNOWN, Uncertain(stiffness, 0.0),
        Uncertain(critical * stiffness / (3.0 * load), 0.0), Uncertain(critical, 0.0))


def record(crossing, state):
    return friction_record(WHEEL, L, crossing, measure(crossing), state)


def single_error(crossing, state):
    """Return the error of mu of a single crossing: relative, and over its sigma."""
    mu, sigma = record(crossing, state).friction_coefficient_single
    true = state.friction.value
    return mu / true - 1.0, (mu - true) / sigma


def normalized_error(fit, normalized_slip=0.18):
    return (fit.normalized_slip - normalized_slip) / fit.normalized_slip_sigma


def test_film_slip_and_adhesion_ratio_are_published_independently_of_the_state():
    crossing = simulated(np.random.default_rng(0))
    records = [record(crossing, state)
               for state in (WheelState(), wheel_state(0.1), wheel_state(0.2))]
    for name in ('film_slip', 'adhesion_ratio', 'adhesion_length'):
        assert records[0].quantity(name) == records[1].quantity(name) == records[2].quantity(name)
    assert records[1].slip != records[2].slip
    assert abs(records[0].adhesion_ratio.value - 0.82) < 3.0 * records[0].adhesion_ratio.sigma


@pytest.mark.parametrize(('cases', 'count'), [(CASES, 70), *(
    pytest.param([case], 150, marks=pytest.mark.long) for case in CASES)])
def test_film_slip_and_normalized_slip_have_consistent_sigmas_and_correlation(cases, count):
    rng, errors, correlations = np.random.default_rng(8), [], []
    for slip, normalized_slip in cases * count:
        fit = measure(simulated(rng, slip=slip, normalized_slip=normalized_slip)).slips
        errors.append(((fit.slip - slip) / fit.slip_sigma,
                       -normalized_error(fit, normalized_slip)))
        covariance = fit.white_cov[0, 1] + fit.systematic_cov[0, 1]
        correlations.append(-covariance / (fit.slip_sigma * fit.normalized_slip_sigma))
    assert np.all(np.abs(np.mean(np.square(errors), axis=0) - 1.0) < 0.3)
    assert np.corrcoef(np.transpose(errors))[0, 1] == pytest.approx(
        float(np.mean(correlations)), abs=0.25)


@pytest.mark.parametrize(('slip', 'normalized_slip'), [(0.1, 0.18), (-0.1, 0.3), (0.2, 0.6)])
def test_mu_of_a_single_crossing_is_within_its_sigma(slip, normalized_slip):
    rng = np.random.default_rng(2)
    relative, normalized = np.transpose([single_error(
        simulated(rng, slip=slip, normalized_slip=normalized_slip),
        wheel_state(slip, 1e-4, normalized_slip)) for _ in range(20)])
    assert np.mean(normalized**2) < 1.5
    assert np.median(np.abs(relative)) < 0.1


def test_a_slip_of_the_motion_determines_mu_where_the_films_determine_a_ratio():
    rng = np.random.default_rng(12)
    for slip, normalized_slip in ((0.5, 1.5), (-0.27, 1.6)):
        crossings = [simulated(rng, slip=slip, normalized_slip=normalized_slip)
                     for _ in range(8)]
        assert measure(crossings[0]).slips.slip_sigma > 0.5 * abs(slip)
        errors = [single_error(one, wheel_state(slip, 0.005, normalized_slip))[0]
                  for one in crossings]
        assert np.median(np.abs(errors)) < 0.1


def test_the_peaks_are_those_of_the_model_with_either_release():
    x_m = float(strain_charge.peak_position((1.0 - 0.18) * L, FILM, L))
    for release in ('fig8', 'state'):
        robot, rng = build(RobotParams, {'film.release': release}), np.random.default_rng(3)
        top = robot.film.gains(WHEEL)[0] * float(
            strain_charge.overlap_integral(x_m, 0.1, 0.1, 0.1 / 0.18, FILM, L))
        for name, truth in (('stretch_voltage', top), ('peak_interval', (L - x_m) / SPEED)):
            errors = []
            for _ in range(12):
                value, sigma = getattr(measure(
                    simulated(rng, robot=robot, gain_error=0.0), robot), name)
                assert sigma < 0.05 * truth
                errors.append((value - truth) / sigma)
            assert np.mean(np.square(errors)) < 1.6, (release, name)


@pytest.mark.parametrize(('robot', 'options'), [
    (ROBOT, {'slip': -0.1}), (build(RobotParams, {'film.length': 0.05}), {}),
    (ROBOT, {'films': (1,)})], ids=['braking', 'long film', 'no film 1'])
def test_there_may_be_friction_without_peaks(robot, options):
    result = measure(simulated(np.random.default_rng(4), robot=robot, **options), robot)
    assert result.stretch_voltage == result.peak_interval == UNKNOWN
    assert result.slips.normalized_slip == pytest.approx(0.18, rel=0.15)


def test_the_shift_is_from_the_detection_to_the_fitted_center():
    rng = np.random.default_rng(6)
    for _ in range(4):
        crossing = simulated(rng)
        detected = np.mean([one.center for one in crossing.samples.detections])
        assert detected + measure(crossing).shift == pytest.approx(0.015, abs=1e-4)


@pytest.mark.parametrize(('edges', 'count'), [(EDGES, 15), *(
    pytest.param([edge], 60, marks=pytest.mark.long) for edge in EDGES)])
def test_at_a_surface_edge_the_result_is_one_surface_or_has_a_large_sigma(edges, count):
    rng, neither = np.random.default_rng(17), 0
    for slip, first, other in edges * count:
        crossing = simulated(rng, slip=slip, normalized_slip=first, other_normalized_slip=other,
                             edge=rng.uniform(-0.035, 0.065))
        fit = measure(crossing).slips
        neither += min(abs(normalized_error(fit, first)), abs(normalized_error(fit, other))) > 3.0
    assert neither <= 9


def test_a_change_of_speed_increases_the_sigma_of_film_slip():
    crossing = simulated(np.random.default_rng(8))
    steady, changing = (measure(one).slips
                        for one in (crossing, patch_crossing(crossing.samples, 0.25)))
    assert changing.slip_sigma > 3.0 * steady.slip_sigma


def test_samples_that_do_not_resemble_a_crossing_have_no_result():
    rng = np.random.default_rng(11)
    samples = simulated(rng, films=(0,)).samples
    film = samples.films[0]
    film.volts[:] = rng.normal(0.0, 0.005, len(film.volts))
    assert measure(patch_crossing(samples)) is None
    assert measure(patch_crossing(None)) is None


def test_the_result_does_not_depend_on_errors_of_the_detection():
    samples = simulated(np.random.default_rng(13)).samples
    shifted = tuple(Detection(one.center + 0.002, one.bending, -one.slip, one.normalized_slip,
                              one.coverage) for one in samples.detections)
    exact, other = (measure(patch_crossing(CrossingSamples(
        samples.films, detections, 0.0))) for detections in (samples.detections, shifted))
    for name, share in (('normalized_slip', 0.01), ('slip', 0.02)):
        assert getattr(other.slips, name) == pytest.approx(
            getattr(exact.slips, name), rel=share)


def test_a_change_of_wheel_speed_allows_a_change_of_slip():
    steady, changing = (slip_variation(patch_crossing(None, change), L) for change in (0.0, 0.2))
    assert steady.change == (0.0, CHANGE_SIGMA)
    assert steady.residual == 0.0 and changing.residual == pytest.approx(0.05 * 0.2)
    assert changing.change.sigma == pytest.approx(np.hypot(CHANGE_SIGMA, 0.5 * 0.2 * L / 0.1))
