# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Slip-compensated kinematics in closed loop with a robot of constant slip coefficients."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np
import pytest
from smart_tire.control.constants import MAX_SLIDE
from smart_tire.control.ground_motion import Motion
from smart_tire.control.slip_kinematics import SlipKinematics
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.parameters.path_following import MotionLimitParams
from smart_tire.samples import NS_PER_S, WheelSlip

TRACK, WHEELBASE = 0.38, 0.26
STEP = 0.008   # s, between estimates
START = 1_000 * NS_PER_S
NANS = (math.nan,) * 4
# bounds that do not act
DELAY = 0.15  # s
WIDE = TrajectoryControllerParams(max_speed=5.0, limits=MotionLimitParams(yaw_rate=10.0))


class World:
    """
    A robot whose body moves with (1 - slip) r w of each side, over an effective track.

    No brush model: the kinematics must learn what it is.
    """

    def __init__(self, kinematics, *, slip=(0.0, 0.0), track=0.57, lateral=None, ahead=None,
                 base_track=TRACK, sigma=0.01, yaw=0.0):
        self.kinematics, self.slip, self.track, self.yaw = kinematics, slip, track, yaw
        # v_y of speed, yaw rate and yaw
        self.lateral = lateral or (lambda v_x, yaw_rate, yaw: 0.0)
        self.ahead = ahead or (lambda yaw_rate, yaw: 0.0)  # v_x that the wheels do not make
        self.base_track, self.sigma = base_track, sigma
        self.now_ns, self.motion = START, (0.0, 0.0)

    def drive(self, v_x, yaw_rate, duration, *, estimates=True):
        """Command the wanted velocity; return the one of the body at the end."""
        for _ in range(round(duration / STEP)):
            command = self.kinematics.command(v_x, yaw_rate, self.now_ns, DELAY, WIDE)
            self.move(*command)
            if estimates:
                self.kinematics.add_motion(self.reached(), self.now_ns)
                self.kinematics.add_slip(self.wheel_slip())
        return self.motion

    def move(self, v_x, yaw_rate):
        """Turn the wheels as the ideal base does."""
        half = 0.5 * self.base_track * yaw_rate
        self.rolling = v_x - half, v_x + half
        left, right = (speed * (1.0 - slip) for speed, slip in zip(self.rolling, self.slip))
        rate = (right - left) / self.track
        # sides that roll against each other have one slip ratio
        share = TRACK / self.track if self.rolling[0] * self.rolling[1] < 0.0 else 1.0
        self.motion = 0.5 * share * (left + right) + self.ahead(rate, self.yaw), rate
        self.yaw += STEP * self.motion[1]
        self.now_ns += round(STEP * NS_PER_S)

    def reached(self):
        v_x, yaw_rate = self.motion
        return Motion(0.0, 0.0, self.yaw, v_x, self.lateral(*self.motion, self.yaw), yaw_rate)

    def wheel_slip(self):
        half = 0.5 * TRACK * self.motion[1]
        left, right = self.rolling[0] - self.motion[0] + half, \
            self.rolling[1] - self.motion[0] - half
        ratio = [u / p if p else math.nan for u, p in zip((left, right), self.rolling)]
        return WheelSlip(self.now_ns, (*ratio, *ratio), (left, right, left, right),
                         (self.sigma,) * 4)


def kinematics(**params):
    return SlipKinematics(TrajectoryControllerParams(**params))


def drift(world, v_x, yaw_rate, yaw):
    """Return the angle [rad] from the x axis to the direction of travel, as if ahead."""
    return math.atan(world.kinematics.lateral_speed(v_x, yaw_rate, yaw) / v_x)


@pytest.mark.parametrize('slip', [0.0, 0.15])
@pytest.mark.parametrize('track', [0.45, 0.57, 0.75])
@pytest.mark.parametrize('v_x, yaw_rate', [
    (0.5, 0.4), (0.5, -0.4), (-0.4, 0.4), (-0.4, -0.4), (0.0, 0.8), (0.0, -0.8)])
def test_the_body_moves_as_wanted_after_three_seconds(slip, track, v_x, yaw_rate):
    world = World(kinematics(), slip=(slip, slip), track=track)
    reached = world.drive(v_x, yaw_rate, 3.0)
    assert reached == (pytest.approx(v_x, rel=0.04, abs=0.01),
                       pytest.approx(yaw_rate, rel=0.05))


