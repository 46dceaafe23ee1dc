"""Friction read off two peaks: right by the exact map without noise, far too high as printed."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.friction.grid import Case, LOAD
from benchmarks.friction.methods import EXACT_MAP, PRINTED_MAP
from benchmarks.friction.paper_method import friction_read_off, ratio_read_off
from smart_tire.models.tire import strain_charge


def exact_interval(case):
    """Return the time [s] between the exact peaks of film 1."""
    film, patch = case.robot.film.length, case.robot.tire.contact_length
    return (patch - strain_charge.peak_position((1.0 - case.sliding) * patch, film,
                                             patch)) / case.speed


def read(case, method):
    return float(friction_read_off(np.array([exact_interval(case)]), np.array([case.speed]),
                                   np.array([case.total_slip]), np.array([LOAD]), case.robot,
                                   method)[0])


@pytest.mark.parametrize('slip', [0.02, 0.1, 0.3])
@pytest.mark.parametrize('mu', [0.3, 0.47, 0.9])
def test_exact_peaks_and_the_exact_map_read_the_true_friction(slip, mu):
    assert read(Case(slip=slip, mu=mu), EXACT_MAP) == pytest.approx(mu)


@pytest.mark.parametrize('slip', [0.02, 0.05, 0.1, 0.2])
def test_exact_peaks_and_the_printed_map_read_about_twice_the_friction(slip):
    assert 1.75 < read(Case(slip=slip), PRINTED_MAP) / 0.47 < 2.25


@pytest.mark.parametrize('method', [EXACT_MAP, PRINTED_MAP])
def test_an_interval_that_is_not_told_reads_nothing(method):
    case = Case(slip=0.1)
    assert np.isnan(ratio_read_off(np.array([np.nan]), np.array([0.5]), case.robot, method))
