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

from collections.abc import Iterator
import itertools
import math
import threading
import time

import numpy as np
import pytest
from smart_tire.control.duty_gate import DutyGate
from smart_tire.drivers.roboclaw_pair import RoboclawPair
from smart_tire.drivers.serial_port import open_port
from smart_tire.parameters import build, MotorDriverParams
from smart_tire.protocol.roboclaw import (
    READ_BATTERY, READ_CURRENTS, READ_ENCODERS, READ_STATUS, READ_TIMEOUT, SET_DUTY, SET_TIMEOUT)
from smart_tire.samples import NS_PER_S
from support.motor_rig import MotorRig
from support.waiting import wait_for

pytestmark = pytest.mark.safety

ADDRESSES = (128, 129)
SLACK = 0.05  # s, for the scheduler of a busy machine


@pytest.fixture(scope='module')
def rig(tmp_path_factory) -> Iterator[MotorRig]:
    with MotorRig(tmp_path_factory.mktemp('boards') / 'motors') as boards:
        yield boards


class Running:
    """Served motor boards, a context; sends commands periodically once ``duty`` is set."""

    def __init__(self, rig, **parameters):
        params = build(MotorDriverParams, {key.replace('__', '.'): value
                                           for key, value in parameters.items()})
        self.rig, self.samples, self.reports = rig, [], []
        self.gate = DutyGate(params.command_timeout, self.reports.append)
        self.motors = RoboclawPair(params, self.gate, self.samples.append)
        self.duty = None
        self.port = open_port(str(rig.path), 115200)
        self._stopping, self._quiet = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self.motors.run,
                                        args=(self.port, self._stopping))
        self._commander = threading.Thread(target=self._command)

    def __enter__(self):
        self.rig.fail()
        self.began = time.monotonic()
        self._thread.start()
        self._commander.start()
        wait_for(lambda: self.gate.enabled)
        return self

    def __exit__(self, *_):
        self._quiet.set()
        self._commander.join()
        self.end()
        self.port.close()

    def end(self):
        """Stop serving the port."""
        self._stopping.set()
        self._thread.join()

    def _command(self):
        while not self._quiet.wait(0.06):
            if self.duty is not None:
                self.gate.command(self.duty, time.monotonic_ns())
                self.motors.wake()

    def drive(self, *duty):
        """Command from now on, and wait until motors and wheels follow."""
        self.duty = duty if len(duty) == 4 else duty * 4
        wait_for(lambda: np.allclose(self.rig.state().duty, self.duty, atol=1e-4)
                 and np.allclose(self.rig.state().speeds, np.multiply(self.duty, 22.0), atol=2.0))

    def stopped(self, since):
        """Return the time from ``since`` to zero duty at the motors [s]."""
        wait_for(lambda: self.rig.state().still)
        return self.rig.state().changed - since

    def wait(self, count):
        """Wait for ``count`` more samples and return the last one."""
        count += len(self.samples)
        wait_for(lambda: len(self.samples) >= count)
        return self.samples[-1]


def pause(seconds):
    """Let time pass while the motors are observed."""
    threading.Event().wait(seconds)


def test_samples_contain_speeds_angles_and_torques(rig):
    with Running(rig) as running:
        running.drive(0.5, 0.3, -0.4, 0.2)
        running.wait(16)
        sample = running.wait(1)
        assert sample.velocity == pytest.approx(rig.state().speeds, rel=0.1, abs=0.2)
        friction = 0.15  # N m, of the rig
        assert sample.effort == pytest.approx([friction, friction, -friction, friction], abs=0.1)
        late, early = running.samples[-1], running.samples[-5]
        elapsed = (late.stamp_ns - early.stamp_ns) / NS_PER_S
        turned = np.subtract(late.position, early.position)
        assert turned / elapsed == pytest.approx(rig.state().speeds, rel=0.1, abs=0.2)
        assert abs(late.stamp_ns - time.time_ns()) < 0.2 * NS_PER_S