@pytest.mark.parametrize('v_x, yaw_rate', [(0.5, 0.4), (0.5, -0.4), (-0.5, 0.4), (-0.5, -0.4)])
def test_the_feed_forward_alone_is_learned_in_both_directions(v_x, yaw_rate):
    world = World(kinematics(), slip=(0.12, 0.12), track=0.65)
    world.drive(v_x, yaw_rate, 4.0)
    assert world.kinematics.factors(v_x, yaw_rate, world.now_ns) == (
        pytest.approx(1.0 / 0.88, rel=0.03), pytest.approx(0.65 / TRACK / 0.88, rel=0.05))


def test_the_widening_of_a_turn_in_place_is_not_kept_on_the_straight_after_it():
    world = World(kinematics(), track=1.0)
    world.drive(0.0, 0.8, 4.0)
    learned, straight = (world.kinematics.factors(*one, world.now_ns)[1]
                         for one in ((0.0, 0.8), (0.5, 0.05)))
    assert learned == pytest.approx(1.0 / TRACK, rel=0.05)
    assert straight == pytest.approx(kinematics().factors(0.5, 0.05, START)[1], rel=0.05)


@pytest.mark.parametrize('v_x', [0.5, -0.5])
def test_sides_on_different_ground_get_their_own_compensation(v_x):
    world = World(kinematics(), slip=(0.02, 0.12))
    ideal = World(kinematics(), slip=(0.02, 0.12))
    ideal.move(v_x, 0.0)
    reached = world.drive(v_x, 0.0, 2.0)
    assert reached[0] == pytest.approx(v_x, rel=0.02)
    assert abs(reached[1]) < 0.15 * abs(ideal.motion[1])


def test_another_ground_is_learned_within_half_a_second():
    world = World(kinematics(), slip=(0.01, 0.01))
    world.drive(0.5, 0.0, 20.0)
    world.slip = (0.2, 0.2)
    assert world.drive(0.5, 0.0, STEP)[0] == pytest.approx(0.4, abs=0.02)
    assert world.drive(0.5, 0.0, 0.2)[0] > 0.46  # the surprise makes it learn faster
    assert world.drive(0.5, 0.0, 0.3)[0] == pytest.approx(0.5, abs=0.02)
    world.slip = (0.01, 0.01)
    assert world.drive(0.5, 0.0, 0.5)[0] == pytest.approx(0.5, abs=0.02)


def test_what_is_learned_in_one_curve_applies_to_the_next():
    world = World(kinematics(), slip=(0.1, 0.1), track=0.7)
    world.drive(0.5, 0.3, 4.0)
    for v_x, yaw_rate in ((0.5, -0.3), (0.3, 0.3), (-0.5, 0.3), (0.5, 0.5)):
        reached = world.drive(v_x, yaw_rate, STEP, estimates=False)
        assert reached == (pytest.approx(v_x, rel=0.05), pytest.approx(yaw_rate, rel=0.25))


def test_coefficients_last_for_seconds_and_return_to_the_prior_in_minutes():
    world, fresh = World(kinematics(), slip=(0.15, 0.15), track=0.75), kinematics()
    world.drive(0.5, 0.4, 4.0)
    learned = world.kinematics.factors(0.5, 0.4, world.now_ns)
    assert world.kinematics.factors(0.5, 0.4, world.now_ns + 2 * NS_PER_S) == (
        pytest.approx(learned, rel=0.08))
    late = world.kinematics.factors(0.5, 0.4, world.now_ns + 1000 * NS_PER_S)
    assert late == pytest.approx(fresh.factors(0.5, 0.4, START), rel=1e-4)
    assert learned[1] > 1.2 * late[1]


def test_the_prior_is_the_calibrated_effective_track():
    calibrated = kinematics(effective_track=0.6)
    v_x, yaw_rate = calibrated.command(0.5, 0.02, START, DELAY, WIDE)
    assert yaw_rate == pytest.approx(0.02, rel=0.03)
    assert v_x == pytest.approx(0.5, rel=0.03)
    plain = kinematics(effective_track=TRACK).command(0.5, 0.02, START, DELAY, WIDE)
    assert plain[1] == pytest.approx(0.02 * (1.0 + (WHEELBASE / TRACK) ** 2), rel=0.03)


def test_the_command_is_the_one_of_the_base_with_its_effective_track():
    world = World(kinematics(effective_track=0.5), slip=(0.1, 0.1), track=0.7, base_track=0.5)
    assert world.drive(0.4, 0.5, 3.0) == (pytest.approx(0.4, rel=0.04),
                                          pytest.approx(0.5, rel=0.05))


