"""What a passage tells with and without the slip of the slip estimator."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.contact.records import CrossingSamples, Detection, PatchCrossing
from smart_tire.estimation.friction.motion_history import UNKNOWN, WheelMotion
from smart_tire.estimation.friction.waveform_method import WaveformReader
from smart_tire.models.tire import strain_charge
from smart_tire.parameters import build, RobotParams
from support.passages import passage, WHEEL

ROBOT = RobotParams()
L, FILM = ROBOT.tire.contact_length, ROBOT.film.length
SPEED = 0.546


def wheel_passage(samples, change=0.0):
    return PatchCrossing(0, 1, SPEED, 0.001, change, 0.1, 0, 1, samples)


def seen(rng, *, robot=ROBOT, slip=0.1, sliding=0.18, change=0.0, **options):
    return wheel_passage(passage(rng, robot, slip=slip, sliding=sliding, **options), change)


def read(one, *, slip=UNKNOWN, robot=ROBOT, **motion):
    return WaveformReader(WHEEL, robot).read(one, WheelMotion(slip=slip, **motion))


def test_films_alone_do_not_look_at_the_slip():
    one = seen(np.random.default_rng(0))
    without, near, far = (read(one, slip=slip) for slip in (UNKNOWN, (0.1, 0.002), (0.2, 0.002)))
    assert without.alone.slip == near.alone.slip == far.alone.slip
    assert without.joined is without.alone


def test_a_slip_from_elsewhere_sharpens_and_a_contradiction_widens():
    one = seen(np.random.default_rng(1))
    without, near, far = (read(one, slip=slip) for slip in (UNKNOWN, (0.1, 0.002), (0.15, 0.002)))
    assert near.joined.slip_sigma < min(without.alone.slip_sigma, 0.002)
    assert far.joined.slip_sigma > 3.0 * near.joined.slip_sigma
    assert near.fit is not None and near.fit.slip[0] == near.joined.slip


def test_gains_do_not_tell_a_slip_again_that_the_films_have_told_already():
    aided = build(RobotParams, {'slip.film_aided': True})
    one = seen(np.random.default_rng(1))
    slip = (0.1, 0.004)
    twice, once = read(one, slip=slip), read(one, slip=slip, robot=aided)
    assert once.alone.slip == twice.alone.slip
    assert twice.joined.slip_sigma < 0.8 * slip[1] < slip[1]
    assert once.joined.slip_sigma == pytest.approx(slip[1], rel=0.02)


def test_slip_and_sliding_are_right_within_their_sigmas():
    rng, off = np.random.default_rng(2), []
    for _ in range(80):
        slip = 0.1 + 0.005 * rng.standard_normal()
        told = read(seen(rng), slip=(slip, 0.005)).joined
        off.append(((told.slip - 0.1) / told.slip_sigma,
                    (told.sliding - 0.18) / told.sliding_sigma))
    assert np.all(np.abs(np.mean(np.square(off), axis=0) - 1.0) < 0.45)


def test_the_peaks_are_those_of_the_model_in_either_release():
    x_m = float(strain_charge.peak_position((1.0 - 0.18) * L, FILM, L))
    for release in ('fig8', 'state'):
        robot, rng = build(RobotParams, {'film.release': release}), np.random.default_rng(3)
        top = robot.film.gains(WHEEL)[0] * float(
            strain_charge.overlap_integral(x_m, 0.1, 0.1, 0.1 / 0.18, FILM, L))
        for name, truth in (('stretch_voltage', top), ('peak_interval', (L - x_m) / SPEED)):
            off = []
            for _ in range(40):
                found = read(seen(rng, robot=robot, gain_error=0.0), slip=(0.1, 1e-4),
                             robot=robot).peaks
                value, sigma = found[name]
                assert sigma < 0.05 * truth
                off.append((value - truth) / sigma)
            assert np.mean(np.square(off)) < 1.6, (release, name)


def test_braking_has_no_peaks_and_neither_has_a_film_longer_than_the_patch():
    rng = np.random.default_rng(4)
    assert read(seen(rng, slip=-0.1), slip=(-0.1, 0.002)).peaks == {}
    long = build(RobotParams, {'film.length': 0.05})
    told = read(seen(rng, robot=long), slip=(0.1, 0.002), robot=long)
    assert told.peaks == {}
    assert told.joined.sliding == pytest.approx(0.18, rel=0.15)


def test_without_film_1_there_are_no_peaks_but_friction():
    told = read(seen(np.random.default_rng(5), films=(1,)), slip=(0.1, 0.002))
    assert told.peaks == {}
    assert told.joined.sliding == pytest.approx(0.18, rel=0.15)


def test_the_shift_leads_from_the_sighting_to_the_passage():
    rng = np.random.default_rng(6)
    for _ in range(10):
        one = seen(rng)
        sighted = np.mean([s.middle for s in one.samples.sightings])
        assert sighted + read(one).shift == pytest.approx(0.015, abs=1e-4)


def test_two_grounds_in_one_passage_are_told_with_a_sigma_that_spans_them():
    rng = np.random.default_rng(7)
    for other in (0.1, 0.45):
        told = read(seen(rng, other_sliding=other), slip=(0.1, 1e-4)).joined
        assert min(other, 0.18) < told.sliding < max(other, 0.18)
        assert told.sliding_sigma > 0.3 * abs(other - 0.18)


@pytest.mark.parametrize('slip', [0.1, -0.1])
@pytest.mark.parametrize(('sliding', 'other'), [(0.18, 0.42), (0.42, 0.18)])
def test_where_the_ground_changes_the_films_tell_one_of_both_or_a_wide_sigma(
        slip, sliding, other):
    rng, neither = np.random.default_rng(17), 0
    for _ in range(60):
        one = seen(rng, slip=slip, sliding=sliding, other_sliding=other,
                   edge=rng.uniform(-0.035, 0.065))
        told = read(one, slip=(slip, 1e-3)).joined
        off = min(abs(told.sliding - sliding), abs(told.sliding - other))
        neither += off > 3.0 * told.sliding_sigma
    assert neither <= 3


def test_a_changing_speed_widens_what_the_films_say_alone():
    rng = np.random.default_rng(8)
    one = seen(rng)
    steady, changing = read(one).alone, read(wheel_passage(one.samples, 0.25)).alone
    assert changing.slip_sigma > 3.0 * steady.slip_sigma


def test_a_slip_that_strayed_widens_the_sliding():
    one, slip = seen(np.random.default_rng(9)), (0.1, 1e-4)
    steady, strayed = (read(one, slip=slip, slip_bend=bend).joined for bend in (0.0, 0.02))
    assert strayed.sliding_sigma > 1.5 * steady.sliding_sigma


def test_a_change_of_the_slip_that_is_told_wrong_is_not_believed():
    rng, off = np.random.default_rng(14), []
    for _ in range(40):
        told = read(seen(rng), slip=(0.1, 1e-4), slip_rate=0.5).joined  # 0.04 in a contact length
        off.append((told.sliding - 0.18) / told.sliding_sigma)
    assert np.mean(np.square(off)) < 1.5


def test_a_slip_that_changes_as_told_biases_nothing():
    rng, off = np.random.default_rng(10), []
    for _ in range(60):
        growth = 0.15 * rng.standard_normal()  # relative, over a contact length
        one = seen(rng, growth=growth)
        told = read(one, slip=(0.1, 1e-4), slip_rate=0.1 * growth * SPEED / L).joined
        off.append((told.sliding - 0.18) / told.sliding_sigma)
    assert np.mean(np.square(off)) < 1.5


@pytest.mark.parametrize(('growth', 'spread'), [(0.15, 0.05), (0.15, 0.15), (-0.15, 0.0)])
def test_a_lateral_slip_that_changes_otherwise_biases_nothing(growth, spread):
    rng, off = np.random.default_rng(15), []
    lateral = (0.083 * SPEED, 1e-4)  # total slip 1.3 times the longitudinal one
    for _ in range(60):
        told = read(seen(rng, growth=growth, spread=spread), slip=(0.1, 1e-4), lateral=lateral,
                    slip_rate=0.1 * growth * SPEED / L).joined
        off.append((told.sliding - 0.18) / told.sliding_sigma)
    assert np.mean(np.square(off)) < 1.5


def test_what_does_not_look_like_a_passage_is_not_read():
    rng = np.random.default_rng(11)
    one = seen(rng, films=(0,)).samples
    film = one.films[0]
    film.volts[:] = rng.normal(0.0, 0.005, len(film.volts))
    assert read(wheel_passage(one)) is None
    assert read(wheel_passage(None)) is None


def test_beyond_the_critical_slip_films_alone_do_not_tell_how_far():
    told = read(seen(np.random.default_rng(12), slip=0.5, sliding=1.5), slip=(0.5, 0.005))
    assert told.alone.slip_sigma > 0.2
    assert abs(told.joined.sliding - 1.5) < 3.0 * told.joined.sliding_sigma < 0.3


def test_where_all_slides_the_slip_from_elsewhere_says_how_far():
    off = []
    for seed in range(20):
        one = seen(np.random.default_rng(seed), slip=-0.27, sliding=1.6, change=0.05)
        told = read(one, slip=(-0.27, 0.02)).joined
        off.append(((told.slip + 0.27) / told.slip_sigma, (told.sliding - 1.6) / 1.6))
    slip, sliding = np.array(off).T
    assert np.sqrt(np.mean(slip**2)) < 1.5
    assert np.median(np.abs(sliding)) < 0.1


def test_a_sighting_that_is_a_little_off_does_not_matter():
    one = seen(np.random.default_rng(13)).samples
    shifted = tuple(Detection(s.middle + 0.002, s.bending, -s.slip, s.sliding, s.coverage)
                    for s in one.sightings)
    near, off = (read(wheel_passage(CrossingSamples(one.films, sightings, 0.0)), slip=(0.1, 1e-4))
                 for sightings in (one.sightings, shifted))
    assert off.joined.sliding == pytest.approx(near.joined.sliding, rel=0.01)
    assert math.isclose(off.alone.slip, near.alone.slip, rel_tol=0.02)
