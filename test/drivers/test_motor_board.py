# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Encoder counts to angles, wheel motion against duty, and when currents are read."""

from __future__ import annotations

import math

from hypothesis import given, strategies as st
import numpy as np
import pytest
from smart_tire.drivers.clock import Clock
from smart_tire.drivers.motor_board import Board, CurrentReader, MotionCheck, Reading, WheelEncoder
from smart_tire.parameters import MotorDriverParams
from smart_tire.protocol.roboclaw import COUNT_WRAP
from smart_tire.samples import NS_PER_S

DT = 1.0 / 16.0
RESOLUTION = math.tau / 2000
STALL_TORQUE = 5.0  # N m


@given(st.sampled_from([-1, 1]), st.integers(0, COUNT_WRAP - 1),
       st.lists(st.integers(-3000, 3000), max_size=20))
def test_counts_become_angles_across_the_wrap(sign, count, steps):
    encoder = WheelEncoder(sign, 2000)
    for step in (0, *steps):
        count = (count + step) % COUNT_WRAP
        encoder.add_count(count, 0.1)
        assert not encoder.jumped
    assert encoder.position == pytest.approx(sign * sum(steps) * RESOLUTION)


@pytest.mark.parametrize('elapsed', [0.0, -0.1])
def test_a_step_without_elapsed_time_is_ignored(elapsed):
    encoder = WheelEncoder(1, 2000)
    for count, seconds in ((0, 0.0), (100, elapsed), (110, 0.1)):
        encoder.add_count(count, seconds)
    assert encoder.position == pytest.approx(10 * RESOLUTION)


@pytest.mark.parametrize(('counts', 'jumped'), [
    (3183, False), (-3183, False), (3184, True), (-3184, True)])
def test_a_step_beyond_the_maximum_speed_is_a_jump_and_is_ignored(counts, jumped):
    encoder = WheelEncoder(1, 2000)  # 100 rad/s are 3183.1 counts in 0.1 s
    encoder.add_count(0, 0.0)
    encoder.add_count(counts % COUNT_WRAP, 0.1)
    assert encoder.jumped == jumped
    encoder.add_count((counts + 10) % COUNT_WRAP, 0.1)
    assert not encoder.jumped
    assert encoder.position == pytest.approx((10 if jumped else counts + 10) * RESOLUTION)


class Motor:
    """Readings of a wheel whose encoder and motor are given; ``sign`` mirrors all of them."""

    def __init__(self, sign=1.0):
        self.check, self.sign = MotionCheck(MotorDriverParams(), RESOLUTION), sign
        self.time = self.position = 0.0

    def run(self, duty, speed, seconds, load=math.nan):
        """Return the fault found within ``seconds`` and its time [s]; ``load`` is a duty."""
        for tick in range(1, round(seconds / DT) + 1):
            self.time += DT
            self.position += speed * DT
            problem = self.check.check_reading(Reading(
                self.time, self.sign * self.position, self.sign * duty,
                self.sign * load * STALL_TORQUE))
            if problem:
                return problem, tick * DT
        return '', seconds


both_directions = pytest.mark.parametrize('sign', [1.0, -1.0])


@both_directions
@pytest.mark.parametrize('duty', [0.05, 0.3, 1.0])
@pytest.mark.parametrize('load', [math.nan, 0.01])
def test_a_wheel_that_follows_its_duty_is_not_a_fault(sign, duty, load):
    assert Motor(sign).run(duty, 22.0 * (duty - 0.01), 2.0, load)[0] == ''


