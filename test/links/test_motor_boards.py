"""Two motor boards on one port: polled, driven, and stopped when nobody commands."""

from __future__ import annotations

import math
import threading

import pytest
from support.boards import Boards
from support.pty_port import PtyPort
from support.waiting import wait_for

from smart_tire.links.motor_boards import MotorBoards
from smart_tire.links.serial_link import open_port
from smart_tire.protocol.roboclaw import COUNT_WRAP, DUTY_MAX

COUNTS = 2000


@pytest.fixture
def boards(tmp_path):
    port = PtyPort(tmp_path / 'motors').plug_in()
    with Boards(port) as served:
        served.path = str(port.path)
        yield served
    port.unplug()


class Running:
    """Motor boards at work on a port; a context."""

    def __init__(self, path, *, signs=(1, 1, 1, 1), rate=100.0, command_timeout=2.0):
        self.samples, self.reports = [], []
        self.motors = MotorBoards((128, 129), signs, COUNTS, rate, command_timeout,
                                  self.samples.append, self.reports.append)
        self._port = open_port(path, 115200)
        self._stopping = threading.Event()
        self._thread = threading.Thread(
            target=self.motors.run, args=(self._port, self._stopping))

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stopping.set()
        self._thread.join()
        self._port.close()

    def wait(self, count):
        """Wait until ``count`` more samples have come and return the last one."""
        count += len(self.samples)
        wait_for(lambda: len(self.samples) >= count)
        return self.samples[-1]


def test_positions_follow_the_counts_of_each_wheel_and_across_the_wrap(boards):
    boards.counts = {128: (10, COUNT_WRAP - 100), 129: (COUNT_WRAP // 2 - 1, 0)}
    with Running(boards.path) as running:
        start = running.wait(1).position
        boards.counts = {128: (30, 100), 129: (COUNT_WRAP // 2 + 49, COUNT_WRAP - 40)}
        end = running.wait(3).position
    turned = [round((b - a) * COUNTS / math.tau, 3) for a, b in zip(start, end)]
    assert turned == [20.0, 200.0, 50.0, -40.0]


def test_speed_is_the_step_over_the_time_between_the_stamps(boards):
    with Running(boards.path) as running:
        running.wait(3)
        boards.counts = {128: (100, 100), 129: (100, 100)}
        running.wait(3)
    for before, after in zip(running.samples, running.samples[1:]):
        elapsed = (after.stamp_ns - before.stamp_ns) * 1e-9
        steps = [b - a for a, b in zip(before.position, after.position)]
        if min(steps) > 0.15:  # the whole step, seen by all wheels in the same cycle
            assert after.velocity == pytest.approx([step / elapsed for step in steps], rel=0.5)
    assert max(max(sample.velocity) for sample in running.samples) > 1.0
    assert running.samples[-1].velocity == (0.0, 0.0, 0.0, 0.0)


def test_mirrored_wheels_count_and_drive_backwards(boards):
    with Running(boards.path, signs=(1, -1, 1, -1)) as running:
        start = running.wait(1).position
        boards.counts = {128: (20, COUNT_WRAP - 20), 129: (20, COUNT_WRAP - 20)}
        end = running.wait(3).position
        running.motors.command((0.5, 0.5, 0.25, 0.25))
        wait_for(lambda: running.samples[-1].effort[3] > 0.0)
        assert running.samples[-1].effort == pytest.approx((0.5, 0.5, 0.25, 0.25), abs=1e-3)
        assert boards.duty.get(128) == (round(DUTY_MAX / 2), -round(DUTY_MAX / 2))
    assert [round((b - a) * COUNTS / math.tau) for a, b in zip(start, end)] == [20] * 4


def test_a_command_goes_out_at_once_and_ends_with_the_commands(boards):
    with Running(boards.path, rate=1.0) as running:  # it does not wait for the next cycle
        wait_for(lambda: boards.duty == {128: (0, 0), 129: (0, 0)})
        running.motors.command((1.0, -1.0, 2.0, 0.0))
        wait_for(lambda: boards.duty == {128: (DUTY_MAX, -DUTY_MAX), 129: (DUTY_MAX, 0)})
        wait_for(lambda: boards.duty == {128: (0, 0), 129: (0, 0)})
        assert running.motors.timeouts == 1
        assert 'motors stopped' in running.reports[0]


def test_the_motors_stop_with_the_program(boards):
    with Running(boards.path) as running:
        running.motors.command((1.0, 1.0, 1.0, 1.0))
        wait_for(lambda: boards.duty.get(129) == (DUTY_MAX, DUTY_MAX))
    assert boards.duty == {128: (0, 0), 129: (0, 0)}


def test_each_board_gets_its_own_time_out_and_again_after_a_silence(boards):
    with Running(boards.path, command_timeout=0.25) as running:
        running.wait(1)
        assert boards.timeout == {128: 3, 129: 3}  # in units of 0.1 s, rounded up
        boards.answering = {128}
        bad = running.motors.frames_bad
        wait_for(lambda: running.motors.frames_bad > bad)
        boards.timeout[129] = 0
        boards.answering = {128, 129}
        wait_for(lambda: boards.timeout[129] == 3)


def test_a_silent_board_is_counted_and_does_not_stop_the_other(boards):
    boards.answering = {128}
    with Running(boards.path) as running:
        running.motors.command((1.0, 1.0, 1.0, 1.0))
        wait_for(lambda: boards.duty.get(128) == (DUTY_MAX, DUTY_MAX))
        wait_for(lambda: running.motors.frames_bad >= 3)
        assert 'reply of 0x81 to command 14 has 0 bytes' in running.motors.last_error
        rear = 'rear board 129 (0x81)'
        wait_for(lambda: running.motors.unread()[rear] > 0.2)
        assert running.motors.unread()['front board 128 (0x80)'] < running.motors.unread()[rear]
        assert not running.samples  # half of the wheels are no wheel state
        boards.answering = {128, 129}
        running.wait(1)
        wait_for(lambda: running.motors.unread()[rear] < 0.2)


def test_a_damaged_reply_is_counted_and_asked_for_again(boards):
    boards.damaged = 3
    with Running(boards.path) as running:
        running.wait(1)
        assert running.motors.frames_bad == 3
        assert running.motors.bytes_skipped == 3 * 10  # two counts and their CRC each
        assert 'wrong CRC' in running.motors.last_error


def test_a_board_that_loses_its_counts_does_not_throw_the_wheels(boards):
    boards.counts = {128: (1_000_000, 1_000_000), 129: (0, 0)}
    with Running(boards.path) as running:
        start = running.wait(2)
        boards.counts = {128: (0, 0), 129: (0, 0)}
        end = running.wait(4)
    assert end.position == start.position
    assert all(speed == 0.0 for sample in running.samples for speed in sample.velocity)
