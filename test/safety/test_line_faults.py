# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motor boards that do not respond, respond wrongly or restart: stop times at the boards."""

from __future__ import annotations

from collections.abc import Iterator
import time

import pytest
from smart_tire.protocol.roboclaw import (
    READ_TIMEOUT, SET_DUTY, SET_TIMEOUT)
from support.robot_rig import RobotRig

pytestmark = pytest.mark.safety

BOARD_TIMEOUT = 0.2  # s, the default
SCHEDULING_TOLERANCE = 0.05  # s, on a busy machine


@pytest.fixture(scope='module')
def robot(tmp_path_factory, isolated_ros) -> Iterator[RobotRig]:
    with RobotRig(tmp_path_factory.mktemp('line')) as started:
        yield started


@pytest.fixture(autouse=True)
def driving(robot):
    robot.rig.fail()
    robot.drive()
    yield
    robot.rig.fail()


LOST = {
    'both mute': {'mute': {128, 129}}, 'front mute': {'mute': {128}},
    'rear mute': {'mute': {129}}, 'both garbled': {'garbled': {128, 129}},
    'rear garbled': {'garbled': {129}}, 'flooded': {'flood': True},
}


@pytest.mark.parametrize('faults', LOST.values(), ids=LOST)
def test_lost_replies_cause_zero_duty_then_silence_until_all_boards_respond(robot, faults):
    failed = robot.rig.fail(**faults)
    assert robot.until_stopped(failed) < 0.3
    robot.hold(1.4, robot.command)
    check_silence(robot.rig.record(failed))
    repaired = robot.rig.fail()
    robot.drive()
    record = robot.rig.record(repaired)
    for address in (128, 129):
        for command in (SET_TIMEOUT, READ_TIMEOUT):
            assert record.times(command, address)[0] < record.first_duty()
    assert robot.rig.state().timeouts == (2, 2)


def check_silence(record):
    """Check that zero was repeated, then the line was silent, then only probes were sent."""
    assert not record.after(record.first_zero()).driven()
    stopped = record.first_zero() - 0.01
    zeros = [[when for when in record.times(SET_DUTY, address) if when >= stopped]
             for address in (128, 129)]
    for times in zeros:
        assert len(times) >= 4
        assert 0.12 < times[-1] - times[0] < 0.25 + SCHEDULING_TOLERANCE
    ended = max(zeros[0][-1], zeros[1][-1])
    after = [when for when in record.bytes_at if when > ended]
    assert after, 'the boards were not probed again'
    assert after[0] - ended > BOARD_TIMEOUT + 0.1 - 0.01
    assert all(late - early > BOARD_TIMEOUT for early, late in zip(after, after[1:]))
    probes = [request for when, request in record.requests if when > ended]
    assert {request.command for request in probes} == {READ_TIMEOUT}
    assert {request.address for request in probes} == {128, 129}


def test_boards_that_ignore_zero_duty_are_stopped_by_their_own_time_out(robot):
    failed = robot.rig.fail(mute={128, 129}, ignoring_duties={128, 129})
    assert robot.until_stopped(failed) < 0.5 + SCHEDULING_TOLERANCE


def test_garbled_requests_let_the_boards_time_out(robot):
    failed = robot.rig.fail(deaf=True)
    assert robot.until_stopped(failed) < 0.5 + SCHEDULING_TOLERANCE


def test_one_lost_reply_is_requested_again_without_a_stop(robot):
    def lose_a_reply():
        bad = int(robot.graph.value('motor_driver', 'frames_bad'))
        robot.rig.fail(drop=1)
        robot.graph.until(lambda: int(robot.graph.value('motor_driver', 'frames_bad')) > bad,
                          robot.command)

    robot.keep_driving(lose_a_reply)


@pytest.mark.parametrize('address', [128, 129])
def test_a_restarted_board_gets_zero_duty_until_its_time_out_is_set(robot, address):
    restarted = robot.rig.restart(address)
    robot.graph.until(lambda: robot.rig.state().timeouts == (2, 2), robot.command)
    robot.drive()
    record = robot.rig.record(restarted)
    assert record.first_zero() - restarted < 0.5
    assert not record.after(record.first_zero()).driven(record.times(SET_TIMEOUT, address)[0])
    robot.graph.until(lambda: 'has restarted' in robot.processes['motor_driver'].output)


