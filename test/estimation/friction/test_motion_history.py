"""Mean slip, lateral speed and load of a wheel while its films were in the patch."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.estimation.friction.motion_history import MotionHistory, UNKNOWN
from smart_tire.models.vehicle.skid_steer import normal_loads
from smart_tire.parameters import RobotParams
from smart_tire.samples import Odometry, WheelSlip
from support.rolling import stamp

ROBOT = RobotParams()
TWIST = [0.0] * 36
TWIST[7], TWIST[11], TWIST[31], TWIST[35] = 4e-6, 1e-6, 1e-6, 1e-4


def history(*, v_x=lambda t: 1.0, v_y=0.05, rate=0.8, slip=lambda t: 0.11, until=1.0):
    motion = MotionHistory(ROBOT, 0.02)
    for t in np.arange(0.0, until, 0.008):
        motion.add_odometry(Odometry(
            stamp(t), (0.0,) * 3, (0.0, 0.0, 0.0, 1.0), (v_x(t), v_y, 0.0), (0.0, 0.0, rate),
            (0.0,) * 36, tuple(TWIST)))
        motion.add_slip(WheelSlip(stamp(t), (slip(t), -0.1, 0.12, -0.1), (0.1,) * 4,
                                  (0.003, 0.004, 0.005, 0.006)))
    return motion


def test_means_are_taken_over_the_passage():
    motion = history(slip=lambda t: 0.1 + 0.2 * (t - 0.5))
    seen = motion.mean('front_left', stamp(0.49), stamp(0.53))
    assert seen.slip == (pytest.approx(0.102, abs=2e-4), pytest.approx(0.003))
    assert seen.slip_rate == pytest.approx(0.2, rel=0.01)


def test_a_slip_that_bends_is_told_from_one_that_only_changes():
    straight = history(slip=lambda t: 0.1 + 0.2 * (t - 0.5))
    bent = history(slip=lambda t: 0.1 + 5.0 * (t - 0.51)**2)
    straight, bent = (motion.mean('front_left', stamp(0.49), stamp(0.53))
                      for motion in (straight, bent))
    assert straight.slip_bend < 1e-6
    assert bent.slip_bend == pytest.approx(5.0 * 0.07**2 * 0.298, rel=0.15)  # of a parabola
    assert bent.slip_rate == pytest.approx(0.0, abs=0.02)


def test_the_lateral_speed_is_that_of_the_wheel_with_its_sigma():
    seen = history().mean('rear_right', stamp(0.5), stamp(0.54))
    assert seen.lateral[0] == pytest.approx(0.05 - 0.13 * 0.8)
    assert seen.lateral[1] == pytest.approx(math.sqrt(4e-6 - 2 * 0.13e-6 + 0.13**2 * 1e-4))


def test_the_load_follows_acceleration_and_turning():
    seen = history(v_x=lambda t: 0.5 + 1.5 * t).mean('front_left', stamp(0.5), stamp(0.54))
    expected = normal_loads(
        ROBOT.mass, ROBOT.center_of_mass, ROBOT.wheelbase, ROBOT.track_width, 1.5 - 0.8 * 0.05,
        0.8 * (0.5 + 1.5 * 0.52), radius=ROBOT.wheel_radius)[0]
    assert seen.load[0] == pytest.approx(float(expected), rel=0.005)
    assert 0.02 < seen.load[1] / seen.load[0] < 0.04


def test_what_the_streams_do_not_tell_is_unknown():
    assert MotionHistory(ROBOT, 0.02).mean('front_left', stamp(0.5), stamp(0.6)).slip == UNKNOWN
    silent = history(until=0.3).mean('front_left', stamp(0.5), stamp(0.54))
    assert silent.slip == silent.lateral == silent.load == UNKNOWN
    standing = history(slip=lambda t: math.nan if t < 0.51 else 0.1)
    assert standing.mean('front_left', stamp(0.5), stamp(0.54)).slip == UNKNOWN


def test_the_history_is_bounded():
    motion = history(until=30.0)
    assert motion.mean('front_left', stamp(1.0), stamp(1.1)).slip == UNKNOWN
    assert motion.mean('front_left', stamp(29.0), stamp(29.1)).slip[0] == pytest.approx(0.11)
