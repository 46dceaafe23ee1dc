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

"""Film slip as a delayed speed measurement: time of use, and effect on the slip estimate."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.estimation.slip.film_slip_update import (
    FilmSlipBuffer, REPORT_DELAY, REPORT_DISTANCE)
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.samples import Friction, NS_PER_S, Odometry, WheelSlip
from smart_tire.uncertain import Uncertain
from support.driving import drive, ramp, START_NS, STEP

MS = 1_000_000
WHEELS = ('front_left', 'front_right')
LEAD = 0.015            # m, from film 1 to the center of both films
NOISE, GAIN = 0.003, 0.02  # of the film slip: noise [-] of each crossing, and relative gain error


def friction(stamp_ns, slip, sigma=0.004, wheel='front_right'):
    return Friction(stamp_ns, wheel, film_slip=Uncertain(slip, sigma))


def new_buffer(speed=0.8, duration=2.0):
    """Return a buffer with a history of constant wheel speed since ``START_NS``."""
    films = FilmSlipBuffer(SlipEstimatorParams().robot)
    for step in range(round(100 * duration)):
        films.record_step(0.01 * step, 0.0, 0.0, 0.0, 0.0, (speed, speed), (0.0, 0.0))
    return films


def add(films, sample, now_ns):
    return films.add(sample, (sample.stamp_ns - START_NS) / NS_PER_S, now_ns)


@pytest.mark.parametrize('speed', [0.2, 0.8, -0.8])
def test_time_of_use_depends_on_timestamp_and_speed_not_on_arrival(speed):
    due_ns = START_NS + round((0.5 + REPORT_DELAY + REPORT_DISTANCE / abs(speed)) * NS_PER_S)
    pair = friction(START_NS + 500 * MS, 0.1), friction(
        START_NS + 501 * MS, 0.2, wheel='front_left')
    for order in (0, 1), (1, 0):
        films = new_buffer(speed)
        for i in order:
            assert add(films, pair[i], START_NS + 800 * MS)
        assert films.pop_due(due_ns - MS) == []
        assert [film.slip for film in films.pop_due(due_ns + 2 * MS)] == [0.1, 0.2]
        assert films.pop_due(due_ns + NS_PER_S) == []


def test_late_and_duplicate_crossings_are_refused():
    films, sample = new_buffer(), friction(START_NS + 500 * MS, 0.1)
    due_ns = START_NS + round((0.5 + REPORT_DELAY + REPORT_DISTANCE / 0.8) * NS_PER_S)
    assert not add(films, sample, due_ns + MS)
    assert add(films, sample, due_ns - MS)
    assert not add(films, sample, due_ns - MS)
    assert add(films, friction(sample.stamp_ns, 0.1, wheel='front_left'), due_ns - MS)


@pytest.mark.parametrize(('time', 'slip', 'sigma', 'speed'), [
    (0.5, math.nan, math.inf, 0.8), (0.5, 0.1, math.nan, 0.8), (0.5, 1.5, 0.1, 0.8),
    (60.0, 0.1, 0.01, 0.8), (-1.0, 0.1, 0.01, 0.8), (0.5, 0.1, 0.01, 0.02)])
def test_samples_without_information_are_ignored(time, slip, sigma, speed):
    films = new_buffer(speed)
    assert add(films, friction(START_NS + round(time * NS_PER_S), slip, sigma), START_NS)
    assert films.pop_due(START_NS + 120 * NS_PER_S) == []


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_delayed_speed_is_that_at_film_1_with_the_motion_since_then(direction):
    films = new_buffer(duration=0.0)
    for step in range(101):  # wheels accelerate by 1 m/s2 from 0.5 m/s
        films.record_step(0.01 * step, direction * 0.009, 1e-6, 0.002, 0.2,
                          (0.0, direction * (0.5 + 0.01 * step)), (0.0, 0.0), 0.004)
    sample = friction(START_NS + 400 * MS, 0.1, 0.01)
    (film,) = add(films, sample, START_NS) and films.pop_due(START_NS + 2 * NS_PER_S)
    delayed = films.delayed_speed(film, 0.4)
    earlier = direction * LEAD / 0.9  # in reverse it crosses last
    assert delayed.side == 1 and delayed.gyro_z == pytest.approx(0.2)
    assert delayed.speed == pytest.approx(direction * 0.9 * (0.9 - earlier), rel=1e-6)
    assert delayed.elapsed == pytest.approx(0.6 + earlier)
    assert delayed.speed_change == pytest.approx(direction * 0.9 * (0.6 + earlier))
    assert delayed.yaw_change == pytest.approx(0.2 * (0.6 + earlier))
    assert delayed.lateral_change == pytest.approx(0.4 * (0.6 + earlier))
    assert delayed.variance > (0.9 * 0.01)**2 + 1e-4 * 0.6


def test_times_before_the_history_give_no_speed():
    films = new_buffer(duration=0.0)
    for step in range(1000):
        films.record_step(0.01 * step, 0.0, 0.0, 0.0, 0.0, (0.8, 0.8), (0.0, 0.0))
    film = SimpleNamespace(wheel=0, slip=0.1, sigma=0.01)
    assert films.delayed_speed(film, 9.5) is not None
    assert films.delayed_speed(film, 2.0) is None


def crossings(run, slip, seed, every=0.667):
    """Return receive times and slips of crossings, by films with gain errors."""
    rng = np.random.default_rng(seed)
    found = []
    for side, wheel in enumerate(WHEELS):
        gain_error = GAIN * rng.standard_normal()
        for time in np.arange(rng.uniform(0.0, every), run.time[-1], every):
            speed = run.rolling[int(time / STEP), side]
            if abs(speed) < 0.3:
                continue
            stamp = START_NS + round((time + LEAD / speed) * NS_PER_S)
            measured = slip[side] * (1.0 + gain_error) + NOISE * rng.standard_normal()
            found.append((stamp + round(rng.uniform(0.3, 0.5) * NS_PER_S), friction(
                stamp, measured, math.hypot(NOISE, GAIN * slip[side]), wheel)))
    return found


def estimates(run, extra=(), **values):
    # the slip of these runs is given, so no force balance holds
    estimator = SlipEstimator(build(SlipEstimatorParams, {'force_balance': 'off', **values}))
    events = [(sample.stamp_ns, sample) for sample in run.samples] + list(extra)
    out = [estimate for _, sample in sorted(events, key=lambda event: event[0])
           for estimate in estimator.update(sample)]
    return estimator, out


def cruising(seed, slip, speed=0.8, duration=15.0):
    """Return a drive straight ahead at constant speed, with common slip."""
    rolling = ramp([(0, 0, 0), (3, 0, 0), (4, speed, speed), (duration, speed, speed)])
    return drive(rolling, rolling * np.array(slip), seed=seed)


def errors(run, out, slip):
    """Return errors and sigmas of the left slip while the robot cruises."""
    slips = [item for item in out if isinstance(item, WheelSlip)
             and item.stamp_ns > START_NS + 8 * NS_PER_S]
    return (np.array([item.ratio[0] - slip[0] for item in slips]),
            np.array([item.sigma[0] for item in slips]))


@pytest.mark.long
def test_films_make_common_slip_observable_in_straight_driving():
    plain, aided = [], []
    for seed in range(10):
        slip = np.full(2, np.random.default_rng([seed, 1]).uniform(0.0, 0.2))
        run = cruising(seed, slip)
        plain.append(errors(run, estimates(run)[1], slip))
        aided.append(errors(run, estimates(
            run, crossings(run, slip, seed))[1], slip))
    plain, aided = (np.concatenate(parts, axis=1) for parts in (plain, aided))
    assert np.sqrt(np.mean(aided[0]**2)) < 0.6 * np.sqrt(np.mean(plain[0]**2))
    assert np.sqrt(np.mean(aided[1]**2)) < 0.5 * np.sqrt(np.mean(plain[1]**2))
    assert 0.5 < np.mean((aided[0] / aided[1])**2) < 1.6


def test_a_crossing_before_a_speed_change_corrects_the_present_speed():
    slip = np.full(2, 0.1)
    rolling = ramp([(0, 0, 0), (3, 0, 0), (4, .6, .6), (12, .6, .6), (12.6, 1., 1.),
                    (13.2, .6, .6), (13.8, 1., 1.), (14.4, .6, .6), (15, 1., 1.)])
    plain, aided = [], []
    for seed in range(8):
        run = drive(rolling, rolling * slip, seed=seed)
        plain.append(speed_errors(run, estimates(run)[1]))
        aided.append(speed_errors(run, estimates(
            run, crossings(run, slip, seed))[1]))
    (error, normalized), (aided_error, aided_normalized) = (
        np.sqrt(np.mean(np.square(parts), axis=(0, 2))) for parts in (plain, aided))
    assert aided_error < 0.6 * error
    assert aided_normalized < 1.2 * normalized


def speed_errors(run, out):
    """Return errors of the forward speed from 12 s on, absolute and over their sigmas."""
    moving = [item for item in out if isinstance(item, Odometry)
              and item.stamp_ns > START_NS + 12 * NS_PER_S]
    rows = [round((item.stamp_ns - START_NS) / NS_PER_S / STEP) for item in moving]
    off = np.array([item.linear[0] for item in moving]) - run.twist[rows, 0]
    return off, off / np.sqrt([item.twist_covariance[0] for item in moving])


def test_estimates_do_not_depend_on_the_arrival_time_of_a_crossing():
    slip = np.full(2, 0.1)
    run = cruising(0, slip, duration=10.0)
    early = crossings(run, slip, 0)
    late = [(at + 120 * MS, sample) for at, sample in early]
    results = [estimates(run, extra) for extra in (early, late)]
    assert results[0][1] == results[1][1]
    assert all(estimator.counters['films_used'] > 10 for estimator, _ in results)
    never = [(at + 600 * MS, sample) for at, sample in early]
    estimator, out = estimates(run, never)
    assert estimator.late['tire_friction'] > 10 and estimator.counters['films_used'] == 0
    assert out == estimates(run)[1]


def test_films_are_used_by_default_and_ignored_if_film_aided_is_false():
    slip = np.full(2, 0.1)
    run = cruising(0, slip, duration=8.0)
    films, plain = crossings(run, slip, 0), estimates(run)[1]
    assert estimates(run, films)[1] != plain
    assert estimates(run, films, **{'slip.film_aided': False})[1] == plain