def test_the_time_out_of_each_board_is_read_back_at_least_once_a_second(robot):
    since = time.monotonic()
    robot.hold(2.0, robot.command)
    record = robot.rig.record(since)
    for address in (128, 129):
        instants = [since, *record.times(READ_TIMEOUT, address)]
        assert max(late - early for early, late in zip(instants, instants[1:])) < 0.5


@pytest.mark.parametrize(('fault', 'text'), [
    ({'status': {129: 0x0004}}, 'rear board 129 (0x81) reports status 0x0004'),
    ({'status': {128: 0x8000}}, 'front board 128 (0x80) reports status 0x8000'),
    ({'supply': {128: 104}}, 'supply of front board 128 (0x80) is low: 10.4 V'),
    ({'supply': {129: 60}}, 'supply of rear board 129 (0x81) is low: 6.0 V'),
])
def test_a_board_fault_causes_zero_duty_until_it_ends_and_commands_pause(
        robot, fault, text):
    failed = robot.rig.fail(**fault)
    assert robot.until_stopped(failed) < 0.5
    robot.graph.until(lambda: text in robot.status_message(), robot.command)
    robot.rig.fail()
    robot.stay_stopped(0.6)
    robot.pause()
    robot.drive()


def test_a_supply_at_the_limit_is_accepted(robot):
    robot.rig.fail(supply={128: 105, 129: 105})
    robot.keep_driving(lambda: robot.hold(0.8, robot.command))


ENCODER_FAULTS = {'frozen': 'no encoder counts', 'reversed': 'encoder or motor reversed'}


@pytest.mark.parametrize('wheel', [1, 2])
@pytest.mark.parametrize('kind', ENCODER_FAULTS)
def test_a_broken_encoder_causes_zero_duty_until_commands_pause(robot, kind, wheel):
    failed = robot.rig.fail(**{kind: {wheel}})
    assert robot.until_stopped(failed) < 0.5
    assert ENCODER_FAULTS[kind] in robot.processes['motor_driver'].output
    robot.rig.fail()
    robot.stay_stopped(0.6)
    robot.pause()
    robot.drive()


ENCODER_CHANNELS = {'toggling': {'toggling': {1}}, 'losing': {'losing': {2: 0.8}}}


@pytest.mark.parametrize('faults', ENCODER_CHANNELS.values(), ids=ENCODER_CHANNELS)
@pytest.mark.parametrize('speed', [0.1, 0.7])
def test_an_encoder_with_an_open_channel_or_lost_counts_causes_zero_duty(robot, faults, speed):
    robot.hold(1.0, lambda: robot.command(speed))
    failed = robot.rig.fail(**faults)
    assert robot.until_stopped(failed, lambda: robot.command(speed)) < (
        1.0 if 'losing' in faults else 0.5)
    robot.rig.fail()
    robot.stay_stopped(0.6)
    robot.pause()
    robot.drive()


def test_an_encoder_frozen_at_a_low_speed_causes_zero_duty(robot):
    robot.hold(1.0, lambda: robot.command(0.1))
    failed = robot.rig.fail(frozen={0})
    assert robot.until_stopped(failed, lambda: robot.command(0.1)) < 0.5
    robot.rig.fail()
    robot.pause()


def test_an_encoder_that_toggles_at_rest_does_not_stop_the_robot(robot):
    robot.pause()
    robot.rig.fail(toggling={0})
    robot.hold(1.0)
    robot.rig.fail()
    robot.keep_driving(lambda: robot.hold(0.3, robot.command))


@pytest.mark.parametrize('kind', ENCODER_FAULTS)
def test_an_encoder_broken_before_the_start_causes_zero_duty_within_half_a_second(
        robot, kind):
    robot.pause()
    failed = robot.rig.fail(**{kind: {1}})
    robot.graph.until(lambda: not robot.rig.state().still, robot.command)
    started = robot.rig.record(failed).first_duty()
    assert robot.until_stopped(started) < 0.5
    robot.stay_stopped(0.6)
    robot.pause()
