# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Two motor boards on one line: polled, driven, supervised, and stopped on every fault."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from smart_tire.control.duty_gate import DutyGate
from smart_tire.drivers.roboclaw_pair import RoboclawPair
from smart_tire.parameters import MotorDriverParams
from smart_tire.protocol.roboclaw import (
    READ_BATTERY, READ_CURRENTS, READ_ENCODERS, READ_STATUS, READ_TIMEOUT, SET_DUTY, SET_TIMEOUT)
from smart_tire.samples import MotorCommand, NS_PER_S
from support.virtual_robot import played, VirtualDriver

ADDRESSES = (128, 129)
NAMES = {128: 'front board 128 (0x80)', 129: 'rear board 129 (0x81)'}
LINE = 0.01  # s, of the exchanges that may be under way on the line


def driver(**parameters):
    """Return the maker of a driver with these parameters."""
    return played(lambda: VirtualDriver(driver=parameters))


def samples(robot, count):
    """Let time pass until ``count`` more samples are there."""
    count += len(robot.samples)
    yield from robot.until(lambda: len(robot.samples) >= count)


def enabled(robot):
    """Let time pass until a command would move the wheels."""
    yield from robot.until(lambda: robot.output.gate.enabled)


def end(robot):
    """Return an iterator that lets time pass while the work of the port ends."""
    robot.stopping.set()
    robot.output.boards.wake()
    yield from robot.until(lambda: robot.ended)


@driver()
def test_samples_contain_speeds_angles_and_torques(robot):
    yield from robot.drive(0.5, 0.3, -0.4, 0.2)
    yield from samples(robot, 17)
    sample, speeds = robot.samples[-1], robot.state.speeds
    assert sample.velocity == pytest.approx(speeds, rel=0.02, abs=0.1)
    friction = 0.15  # N m, of the motors
    assert sample.effort == pytest.approx([friction, friction, -friction, friction], abs=0.05)
    late, early = robot.samples[-1], robot.samples[-5]
    elapsed = (late.stamp_ns - early.stamp_ns) / NS_PER_S
    turned = np.subtract(late.position, early.position)
    assert turned / elapsed == pytest.approx(speeds, rel=0.02, abs=0.1)
    assert 0 <= robot.clock.time_ns() - late.stamp_ns < LINE * NS_PER_S


@pytest.mark.parametrize('rate', [1.0, 4.0, 16.0, 50.0, 200.0])
@played(lambda rate: VirtualDriver(rate=rate, turnaround=1e-4))
def test_samples_have_the_configured_rate_and_the_mean_speed_of_their_period(robot, rate):
    robot.duty = (0.3,) * 4
    yield from samples(robot, max(round(1.5 * rate), 4))
    steps = np.diff([sample.stamp_ns for sample in robot.samples]) / NS_PER_S
    assert np.mean(steps) == pytest.approx(1.0 / rate, rel=0.05 if rate < 200.0 else 0.2)
    for early, late in itertools.pairwise(robot.samples[1:]):
        elapsed = (late.stamp_ns - early.stamp_ns) / NS_PER_S
        mean = np.subtract(late.position, early.position) / elapsed
        assert late.velocity == pytest.approx(mean, abs=0.3)
    assert max(sample.velocity[0] for sample in robot.samples) > 5.0


@driver(rate=1.0)
def test_wheels_are_checked_16_times_a_second_at_any_sample_rate(robot):
    yield from samples(robot, 2)
    for address in ADDRESSES:
        assert np.max(np.diff(robot.record().times(READ_ENCODERS, address))) < 0.0625 + LINE


@driver(rate=200.0)
def test_the_boards_are_supervised_on_a_line_that_is_too_slow_for_the_rate(robot):
    robot.port.turnaround = 0.003
    yield from robot.drive(0.3)
    since = robot.now
    yield 2.0
    for address in ADDRESSES:
        for command in (READ_STATUS, READ_TIMEOUT, READ_BATTERY):
            assert np.max(np.diff(robot.record(since).times(command, address))) < 0.15 + 0.15
    assert robot.output.boards.line.timing.excess(200.0)


@driver(signs=[1, -1, 1, -1])
def test_a_negative_sign_reverses_encoder_and_motor(robot):
    robot.duty = (0.4, 0.4, 0.2, 0.2)
    yield from robot.until(lambda: np.allclose(robot.state.duty, (0.4, -0.4, 0.2, -0.2),
                                               atol=1e-4))
    yield 1.5
    assert min(robot.samples[-1].velocity) > 3.0
    assert robot.samples[-1].effort == pytest.approx([0.15] * 4, abs=0.05)