@both_directions
@pytest.mark.parametrize('phases', [
    pytest.param([(0.0, speed, 1.0, 0.0) for speed in (0.0, 5.0, -5.0, RESOLUTION / DT, 0.0)],
                 id='without duty any motion is accepted'),
    pytest.param([(0.5, 0.0, 0.2), (0.0, 0.0, 1.0)], id='the duty has ended'),
    pytest.param([(0.045, 0.0, 2.0, 0.0)], id='below the friction of the gear'),
    pytest.param([(0.12, 1.2, 1.0), (0.1, 0.0, 2.0)], id='the duty is reduced'),
    pytest.param([(0.12, 1.2, 1.0), (-0.02, 0.6, DT), (0.12, 0.0, 2.0)],
                 id='it was braked, and may be held now'),
    pytest.param([(0.049, 1.0, 1.0), (0.049, 0.0, 1.0)], id='below the driving duty'),
    pytest.param([(0.0, 2.0, 1.0), (0.1, 0.0, 2.0)], id='it coasted, and starts slowly'),
    pytest.param([(0.1, 0.4, 1.0), (0.1, 0.0, 1.0)], id='a slow wheel stops'),
    pytest.param([(0.299, 0.0, 10.0, 0.299)], id='below the stall duty'),
    pytest.param([(0.07, 0.0, 5.0, 0.07)], id='held by its load'),
    pytest.param([(0.35, 2.0 * RESOLUTION / (4.0 * DT), 2.0, 0.35)],
                 id='turned by two counts in a stall time'),
    pytest.param([(0.29, 0.0, 5.0, 0.29)], id='held by a high load'),
    pytest.param([(0.6, 22.0 * 0.55, 1.0, 0.05)], id='it rolls'),
    # the measured load is too low by the errors of both constants
    pytest.param([(0.6, 0.8 * 22.0 * 0.4, 2.0, 0.8 / 1.2 * 0.2)], id='other motor constants'),
    pytest.param([(-0.5, 6.0, 5.0, 0.5 + 6.0 / 22.0)], id='turned by a measured torque')])
def test_what_a_motor_and_its_load_explain_is_not_a_fault(sign, phases):
    motor = Motor(sign)
    assert [motor.run(*phase)[0] for phase in phases] == [''] * len(phases)


@both_directions
@pytest.mark.parametrize(('phases', 'text', 'earliest', 'latest'), [
    *(pytest.param([(0.07, 0.6, 1.0, load), (0.07, 0.0, 1.0, load)],
                   'no encoder counts', 0.2, 0.27,
                   id='rolling, then stopped at the same duty') for load in (math.nan, 0.04)),
    pytest.param([(0.05, 0.6, 1.0, 0.02), (0.05, 0.0, 1.0, 0.02)], 'no encoder counts', 0.2, 0.27,
                 id='stopped at the least driving duty'),
    pytest.param([(0.15, 0.0, DT, load) for load in (math.nan, 0.04, math.nan, 0.04, math.nan)],
                 'no encoder counts', 0.0, 0.1, id='two torques in a stall time are measured'),
    pytest.param([(0.301, 0.0, 1.0, 0.301)], 'no encoder counts', 0.2, 0.32,
                 id='at the stall duty'),
    pytest.param([(0.15, 0.0, 1.0, 0.04)], 'no encoder counts', 0.0, 0.32,
                 id='the current explains no standstill'),
    pytest.param([(0.6, 22.0 * 0.55, 1.0, 0.05), (0.6, 0.2 * 22.0 * 0.55, 1.0, 0.05)],
                 'too slowly', 0.0, 0.3, id='four of five counts are lost'),
    *(pytest.param([(0.5, -6.0, 1.0, load)], 'reversed', 0.2, 0.33, id='against the duty')
      for load in (math.nan, 0.05))])
def test_what_no_motor_does_is_a_fault_soon(sign, phases, text, earliest, latest):
    motor = Motor(sign)
    *before, (problem, after) = [motor.run(*phase) for phase in phases]
    assert all(found == '' for found, _ in before)
    assert text in problem and f'{sign * phases[-1][0]:.2f}' in problem
    assert earliest <= after < latest