def test_slips_without_motion_of_the_same_time_are_ignored():
    world = World(kinematics(), slip=(0.2, 0.2))
    before = world.kinematics.command(0.5, 0.0, START, DELAY, WIDE)
    for _ in range(100):
        world.move(0.5, 0.0)
        world.kinematics.add_slip(world.wheel_slip())
    assert world.kinematics.command(0.5, 0.0, START, DELAY, WIDE) == before
    world.kinematics.add_motion(world.reached(), world.now_ns)
    stopped = world.now_ns
    for _ in range(100):  # odometry has stopped: the first slips only belong to it
        world.move(0.5, 0.0)
        world.kinematics.add_slip(world.wheel_slip())
    world.kinematics.add_motion(world.reached(), stopped + 10 ** 9)
    assert world.kinematics.command(0.5, 0.0, START, DELAY, WIDE) == before


@pytest.mark.parametrize('change', [
    {'slip_velocity': NANS, 'ratio': NANS, 'sigma': (1.0,) * 4},
    {'slip_velocity': (math.nan, 0.1, math.nan, 0.1)},
    {'sigma': (math.nan,) * 4}, {'sigma': (math.inf,) * 4}])
def test_unknown_slips_are_not_learned(change):
    world = World(kinematics(), slip=(0.2, 0.2))
    before = world.kinematics.command(0.5, 0.3, START, DELAY, WIDE)
    for _ in range(200):
        world.move(0.5, 0.3)
        world.kinematics.add_motion(world.reached(), world.now_ns)
        world.kinematics.add_slip(replace(world.wheel_slip(), **change))
    assert world.kinematics.command(0.5, 0.3, START, DELAY, WIDE) == before


def test_one_measured_wheel_of_a_side_is_enough():
    world = World(kinematics(), slip=(0.15, 0.15))
    for _ in range(250):
        world.move(0.5, 0.0)
        slip = world.wheel_slip()
        velocity = (math.nan, *slip.slip_velocity[1:])
        world.kinematics.add_motion(world.reached(), world.now_ns)
        world.kinematics.add_slip(replace(slip, slip_velocity=velocity))
    v_x, _ = world.kinematics.command(0.5, 0.0, world.now_ns, DELAY, WIDE)
    assert v_x == pytest.approx(0.588, rel=0.02)


def test_uncertain_slips_change_little():
    certain, uncertain = (World(kinematics(), slip=(0.2, 0.2), sigma=sigma)
                          for sigma in (0.01, 1.0))
    for world in (certain, uncertain):
        world.drive(0.5, 0.0, 1.0)
    learned, vague = (world.kinematics.factors(0.5, 0.0, world.now_ns)[0] - 1.0
                      for world in (certain, uncertain))
    assert learned > 0.1
    assert abs(vague - 0.01) < 0.25 * (learned - 0.01)


@pytest.mark.parametrize('v_x, yaw_rate', [(0.5, 0.5), (0.5, -0.5), (-0.5, 0.5)])
def test_the_direction_of_travel_is_learned_from_the_lateral_speed(v_x, yaw_rate):
    # the body slides outward, behind the direction of travel
    world = World(kinematics(), lateral=lambda v_x, rate, yaw: -0.12 * abs(v_x) * v_x * rate)
    world.drive(v_x, yaw_rate, 3.0)
    offset = drift(world, v_x, yaw_rate, world.yaw)
    assert offset == pytest.approx(math.atan(-0.12 * abs(v_x) * yaw_rate), rel=0.15)
    # with a fifth of the weight, half of it may be that of a slope
    assert abs(drift(world, v_x, 0.0, world.yaw)) < 0.5 * abs(offset)


SLIDE = 0.06, -0.03  # rad, slip angles along x and y of odom that a slope causes


def slide(v_x, yaw_rate, yaw):
    return abs(v_x) * (SLIDE[1] * math.cos(yaw) - SLIDE[0] * math.sin(yaw))


@pytest.mark.parametrize('v_x', [0.5, -0.5])
@pytest.mark.parametrize('yaw', [0.0, 1.2, 2.5, -1.6])
def test_a_slide_on_a_slope_is_known_after_a_second_in_both_directions(v_x, yaw):
    world = World(kinematics(), lateral=slide, yaw=yaw)
    world.drive(v_x, 0.0, 1.0)
    for other in (v_x, -v_x):  # downhill remains downhill
        assert drift(world, other, 0.0, yaw) == pytest.approx(
            math.atan(slide(v_x, 0.0, yaw) / other), rel=0.05, abs=1e-3)