@pytest.mark.parametrize('sign', ['draw', 'signed'])
@played(lambda sign: VirtualDriver(driver={
    'signs': [1, -1, 1, -1], 'motor.current_sign': sign}))
def test_torques_have_the_sign_of_their_convention(robot, sign):
    robot.duty = (0.5, -0.5, 0.4, -0.4)
    yield from robot.until(lambda: np.allclose(
        robot.state.duty, np.multiply(robot.duty, (1, -1, 1, -1)), atol=1e-4))
    robot.fail(currents={0: 100, 1: 100, 2: -50, 3: -50})
    yield from samples(robot, 2)
    assert robot.samples[-1].effort == pytest.approx((1.2, -1.2, -0.6, 0.6))


@pytest.mark.parametrize('faults', [{'without_currents': {128}}, {'garbled_currents': {128}}],
                         ids=str)
@driver()
def test_without_currents_only_the_torques_of_that_board_are_missing(robot, faults):
    currents = robot.output.boards.currents
    yield from robot.drive(0.4)
    assert currents.silent_boards() == []
    failed, seen = robot.fail(**faults), len(robot.samples)
    yield from robot.until(currents.silent_boards)
    yield from samples(robot, 8)
    late = robot.samples[seen + 1:]
    assert all(sample.effort is None or np.isnan(sample.effort[:2]).all() for sample in late)
    assert all(np.isfinite(sample.effort[2:]).all() for sample in late if sample.effort)
    assert all(min(sample.velocity) > 4.0 for sample in late)
    assert np.max(np.diff([sample.stamp_ns for sample in late])) < (0.0625 + 0.03) * NS_PER_S
    assert currents.silent_boards() == [NAMES[128]]
    assert currents.missing >= 4
    assert robot.record(failed).always_driven()
    assert robot.reports == []
    robot.fail()
    yield from robot.until(lambda: not currents.silent_boards())
    yield from samples(robot, 2)
    assert np.isfinite(robot.samples[-1].effort).all()


@pytest.mark.parametrize('phase', np.arange(50) / 50)
@driver()
def test_a_stop_does_not_wait_for_currents(robot, phase):
    yield from robot.drive(0.4)
    robot.fail(without_currents={128, 129})
    yield 0.2 + 0.0625 * phase
    asked = robot.now
    robot.output.engage()
    stopped = yield from robot.stop_time(asked)
    assert stopped < 0.02 + LINE


@pytest.mark.parametrize('phase', np.arange(125) / 125)
@driver()
def test_a_start_before_the_currents_rise_is_no_fault_at_any_phase_of_the_poll(robot, phase):
    yield from enabled(robot)
    yield 0.5 + 0.0625 * phase
    robot.fail(currents=dict.fromkeys(range(4), 1))  # 10 mA
    robot.duty = (0.254,) * 4
    robot.output.set_command(MotorCommand(0, robot.duty), robot.clock.now_ns())
    yield 0.006
    robot.fail()
    yield 0.5
    assert robot.output.gate.enabled and robot.reports == []


@pytest.mark.parametrize('delay', [0.03, 0.045, 0.07])
@driver()
def test_late_currents_are_neither_torques_nor_acknowledgements(robot, delay):
    yield from robot.drive(0.4)
    failed = robot.fail(late_currents={128: delay}, currents={0: -1, 1: -1})
    yield from samples(robot, 3)
    seen = len(robot.samples)
    yield 2.0
    efforts = [sample.effort for sample in robot.samples[seen:] if sample.effort]
    assert all(math.isnan(effort[0]) and math.isnan(effort[1]) for effort in efforts)
    if delay < 0.05:  # later, both replies to a duty behind them may be too late
        assert len(efforts) > 4  # of the other board
        assert all(min(sample.velocity) > 4.0 for sample in robot.samples[seen:])
        assert robot.reports == []
        assert robot.record(failed).always_driven()


@pytest.mark.parametrize('code', [32767, -32768, 3001, -3001])
@driver()
def test_an_implausible_current_is_rejected_for_its_wheel_only(robot, code):
    yield from robot.drive(0.4)
    robot.fail(currents={2: code})
    yield from samples(robot, 3)
    assert [math.isnan(one) for one in robot.samples[-1].effort] == [False, False, True, False]
    assert robot.output.boards.currents.rejected > 0
    assert robot.output.boards.currents.silent_boards() == []


