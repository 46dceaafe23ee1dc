# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Two-peak method of paper B on raw samples, with its errors."""

from __future__ import annotations

from functools import cache
import math

import numpy as np
import pytest

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.models.tire import brush_tire, strain_charge
from smart_tire.papers.printed import printed_adhesion_length, two_peaks, TwoPeakMethod
from smart_tire.parameters import build, FrictionEstimatorParams, RobotParams, SimulatorParams
from smart_tire.samples import Friction
from smart_tire.simulation.offline import simulate
from smart_tire.uncertain import Uncertain, UNKNOWN
from support.crossings import crossing_samples, WHEEL
from support.identifying import errors_of, rms

ROBOT = RobotParams()
L, FILM = ROBOT.tire.contact_length, ROBOT.film.length
SLIP, NORMALIZED_SLIP, SPEED = 0.1, 0.18, 0.546


def simulated(rng, slip=SLIP, rpm=60.0, **options):
    samples = crossing_samples(rng, ROBOT, slip=slip, normalized_slip=NORMALIZED_SLIP, rpm=rpm,
                               gain_error=0.0, **options)
    return PatchCrossing(0, 1, SPEED * rpm / 60.0, 0.001, 0.0, 0.1, 0, 1, samples)


def measure(crossing, slip=SLIP, map_name='exact'):
    return TwoPeakMethod(WHEEL, ROBOT, map_name).measure(crossing, Uncertain(slip, 0.002))


@cache
def results(map_name='exact'):
    """Return the results of 80 crossings in which both peaks were found."""
    rng = np.random.default_rng(0)
    found = [measure(simulated(rng), map_name=map_name) for _ in range(80)]
    return [result for result in found if result is not None]


def test_slips_scatter_as_reported_and_the_printed_map_underestimates_normalized_slip():
    found = results()
    assert len(found) > 70
    slip, sigma = np.array([(one.slips.normalized_slip, one.slips.normalized_slip_sigma)
                            for one in found]).T
    assert 0.4 < rms((slip - NORMALIZED_SLIP) / sigma) < 1.6
    assert abs(np.median(slip) - NORMALIZED_SLIP) < 0.04
    assert np.median([one.slips.slip for one in found]) == pytest.approx(SLIP, rel=0.35)
    printed = np.median([one.slips.normalized_slip for one in results('printed')])
    assert 1.7 < np.median(slip) / printed < 2.3


def test_the_peaks_of_film_1_are_within_their_sigmas():
    found = results()
    x_m = float(strain_charge.peak_position((1.0 - NORMALIZED_SLIP) * L, FILM, L))
    top = ROBOT.film.gains(WHEEL)[0] * float(strain_charge.overlap_integral(
        x_m, SLIP, SLIP, SLIP / NORMALIZED_SLIP, FILM, L))
    for name, truth in (('stretch_voltage', top), ('peak_interval', (L - x_m) / SPEED)):
        peaks = [getattr(one, name) for one in found]
        error = errors_of([peak for peak in peaks if math.isfinite(peak.value)], truth)
        assert len(error) > 50 and 0.3 < rms(error) < 2.0, name


@pytest.mark.parametrize('slip', [-0.1, 0.0, math.nan])
def test_only_traction_has_two_peaks(slip):
    crossing = simulated(np.random.default_rng(1), slip=0.1 if math.isnan(slip) else slip)
    assert measure(crossing, slip=slip) is None


def test_a_gap_in_the_samples_yields_no_result():
    crossing = simulated(np.random.default_rng(2), films=(0,))
    crossing.samples.films[0].distance[40:60] += 1.0
    assert measure(crossing) is None


@pytest.mark.parametrize('values', [{'film.length': 0.05}, {'film.release': 'state'}], ids=str)
def test_films_without_two_peaks_are_refused(values):
    with pytest.raises(ValueError, match='two peaks need'):
        TwoPeakMethod(WHEEL, build(RobotParams, values), 'exact')


def test_the_printed_map_gives_1_8_to_2_2_times_the_friction_without_noise():
    load, stiffness, mu = 26.7, 52.7, 0.47
    slip = np.array([0.02, 0.1, 0.2, 0.3])
    stuck = L * brush_tire.adhesion_ratio(slip, mu, load, stiffness)
    x_m = strain_charge.peak_position(stuck, FILM, L)
    for ratio, low, high in ((strain_charge.adhesion_length(x_m, FILM, L), 1.0 - 1e-6, 1.0 + 1e-6),
                             (printed_adhesion_length(x_m, FILM, L), 1.75, 2.25)):
        factor = brush_tire.friction_from_adhesion(ratio / L, slip, load, stiffness) / mu
        assert np.all((low < factor) & (factor < high))


@pytest.mark.long
def test_the_method_of_the_paper_on_a_drive():
    films = {'film.wheels': ('front_left', 'front_right')}
    events = simulate(build(SimulatorParams, {'seed': 70, 'ground.base': 'concrete', **films}),
                      [(0, 0, 0), (1, 120, 60), (9, 60, 120), (17, 0, 0)], 17.0)
    truth = [s for _, topic, s in events if topic == 'ground_truth/tire_friction']
    samples = [s for _, topic, s in events
               if topic in ('imu/data', 'tire_samples', 'wheel_states')]
    params = build(FrictionEstimatorParams, films)
    exact, printed = (two_peaks(samples, params, name) for name in ('exact', 'printed'))
    estimator = FrictionEstimator(params)
    fitted = [one for s in samples for one in estimator.update(s) if isinstance(one, Friction)]

    def paired(found):
        return [(t, f) for t in truth for f in found
                if f.wheel == t.wheel and abs(f.stamp_ns - t.stamp_ns) < 20_000_000]
    ratio = np.nanmedian([(1.0 - e.adhesion_ratio.value) / (1.0 - p.adhesion_ratio.value)
                          for p, e in zip(printed, exact)])
    assert 1.7 < ratio < 2.3
    driving = [(t, f) for t, f in paired(exact) if t.slip.value > 0.05]
    error = np.array([f.adhesion_ratio.value - t.adhesion_ratio.value for t, f in driving])
    best = np.array([f.adhesion_ratio.value - t.adhesion_ratio.value
                     for t, f in paired(fitted) if t.slip.value > 0.05])
    assert np.nanstd(error) > 5.0 * np.nanstd(best)
    sigma = np.array([f.adhesion_ratio.sigma for _, f in driving])
    assert 0.5 < np.sqrt(np.nanmean((error / sigma)**2)) < 2.0
    braking = [(t, f) for t, f in paired(exact)
               if t.slip.value < -0.05 and math.isfinite(f.slip.value)]
    assert len(braking) > 5
    for true, crossing in braking:
        for name in ('friction_coefficient_single', 'adhesion_ratio', 'stretch_voltage',
                     'peak_interval'):
            assert crossing.quantity(name) == UNKNOWN, name
        assert crossing.slip.value == pytest.approx(true.slip.value, abs=0.02)
