"""The two peaks of the paper: read off raw samples, with all that this costs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.motion_history import WheelMotion
from smart_tire.estimation.friction.two_peak_method import TwoPeakReader
from smart_tire.models.tire import strain_charge
from smart_tire.parameters import RobotParams
from support.passages import passage, WHEEL

ROBOT = RobotParams()
L, FILM = ROBOT.tire.contact_length, ROBOT.film.length
SLIP, SLIDING, SPEED = 0.1, 0.18, 0.546


def seen(rng, slip=SLIP, rpm=60.0, **options):
    samples = passage(rng, ROBOT, slip=slip, sliding=SLIDING, rpm=rpm, gain_error=0.0, **options)
    return PatchCrossing(0, 1, SPEED * rpm / 60.0, 0.001, 0.0, 0.1, 0, 1, samples)


def read(passage, slip=SLIP, name='exact'):
    return TwoPeakReader(WHEEL, ROBOT, name).read(passage, WheelMotion(slip=(slip, 0.002)))


def readings(count=80, name='exact', **options):
    rng = np.random.default_rng(0)
    return [read(seen(rng, **options), name=name) for _ in range(count)]


def test_the_peaks_scatter_around_the_truth_as_their_sigmas_say():
    found = [r for r in readings() if r is not None]
    assert len(found) > 70
    off = np.array([(r.joined.sliding - SLIDING) / r.joined.sliding_sigma for r in found])
    assert 0.4 < np.sqrt(np.mean(off**2)) < 1.6
    assert abs(np.median([r.joined.sliding for r in found]) - SLIDING) < 0.04


def test_sampling_alone_scatters_them():
    slow, fast = (np.std([r.joined.sliding for r in readings(rpm=rpm) if r is not None])
                  for rpm in (15.0, 60.0))
    assert fast > 0.02
    assert slow < fast


def test_the_printed_map_finds_too_little_sliding():
    exact, printed = (np.median([r.joined.sliding for r in readings(name=name) if r is not None])
                      for name in ('exact', 'printed'))
    assert 1.7 < exact / printed < 2.3


def test_the_slip_is_that_of_the_estimator_and_the_films_tell_their_own():
    found = [r for r in readings() if r is not None]
    assert {r.joined.slip for r in found} == {SLIP}
    assert np.median([r.alone.slip for r in found]) == pytest.approx(SLIP, rel=0.35)


def test_the_peaks_of_film_1_are_told_with_sigmas_that_hold():
    found = [r for r in readings() if r is not None]
    x_m = float(strain_charge.peak_position((1.0 - SLIDING) * L, FILM, L))
    top = ROBOT.film.gains(WHEEL)[0] * float(strain_charge.overlap_integral(
        x_m, SLIP, SLIP, SLIP / SLIDING, FILM, L))
    for name, truth in (('stretch_voltage', top), ('peak_interval', (L - x_m) / SPEED)):
        off = np.array([(r.peaks[name][0] - truth) / r.peaks[name][1]
                        for r in found if name in r.peaks])
        assert len(off) > 50
        assert 0.3 < np.sqrt(np.mean(off**2)) < 2.0, name


@pytest.mark.parametrize('slip', [-0.1, 0.0, math.nan])
def test_only_traction_has_two_peaks(slip):
    one = seen(np.random.default_rng(1), slip=0.1 if math.isnan(slip) else slip)
    assert read(one, slip=slip) is None


def test_a_hole_in_the_samples_leaves_no_peaks():
    one = seen(np.random.default_rng(2), films=(0,))
    film = one.samples.films[0]
    film.distance[40:60] += 1.0  # elsewhere
    assert read(one) is None


def test_without_samples_nothing_is_read():
    assert read(PatchCrossing(0, 1, SPEED, 0.001, 0.0, 0.1, 0, 1, None)) is None
