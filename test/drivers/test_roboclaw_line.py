# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Requests and replies: one retry, no confusion of replies, refusal of unrequested bytes."""

from __future__ import annotations

import os

import pytest
from serial import SerialTimeoutException

from smart_tire.drivers.clock import Clock
from smart_tire.drivers.roboclaw_line import (
    ACKNOWLEDGE_GAP, LineTiming, MAX_EXCHANGES, MAX_UNREQUESTED_BYTES, MIN_EXCHANGES,
    REPLY_TIMEOUT, RoboclawLine)
from smart_tire.drivers.serial_port import open_port
from smart_tire.errors import FrameError
from smart_tire.protocol.roboclaw import (
    encode_reply, encode_request, READ_CURRENTS, READ_ENCODERS, READ_STATUS, READ_STATUS_32,
    READ_TIMEOUT, SET_DUTY)
from smart_tire.samples import NS_PER_S
from support.pty_port import PtyPort
from support.virtual_robot import VirtualClock, VirtualPort

EPOCH_NS = 1_700_000_000 * NS_PER_S

GOOD = encode_reply(128, READ_TIMEOUT, 2)
CURRENTS = encode_reply(128, READ_CURRENTS, -10, 150)  # begins like an acknowledgement
BAD_CURRENTS = CURRENTS[:-1] + bytes((CURRENTS[-1] ^ 1,))
ENCODERS = encode_reply(128, READ_ENCODERS, 7, 8)
BAD = GOOD[:-1] + bytes((GOOD[-1] ^ 1,))
MS = 1_000_000


class ScriptedPort:
    """A port that returns the next of ``replies`` after each request."""

    def __init__(self, *replies):
        self.replies = list(replies)
        self.written = []
        self.pending = b''
        self.unsent = b''
        self.timeouts = []  # of the requests, s
        self.timeout = None
        self.sizes = []  # of the reads

    @property
    def in_waiting(self):
        return len(self.pending)

    def write(self, data):
        self.written.append(data)
        self.timeouts.append(self.timeout)
        self.unsent += data
        self.pending += self.replies.pop(0) if self.replies else b''

    def read(self, size):
        self.sizes.append(size)
        data, self.pending = self.pending[:size], self.pending[size:]
        return data

    def reset_input_buffer(self):
        self.pending = b''

    def reset_output_buffer(self):
        self.unsent = b''


class ReadClock(Clock):
    """A clock that advances by 1 ms with each reading, and by each sleep."""

    def __init__(self):
        self.steady_ns, self.slept = 0, 0.0

    def now_ns(self):
        self.steady_ns += 1_000_000
        return self.steady_ns

    def time_ns(self):
        return EPOCH_NS + self.steady_ns

    def sleep(self, seconds):
        self.slept += seconds


def line_on(*replies):
    line, port = RoboclawLine(ReadClock()), ScriptedPort(*replies)
    line.use(port)
    return line, port


def test_the_time_of_good_replies_only_is_recorded(monkeypatch):
    line, _ = line_on(BAD, GOOD)
    recorded = []
    monkeypatch.setattr(line.timing, 'record', lambda *one: recorded.append(one))
    line.exchange(128, READ_TIMEOUT)
    assert recorded == [(READ_TIMEOUT, 1_000_000)]  # one reading before, one after it


def test_a_good_reply_is_returned_and_counted():
    line, port = line_on(GOOD)
    assert line.exchange(128, READ_TIMEOUT) == (2,)
    assert (line.frames_ok, line.frames_bad, line.bytes_skipped) == (1, 0, 0)
    assert (line.last_ok_ns, line.last_error) == (EPOCH_NS + 2_000_000, '')
    assert not line.retried
    assert port.written == [encode_request(128, READ_TIMEOUT)]


@pytest.mark.parametrize('first', [BAD, b'', GOOD[:2]])
def test_a_request_is_repeated_once_after_a_bad_reply(first):
    line, port = line_on(first, GOOD)
    assert line.exchange(128, READ_TIMEOUT) == (2,)
    assert line.retried
    assert (line.frames_ok, line.frames_bad) == (1, 1)
    assert line.bytes_skipped == len(first)
    assert len(port.written) == 2
    port.replies = [GOOD]
    line.exchange(128, READ_TIMEOUT)
    assert not line.retried


