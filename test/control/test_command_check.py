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

"""Age of commands, queued commands, and conflicting publishers."""

from __future__ import annotations

import pytest

from smart_tire.control.command_check import (
    check_age, MAX_SEQUENCE_GAP, MIN_STALL_NS, PublisherMonitor, QUEUE_DRAIN_NS, SequenceTracker,
    StallDetector)
from smart_tire.errors import CommandError
from smart_tire.samples import NS_PER_S

NOW = 1_700_000_000 * NS_PER_S
HALF = NS_PER_S // 2


@pytest.mark.parametrize('age', [0, HALF, -HALF])
def test_a_recent_command_is_accepted(age):
    check_age('cmd_vel', NOW - age, NOW, 0, 0.5)


@pytest.mark.parametrize(('age', 'text'), [
    (HALF + 1, '0.5 s old, expected at most 0.5 s'),
    (-HALF - 1, '0.5 s ahead, expected at most 0.5 s'),
    (3600 * NS_PER_S, 'cmd_vel: 3.6e+03 s old'),
    (-3600 * NS_PER_S, 'cmd_vel: 3.6e+03 s ahead')])
def test_a_command_too_old_or_too_far_in_the_future_is_refused(age, text):
    with pytest.raises(CommandError, match=text.replace('+', r'\+')):
        check_age('cmd_vel', NOW - age, NOW, 0, 0.5)


def test_a_negative_timestamp_is_refused_even_near_the_epoch():
    with pytest.raises(CommandError, match='negative'):
        check_age('cmd_vel', -1, 0, 0, 0.5)


def test_without_a_timestamp_the_age_is_the_time_since_reception():
    check_age('cmd_vel', 0, NOW, HALF, 0.5)
    with pytest.raises(CommandError, match='old'):
        check_age('cmd_vel', 0, NOW, HALF + 1, 0.5)


@pytest.mark.parametrize(('age', 'waited', 'expected'), [
    (HALF, 0, HALF), (0, HALF, HALF), (-HALF, 100, 100)])
def test_the_age_counts_from_the_earlier_one_of_timestamp_and_arrival(age, waited, expected):
    assert check_age('cmd_vel', NOW - age, NOW, waited, 0.5) == expected


def test_a_command_that_waited_is_old_whatever_its_timestamp_says():
    with pytest.raises(CommandError, match='10 s old'):
        check_age('cmd_vel', NOW, NOW, 10 * NS_PER_S, 0.5)


@pytest.mark.parametrize(('stamp', 'waited'), [(NOW - HALF // 2 - 1, 0), (0, HALF // 2 + 1)])
def test_a_command_older_than_its_time_out_is_refused(stamp, waited):
    with pytest.raises(CommandError, match='expected at most 0.25 s'):
        check_age('cmd_vel', stamp, NOW, waited, 0.5, 0.25)
    assert check_age('cmd_vel', stamp and stamp + 1, NOW, max(waited - 1, 0), 0.5, 0.25)


def test_messages_right_after_a_stall_may_be_queued():
    stall = StallDetector(0)
    stall.tick(MIN_STALL_NS)
    assert stall.stalls == 0
    assert not stall.may_be_queued(MIN_STALL_NS)
    resumed = 2 * MIN_STALL_NS + 1
    stall.tick(resumed)
    assert stall.stalls == 1
    assert stall.may_be_queued(resumed)
    assert stall.may_be_queued(resumed + QUEUE_DRAIN_NS - 1)
    assert not stall.may_be_queued(resumed + QUEUE_DRAIN_NS)
    stall.tick(resumed + MIN_STALL_NS)
    assert stall.stalls == 1


def test_the_stall_threshold_is_between_executor_delays_and_the_maximum_age():
    assert 0.1 <= MIN_STALL_NS / NS_PER_S <= 0.25
    assert QUEUE_DRAIN_NS >= 0.05 * NS_PER_S


def test_one_publisher_is_not_a_conflict():
    monitor = PublisherMonitor(NS_PER_S)
    for instant in range(5):
        monitor.record(b'a', instant)
    assert monitor.conflicting(5) == []


def test_two_publishers_conflict_until_one_is_inactive():
    monitor = PublisherMonitor(NS_PER_S)
    monitor.record(b'a', 0)
    monitor.record(b'b', 1)
    assert monitor.conflicting(1) == [b'a', b'b']
    monitor.record(b'b', HALF)
    assert monitor.conflicting(NS_PER_S) == [b'a', b'b']
    assert monitor.conflicting(NS_PER_S + 1) == []


def test_a_publisher_that_replaces_another_after_a_pause_is_not_a_conflict():
    monitor = PublisherMonitor(NS_PER_S)
    monitor.record(b'a', 0)
    monitor.record(b'b', NS_PER_S + 1)
    assert monitor.conflicting(NS_PER_S + 1) == []


def test_ascending_numbers_are_one_publisher_with_or_without_losses():
    tracker, numbers = SequenceTracker(), (7, 8, 9, 20, 21, 21 + MAX_SEQUENCE_GAP)
    assert {tracker.publisher(number) for number in numbers} == {0}


def test_a_number_that_does_not_ascend_is_another_publisher():
    tracker = SequenceTracker()
    assert [tracker.publisher(number) for number in (500, 1, 501, 2, 502, 3)] == [0, 1, 0, 1, 0, 1]


def test_a_repeated_or_distant_number_is_another_publisher():
    tracker = SequenceTracker()
    assert [tracker.publisher(number) for number in (5, 5)] == [0, 1]
    assert tracker.publisher(6 + MAX_SEQUENCE_GAP) == 2


def test_the_maximum_gap_covers_seconds_of_losses_but_not_minutes():
    assert 200 <= MAX_SEQUENCE_GAP <= 2000  # of 16 to 200 per second


def test_a_number_continues_the_nearest_sequence():
    tracker = SequenceTracker()
    assert [tracker.publisher(number) for number in (100, 50, 101, 51, 103)] == [0, 1, 0, 1, 0]