@pytest.mark.parametrize('rate', [4.0, 16.0, 50.0])
def test_samples_have_the_configured_rate_and_the_mean_speed_of_their_period(rig, rate):
    with Running(rig, rate=rate) as running:
        running.duty = (0.3,) * 4
        running.wait(round(1.5 * rate))
        samples = running.samples
        steps = np.diff([sample.stamp_ns for sample in samples]) / NS_PER_S
        assert np.median(steps) == pytest.approx(1.0 / rate, rel=0.1)
        errors = []
        for early, late in itertools.pairwise(samples[1:]):
            elapsed = (late.stamp_ns - early.stamp_ns) / NS_PER_S
            mean = np.subtract(late.position, early.position) / elapsed
            errors.append(np.max(np.abs(np.subtract(late.velocity, mean))))
        assert np.median(errors) < 0.3
        assert max(sample.velocity[0] for sample in samples) > 5.0


def test_wheels_are_checked_16_times_a_second_at_any_sample_rate(rig):
    with Running(rig, rate=1.0) as running:
        running.wait(2)
        record = rig.record(running.began)
        for address in ADDRESSES:
            times = record.times(READ_ENCODERS, address)
            assert np.max(np.diff(times)) < 0.0625 + SLACK


def test_a_negative_sign_reverses_encoder_and_motor(rig):
    with Running(rig, signs=[1, -1, 1, -1]) as running:
        running.duty = (0.4, 0.4, 0.2, 0.2)
        wait_for(lambda: np.allclose(rig.state().duty, (0.4, -0.4, 0.2, -0.2), atol=1e-4))
        running.wait(1)
        wait_for(lambda: running.samples[-1].velocity[3] > 2.0)
        wait_for(lambda: min(running.samples[-1].velocity) > 3.0)
        pause(1.0)
        assert running.wait(1).effort == pytest.approx([0.15] * 4, abs=0.1)
        assert min(running.samples[-1].velocity) > 0.0


@pytest.mark.parametrize(('sign', 'signs', 'torques'), [
    ('draw', [1, -1, 1, -1], (1.2, -1.2, -0.6, 0.6)),
    ('signed', [1, -1, 1, -1], (1.2, -1.2, -0.6, 0.6))])
def test_torques_have_the_sign_of_their_convention(rig, sign, signs, torques):
    with Running(rig, signs=signs, motor__current_sign=sign) as running:
        running.duty = (0.5, -0.5, 0.4, -0.4)
        wait_for(lambda: np.allclose(rig.state().duty, np.multiply(running.duty, signs),
                                     atol=1e-4))
        rig.fail(currents={0: 100, 1: 100, 2: -50, 3: -50})
        running.wait(2)
        assert running.samples[-1].effort == pytest.approx(torques)


@pytest.mark.parametrize('faults', [{'without_currents': {128}}, {'garbled_currents': {128}}],
                         ids=str)
def test_without_currents_only_the_torques_of_that_board_are_missing(rig, faults):
    with Running(rig) as running:
        running.drive(0.4)
        assert running.motors.currents.silent_boards() == []
        failed = rig.fail(**faults)
        seen = len(running.samples)
        wait_for(lambda: running.motors.currents.silent_boards())
        running.wait(8)
        late = running.samples[seen + 3:]
        assert all(sample.effort is None or np.isnan(sample.effort[:2]).all() for sample in late)
        late = [sample for sample in late if sample.effort]
        assert np.mean([np.isfinite(sample.effort[2:]) for sample in late]) > 0.8
        assert all(min(sample.velocity) > 4.0 for sample in late)
        assert np.max(np.diff([sample.stamp_ns for sample in late])) < (
            0.0625 + SLACK) * NS_PER_S
        assert running.motors.currents.silent_boards() == ['front board 128 (0x80)']
        assert running.motors.currents.missing >= 4
        assert rig.record(failed).always_driven()
        assert running.reports == []
        rig.fail()
        wait_for(lambda: not running.motors.currents.silent_boards())
        assert np.isfinite(running.wait(2).effort).all()


def test_a_stop_does_not_wait_for_currents(rig):
    with Running(rig, rate=16.0) as running:
        for _ in range(5):
            running.drive(0.4)
            rig.fail(without_currents={128, 129})
            pause(0.2)
            asked = time.monotonic()
            running.gate.engage(time.monotonic_ns())
            running.motors.wake()
            assert running.stopped(asked) < 0.03 + SLACK
            running.duty = None
            running.gate.release(time.monotonic_ns())
            rig.fail()
            wait_for(lambda: running.gate.enabled)