def test_two_bad_replies_are_an_error():
    line, port = line_on(BAD, BAD, GOOD)
    with pytest.raises(FrameError, match='wrong CRC'):
        line.exchange(128, READ_TIMEOUT)
    assert len(port.written) == 2
    assert line.frames_bad == 2
    assert 'wrong CRC' in line.last_error


def test_a_late_reply_is_not_mistaken_for_the_next_one():
    line, port = line_on(GOOD)
    port.pending = encode_reply(128, READ_TIMEOUT, 9)
    assert line.exchange(128, READ_TIMEOUT) == (2,)
    assert line.bytes_skipped == len(GOOD)


def test_many_unrequested_bytes_are_an_error_whatever_the_reply():
    line, port = line_on(GOOD)
    count = MAX_UNREQUESTED_BYTES + 1
    port.pending = bytes(count)
    with pytest.raises(FrameError, match=f'{count} bytes arrived without a request'):
        line.exchange(128, READ_TIMEOUT)
    assert port.written == []
    assert line.frames_bad == 1
    port.pending = bytes(MAX_UNREQUESTED_BYTES)
    assert line.exchange(128, READ_TIMEOUT) == (2,)


def test_values_that_may_be_missing_are_asked_for_once_and_with_their_own_time_out():
    line, port = line_on(CURRENTS, b'', GOOD)
    assert line.ask(128, READ_CURRENTS, 0.01) == (-10, 150)
    assert line.ask(128, READ_CURRENTS, 0.01) is None
    assert (line.frames_ok, line.frames_bad) == (1, 1)
    assert line.exchange(128, READ_TIMEOUT) == (2,)
    assert port.timeouts == [0.01, 0.01, REPLY_TIMEOUT]


def test_a_flood_is_an_error_for_values_that_may_be_missing_too():
    line, port = line_on(CURRENTS)
    port.pending = bytes(MAX_UNREQUESTED_BYTES + 1)
    with pytest.raises(FrameError):
        line.ask(128, READ_CURRENTS, 0.01)


@pytest.mark.parametrize('late', [CURRENTS[:3], BAD_CURRENTS, BAD_CURRENTS + b'\xff'])
def test_the_first_byte_of_a_damaged_late_reply_is_no_acknowledgement(late):
    line, port = line_on(b'', late, b'\xff')
    assert line.ask(128, READ_CURRENTS, 0.01) is None
    assert line.exchange(129, SET_DUTY, 0, 0) == ()
    assert line.retried
    assert len(port.written) == 3


@pytest.mark.parametrize(('request_of_duty', 'reply', 'answer'), [
    ((129, SET_DUTY, 0, 0), b'\xff', ()), ((128, READ_TIMEOUT), GOOD, (2,)),
    ((129, READ_ENCODERS), encode_reply(129, READ_ENCODERS, 7, 8), (7, 8))])
def test_the_reply_behind_a_late_one_is_found(request_of_duty, reply, answer):
    line, port = line_on(b'', CURRENTS + reply)
    assert line.ask(128, READ_CURRENTS, 0.01) is None
    assert line.exchange(*request_of_duty) == answer
    assert not line.retried
    assert line.bytes_skipped == len(CURRENTS)


@pytest.mark.parametrize(('asked', 'replies', 'request_of_duty', 'answer'), [
    ((128, 129), (CURRENTS + encode_reply(129, READ_CURRENTS, 0, 0) + b'\xff',),
     (128, SET_DUTY, 0, 0), ()),
    ((128,), (b'', CURRENTS + 2 * ENCODERS), (128, READ_ENCODERS), (7, 8)),
    ((128,), (b'', CURRENTS + b'\xff\xff'), (128, SET_DUTY, 0, 0), ())])
def test_the_reply_behind_late_ones_of_two_boards_or_of_a_repetition_is_found(
        asked, replies, request_of_duty, answer):
    line, _ = line_on(*[b''] * len(asked), *replies)
    for address in asked:
        line.ask(address, READ_CURRENTS, 0.01)
    assert line.exchange(*request_of_duty) == answer
    assert line.retried == (len(replies) > 1)