@pytest.mark.parametrize('duty', [0.4, -0.4])
def test_an_encoder_that_toggles_by_one_count_is_a_fault(duty):
    check = MotionCheck(MotorDriverParams(), RESOLUTION)
    for tick in range(10):
        position = (tick // 4 % 2) * RESOLUTION
        if check.check_reading(Reading(tick * DT, position, duty, math.nan)):
            break
    assert 0.2 <= tick * DT < 0.3


@both_directions
@pytest.mark.parametrize('gap', [0.1, 0.15, 0.2, 0.3, 0.5])
def test_a_duty_after_a_stall_of_the_host_has_the_whole_stall_time_to_turn_the_wheel(sign, gap):
    motor = Motor(sign)
    motor.run(0.0, 0.0, 1.0, 0.0)
    motor.time += gap
    problem, after = motor.run(0.06, 0.0, 1.0, 0.005)
    assert 'no encoder counts' in problem and 0.2 <= after - DT < 0.2 + DT


@both_directions
@pytest.mark.parametrize('load', [math.nan, 0.0])
def test_a_braking_wheel_is_not_a_fault_even_if_the_board_measures_no_braking(sign, load):
    motor, speed = Motor(sign), 12.0
    motor.run(0.6, speed, 1.0, 0.05)
    while speed > 0.5:
        assert motor.run(-0.2, speed, DT, load)[0] == ''
        speed -= STALL_TORQUE * (0.2 + speed / 22.0) / 0.0286 * DT


@pytest.mark.parametrize(('speed', 'stopped'), [(1.9, ''), (2.1, 'no encoder counts')])
def test_a_coarse_encoder_rolls_once_it_has_counted_four_times(speed, stopped):
    motor = Motor()
    motor.check = MotionCheck(MotorDriverParams(), 0.1)  # rad per count: 0.6 rad in 5 readings
    assert motor.run(0.1, speed, 1.0)[0] == ''
    assert motor.run(0.1, 0.0, 1.0)[0].partition(' under')[0] == stopped


def test_a_reset_discards_the_readings_from_before():
    motor = Motor()
    motor.run(0.5, 0.0, 0.2)
    motor.check.reset()
    assert motor.run(0.5, 0.0, 1.0)[1] > 0.2


@both_directions
@pytest.mark.parametrize(('own', 'other', 'seconds', 'lags'), [  # duty, rad/s
    ((0.4, 1.0), (0.25, 4.0), 0.625, True), ((0.4, 0.0), (0.25, 0.5), 0.625, True),
    pytest.param((0.4, 1.0), (0.25, 4.0), 0.4375, False, id='too early'),
    pytest.param((0.34, 1.0), (0.25, 4.0), 0.625, False, id='under hardly more duty'),
    pytest.param((0.4, 1.61), (0.25, 4.0), 0.625, False, id='hardly slower'),
    pytest.param((0.4, 0.1), (0.25, 0.49), 0.625, False, id='the other one hardly rolls'),
    pytest.param((0.4, -0.1), (0.25, 4.0), 0.625, False, id='in the other direction')])
def test_a_wheel_that_lags_behind_the_other_one_of_its_side_is_a_fault(
        sign, own, other, seconds, lags):
    motors = Motor(sign), Motor(sign)
    for motor, (duty, speed) in zip(motors, (own, other)):
        for _ in range(round(seconds / DT) + 1):
            motor.run(duty, speed, DT)  # readings go on behind a fault of this wheel alone
    found = motors[0].check.lag(motors[1].check)
    assert bool(found) == lags
    assert motors[1].check.lag(motors[0].check) == ''
    if lags:
        assert f'under duty {sign * own[0]:.2f}' in found


ADDRESSES = (128, 129)


def readings(period, seconds, silent=()):
    """Return the times [s] of the requests to each board in ``seconds`` of polls."""
    now, asked, before = [0.0], {address: [] for address in ADDRESSES}, []

    class Line:

        def ask(self, address, command, wait):
            assert wait <= min(period, 0.02)
            asked[address].append(now[0])
            return None if address in silent else (0, 0)

    class ListClock(Clock):

        def now_ns(self):
            return round(now[0] * NS_PER_S)

    boards = [Board(address, str(address), [WheelEncoder(1, 2000)] * 2, [], span_ns=1)
              for address in ADDRESSES]
    reader = CurrentReader(MotorDriverParams(), boards, Line(), period, ListClock())
    for poll in range(round(seconds / period)):
        now[0] = poll * period
        reader.read(lambda: before.append(now[0]))
        assert reader.silent_boards() == [
            str(address) for address in silent if len(asked[address]) >= 4]
        for board in boards:  # torques are those of this poll only
            assert np.isfinite(board.torques).all() == (
                board.address not in silent and asked[board.address][-1:] == now)
    assert reader.missing == sum(len(asked[address]) for address in silent)
    assert before == sorted(sum(asked.values(), []))  # once before each request
    return asked.values()


@pytest.mark.parametrize(('rate', 'interval'), [(16.0, 1), (50.0, 1), (100.0, 2), (200.0, 4)])
def test_currents_are_read_at_50_hz_at_most_and_in_turn(rate, interval):
    front, rear = readings(1.0 / rate, 1.0)
    for times in (front, rear):
        assert np.diff(times) == pytest.approx(interval / rate)
        assert len(times) == rate // interval
    assert len({*front, *rear}) == rate * min(1.0, 2.0 / interval)  # not in the same poll


def test_a_board_without_currents_is_asked_at_doubling_intervals_up_to_10_s():
    silent, other = readings(0.0625, 60.0, {128})
    waits = [0.0625, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 10.0, 10.0, 10.0, 10.0]
    assert np.diff(silent) == pytest.approx(waits)
    assert np.diff(other) == pytest.approx(0.0625)
