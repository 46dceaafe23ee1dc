# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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


def test_boards_without_currents_have_no_part_for_them():
    assert polled(MIN_EXCHANGES, currents=False).poll_time == pytest.approx(2 * 3.5e-3)


def test_a_few_exchanges_that_a_busy_host_delayed_do_not_count():
    timing = polled(MAX_EXCHANGES)
    for _ in range(MAX_EXCHANGES // 2):
        timing.record(READ_ENCODERS, 500 * MS)
    timing.record(SET_DUTY, 500 * MS)
    assert timing.poll_time == pytest.approx(2 * 4.5e-3)


def test_the_time_follows_a_line_that_has_become_slower():
    timing = polled(MAX_EXCHANGES)
    for _ in range(MAX_EXCHANGES // 2 + 1):
        timing.record(READ_ENCODERS, 5 * MS)
    timing.record(SET_DUTY, round(1.5 * MS))
    assert timing.poll_time == pytest.approx(2 * 7.5e-3)


def test_other_commands_are_no_part_of_a_poll():
    timing = polled(MIN_EXCHANGES)
    timing.record(READ_STATUS, 900 * MS)
    timing.record(SET_DUTY, round(1.5 * MS))
    assert timing.poll_time == pytest.approx(2 * 4.5e-3)