def test_the_second_reply_to_a_repeated_request_is_no_acknowledgement():
    encoders = encode_reply(128, READ_ENCODERS, 0xFFFFFF00, 8)
    line, port = line_on(b'', encoders, encoders + b'\xff', b'\xff')
    assert line.exchange(128, READ_ENCODERS) == (0xFFFFFF00, 8)
    line.exchange(128, SET_DUTY, 0, 0)
    assert not line.retried
    assert line.bytes_skipped == len(encoders)


def test_a_late_reply_alone_is_no_acknowledgement():
    line, port = line_on(b'', CURRENTS, b'', b'\xff')
    line.ask(128, READ_CURRENTS, 0.01)
    with pytest.raises(FrameError, match='has 0 bytes'):
        line.exchange(128, SET_DUTY, 0, 0)


def test_a_reply_of_the_same_board_ends_the_wait_for_a_late_one():
    line, port = line_on(b'', GOOD, b'\xff', b'\xff\x00')
    line.ask(128, READ_CURRENTS, 0.01)
    line.exchange(128, READ_TIMEOUT)
    line.exchange(128, SET_DUTY, 0, 0)
    assert not line.retried
    line.exchange(128, SET_DUTY, 0, 0)  # a byte behind an acknowledgement is of no concern
    assert not line.retried
    assert line._clock.slept == 0.0


@pytest.mark.parametrize(('replies', 'requests', 'retried'), [
    # a late reply that has come: a byte behind an acknowledgement is of no concern
    ((CURRENTS + b'\xff', b'\xff\x00'), [(129, SET_DUTY, 0, 0)] * 2, False),
    # a reply of another board does not end the wait
    ((encode_reply(129, READ_TIMEOUT, 2), b'\xff\x00', b'\xff'),
     [(129, READ_TIMEOUT), (128, SET_DUTY, 0, 0)], True)])
def test_a_late_reply_that_has_come_ends_the_wait_for_it(replies, requests, retried):
    line, _ = line_on(b'', *replies)
    line.ask(128, READ_CURRENTS, 0.01)
    for request in requests:
        line.exchange(*request)
    assert line.retried == retried


def test_a_probe_is_a_single_request_and_needs_a_quiet_line():
    line, port = line_on(GOOD, BAD, b'', GOOD)
    assert line.probe(128, READ_TIMEOUT) is True
    assert line.probe(128, READ_TIMEOUT) is False
    assert line.probe(128, READ_TIMEOUT) is False
    port.pending = b'\x00'
    assert line.probe(128, READ_TIMEOUT) is False
    assert len(port.written) == 4


def test_a_post_does_not_wait():
    line, port = line_on()
    line.post(129, SET_DUTY, 0, 0)
    assert port.written == [encode_request(129, SET_DUTY, 0, 0)]
    assert line.receive() == b''
    port.pending = b'\xff\xff'
    assert line.receive() == b'\xff\xff'


def test_unsent_and_received_bytes_can_be_discarded():
    line, port = line_on()
    line.post(128, SET_DUTY, 100, 100)
    port.pending = b'\xff'
    line.discard()
    assert (port.unsent, port.pending) == (b'', b'')


def test_a_missing_reply_is_an_error_after_two_attempts():
    clock = VirtualClock()
    clock.end_ns = clock.now_ns() + NS_PER_S
    line, began_ns = RoboclawLine(clock), clock.now_ns()
    line.use(VirtualPort(clock, turnaround=1.0, speed=0.0))
    with pytest.raises(FrameError, match='has 0 bytes'):
        line.exchange(128, READ_TIMEOUT)
    assert REPLY_TIMEOUT >= 0.03  # a host that is busy reads later than a board answers
    assert clock.now_ns() - began_ns == round((2 * REPLY_TIMEOUT + ACKNOWLEDGE_GAP) * NS_PER_S)


