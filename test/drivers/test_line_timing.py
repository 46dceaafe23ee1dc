# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Time of one poll of both motor boards."""

from __future__ import annotations

import pytest
from smart_tire.drivers.roboclaw_line import LineTiming, MAX_EXCHANGES, MIN_EXCHANGES
from smart_tire.protocol.roboclaw import READ_CURRENTS, READ_ENCODERS, READ_STATUS, SET_DUTY

MS = 1_000_000


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
