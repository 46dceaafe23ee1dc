"""The Cramer-Rao bound: the published figures, and how it scales."""

from __future__ import annotations

import math

import pytest

from benchmarks.friction.cramer_rao import friction_bound
from smart_tire.parameters import build, RobotParams

ROBOT = RobotParams()
WHEEL = 'front_right'
SPEED = 2.0 * math.pi * ROBOT.wheel_radius  # m/s, at 60 rpm
CRITICAL = 3.0 * 0.47 * 0.25 * ROBOT.mass * 9.80665 / ROBOT.tire.longitudinal_stiffness


def bound(slip, noise=0.005, films=None, speed=SPEED, **values):
    robot = build(RobotParams, {'film.noise': noise, **values})
    return friction_bound(robot, WHEEL, slip=slip, sliding=abs(slip) / CRITICAL, speed=speed,
                          films=films)


@pytest.mark.parametrize(('slip', 'published'), [(0.05, 0.067), (0.10, 0.018), (0.15, 0.009)])
def test_two_films_reach_the_published_figures(slip, published):
    assert bound(slip) == pytest.approx(published, rel=0.08)


@pytest.mark.parametrize(('slip', 'published'), [(0.05, 0.096), (0.1, 0.025), (0.2, 0.008)])
def test_one_film_comes_near_the_published_figures(slip, published):
    assert bound(slip, films=(0,)) == pytest.approx(published, rel=0.15)


def test_it_grows_as_noise_over_the_square_of_the_slip_where_slip_is_small():
    assert bound(0.02, 0.02) == pytest.approx(4.0 * bound(0.02, 0.005), rel=0.1)
    assert bound(0.02) == pytest.approx(4.0 * bound(0.04), rel=0.25)


def test_less_noise_more_films_slower_rolling_and_sharper_gains_tell_more():
    assert bound(0.1, 0.002) < bound(0.1) < bound(0.1, 0.02)
    assert bound(0.1) < bound(0.1, films=(0,)) < bound(0.1, films=(1,))
    assert bound(0.1, speed=0.25 * SPEED) < bound(0.1)
    assert bound(0.1, **{'film.stretch_gain_tolerance': 0.0}) < bound(0.1)


def test_braking_tells_about_as_much_as_driving():
    assert bound(-0.1) == pytest.approx(bound(0.1), rel=0.2)


def test_without_slip_nothing_is_told():
    assert friction_bound(ROBOT, WHEEL, slip=0.0, sliding=0.3, speed=SPEED) == math.inf