def test_a_line_that_accepts_no_bytes_is_an_error_after_the_write_time_out(tmp_path):
    port = PtyPort(tmp_path / 'line').plug_in()
    line, opened = RoboclawLine(), open_port(str(port.path), 115200)
    line.use(opened)
    assert opened.write_timeout == 0.2  # s, of pyserial
    os.set_blocking(opened.fileno(), False)
    with pytest.raises(SerialTimeoutException):
        for _ in range(10_000):  # not read: the kernel buffer fills
            line.post(128, SET_DUTY, 0, 0)
    port.unplug()


STATUS, WIDE_STATUS = (encode_reply(128, command, 0x4000)
                       for command in (READ_STATUS, READ_STATUS_32))


@pytest.mark.parametrize('replies', [[STATUS] * 3, [WIDE_STATUS] * 3, [BAD, WIDE_STATUS] * 2])
def test_a_status_of_16_or_32_bits_is_read(replies):
    port, line = ScriptedPort(*replies), RoboclawLine(ReadClock())
    line.use(port)
    for _ in range(3 if BAD not in replies else 2):
        assert line.exchange(128, READ_STATUS) == (0x4000,)
    assert line.frames_bad == replies.count(BAD) and not port.pending


def test_a_known_width_is_kept():
    port, line = ScriptedPort(STATUS, STATUS[:-1] + b'?', STATUS), RoboclawLine(ReadClock())
    line.use(port)
    line.exchange(128, READ_STATUS)
    port.sizes = []
    line.exchange(128, READ_STATUS)
    assert port.sizes == [4, 4]  # the damaged reply and its repetition: no wait for two more bytes


def test_each_board_has_its_own_width():
    other = encode_reply(129, READ_STATUS_32, 0x80000000)
    port, line = ScriptedPort(STATUS, other, STATUS, other), RoboclawLine(ReadClock())
    line.use(port)
    for _ in range(2):
        assert line.exchange(128, READ_STATUS) == (0x4000,)
        assert line.exchange(129, READ_STATUS) == (0x80000000,)


def polled(count, *, currents=True, encoders=2.0):
    """Return the timing after ``count`` polls; durations in ms."""
    timing = LineTiming()
    for _ in range(count):
        timing.record(READ_ENCODERS, round(encoders * MS))
        if currents:
            timing.record(READ_CURRENTS, 1 * MS)
        timing.record(SET_DUTY, round(1.5 * MS))
    return timing


def test_a_poll_is_encoders_currents_and_duty_of_both_boards():
    timing = polled(MIN_EXCHANGES)
    assert timing.poll_time == pytest.approx(2 * 4.5e-3)
    assert str(timing) == '2 boards on the line: one poll takes 9.0 ms, at most 111 Hz'


def test_a_rate_above_that_of_the_line_is_named():
    timing = polled(MIN_EXCHANGES)
    assert timing.excess(111.0) == ''
    assert timing.excess(112.0) == f'rate is 112 Hz, expected less; {timing}'
    assert LineTiming().excess(200.0) == ''


def test_the_time_is_unknown_before_enough_polls():
    timing = polled(MIN_EXCHANGES - 1)
    assert timing.poll_time == 0.0 and timing.excess(200.0) == ''


@pytest.mark.parametrize(('polls', 'later', 'seconds'), [
    (MIN_EXCHANGES, [], 9e-3),
    # a few exchanges that a busy host delayed do not count
    (MAX_EXCHANGES, [(READ_ENCODERS, 500.0)] * (MAX_EXCHANGES // 2) + [(SET_DUTY, 500.0)], 9e-3),
    # a line that has become slower
    (MAX_EXCHANGES, [(READ_ENCODERS, 5.0)] * (MAX_EXCHANGES // 2 + 1) + [(SET_DUTY, 1.5)], 15e-3),
    # another command is no part of a poll
    (MIN_EXCHANGES, [(READ_STATUS, 900.0), (SET_DUTY, 1.5)], 9e-3)])
def test_the_time_is_that_of_the_median_exchanges(polls, later, seconds):
    timing = polled(polls)
    for command, milliseconds in later:
        timing.record(command, round(milliseconds * MS))
    assert timing.poll_time == pytest.approx(seconds)
    without = polled(polls, currents=False)
    assert without.poll_time == pytest.approx(7e-3)  # boards that do not report them