@pytest.mark.parametrize('delay', [0.03, 0.045, 0.07])
def test_late_currents_are_neither_torques_nor_acknowledgements(rig, delay):
    with Running(rig) as running:
        running.drive(0.4)
        failed = rig.fail(late_currents={128: delay}, currents={0: -1, 1: -1})
        running.wait(3)
        seen = len(running.samples)
        pause(2.0)
        efforts = [sample.effort for sample in running.samples[seen:] if sample.effort]
        assert all(math.isnan(effort[0]) and math.isnan(effort[1]) for effort in efforts)
        if delay < 0.05:  # later, both replies to a duty behind them may be too late
            assert len(efforts) > 4  # of the other board
            assert all(min(sample.velocity) > 4.0 for sample in running.samples[seen:])
            assert running.reports == []
            assert rig.record(failed).always_driven()


@pytest.mark.parametrize('code', [32767, -32768, 3001, -3001])
def test_an_implausible_current_is_rejected_for_its_wheel_only(rig, code):
    with Running(rig) as running:
        running.drive(0.4)
        rig.fail(currents={2: code})
        running.wait(2)
        effort = running.wait(1).effort
        assert math.isnan(effort[2])
        assert np.isfinite([effort[0], effort[1], effort[3]]).all()
        assert running.motors.currents.rejected > 0
        assert running.motors.currents.silent_boards() == []


def test_encoders_are_read_before_currents_in_every_period(rig):
    with Running(rig) as running:
        running.wait(6)
        commands = [(request.command, request.address)
                    for _, request in rig.record(running.began).requests
                    if request.command in (READ_ENCODERS, READ_CURRENTS)]
        first = commands.index((READ_CURRENTS, 128))
        cycle = [(READ_CURRENTS, 128), (READ_CURRENTS, 129),
                 (READ_ENCODERS, 128), (READ_ENCODERS, 129)]
        assert commands[first:first + 16] == cycle * 4


def test_a_command_is_sent_at_once_and_ends_at_its_time_out(rig):
    with Running(rig, rate=1.0) as running:
        pause(0.1)
        asked = time.monotonic()
        running.gate.command((1.0, -1.0, 0.5, 0.0), time.monotonic_ns())
        running.motors.wake()
        wait_for(lambda: not rig.state().still)
        record = rig.record(asked)
        assert record.first_duty() - asked < 0.03
        assert 0.24 < running.stopped(asked) < 0.25 + SLACK
        assert running.reports == ['motors stopped: no motor command for 0.25 s']


def test_the_motors_stop_with_the_program(rig):
    with Running(rig) as running:
        running.drive(0.5)
        ended = time.monotonic()
        running.end()
        assert rig.state().still
        assert running.stopped(ended) < 0.1
        assert not running.gate.enabled
        assert running.reports == []  # a regular end is not reported


def test_waiting_costs_no_cpu_time(rig):
    with Running(rig, rate=4.0) as running:
        running.wait(1)
        before = time.process_time()
        pause(1.0)
        assert time.process_time() - before < 0.5


def test_the_ages_of_readings_restart_when_the_port_is_reopened(rig):
    with Running(rig) as running:
        running.wait(1)
        running.end()
        running.port.close()
        pause(1.0)
        port = open_port(str(rig.path), 115200)
        stopping = threading.Event()
        rig.fail(mute={128, 129})
        thread = threading.Thread(target=running.motors.run, args=(port, stopping))
        thread.start()
        pause(0.3)
        assert max(running.motors.reading_ages().values()) < 0.8
        stopping.set()
        thread.join()
        port.close()


def test_the_boards_get_zero_and_their_time_out_before_any_duty(rig):
    with Running(rig, board_timeout=0.25) as running:
        running.drive(0.3)
        record = rig.record(running.began)
        for address in ADDRESSES:
            first = next(request for _, request in record.requests if request.address == address)
            assert (first.command, first.values) == (SET_DUTY, (0, 0))
            for command in (SET_TIMEOUT, READ_TIMEOUT, READ_STATUS, READ_BATTERY):
                assert record.times(command, address)[0] < record.first_duty()
        assert rig.state().timeouts == (3, 3)  # 0.1 s, rounded up


