"""The rolled distance: smooth where it moves, true where it stands."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.contact.stamp_regularizer import StampRegularizer
from smart_tire.estimation.contact.wheel_trajectory import ReversalDetector, WheelTrajectory
from support.rolling import along, ROBOT, stamp, steady

R = ROBOT.wheel_radius
JITTER = ROBOT.encoder.stamp_jitter


def followed(course, duration, *, rate=16.0, jitter=0.0, positions=True, seed=0):
    rng = np.random.default_rng(seed)
    wheel = WheelTrajectory(R, 2000.0, JITTER)
    count, before = 2000.0 / (2.0 * np.pi), 0.0
    for i, time in enumerate(np.arange(0.0, duration, 1.0 / rate)):
        angle = np.floor(float(course(np.array(time + 1e-9))) / R * count) / count
        wheel.add(stamp(time + jitter * rng.standard_normal()), (angle - before) * rate if i else
                  0.0, angle if positions else None)
        before = angle
    return wheel


@pytest.mark.parametrize('rpm', [60.0, 120.0, 200.0])
def test_jittering_stamps_do_not_reach_the_smoothed_speed(rpm):
    course = steady(rpm)
    speed = rpm / 60.0 * 2.0 * np.pi * R
    errors = []
    for seed in range(20):
        wheel = followed(course, 4.0, jitter=JITTER, seed=seed)
        smooth = wheel.smooth(stamp(2.0), stamp(2.1))
        rolled = np.diff(smooth.at(np.array([stamp(2.0), stamp(2.1)])))[0]
        errors.append((rolled / 0.1 - speed) / smooth.speed_sigma)
    assert np.std(errors) < 1.5
    assert smooth.speed_sigma < 0.01 * speed


def test_a_stop_is_followed_without_overshoot_however_long_it_lasts():
    course = along([(0.0, 0.0), (1.0, 0.0), (2.0, 0.4), (40.0, 0.4), (41.0, 0.8)])
    wheel = followed(course, 42.0)
    times = np.array([stamp(t) for t in (5.0, 10.0, 20.0, 35.0)])
    smooth = wheel.smooth(stamp(1.5), stamp(40.5)).at(times)
    assert np.ptp(smooth) < 0.002
    assert smooth[0] == pytest.approx(wheel.coarse(times)[0], abs=0.005)


def test_speeds_alone_give_the_same_course():
    course = along([(0.0, 0.0), (1.0, 0.0), (3.0, 1.5), (4.0, 1.0)])
    times = np.array([stamp(t) for t in np.arange(0.2, 3.9, 0.1)])
    with_angles, without = (followed(course, 4.0, positions=p).coarse(times)
                            for p in (True, False))
    np.testing.assert_allclose(with_angles, without, atol=1e-6)


def test_an_encoder_that_is_reset_does_not_roll_the_wheel():
    wheel = WheelTrajectory(R, 2000.0, JITTER)
    for i in range(20):
        wheel.add(stamp(0.0625 * i), 10.0, 0.625 * i - (500.0 if i > 10 else 0.0))
    assert wheel.coarse(np.array([stamp(0.0625 * 19)]))[0] == pytest.approx(R * 0.625 * 19)


def test_the_latency_of_the_stamps_is_taken_off():
    late = WheelTrajectory(R, 2000.0, JITTER, latency=0.02)
    late.add(stamp(1.0), 0.0, 0.0)
    assert late.newest_ns == stamp(0.98)


def test_a_silent_wheel_rolls_on_for_a_while():
    wheel = followed(steady(60.0), 2.0)
    newest = wheel.newest_ns
    ahead = wheel.coarse(np.array([newest, newest + 300_000_000, newest + 10**10]))
    assert ahead[1] - ahead[0] == pytest.approx(0.3 * 2.0 * np.pi * R, rel=0.05)
    assert ahead[2] - ahead[0] < 1.1 * 2.0 * np.pi * R


def test_a_roll_knows_when_and_how_evenly_it_went():
    wheel = followed(along([(0.0, 0.0), (4.0, 2.0), (6.0, 2.0), (10.0, 4.0)]), 10.0)
    smooth = wheel.roll(0.9, 1.1, stamp(10.0))
    assert smooth.when(0.1) == pytest.approx(stamp(2.0), abs=3_000_000)
    assert smooth.at(smooth.when(0.05)) == pytest.approx(0.05, abs=1e-3)
    assert smooth.speed_change() < 0.1
    assert wheel.roll(1.95, 2.05, stamp(10.0)).speed_change() > 1.0


def test_the_path_turns_where_the_wheel_did_and_not_where_it_shook():
    path = ReversalDetector(0.003)
    time = np.arange(0.0, 4.0, 0.008)
    place = np.where(time < 2.0, 0.2 * time, 0.8 - 0.2 * time)
    place = place + 0.001 * np.sin(40.0 * time)
    turns = path.advance((time * 1e9).astype(np.int64), place)
    assert len(turns) == 1
    assert turns[0][0] == pytest.approx(2e9, abs=3e7)
    assert path.direction == -1


def test_stamps_of_batches_become_as_regular_as_the_conversions():
    rng = np.random.default_rng(0)
    true = np.arange(4000) * 2_500_125  # 50 ppm slow
    given = true + np.repeat(rng.normal(0.0, 300_000.0, 250), 16).astype(np.int64)
    clock = StampRegularizer(2_500_000)
    kept = np.ones(4000, bool)
    kept[1600:1648] = False
    regular = clock.regular(given[kept].tolist())
    error = (regular - true[kept])[1000:]
    assert np.std(error) < 120_000
    steps = np.abs(np.diff(error))
    assert np.max(steps) < 10_000


def test_a_clock_that_was_set_is_followed_at_once():
    clock = StampRegularizer(2_500_000)
    clock.regular([i * 2_500_000 for i in range(500)])
    assert clock.regular([10**12])[0] == 10**12
