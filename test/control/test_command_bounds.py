# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bounds of the command that leaves the trajectory controller, whatever the estimates are."""

from __future__ import annotations

from dataclasses import replace
import math
from unittest import mock

from hypothesis import given, settings, strategies as st
import pytest

from smart_tire.control.ground_motion import Motion
from smart_tire.control.motion_limits import command_share, motion_limits
from smart_tire.control.path_library import figure_eight, line, square
from smart_tire.control.slip_kinematics import SlipCoefficient, SlipKinematics, VelocityFeedback
from smart_tire.control.trajectory_control import PathState, TrajectoryControl
from smart_tire.parameters.control import TrajectoryControllerParams
from smart_tire.parameters.path_following import PathCheckParams
from smart_tire.samples import NS_PER_S, WheelSlip
from support.ideal_robot import odometry, Run

# no check of odometry but that it is finite: the bounds do not rest on any
DELAY = 0.15  # s
PARAMS = TrajectoryControllerParams(checks=PathCheckParams(
    odom_jump=10.0, max_cross_track_error=100.0, progress_timeout=600.0))
PERIOD_NS = 50_000_000
HOSTILE = st.one_of(st.floats(-3.0, 3.0), st.floats(), st.sampled_from(
    [math.nan, math.inf, -math.inf, 1e9, -1e9, 1e308, 5e-324]))
MOTION = st.tuples(HOSTILE, HOSTILE, HOSTILE)
SLIP = st.tuples(*[HOSTILE] * 5)


@settings(deadline=None, max_examples=15)
@given(st.sampled_from([figure_eight(0.3), square(0.6), line(-1.0)]),
       st.lists(st.tuples(MOTION, SLIP), min_size=40, max_size=40))
def test_every_command_is_bounded_whatever_odometry_and_slip_say(path, stream):
    control, now_ns = TrajectoryControl(PARAMS), NS_PER_S
    for (v_x, v_y, yaw_rate), slip in stream:
        sample = odometry(now_ns, v_x=v_x, yaw_rate=yaw_rate)
        control.add_odometry(replace(sample, linear=(v_x, v_y, 0.0)), now_ns)
        control.add_slip(WheelSlip(now_ns, slip[:4], slip[:4], (abs(slip[4]),) * 4))
        if control.state != PathState.FOLLOWING:
            control.add_odometry(odometry(now_ns + 1), now_ns + 1)
            control.follow(path, now_ns)
        command = control.step(now_ns + 1)
        if command is not None:
            assert abs(command.v_x) <= 1.1 * PARAMS.max_speed + 1e-12
            assert abs(command.yaw_rate) <= 1.1 * PARAMS.limits.yaw_rate + 1e-12
        now_ns += PERIOD_NS


@given(st.tuples(HOSTILE, HOSTILE))
def test_a_command_is_scaled_with_its_curvature(command):
    share = command_share(command, PARAMS)
    assert 0.0 <= share <= 1.0
    if not all(map(math.isfinite, command)):
        assert share == 0.0
    elif abs(command[0]) <= 0.66 and abs(command[1]) <= 1.65:
        assert share == 1.0
    else:
        assert max(share * abs(command[0]) / 0.66,
                   share * abs(command[1]) / 1.65) == pytest.approx(1.0)


@given(st.tuples(HOSTILE, HOSTILE))
def test_the_last_bound_holds_whatever_the_kinematics_return(wrong):
    control = TrajectoryControl(PARAMS)
    control.add_odometry(odometry(NS_PER_S), NS_PER_S)
    control.follow(line(4.0), NS_PER_S)
    with mock.patch.object(SlipKinematics, 'command', return_value=wrong):
        command = control.step(NS_PER_S)
    assert command is not None
    assert abs(command.v_x) <= 0.66 + 1e-12 and abs(command.yaw_rate) <= 1.65 + 1e-12
    if not all(map(math.isfinite, wrong)):
        assert (command.v_x, command.yaw_rate) == (0.0, 0.0)


def test_a_bounded_command_does_not_wind_up_the_feedback():
    kinematics, wanted, now_ns = SlipKinematics(PARAMS), (0.3, 1.5), NS_PER_S
    first = kinematics.command(*wanted, now_ns, DELAY, PARAMS)
    factors = kinematics.factors(*wanted, now_ns)
    assert first[1] == pytest.approx(1.65) and 1.5 * factors[1] > 2.0
    for step in range(1, 60):  # the body moves as the bounded command says
        now_ns = NS_PER_S + step * PERIOD_NS
        reached = first if step > 3 else (0.0, 0.0)
        kinematics.add_motion(Motion(0.0, 0.0, 0.0, reached[0] / factors[0], 0.0,
                                     reached[1] / factors[1]), now_ns)
        kinematics.command(*wanted, now_ns, DELAY, PARAMS)
    slower = kinematics.command(0.3, 0.5, now_ns + PERIOD_NS, DELAY, PARAMS)
    assert slower[1] == pytest.approx(0.5 * factors[1], abs=0.15)


