"""Standstill: seen when wheels and unit are quiet, settled when the body is, too."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.zero_velocity import QUIET, SETTLED, ZeroVelocityDetector

GYRO, ACCEL = 0.01, 0.05


def feed(detector, duration, *, rate=lambda t: 0.0, force=lambda t: 0.0, seed=0, start=0.0):
    rng = np.random.default_rng(seed)
    for time in np.arange(start, start + duration, 0.01):
        detector.push(time, (rate(time) + GYRO * rng.standard_normal(),
                             force(time) + ACCEL * rng.standard_normal(),
                             ACCEL * rng.standard_normal()))
    return start + duration


@pytest.mark.parametrize('seed', range(10))
def test_a_quiet_robot_stands_and_its_mean_rate_is_the_bias(seed):
    detector = ZeroVelocityDetector(GYRO, ACCEL)
    time = feed(detector, QUIET + 0.1, rate=lambda t: 0.02, seed=seed)
    assert detector.rest(time, 0.0) is not None
    time = feed(detector, SETTLED, rate=lambda t: 0.02, seed=seed + 100, start=time)
    rest = detector.rest(time, 0.0)
    assert rest.duration == pytest.approx(SETTLED)
    assert abs(rest.rate - 0.02) < 4.0 * rest.sigma
    assert rest.sigma == pytest.approx(GYRO / 10.0, rel=0.05)


def test_turning_wheels_and_a_moving_unit_are_no_standstill():
    detector = ZeroVelocityDetector(GYRO, ACCEL)
    time = feed(detector, 2.0)
    assert detector.rest(time, 0.05) is None
    time = feed(detector, 0.5, force=lambda t: 2.0 * (t - 2.0), start=time)
    assert detector.rest(time, 0.0) is None


def test_too_little_is_no_standstill():
    detector = ZeroVelocityDetector(GYRO, ACCEL)
    assert detector.rest(0.0, 0.0) is None
    assert detector.rest(feed(detector, 0.1), 0.0) is None


def test_a_body_that_still_settles_is_not_settled():
    settled = []
    for seed in range(10):
        detector = ZeroVelocityDetector(GYRO, ACCEL)
        time = feed(detector, 0.7, rate=lambda t: 0.06 * np.exp(-t / 0.5), seed=seed)
        detector.rest(time, 0.0)
        time = feed(detector, 0.7, rate=lambda t: 0.06 * np.exp(-t / 0.5), seed=seed + 50,
                    start=time)
        rest = detector.rest(time, 0.0)
        settled.append(rest is not None and rest.settled)
    assert sum(settled) <= 2


def test_rest_begins_anew_after_a_movement():
    detector = ZeroVelocityDetector(GYRO, ACCEL)
    time = feed(detector, 3.0)
    detector.rest(time, 0.0)
    time = feed(detector, 1.0, start=time)
    assert detector.rest(time, 0.0).duration == pytest.approx(1.0)
    detector.rest(time, 0.5)
    assert detector.rest(time, 0.0).duration == 0.0


def test_after_a_turn_the_rate_may_be_of_tires_that_unwind_and_at_the_start_it_is_not():
    detector = ZeroVelocityDetector(GYRO, ACCEL)
    time = feed(detector, 2.0)
    assert detector.rest(time, 0.0).unwinding == 0.0
    time = feed(detector, 1.0, rate=lambda t: 0.6, start=time)
    detector.rest(time, 0.5)
    time = feed(detector, 1.5, start=time)
    first = detector.rest(time, 0.0).unwinding
    assert 0.01 < first < 0.06
    time = feed(detector, 6.0, start=time)
    assert detector.rest(time, 0.0).unwinding < 0.05 * first


def test_wheels_that_slow_down_do_not_hide_the_turn_before():
    detector = ZeroVelocityDetector(GYRO, ACCEL)
    time = feed(detector, 1.0, rate=lambda t: 0.6)
    detector.rest(time, 0.5)
    time = feed(detector, 0.2, start=time)
    detector.rest(time, 0.02)
    time = feed(detector, 1.0, start=time)
    assert detector.rest(time, 0.0).unwinding > 0.01