@pytest.mark.parametrize('commanded', [False, True])
def test_duties_are_sent_continuously_with_and_without_commands(rig, commanded):
    with Running(rig, rate=1.0, command_timeout=1.0) as running:
        asked = time.monotonic()
        if commanded:
            running.gate.command((0.2,) * 4, time.monotonic_ns())
            running.motors.wake()
        pause(0.8)
        for address in ADDRESSES:
            assert np.max(np.diff(rig.record(asked).times(SET_DUTY, address))) < 0.03 + SLACK


def test_status_time_out_and_supply_are_read_several_times_a_second(rig):
    with Running(rig) as running:
        pause(1.0)
        record = rig.record(running.began)
        for address in ADDRESSES:
            for command in (READ_STATUS, READ_TIMEOUT, READ_BATTERY):
                times = record.times(command, address)
                assert np.max(np.diff(times)) < 0.15 + 2 * SLACK
                assert len(times) < 15  # the line has other work
        assert running.motors.supply_voltage() == pytest.approx(14.8)


@pytest.mark.parametrize('faults', [
    {'mute': {128, 129}}, {'mute': {128}}, {'garbled': {129}}, {'flood': True}], ids=str)
def test_a_missing_or_damaged_reply_stops_both_boards(rig, faults):
    with Running(rig) as running:
        running.drive(0.4)
        assert running.motors.faults == 0
        failed = rig.fail(**faults)
        assert running.stopped(failed) < 0.15 + SLACK
        pause(1.5)
        record = rig.record(failed)
        assert not record.after(record.first_zero()).driven()
        assert running.motors.faults == 1
        assert len(running.reports) == 1
        each = [[when for when in record.times(SET_DUTY, address)
                 if when >= record.first_zero() - 0.01] for address in ADDRESSES]
        zeros = sum(each, [])
        assert abs(min(each[0]) - min(each[1])) < 0.005  # to both boards at once
        quiet = [when for when in record.bytes_at if when > max(zeros)]
        assert 0.15 < max(zeros) - min(zeros) < 0.25 + SLACK
        assert len(zeros) < 40
        assert quiet[0] - max(zeros) > 0.29
        assert np.min(np.diff(quiet)) > 0.29
        assert {request.address for when, request in record.requests
                if when > max(zeros)} == set(ADDRESSES)
        assert {request.command for when, request in record.requests
                if when > max(zeros)} == {READ_TIMEOUT}
        rig.fail()
        running.drive(0.4)


def test_a_line_that_recovers_at_once_is_used_again_without_the_silence(rig):
    with Running(rig) as running:
        running.drive(0.4)
        failed = rig.fail(drop=2)  # a request and its repetition
        running.stopped(failed)
        running.drive(0.4)
        record = rig.record(failed)
        back = record.after(record.first_zero()).first_duty()
        assert 0.2 < back - failed < 0.45
        assert running.motors.faults == 1
        assert all(min(sample.velocity) > 0.0 for sample in running.samples[-4:])


def test_the_first_reading_after_a_fault_gives_no_speed(rig):
    with Running(rig) as running:
        running.drive(0.4)
        seen = len(running.samples)
        rig.fail(drop=2)
        wait_for(lambda: running.motors.faults == 1)
        running.wait(2)
        assert all(min(sample.velocity) > 0.1 for sample in running.samples[seen:])  # coasting


def test_a_repeated_request_does_not_yield_a_sample(rig):
    with Running(rig) as running:
        running.drive(0.3)
        count = len(running.samples)
        for _ in range(10):
            rig.fail(drop=1)
            running.wait(3)
        assert running.motors.line.frames_bad >= 10
        speeds = [sample.velocity for sample in running.samples[count:]]
        assert np.ptp(speeds) < 3.0


def test_a_restarted_board_is_configured_again(rig):
    with Running(rig) as running:
        running.drive(0.4)
        position = running.wait(1).position
        restarted = rig.restart(129)
        wait_for(lambda: rig.state().timeouts == (2, 2))
        running.drive(0.4)
        record = rig.record(restarted)
        assert record.first_zero() - restarted < 0.3
        assert 'rear board 129 (0x81) has restarted: its time-out is 0.0 s, expected 0.2 s' in (
            running.reports[0])
        assert np.all(np.abs(np.subtract(running.wait(1).position, position)) < 20.0)


