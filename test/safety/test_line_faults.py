"""Motor boards that do not answer, answer badly, or started over: bounds at the boards."""

from __future__ import annotations

from collections.abc import Iterator
import time

import pytest
from support.robot_rig import RobotRig

from smart_tire.protocol.roboclaw import (
    READ_TIMEOUT, SET_DUTY, SET_TIMEOUT)

pytestmark = pytest.mark.safety

BOARD_TIMEOUT = 0.2  # s, the default
SLACK = 0.05         # s, for the scheduler of a busy machine


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
def test_lost_replies_mean_zero_then_silence_and_duty_only_once_all_is_well(robot, faults):
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
    """Check that zero was repeated, that the line was silent then, and only probed after that."""
    assert not record.after(record.first_zero()).driven()
    stopped = record.first_zero() - 0.01
    zeros = [[when for when in record.times(SET_DUTY, address) if when >= stopped]
             for address in (128, 129)]
    for instants in zeros:
        assert len(instants) >= 4
        assert 0.12 < instants[-1] - instants[0] < 0.25 + SLACK
    ended = max(zeros[0][-1], zeros[1][-1])
    after = [when for when in record.bytes_at if when > ended]
    assert after, 'it never asked again'
    assert after[0] - ended > BOARD_TIMEOUT + 0.1 - 0.01
    assert all(late - early > BOARD_TIMEOUT for early, late in zip(after, after[1:]))
    probes = [request for when, request in record.requests if when > ended]
    assert {request.command for request in probes} == {READ_TIMEOUT}
    assert {request.address for request in probes} == {128, 129}


def test_boards_that_ignore_zero_are_stopped_by_their_own_time_out(robot):
    failed = robot.rig.fail(mute={128, 129}, ignoring_duties={128, 129})
    assert robot.until_stopped(failed) < 0.5 + SLACK


def test_requests_that_arrive_as_noise_leave_the_boards_to_their_time_out(robot):
    failed = robot.rig.fail(deaf=True)
    assert robot.until_stopped(failed) < 0.5 + SLACK


def test_one_lost_reply_is_asked_for_again_and_stops_nothing(robot):
    bad = int(robot.graph.value('motor_driver', 'frames_bad'))
    since = robot.rig.fail(drop=1)
    robot.graph.until(lambda: int(robot.graph.value('motor_driver', 'frames_bad')) == bad + 1,
                      robot.command)
    assert robot.rig.record(since).always_driven()


@pytest.mark.parametrize('address', [128, 129])
def test_a_board_that_restarted_means_zero_duty_until_its_time_out_is_set_again(robot, address):
    restarted = robot.rig.restart(address)
    robot.graph.until(lambda: robot.rig.state().timeouts == (2, 2), robot.command)
    robot.drive()
    record = robot.rig.record(restarted)
    assert record.first_zero() - restarted < 0.5
    assert not record.after(record.first_zero()).driven(record.times(SET_TIMEOUT, address)[0])
    robot.graph.until(lambda: 'has restarted' in robot.processes['motor_driver'].output)


def test_each_time_out_is_read_back_at_least_once_a_second(robot):
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
def test_a_board_that_is_not_well_means_zero_duty_until_it_is_and_commands_paused(
        robot, fault, text):
    failed = robot.rig.fail(**fault)
    assert robot.until_stopped(failed) < 0.5
    robot.graph.until(lambda: text in robot.complaint(), robot.command)
    robot.rig.fail()
    robot.stay_stopped(0.6)
    robot.pause()
    robot.drive()


def test_a_supply_at_the_limit_is_enough(robot):
    since = robot.rig.fail(supply={128: 105, 129: 105})
    robot.hold(0.8, robot.command)
    assert robot.rig.record(since).always_driven()


BROKEN = {'frozen': 'no encoder counts', 'reversed': 'encoder or motor reversed'}


@pytest.mark.parametrize('wheel', [1, 2])
@pytest.mark.parametrize('kind', BROKEN)
def test_an_encoder_that_breaks_means_zero_duty_until_commands_paused(robot, kind, wheel):
    failed = robot.rig.fail(**{kind: {wheel}})
    assert robot.until_stopped(failed) < 0.5
    assert BROKEN[kind] in robot.processes['motor_driver'].output
    robot.rig.fail()
    robot.stay_stopped(0.6)
    robot.pause()
    robot.drive()


@pytest.mark.parametrize('kind', BROKEN)
def test_an_encoder_that_was_broken_before_the_start_means_zero_duty_within_half_a_second(
        robot, kind):
    robot.pause()
    failed = robot.rig.fail(**{kind: {1}})
    robot.graph.until(lambda: not robot.rig.state().still, robot.command)
    started = robot.rig.record(failed).first_duty()
    assert robot.until_stopped(started) < 0.5
    robot.stay_stopped(0.6)
    robot.pause()