@driver()
def test_encoders_are_read_before_currents_in_every_period(robot):
    yield from samples(robot, 6)
    commands = [(request.command, request.address) for _, request in robot.record().requests
                if request.command in (READ_ENCODERS, READ_CURRENTS)]
    first = commands.index((READ_CURRENTS, 128))
    cycle = [(READ_CURRENTS, 128), (READ_CURRENTS, 129),
             (READ_ENCODERS, 128), (READ_ENCODERS, 129)]
    assert commands[first:first + 16] == cycle * 4


@pytest.mark.parametrize('phase', np.arange(50) / 50)
@driver(rate=1.0)
def test_a_command_is_sent_at_once_and_ends_at_its_time_out(robot, phase):
    yield from enabled(robot)
    yield 0.3 * phase
    asked = robot.now
    robot.output.gate.command((1.0, -1.0, 0.5, 0.0), robot.clock.now_ns())
    robot.output.boards.wake()
    yield from robot.until(lambda: not robot.state.still)
    assert robot.record(asked).first_duty() - asked < LINE
    stopped = yield from robot.stop_time(asked)
    assert 0.25 < stopped < 0.25 + LINE
    assert robot.reports == ['motors stopped: no motor command for 0.25 s']


@driver()
def test_the_motors_stop_with_the_program(robot):
    yield from robot.drive(0.5)
    ended = robot.now
    yield from end(robot)
    assert robot.state.changed - ended < LINE
    assert robot.state.still
    assert not robot.output.gate.enabled
    assert robot.reports == []  # a regular end is not reported


@pytest.mark.parametrize('held, later', [(0.15, 0.0), (0.3, 0.0625)])
@driver()
def test_a_mean_speed_of_more_than_a_quarter_second_is_no_sample(robot, held, later):
    yield from samples(robot, 1)
    robot.clock.held_until_ns = robot.clock.now_ns() + round(held * NS_PER_S)
    yield held
    begin = robot.now
    yield from samples(robot, 1)
    assert later <= robot.now - begin < later + 3 * LINE


@driver(rate=4.0)
def test_nothing_is_done_while_nothing_is_due(robot):
    yield from samples(robot, 1)
    before = robot.clock.waits
    yield 1.0
    assert robot.clock.waits - before < 300  # exchanges: 16 polls, 33 duties, 13 checks


@driver()
def test_the_ages_of_readings_restart_when_the_port_is_reopened(robot):
    yield from samples(robot, 1)
    robot.port.plugged = False
    yield 1.0
    robot.port.plugged = True
    robot.fail(mute={128, 129})
    yield 0.5
    assert 0.0 < max(robot.output.boards.reading_ages().values()) <= 0.5


@driver(board_timeout=0.25)
def test_the_boards_get_zero_and_their_time_out_before_any_duty(robot):
    yield from robot.drive(0.3)
    record = robot.record()
    for address in ADDRESSES:
        first = next(request for _, request in record.requests if request.address == address)
        assert (first.command, first.values) == (SET_DUTY, (0, 0))
        for command in (SET_TIMEOUT, READ_TIMEOUT, READ_STATUS, READ_BATTERY):
            assert record.times(command, address)[0] < record.first_duty()
    assert robot.state.timeouts == (3, 3)  # 0.1 s, rounded up


@pytest.mark.parametrize('commanded', [False, True])
@driver(rate=1.0, command_timeout=1.0)
def test_duties_are_sent_continuously_with_and_without_commands(robot, commanded):
    yield from enabled(robot)
    asked = robot.now
    if commanded:
        robot.output.gate.command((0.2,) * 4, robot.clock.now_ns())
        robot.output.boards.wake()
    yield 0.9
    for address in ADDRESSES:
        assert np.max(np.diff(robot.record(asked).times(SET_DUTY, address))) < 0.03 + LINE


@pytest.mark.parametrize('rate', [4.0, 16.0, 200.0])
@played(lambda rate: VirtualDriver(rate=rate))
def test_status_time_out_and_supply_are_read_several_times_a_second(robot, rate):
    yield 1.0
    for address in ADDRESSES:
        for command in (READ_STATUS, READ_TIMEOUT, READ_BATTERY):
            times = robot.record().times(command, address)
            assert np.max(np.diff(times)) < 0.15 + 2 * LINE
            assert len(times) < 15  # the line has other work
    assert robot.output.boards.supply_voltage() == pytest.approx(14.8)


@pytest.mark.parametrize('faults', [
    {'mute': {128, 129}}, {'mute': {128}}, {'garbled': {129}}, {'flood': True}], ids=str)
