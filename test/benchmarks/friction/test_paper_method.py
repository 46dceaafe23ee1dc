# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction from two peaks: exact with the exact map, far too high with the printed map."""

from benchmarks.friction.grid import Case, LOAD
from benchmarks.friction.paper_method import EXACT_MAP, friction_from_peaks, MAPS, PRINTED_MAP
import numpy as np
import pytest
from smart_tire.models.tire import strain_charge


def exact_interval(case):
    """Return the time [s] between the exact peaks of film 1."""
    film, patch = case.robot.film.length, case.robot.tire.contact_length
    return (patch - strain_charge.peak_position((1.0 - case.normalized_slip) * patch, film,
                                                patch)) / case.speed


def read(case, method):
    return float(friction_from_peaks(np.array([exact_interval(case)]), np.array([case.speed]),
                                     np.array([case.total_slip]), np.array([LOAD]), case.robot,
                                     method)[0])


@pytest.mark.parametrize('slip', [0.02, 0.1, 0.3])
@pytest.mark.parametrize('mu', [0.3, 0.47, 0.9])
def test_exact_peaks_and_the_exact_map_give_the_true_friction(slip, mu):
    assert read(Case(slip=slip, mu=mu), EXACT_MAP) == pytest.approx(mu)


@pytest.mark.parametrize('slip', [0.02, 0.05, 0.1, 0.2])
def test_exact_peaks_and_the_printed_map_give_about_twice_the_friction(slip):
    assert 1.75 < read(Case(slip=slip), PRINTED_MAP) / 0.47 < 2.25


@pytest.mark.parametrize('which', MAPS)
def test_an_unknown_interval_gives_nan(which):
    one = np.ones(1)
    assert np.isnan(friction_from_peaks(np.nan * one, one, one, one, Case(slip=0.1).robot, which))
