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

"""Two-peak method of paper B on raw samples, with its errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.two_peak_method import TwoPeakMethod
from smart_tire.models.tire import strain_charge
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain
from support.crossings import crossing_samples, WHEEL

ROBOT = RobotParams()
L, FILM = ROBOT.tire.contact_length, ROBOT.film.length
SLIP, NORMALIZED_SLIP, SPEED = 0.1, 0.18, 0.546


def simulated(rng, slip=SLIP, rpm=60.0, **options):
    samples = crossing_samples(rng, ROBOT, slip=slip, normalized_slip=NORMALIZED_SLIP, rpm=rpm,
                               gain_error=0.0, **options)
    return PatchCrossing(0, 1, SPEED * rpm / 60.0, 0.001, 0.0, 0.1, 0, 1, samples)


def measure(crossing, slip=SLIP, map_name='exact'):
    return TwoPeakMethod(WHEEL, ROBOT, map_name).measure(crossing, Uncertain(slip, 0.002))


def results(map_name='exact', **options):
    """Return the results of 80 crossings in which both peaks were found."""
    rng = np.random.default_rng(0)
    found = [measure(simulated(rng, **options), map_name=map_name) for _ in range(80)]
    return [result for result in found if result is not None]


def test_normalized_slip_scatters_as_reported():
    found = results()
    assert len(found) > 70
    error = np.array([(one.films_only.normalized_slip - NORMALIZED_SLIP)
                      / one.films_only.normalized_slip_sigma for one in found])
    assert 0.4 < np.sqrt(np.mean(error**2)) < 1.6
    median = np.median([one.films_only.normalized_slip for one in found])
    assert abs(median - NORMALIZED_SLIP) < 0.04


def test_sampling_alone_causes_scatter():
    slow, fast = (np.std([one.films_only.normalized_slip for one in results(rpm=rpm)])
                  for rpm in (15.0, 60.0))
    assert fast > 0.02
    assert slow < fast


def test_the_printed_map_underestimates_normalized_slip():
    exact, printed = (np.median([one.films_only.normalized_slip for one in results(map_name)])
                      for map_name in ('exact', 'printed'))
    assert 1.7 < exact / printed < 2.3


def test_film_slip_is_proportional_to_the_height_of_the_peaks():
    assert np.median([one.films_only.slip for one in results()]) == pytest.approx(SLIP, rel=0.35)


def test_the_peaks_of_film_1_are_within_their_sigmas():
    found = results()
    x_m = float(strain_charge.peak_position((1.0 - NORMALIZED_SLIP) * L, FILM, L))
    top = ROBOT.film.gains(WHEEL)[0] * float(strain_charge.overlap_integral(
        x_m, SLIP, SLIP, SLIP / NORMALIZED_SLIP, FILM, L))
    for name, truth in (('stretch_voltage', top), ('peak_interval', (L - x_m) / SPEED)):
        peaks = [getattr(one, name) for one in found]
        error = np.array([(peak.value - truth) / peak.sigma for peak in peaks
                          if math.isfinite(peak.value)])
        assert len(error) > 50
        assert 0.3 < np.sqrt(np.mean(error**2)) < 2.0, name


@pytest.mark.parametrize('slip', [-0.1, 0.0, math.nan])
def test_only_traction_has_two_peaks(slip):
    crossing = simulated(np.random.default_rng(1), slip=0.1 if math.isnan(slip) else slip)
    assert measure(crossing, slip=slip) is None


def test_a_gap_in_the_samples_yields_no_result():
    crossing = simulated(np.random.default_rng(2), films=(0,))
    crossing.samples.films[0].distance[40:60] += 1.0
    assert measure(crossing) is None


def test_a_crossing_without_samples_yields_no_result():
    assert measure(PatchCrossing(0, 1, SPEED, 0.001, 0.0, 0.1, 0, 1, None)) is None