@driver()
def test_a_missing_or_damaged_reply_stops_both_boards(robot, faults):
    boards = robot.output.boards
    yield from robot.drive(0.4)
    assert boards.faults == 0
    failed = robot.fail(**faults)
    stopped = yield from robot.stop_time(failed)
    assert stopped < 0.15
    yield 1.5
    record = robot.record(failed)
    assert not record.after(record.first_zero()).driven()
    assert boards.faults == 1
    assert len(robot.reports) == 1
    each = [[when for when in record.times(SET_DUTY, address)
             if when >= record.first_zero() - 0.01] for address in ADDRESSES]
    zeros = sum(each, [])
    assert abs(min(each[0]) - min(each[1])) < 0.005  # to both boards at once
    quiet = [when for when in record.bytes_at if when > max(zeros)]
    assert 0.15 < max(zeros) - min(zeros) < 0.25
    assert 10 <= len(zeros) < 40
    assert quiet[0] - max(zeros) > 0.3
    assert np.min(np.diff(quiet)) > 0.3
    probes = [request for when, request in record.requests if when > max(zeros)]
    assert {request.address for request in probes} == set(ADDRESSES)
    assert {request.command for request in probes} == {READ_TIMEOUT}
    robot.fail()
    yield from robot.drive(0.4)
    record = robot.record(failed + 1.5)
    for address in ADDRESSES:
        for command in (SET_TIMEOUT, READ_TIMEOUT):
            assert record.times(command, address)[0] < record.first_duty()


@driver()
def test_a_line_that_recovers_at_once_is_used_again_without_the_silence(robot):
    yield from robot.drive(0.4)
    failed = robot.fail(drop=2)  # a request and its repetition
    yield from robot.stop_time(failed)
    yield from robot.drive(0.4)
    record = robot.record(failed)
    assert 0.2 < record.after(record.first_zero()).first_duty() - failed < 0.45
    assert robot.output.boards.faults == 1
    assert all(min(sample.velocity) > 0.1 for sample in robot.samples[-4:])  # coasting


@driver()
def test_one_lost_reply_is_requested_again_and_yields_no_sample(robot):
    yield from robot.drive(0.3)
    yield 1.0
    since, count = robot.now, len(robot.samples)
    for _ in range(10):
        robot.fail(drop=1)
        yield from samples(robot, 3)
    assert robot.output.boards.line.frames_bad >= 10
    assert robot.record(since).always_driven()
    assert np.ptp([sample.velocity for sample in robot.samples[count:]]) < 1.0


@pytest.mark.parametrize('address', ADDRESSES)
@driver()
def test_a_restarted_board_is_configured_again_before_any_duty(robot, address):
    yield from robot.drive(0.4)
    yield from samples(robot, 1)
    position, restarted = robot.samples[-1].position, robot.now
    robot.boards.restart(address, restarted)
    yield from robot.until(lambda: robot.state.timeouts == (2, 2))
    yield from robot.drive(0.4)
    record = robot.record(restarted)
    assert not record.after(record.first_zero()).driven(record.times(SET_TIMEOUT, address)[0])
    assert f'{NAMES[address]} has restarted: its time-out is 0.0 s, expected 0.2 s' in (
        robot.reports[0])
    yield from samples(robot, 1)
    assert np.all(np.abs(np.subtract(robot.samples[-1].position, position)) < 20.0)


@pytest.mark.parametrize(('faults', 'text'), [
    ({'status': {128: 0x8000}}, 'front board 128 (0x80) reports status 0x8000, expected 0'),
    ({'status': {129: 0x0004}}, 'rear board 129 (0x81) reports status 0x0004, expected 0'),
    ({'supply': {128: 104}}, 'supply of front board 128 (0x80) is low: 10.4 V, expected at least'),
    ({'supply': {129: 60}}, 'supply of rear board 129 (0x81) is low: 6.0 V, expected at least'),
])
@driver()
def test_a_board_fault_stops_both_until_it_is_gone_and_commands_paused(robot, faults, text):
    yield from robot.drive(0.4)
    failed = robot.fail(**faults)
    yield from robot.stop_time(failed)
    assert text in robot.reports[0]
    robot.duty = (0.0,) * 4
    yield 0.2
    assert not robot.output.gate.enabled  # the cause is still present
    robot.duty = (0.4,) * 4
    yield 0.1
    robot.fail()
    yield 0.6
    assert robot.state.still  # commands were never interrupted
    robot.duty = (0.0,) * 4
    yield from enabled(robot)
    yield from robot.drive(0.4)


