# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Time limits of the trajectory controller on an injected clock: exact, at every phase and rate.

Samples of the odometry and steps of the control are events of two periods with any phase between
them. Each limit is kept to one period: the robot does not stop before, and stops right after.
"""

from __future__ import annotations

from dataclasses import replace
import heapq

from hypothesis import given, settings, strategies as st
import pytest

from smart_tire.control.constants import MAX_WAIT
from smart_tire.control.ground_motion import Motion, TwistCheck
from smart_tire.control.path_library import line
from smart_tire.control.stop_conditions import OdometryCheck
from smart_tire.control.trajectory_control import PathState, TrajectoryControl
from smart_tire.parameters.path_following import PathCheckParams
from smart_tire.samples import NS_PER_S, WheelSample
from support.ideal_robot import IDEAL, odometry

RATES = 4.0, 16.0, 50.0, 100.0, 200.0  # Hz, of odometry and wheels
PHASES = 20                            # of each period
STEP_NS = round(NS_PER_S / IDEAL.rate)
RADIUS = IDEAL.robot.wheel_radius
ONE_MM = 0.001 / IDEAL.max_speed * NS_PER_S  # ns
phases = st.floats(0.0, 1.0, exclude_max=True)


class Drive:
    """A robot on a straight path that moves as commanded; ``rate`` [Hz] is that of ``odom``."""

    def __init__(self, rate, phase=0.0, **checks):
        self.control = TrajectoryControl(replace(IDEAL, checks=PathCheckParams(**checks)))
        self.x = self.speed = 0.0
        self.now_ns = self.shown_ns = NS_PER_S
        self.delay_ns = 0  # from the stamp of odometry to its arrival
        self.is_silent = self.is_blocked = False
        self._period_ns = round(NS_PER_S / rate)
        self._number = 0
        self._events = []
        self._put(self.now_ns, self._observe)
        self._put(self.now_ns + round(phase * STEP_NS), self._step)

    def _put(self, when_ns, act):
        heapq.heappush(self._events, (when_ns, self._number, act))
        self._number += 1

    def _observe(self):
        speed = 0.0 if self.is_blocked else self.speed
        self.x += speed * self._period_ns / NS_PER_S
        if not self.is_silent:
            sample = odometry(self.now_ns, self.x, v_x=speed)
            self._put(self.now_ns + self.delay_ns, lambda: self._receive(sample))
        self._put(self.now_ns + self._period_ns, self._observe)

    def _receive(self, sample):
        self.control.add_odometry(sample, self.now_ns)
        self.shown_ns = sample.stamp_ns

    def _step(self):
        command = self.control.step(self.now_ns)
        self.speed = command.v_x if command else 0.0
        self._put(self.now_ns + STEP_NS, self._step)

    def run(self, seconds):
        """Let time pass, or until following ends; return whether it goes on."""
        end_ns = self.now_ns + round(seconds * NS_PER_S)
        while self._events[0][0] <= end_ns:
            self.now_ns, _, act = heapq.heappop(self._events)
            act()
            if self.control.state == PathState.STOPPED:
                return False
        self.now_ns = end_ns
        return True

    def stall(self, seconds):
        """Let time pass in which the process does not run: events wait, in their order."""
        self.now_ns += round(seconds * NS_PER_S)
        late, self._events = self._events, []
        for when_ns, _, act in sorted(late):
            self._put(max(when_ns, self.now_ns), act)

    def under_way(self):
        """Follow a path for some time."""
        assert self.run(0.6)
        self.control.follow(line(100.0), self.now_ns)
        assert self.run(1.5) and self.speed > 0.5
        return self


@pytest.mark.parametrize('rate', RATES)
def test_the_robot_stops_when_odom_is_older_than_its_time_out(rate):
    for phase in range(PHASES):
        drive = Drive(rate, phase / PHASES).under_way()
        drive.is_silent = True
        assert not drive.run(2.0)
        assert 0 < drive.now_ns - drive.shown_ns - NS_PER_S // 2 <= STEP_NS
        assert (drive.speed, drive.control.reason[:6]) == (0.0, 'odom: ')


@settings(max_examples=150)
@given(st.sampled_from(RATES), phases, st.floats(0.0, 0.6), st.floats(0.05, 1.0))
def test_delayed_odom_stops_the_robot_by_the_age_of_its_stamp(rate, phase, delay, timeout):
    drive = Drive(rate, phase, odom_timeout=timeout)
    drive.delay_ns = round(delay * NS_PER_S)
    oldest = delay + 1.0 / rate  # s, just before the next sample arrives
    drive.run(1.5)
    drive.control.follow(line(100.0), drive.now_ns)
    goes_on = drive.run(3.0)
    if oldest < timeout:
        assert goes_on and drive.speed > 0.5
    if delay > timeout:
        assert not goes_on and drive.speed == 0.0
    if goes_on:
        drive.is_silent = True
        assert not drive.run(3.0)
    assert 0 < drive.now_ns - drive.shown_ns - timeout * NS_PER_S <= max(
        STEP_NS, (delay - timeout) * NS_PER_S + 1.5 * NS_PER_S / rate + STEP_NS)


@settings(max_examples=150)
@given(st.sampled_from(RATES), phases, st.floats(0.01, 2.0))
def test_after_a_stall_the_robot_drives_on_only_with_odom_that_is_not_too_old(
        rate, phase, seconds):
    drive = Drive(rate, phase).under_way()
    drive.stall(seconds)
    while drive.run(0.01) and drive.now_ns < 5 * NS_PER_S:
        assert drive.control.state == PathState.FOLLOWING
        if drive.speed:
            assert drive.now_ns - drive.shown_ns <= NS_PER_S // 2 + STEP_NS
    if seconds < 0.5 - 1.0 / rate:
        assert drive.control.state == PathState.FOLLOWING


@pytest.mark.parametrize('rate', RATES)
def test_a_robot_that_is_blocked_stops_after_the_time_without_progress(rate):
    timeout = 1.0
    for phase in range(PHASES):
        drive = Drive(rate, phase / PHASES, progress_timeout=timeout).under_way()
        drive.is_blocked, began_ns = True, drive.now_ns
        assert not drive.run(2.0 * timeout + 1.0)
        assert drive.control.reason.startswith(f'no progress for {timeout:g} s')
        # progress counts in steps of 20 mm, which odometry shows up to one sample later
        late_ns = drive.now_ns - began_ns - timeout * NS_PER_S
        assert -40 * ONE_MM - STEP_NS <= late_ns <= NS_PER_S / rate + 2 * STEP_NS


def test_the_first_odom_is_awaited_for_a_limited_time():
    for phase in range(PHASES):
        drive = Drive(RATES[0], phase / PHASES)
        drive.is_silent = True
        drive.control.follow(line(1.0), drive.now_ns)
        assert not drive.run(2.0 * MAX_WAIT)
        first_ns = NS_PER_S + round(phase / PHASES * STEP_NS)  # step after the path
        assert 0 < drive.now_ns - first_ns - MAX_WAIT * NS_PER_S <= STEP_NS


@settings(max_examples=200)
@given(st.sampled_from(RATES), st.sampled_from(RATES), phases, phases, st.sampled_from((
    ((0.5, 0.0), (0.0, 0.0)), ((0.5, 0.0), (0.025, 0.0)), ((0.0, 0.0), (0.3, 0.0)),
    ((0.0, 1.5), (0.0, -0.5)), ((0.0, 0.0), (0.0, 1.0)))))
def test_odom_that_contradicts_the_wheels_is_found_within_1_s_after_it_began(
        wheel_rate, odom_rate, wheel_phase, odom_phase, motions):
    """Until then the robot stands; both inputs have any rate and phase."""
    (wheels, turning), (speed, yaw_rate) = motions
    arm = 0.5 * IDEAL.robot.track_width
    poses, began = TwistCheck(), 2.0
    check = OdometryCheck(IDEAL.robot, poses.travel)
    events = sorted(
        [((index + wheel_phase) / wheel_rate, 'wheels') for index in range(round(4 * wheel_rate))]
        + [((index + odom_phase) / odom_rate, 'odom') for index in range(round(4 * odom_rate))])
    for now, kind in events:
        since, stamp_ns = max(now - began, 0.0), round(now * NS_PER_S)
        if kind == 'wheels':
            speeds = [(wheels + side * arm * turning) / RADIUS if since else 0.0
                      for side in (-1, 1, -1, 1)]
            check.add_wheels(WheelSample(stamp_ns, tuple(speeds)))
        else:
            poses.corrected(
                Motion(speed * since, 0.0, yaw_rate * since, 0.0, 0.0, 0.0), stamp_ns)
        if check.fault(IDEAL.checks.max_slip):
            break
    assert 0.0 < since < 1.0