def test_a_slide_that_was_learned_in_a_curve_is_that_of_every_heading():
    world = World(kinematics(), lateral=lambda v_x, yaw_rate, yaw: (
        slide(v_x, yaw_rate, yaw) - 0.05 * abs(v_x) * v_x * yaw_rate))
    world.drive(0.5, 1.4, 3.0)
    for yaw in (0.0, 1.2, 2.5, -1.6):
        assert drift(world, 0.5, 1.4, yaw) == pytest.approx(
            math.atan(slide(0.5, 1.4, yaw) / 0.5 - 0.05 * 0.5 * 1.4), abs=0.01)


def test_motions_of_another_turning_share_or_of_long_ago_are_not_used():
    world = World(kinematics(), lateral=slide)
    world.drive(0.02, 0.8, 3.0)  # nearly in place
    assert abs(drift(world, 0.5, 0.0, 0.0)) < 0.2 * abs(SLIDE[1])
    world.drive(0.5, 0.0, 1.0)
    known = drift(world, 0.5, 0.0, world.yaw)
    world.lateral = lambda v_x, yaw_rate, yaw: 0.0
    world.drive(0.5, 0.0, 3.5)
    assert abs(drift(world, 0.5, 0.0, world.yaw)) < 0.01 * abs(known)


class Slope(World):
    """A slope on which the body slides along ``slide`` with the speed of a side of the turn."""

    def __init__(self, slide=(0.2, -0.1), pivot=0.0):
        def speeds(rate, yaw):
            s, cos, sin = 0.5 * TRACK * abs(rate), np.cos(yaw), np.sin(yaw)
            return s * (slide[0] * cos + slide[1] * sin), (
                s * (slide[1] * cos - slide[0] * sin) - pivot * rate)

        self.speeds = speeds
        super().__init__(kinematics(), ahead=lambda rate, yaw: speeds(rate, yaw)[0],
                         lateral=lambda v_x, rate, yaw: speeds(rate, yaw)[1])


@pytest.mark.parametrize('rate', [0.8, -0.8])
@pytest.mark.parametrize('pivot', [0.0, 0.03, -0.03])
def test_slide_and_center_of_a_turn_in_place_are_learned_for_other_yaws_and_rates(rate, pivot):
    world, yaws = Slope(pivot=pivot), np.linspace(-3.0, 3.0, 7)
    world.drive(0.0, rate, 4.0)  # in a shorter turn, slide and center look alike
    for other in (rate, -rate, 0.5 * rate):
        assert world.kinematics.lateral_speed(0.0, other, yaws) == pytest.approx(
            world.speeds(other, yaws)[1], abs=0.005)


def test_the_wheels_drive_against_the_slide_of_a_turn_in_place():
    world = Slope()
    world.drive(0.0, 0.8, 2.0)
    moved, free = zip(*((world.drive(0.0, 0.8, STEP)[0], world.speeds(0.8, world.yaw)[0])
                        for _ in range(500)))
    assert max(map(abs, free)) > 0.03
    assert max(map(abs, moved)) < 0.2 * max(map(abs, free))


def test_the_slide_of_a_turn_in_place_is_made_up_for_once():
    world = Slope()
    world.drive(0.08, 0.8, 2.0)
    moved, free = zip(*((world.drive(0.08, 0.8, STEP)[0], world.speeds(0.8, world.yaw)[0])
                        for _ in range(500)))
    assert np.abs(np.array(moved) - 0.08).max() < 0.25 * max(map(abs, free))


def test_in_place_the_speed_ahead_is_commanded_for_the_slip_of_the_turn():
    world = World(kinematics(), track=0.8)
    straight = world.kinematics.factors(0.5, 0.0, world.now_ns)[0]
    world.drive(0.05, 0.8, 3.0)
    ahead, _ = world.kinematics.factors(0.05, 0.8, world.now_ns)
    assert ahead == pytest.approx(0.8 / TRACK, rel=0.05)
    assert world.kinematics.factors(0.5, 0.0, world.now_ns)[0] == pytest.approx(
        straight, abs=1e-3)


def test_the_slip_of_a_turn_in_place_is_no_slide():
    world, yaws = World(kinematics(), track=0.8), np.linspace(-3.0, 3.0, 7)
    world.drive(0.05, 0.8, 1.0)
    assert abs(world.kinematics.lateral_speed(0.0, 0.8, yaws)).max() < 0.002


