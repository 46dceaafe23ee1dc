"""Old commands, queued commands, and who else commands."""

from __future__ import annotations

import pytest

from smart_tire.control.command_check import (
    check_age, MAX_SEQUENCE_GAP, PublisherClaims, SequenceStreams, SETTLE_NS, STALL_NS,
    StallDetector)
from smart_tire.errors import CommandError
from smart_tire.samples import NS_PER_S

NOW = 1_700_000_000 * NS_PER_S
HALF = NS_PER_S // 2


@pytest.mark.parametrize('age', [0, HALF, -HALF])
def test_a_command_of_the_present_is_accepted(age):
    check_age('cmd_vel', NOW - age, NOW, 0, 0.5)


@pytest.mark.parametrize(('age', 'text'), [
    (HALF + 1, '0.5 s old, expected at most 0.5 s'),
    (-HALF - 1, '0.5 s ahead, expected at most 0.5 s'),
    (3600 * NS_PER_S, 'cmd_vel: 3.6e+03 s old'),
    (-3600 * NS_PER_S, 'cmd_vel: 3.6e+03 s ahead')])
def test_a_command_of_another_time_is_refused_either_way(age, text):
    with pytest.raises(CommandError, match=text.replace('+', r'\+')):
        check_age('cmd_vel', NOW - age, NOW, 0, 0.5)


def test_a_negative_stamp_is_refused_even_near_the_epoch():
    with pytest.raises(CommandError, match='negative'):
        check_age('cmd_vel', -1, 0, 0, 0.5)


def test_without_a_stamp_the_time_since_the_arrival_counts():
    check_age('cmd_vel', 0, NOW, HALF, 0.5)
    with pytest.raises(CommandError, match='old'):
        check_age('cmd_vel', 0, NOW, HALF + 1, 0.5)


def test_the_time_since_the_arrival_does_not_count_where_there_is_a_stamp():
    check_age('cmd_vel', NOW, NOW, 10 * NS_PER_S, 0.5)


def test_messages_right_after_a_stall_were_queued():
    stall = StallDetector(0)
    stall.tick(STALL_NS)
    assert stall.stalls == 0
    assert not stall.queued(STALL_NS)
    resumed = 2 * STALL_NS + 1
    stall.tick(resumed)
    assert stall.stalls == 1
    assert stall.queued(resumed)
    assert stall.queued(resumed + SETTLE_NS - 1)
    assert not stall.queued(resumed + SETTLE_NS)
    stall.tick(resumed + STALL_NS)
    assert stall.stalls == 1


def test_a_stall_is_longer_than_a_busy_executor_and_shorter_than_a_command_may_be_old():
    assert 0.1 <= STALL_NS / NS_PER_S <= 0.25
    assert SETTLE_NS >= 0.05 * NS_PER_S


def test_one_publisher_has_no_rivals():
    claims = PublisherClaims(NS_PER_S)
    for instant in range(5):
        claims.heard(b'a', instant)
    assert claims.rivals(5) == []


def test_two_publishers_are_rivals_until_one_was_silent_for_the_window():
    claims = PublisherClaims(NS_PER_S)
    claims.heard(b'a', 0)
    claims.heard(b'b', 1)
    assert claims.rivals(1) == [b'a', b'b']
    claims.heard(b'b', HALF)
    assert claims.rivals(NS_PER_S) == [b'a', b'b']
    assert claims.rivals(NS_PER_S + 1) == []


def test_a_publisher_that_takes_over_after_a_pause_has_no_rivals():
    claims = PublisherClaims(NS_PER_S)
    claims.heard(b'a', 0)
    claims.heard(b'b', NS_PER_S + 1)
    assert claims.rivals(NS_PER_S + 1) == []


def test_numbers_that_rise_are_one_stream_with_or_without_losses():
    streams, numbers = SequenceStreams(), (7, 8, 9, 20, 21, 21 + MAX_SEQUENCE_GAP)
    assert {streams.publisher(number) for number in numbers} == {0}


def test_numbers_that_do_not_rise_are_another_stream():
    streams = SequenceStreams()
    assert [streams.publisher(number) for number in (500, 1, 501, 2, 502, 3)] == [0, 1, 0, 1, 0, 1]


def test_a_number_that_is_repeated_or_far_away_is_another_stream():
    streams = SequenceStreams()
    assert [streams.publisher(number) for number in (5, 5)] == [0, 1]
    assert streams.publisher(6 + MAX_SEQUENCE_GAP) == 2


def test_hundreds_of_messages_may_be_lost_but_not_minutes_of_them():
    assert 200 <= MAX_SEQUENCE_GAP <= 2000  # of 16 to 200 per second


def test_of_two_streams_the_nearer_one_goes_on():
    streams = SequenceStreams()
    assert [streams.publisher(number) for number in (100, 50, 101, 51, 103)] == [0, 1, 0, 1, 0]