@pytest.mark.parametrize('address', ADDRESSES)
@driver()
def test_a_single_low_supply_reading_does_not_stop_the_motors(robot, address):
    yield from robot.drive(0.4)
    for _ in range(3):
        failed = robot.fail(supply={address: 50})
        yield from robot.until(
            lambda: robot.record(failed).times(READ_BATTERY, address))  # noqa: B023
        robot.fail(supply={128: 105, 129: 105})  # the limit
        yield 0.2
    assert robot.reports == []
    failed = robot.fail(supply={address: 50})
    yield from robot.until(lambda: robot.reports)
    assert len(robot.record(failed).times(READ_BATTERY, address)) == 2


@driver(tolerated_status=0x0003)
def test_status_bits_may_be_tolerated(robot):
    yield from robot.drive(0.4)
    robot.fail(status={128: 0x0002})
    yield 0.4
    assert robot.reports == []
    robot.fail(status={128: 0x0006})
    yield from robot.until(lambda: robot.reports)


@pytest.mark.parametrize(('faults', 'text'), [
    ({'frozen': {0}}, 'front_left no encoder counts'),
    ({'frozen': {3}}, 'rear_right no encoder counts'),
    ({'blocked': {2}}, 'rear_left no encoder counts'),
    ({'reversed': {1}}, 'front_right turns against duty'),
    ({'reversed': {2}}, 'rear_left turns against duty')])
@driver()
def test_a_wheel_that_contradicts_its_duty_stops_all_motors(robot, faults, text):
    yield from robot.drive(0.4)
    failed = robot.fail(**faults)
    yield from robot.stop_time(failed)
    assert text in robot.reports[0]
    robot.fail()
    yield 1.2
    assert robot.state.still  # commands were never interrupted
    robot.duty = (0.0,) * 4
    yield from enabled(robot)
    yield from robot.drive(0.4)


@driver()
def test_an_encoder_that_toggles_at_rest_does_not_stop_the_robot(robot):
    yield from enabled(robot)
    robot.fail(toggling={0})
    yield 1.0
    robot.fail()
    yield from robot.drive(0.4)
    assert robot.reports == []


@driver()
def test_a_stop_is_confirmed_by_both_boards(robot):
    yield from robot.drive(0.4)
    asked = robot.now
    robot.output.engage()
    robot.output.boards.expect_zero()
    yield from robot.until(robot.output.boards.confirmed.is_set)
    assert robot.now - asked < 2 * LINE
    for address in ADDRESSES:
        assert len(robot.record(asked).times(SET_DUTY, address)) >= 2


@driver()
def test_zero_is_confirmed_by_two_replies_after_the_last_one_to_another_duty(robot):
    yield from robot.drive(0.4)
    robot.output.boards.expect_zero()
    yield 0.3
    assert not robot.output.boards.confirmed.is_set()
    asked = robot.now
    robot.output.engage()
    yield from robot.until(robot.output.boards.confirmed.is_set)
    for address in ADDRESSES:
        assert len(robot.record(asked).times(SET_DUTY, address)) >= 2


@pytest.mark.parametrize('mute', [{128}, {129}, {128, 129}])
@driver()
def test_the_boards_that_do_not_confirm_a_stop_are_named(robot, mute):
    yield from robot.drive(0.4)
    robot.fail(mute=mute)
    robot.output.engage()
    robot.output.boards.expect_zero()
    yield 0.4
    assert not robot.output.boards.confirmed.is_set()
    assert robot.output.boards.unconfirmed() == [NAMES[address] for address in sorted(mute)]


@driver()
def test_the_time_since_the_latest_reading_is_reported_per_board(robot):
    yield from samples(robot, 2)
    ages = robot.output.boards.reading_ages
    assert max(ages().values()) < LINE
    failed = robot.fail(mute={129})
    yield 0.6
    assert list(ages()) == list(NAMES.values())
    assert ages()[NAMES[129]] == pytest.approx(robot.now - failed, abs=0.07)


def test_before_the_first_reading_the_supply_voltage_is_nan():
    motors = RoboclawPair(MotorDriverParams(), DutyGate(0.25, print), print)
    assert math.isnan(motors.supply_voltage())
    motors._boards[0].supply_voltage = 12.0
    assert math.isnan(motors.supply_voltage())
    motors._boards[1].supply_voltage = 11.0
    assert motors.supply_voltage() == 11.0
    assert motors.await_zero(0.01) == list(NAMES.values())
