"""The films' slip in the slip estimator: when it is used, and what it is worth."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.film_slip_update import DELAY, FilmAid, ROLL
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.samples import Friction, NS_PER_S, Odometry, WheelSlip
from support.driving import drive, ramp, START_NS, STEP

MS = 1_000_000
WHEELS = ('front_left', 'front_right')
LEAD = 0.015            # m, by which film 1 is before the middle of both
NOISE, GAIN = 0.003, 0.02  # of a film's slip, -: new in each passage, and a share that lasts


def friction(stamp_ns, slip, sigma=0.004, wheel='front_right'):
    return Friction(stamp_ns, wheel, {'film_slip': slip}, {'film_slip': sigma})


def aid(speed=0.8, duration=2.0):
    """Return one that knows of wheels at an even speed, from 0 s on, at ``START_NS``."""
    films = FilmAid(build(SlipEstimatorParams, {'slip.film_aided': True}).robot)
    for step in range(round(100 * duration)):
        films.note(0.01 * step, 0.0, 0.0, 0.0, 0.0, (speed, speed), (0.0, 0.0))
    return films


def push(films, told, now_ns):
    return films.push(told, (told.stamp_ns - START_NS) / NS_PER_S, now_ns)


@pytest.mark.parametrize('speed', [0.2, 0.8, -0.8])
def test_a_passage_is_used_when_its_stamp_and_the_speed_say_whenever_it_comes(speed):
    due_ns = START_NS + round((0.5 + DELAY + ROLL / abs(speed)) * NS_PER_S)
    pair = friction(START_NS + 500 * MS, 0.1), friction(
        START_NS + 501 * MS, 0.2, wheel='front_left')
    for order in (0, 1), (1, 0):
        films = aid(speed)
        for i in order:
            assert push(films, pair[i], START_NS + 800 * MS)
        assert films.due(due_ns - MS) == []
        assert [film.slip for film in films.due(due_ns + 2 * MS)] == [0.1, 0.2]
        assert films.due(due_ns + NS_PER_S) == []


def test_what_comes_too_late_or_twice_is_refused():
    films, told = aid(), friction(START_NS + 500 * MS, 0.1)
    due_ns = START_NS + round((0.5 + DELAY + ROLL / 0.8) * NS_PER_S)
    assert not push(films, told, due_ns + MS)
    assert push(films, told, due_ns - MS)
    assert not push(films, told, due_ns - MS)
    assert push(films, friction(told.stamp_ns, 0.1, wheel='front_left'), due_ns - MS)


@pytest.mark.parametrize(('time', 'slip', 'sigma', 'speed'), [
    (0.5, math.nan, math.inf, 0.8), (0.5, 0.1, math.nan, 0.8), (0.5, 1.5, 0.1, 0.8),
    (60.0, 0.1, 0.01, 0.8), (-1.0, 0.1, 0.01, 0.8), (0.5, 0.1, 0.01, 0.02)])
def test_what_tells_nothing_is_passed_over(time, slip, sigma, speed):
    films = aid(speed)
    assert push(films, friction(START_NS + round(time * NS_PER_S), slip, sigma), START_NS)
    assert films.due(START_NS + 120 * NS_PER_S) == []


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_the_speed_is_that_of_film_1_and_what_was_gained_since_is_told(direction):
    films = aid(duration=0.0)
    for step in range(101):  # wheels get faster by 1 m/s2 from 0.5 m/s on
        films.note(0.01 * step, direction * 0.009, 1e-6, 0.002, 0.2,
                   (0.0, direction * (0.5 + 0.01 * step)), (0.0, 0.0))
    told = friction(START_NS + 400 * MS, 0.1, 0.01)
    (film,) = push(films, told, START_NS) and films.due(START_NS + 2 * NS_PER_S)
    past = films.speed(film, 0.4)
    earlier = direction * LEAD / 0.9  # rolling back it passes last
    assert past.side == 1 and past.gyro_z == pytest.approx(0.2)
    assert past.speed == pytest.approx(direction * 0.9 * (0.9 - earlier), rel=1e-6)
    assert past.since == pytest.approx(0.6 + earlier)
    assert past.gained == pytest.approx(direction * 0.9 * (0.6 + earlier))
    assert past.turned == pytest.approx(0.2 * (0.6 + earlier))
    assert past.variance > (0.9 * 0.01)**2 + 1e-4 * 0.6


def test_a_time_that_is_forgotten_tells_nothing():
    films = aid(duration=0.0)
    for step in range(1000):
        films.note(0.01 * step, 0.0, 0.0, 0.0, 0.0, (0.8, 0.8), (0.0, 0.0))
    film = SimpleNamespace(wheel=0, slip=0.1, sigma=0.01)
    assert films.speed(film, 9.5) is not None
    assert films.speed(film, 2.0) is None


def passages(run, slip, seed, every=0.667):
    """Return what films with gains that are off say of a run, and when it is received."""
    rng = np.random.default_rng(seed)
    found = []
    for side, wheel in enumerate(WHEELS):
        off = GAIN * rng.standard_normal()
        for time in np.arange(rng.uniform(0.0, every), run.time[-1], every):
            speed = run.rolling[int(time / STEP), side]
            if abs(speed) < 0.3:
                continue
            stamp = START_NS + round((time + LEAD / speed) * NS_PER_S)
            told = slip[side] * (1.0 + off) + NOISE * rng.standard_normal()
            found.append((stamp + round(rng.uniform(0.3, 0.5) * NS_PER_S), friction(
                stamp, told, math.hypot(NOISE, GAIN * slip[side]), wheel)))
    return found


def estimates(run, extra=(), **values):
    estimator = SlipEstimator(build(SlipEstimatorParams, values))
    events = [(sample.stamp_ns, sample) for sample in run.samples] + list(extra)
    out = [estimate for _, sample in sorted(events, key=lambda event: event[0])
           for estimate in estimator.update(sample)]
    return estimator, out


def cruising(seed, slip, speed=0.8, duration=15.0):
    """Return a run straight ahead at an even speed, with a slip that both sides share."""
    rolling = ramp([(0, 0, 0), (3, 0, 0), (4, speed, speed), (duration, speed, speed)])
    return drive(rolling, rolling * np.array(slip), seed=seed)


def errors(run, out, slip):
    """Return errors and sigmas of the left slip while the robot cruises."""
    slips = [item for item in out if isinstance(item, WheelSlip)
             and item.stamp_ns > START_NS + 8 * NS_PER_S]
    return (np.array([item.ratio[0] - slip[0] for item in slips]),
            np.array([item.sigma[0] for item in slips]))


def test_cruising_straight_ahead_the_films_tell_the_slip_that_both_sides_share():
    plain, aided = [], []
    for seed in range(10):
        slip = np.full(2, np.random.default_rng([seed, 1]).uniform(0.0, 0.2))
        run = cruising(seed, slip)
        plain.append(errors(run, estimates(run)[1], slip))
        aided.append(errors(run, estimates(
            run, passages(run, slip, seed), **{'slip.film_aided': True})[1], slip))
    plain, aided = (np.concatenate(parts, axis=1) for parts in (plain, aided))
    assert np.sqrt(np.mean(aided[0]**2)) < 0.6 * np.sqrt(np.mean(plain[0]**2))
    assert np.sqrt(np.mean(aided[1]**2)) < 0.5 * np.sqrt(np.mean(plain[1]**2))
    assert 0.5 < np.mean((aided[0] / aided[1])**2) < 1.6


def test_a_passage_from_before_a_change_of_speed_corrects_what_is_now():
    slip = np.full(2, 0.1)
    rolling = ramp([(0, 0, 0), (3, 0, 0), (4, .6, .6), (12, .6, .6), (12.6, 1., 1.),
                    (13.2, .6, .6), (13.8, 1., 1.), (14.4, .6, .6), (15, 1., 1.)])
    plain, aided = [], []
    for seed in range(8):
        run = drive(rolling, rolling * slip, seed=seed)
        plain.append(speed_errors(run, estimates(run)[1]))
        aided.append(speed_errors(run, estimates(
            run, passages(run, slip, seed), **{'slip.film_aided': True})[1]))
    (error, normalised), (aided_error, aided_normalised) = (
        np.sqrt(np.mean(np.square(parts), axis=(0, 2))) for parts in (plain, aided))
    assert aided_error < 0.6 * error
    assert aided_normalised < 1.2 * normalised


def speed_errors(run, out):
    """Return errors of the forward speed from 12 s on, as they are and over their sigmas."""
    moving = [item for item in out if isinstance(item, Odometry)
              and item.stamp_ns > START_NS + 12 * NS_PER_S]
    rows = [round((item.stamp_ns - START_NS) / NS_PER_S / STEP) for item in moving]
    off = np.array([item.linear[0] for item in moving]) - run.twist[rows, 0]
    return off, off / np.sqrt([item.twist_covariance[0] for item in moving])


def test_numbers_do_not_depend_on_when_a_passage_comes():
    slip = np.full(2, 0.1)
    run = cruising(0, slip, duration=10.0)
    early = passages(run, slip, 0)
    late = [(at + 120 * MS, sample) for at, sample in early]
    results = [estimates(run, extra, **{'slip.film_aided': True}) for extra in (early, late)]
    assert results[0][1] == results[1][1]
    assert all(estimator.films_used > 10 for estimator, _ in results)
    never = [(at + 600 * MS, sample) for at, sample in early]
    estimator, out = estimates(run, never, **{'slip.film_aided': True})
    assert estimator.late['tire_friction'] > 10 and estimator.films_used == 0
    assert out == estimates(run)[1]


def test_without_being_asked_the_estimator_does_not_listen_to_films():
    slip = np.full(2, 0.1)
    run = cruising(0, slip, duration=8.0)
    assert estimates(run, passages(run, slip, 0))[1] == estimates(run)[1]