@pytest.mark.parametrize(('faults', 'text'), [
    ({'status': {128: 0x0001}}, 'front board 128 (0x80) reports status 0x0001, expected 0'),
    ({'supply': {129: 104}}, 'supply of rear board 129 (0x81) is low: 10.4 V, expected at least'),
])
def test_a_board_fault_stops_both_until_it_is_gone_and_commands_paused(rig, faults, text):
    with Running(rig) as running:
        running.drive(0.4)
        failed = rig.fail(**faults)
        assert running.stopped(failed) < 0.4
        assert text in running.reports[0]
        running.duty = (0.0,) * 4
        pause(0.2)
        assert not running.gate.enabled  # the cause is still present
        rig.fail()
        wait_for(lambda: running.gate.enabled)
        running.drive(0.4)


def test_a_single_low_supply_reading_does_not_stop_the_motors(rig):
    with Running(rig) as running:
        running.drive(0.4)
        for _ in range(3):
            failed = rig.fail(supply={128: 50})
            wait_for(lambda: rig.record(failed).times(READ_BATTERY, 128))  # noqa: B023
            rig.fail()
            pause(0.2)
        assert running.reports == []


def test_status_bits_may_be_tolerated(rig):
    with Running(rig, tolerated_status=0x0003) as running:
        running.drive(0.4)
        rig.fail(status={128: 0x0002})
        pause(0.4)
        assert running.reports == []
        rig.fail(status={128: 0x0006})
        wait_for(lambda: running.reports)


@pytest.mark.parametrize(('faults', 'text'), [
    ({'frozen': {0}}, 'front_left no encoder counts'),
    ({'frozen': {3}}, 'rear_right no encoder counts'),
    ({'reversed': {1}}, 'front_right turns against duty'),
    ({'reversed': {2}}, 'rear_left turns against duty')])
def test_a_wheel_that_contradicts_its_duty_stops_all_motors(rig, faults, text):
    with Running(rig) as running:
        running.drive(0.4)
        failed = rig.fail(**faults)
        assert running.stopped(failed) < 0.5
        assert text in running.reports[0]
        rig.fail()
        pause(0.4)
        assert rig.state().still  # commands were never interrupted
        running.duty = (0.0,) * 4
        wait_for(lambda: running.gate.enabled)
        running.drive(0.4)


def test_a_stop_is_confirmed_by_both_boards(rig):
    with Running(rig) as running:
        running.drive(0.4)
        running.gate.engage(time.monotonic_ns())
        asked = time.monotonic()
        assert running.motors.await_zero(0.4) == []
        assert time.monotonic() - asked < 0.1
        for address in ADDRESSES:
            assert len(rig.record(asked).times(SET_DUTY, address)) >= 2


@pytest.mark.parametrize('mute', [{128}, {129}, {128, 129}])
def test_the_boards_that_do_not_confirm_a_stop_are_named(rig, mute):
    with Running(rig) as running:
        running.drive(0.4)
        rig.fail(mute=mute)
        running.gate.engage(time.monotonic_ns())
        asked = time.monotonic()
        silent = running.motors.await_zero(0.4)
        assert time.monotonic() - asked == pytest.approx(0.4, abs=0.1)
        names = {128: 'front board 128 (0x80)', 129: 'rear board 129 (0x81)'}
        assert silent == [names[address] for address in sorted(mute)]


def test_the_time_since_the_latest_reading_is_reported_per_board(rig):
    with Running(rig) as running:
        running.wait(2)
        assert max(running.motors.reading_ages().values()) < 0.2
        failed = rig.fail(mute={129})
        pause(0.6)
        ages = running.motors.reading_ages()
        assert list(ages) == ['front board 128 (0x80)', 'rear board 129 (0x81)']
        assert ages['rear board 129 (0x81)'] == pytest.approx(time.monotonic() - failed, abs=0.2)


def test_before_the_first_reading_the_supply_voltage_is_nan():
    motors = RoboclawPair(MotorDriverParams(), DutyGate(0.25, print), print)
    assert math.isnan(motors.supply_voltage())
    motors._boards[0].supply_voltage = 12.0
    assert math.isnan(motors.supply_voltage())
    motors._boards[1].supply_voltage = 11.0
    assert motors.supply_voltage() == 11.0
    assert max(motors.reading_ages().values()) < 1.0
    assert motors.await_zero(0.01) == ['front board 128 (0x80)', 'rear board 129 (0x81)']