def test_a_slide_ahead_is_expected_in_place_only():
    world = World(kinematics(), lateral=lambda v_x, yaw_rate, yaw: -0.3 * v_x * math.cos(yaw))
    world.drive(0.15, 0.0, 3.0)
    world.yaw = 0.5 * math.pi  # where the body would slide ahead
    assert world.drive(0.15, 0.0, 2.0 * STEP)[0] == pytest.approx(0.15, rel=0.03)


def test_turns_in_place_are_remembered_over_the_way_between_them():
    world = Slope()
    world.drive(0.0, 0.8, 2.0)
    known = world.kinematics.lateral_speed(0.0, 0.8, 0.0)
    world.ahead, world.lateral = (lambda *_: 0.0), (lambda *_: 0.0)
    world.drive(0.5, 0.0, 6.0)
    assert world.kinematics.lateral_speed(0.0, 0.8, 0.0) == pytest.approx(known, rel=0.01)


def test_a_first_turn_in_place_is_expected_to_slide_as_straights():
    world = World(kinematics(), lateral=slide)
    world.drive(0.5, 0.0, 1.0)
    sides = 0.5 * TRACK * 0.8
    assert world.kinematics.lateral_speed(0.0, 0.8, world.yaw) == pytest.approx(
        sides * SLIDE[1], rel=0.05)


def test_wheels_do_not_drive_against_a_slide_that_is_faster_than_they_are():
    world = Slope(slide=(0.0, -2.0))
    world.drive(0.0, 0.8, 0.5)
    assert abs(world.kinematics.command(0.0, 0.8, world.now_ns, DELAY, WIDE)[0]) < 1e-4


def test_a_slide_is_made_up_for_within_its_bound():
    world, sides = Slope(slide=(0.0, -0.9)), 0.5 * TRACK * 0.8
    world.drive(0.0, 0.8, 1.5)
    slide, _ = world.speeds(0.8, world.yaw)
    v_x, _ = world.kinematics.command(0.0, 0.8, world.now_ns, DELAY, WIDE)
    v_x /= world.kinematics.factors(0.0, 0.8, world.now_ns)[0]  # of the body
    assert slide < -0.6 * sides
    assert 0.2 * sides < v_x < 1.05 * MAX_SLIDE * sides


def test_a_slip_that_is_not_plausible_teaches_nothing():
    world = Slope()
    world.drive(0.0, 0.8, 2.0)
    known = world.kinematics.lateral_speed(0.0, 0.8, 0.0)
    for _ in range(60):
        world.move(0.0, 0.8)
        world.kinematics.add_motion(world.reached(), world.now_ns)
        world.kinematics.add_slip(replace(world.wheel_slip(), slip_velocity=(1e6,) * 4))
    assert world.kinematics.lateral_speed(0.0, 0.8, 0.0) == pytest.approx(known, abs=1e-3)


def test_a_robot_that_rolls_down_a_slope_with_released_motors_teaches_nothing():
    world = World(kinematics())
    before = world.kinematics.command(0.5, 0.3, START, DELAY, WIDE)
    world.drive(0.0, 0.0, 0.1)
    for _ in range(400):
        world.move(0.01, 0.0)
        world.rolling = 0.0, 0.0  # the wheels stand
        world.kinematics.add_motion(world.reached(), world.now_ns)
        world.kinematics.add_slip(world.wheel_slip())
    assert world.kinematics.command(0.5, 0.3, START, DELAY, WIDE) == before


def test_older_odometry_is_ignored_and_another_clock_discards_all():
    world = World(kinematics(), slip=(0.2, 0.2))
    world.drive(0.5, 0.0, 2.0)
    learned = world.kinematics.command(0.5, 0.0, world.now_ns, DELAY, WIDE)
    world.kinematics.add_motion(world.reached(), world.now_ns - 10 ** 8)
    assert world.kinematics.command(0.5, 0.0, world.now_ns, DELAY, WIDE) == learned
    world.now_ns -= 10 * NS_PER_S
    world.kinematics.add_motion(world.reached(), world.now_ns)
    assert world.kinematics.command(0.5, 0.0, world.now_ns, DELAY, WIDE) == kinematics().command(
        0.5, 0.0, world.now_ns, DELAY, WIDE)
    world.slip = (0.1, 0.1)
    assert world.drive(0.5, 0.0, 2.0)[0] == pytest.approx(0.5, rel=0.02)