def test_the_robot_slows_down_for_what_the_command_can_reach():
    plain, slipping = (motion_limits(PARAMS, 9.0, one) for one in ((1.05, 1.1), (1.5, 2.2)))
    assert (plain.speed, plain.yaw_rate) == (0.6, 1.5)
    assert (slipping.speed, slipping.yaw_rate) == pytest.approx((0.6 / 1.5 * 1.1, 0.75))


def followed(path, slip_velocity, seconds):
    """Return the commands (n, 2) of a robot without slip that reports a slip velocity."""
    run = Run(PARAMS).start(path)
    for _ in range(round(seconds * run.params.rate)):
        run.control.add_slip(WheelSlip(run.now_ns, (0.3,) * 4, (slip_velocity,) * 4, (0.01,) * 4))
        run.step()
    return run.log[:, 6:]


@pytest.mark.parametrize('slip_velocity', [0.3, -0.3, 3.0])
def test_a_fault_of_the_slip_makes_the_robot_no_faster(slip_velocity):
    commands = abs(followed(figure_eight(0.5), slip_velocity, 8.0))
    assert (commands.max(axis=0) <= (0.66 + 1e-9, 1.65 + 1e-9)).all()


def test_a_slip_fault_makes_the_robot_slower_instead():
    assert 0.4 <= followed(line(4.0), 0.3, 4.0)[-1, 0] <= 0.6


def test_a_gyro_that_is_faster_than_wanted_lowers_the_command():
    feedback = VelocityFeedback()
    for step in range(1, 40):
        feedback.wanted.add(step * PERIOD_NS, 0.5, 1.0)
        added = feedback.correction((0.5, 1.7), step * PERIOD_NS, 0.15, (0.25, 0.45))
    assert added == (pytest.approx(0.0, abs=0.2), -0.45)


def test_feedback_waits_for_the_delay_of_the_base():
    feedback, added = VelocityFeedback(), (0.0, 0.0)
    for step in range(1, 6):
        feedback.wanted.add(step * PERIOD_NS, *((0.5, 1.0) if step > 2 else (0.0, 0.0)))
        added = feedback.correction((0.0, 0.0), step * PERIOD_NS, 0.15, (0.25, 0.45))
        assert added == (0.0, 0.0)
    added = feedback.correction((0.0, 0.0), 6 * PERIOD_NS, 0.15, (0.25, 0.45))
    assert added[0] > 0.0 and added[1] > 0.0


def test_feedback_begins_at_zero_after_standstill():
    kinematics = SlipKinematics(PARAMS)
    for step in range(1, 20):
        kinematics.add_motion(Motion(0.0, 0.0, 0.0, 0.1, 0.0, 0.0), step * PERIOD_NS)
        raised = kinematics.command(0.3, 0.0, step * PERIOD_NS, DELAY, PARAMS)
    assert raised[0] > 0.4
    assert kinematics.command(0.0, 0.0, 20 * PERIOD_NS, DELAY, PARAMS) == (0.0, 0.0)
    assert kinematics.command(0.3, 0.0, 21 * PERIOD_NS, DELAY, PARAMS)[0] < 0.35


def test_feedback_ends_at_its_bound_and_leaves_it_at_once():
    feedback, added = VelocityFeedback(), (0.0, 0.0)
    for step in range(1, 400):
        feedback.wanted.add(step * PERIOD_NS, 0.5, 0.0)
        added = feedback.correction((0.0, 0.0), step * PERIOD_NS, 0.15, (0.25, 0.45))
    assert added[0] == 0.25
    added = feedback.correction((0.6, 0.0), 400 * PERIOD_NS, 0.15, (0.25, 0.45))
    assert added[0] < 0.25


@given(st.lists(st.tuples(HOSTILE, HOSTILE, HOSTILE), max_size=30))
def test_a_coefficient_remains_in_its_range_and_finite(measurements):
    coefficient = SlipCoefficient(0.5, 0.4, 0.0, 2.0)
    for regressor, measured, sigma in measurements:
        coefficient.correct(regressor, measured, abs(sigma), 0.003, 0.08)
        assert 0.0 <= coefficient.value <= 2.0


def test_one_outlier_changes_a_coefficient_little():
    coefficient = SlipCoefficient(0.5, 0.4, 0.0, 2.0)
    for _ in range(50):
        coefficient.correct(0.2, 0.12, 0.0, 0.003, 0.08)
    assert coefficient.value == pytest.approx(0.6, abs=0.01)
    coefficient.correct(0.2, 5.0, 0.0, 0.003, 0.08)
    assert coefficient.value == pytest.approx(0.6, abs=0.1)
