# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Validity of commands: age, queuing, several publishers; choice among the inputs."""

from __future__ import annotations

import itertools
import math
import re

from hypothesis import example, given
from hypothesis import strategies as st
import pytest

from smart_tire.control.command_check import check_age, StallDetector, VelocityMux
from smart_tire.control.constants import (
    MAX_PUBLISHERS, MAX_SEQUENCE_GAP, MIN_STALL_NS, QUEUE_DRAIN_NS, REPAIR_NS)
from smart_tire.control.publishers import PublisherCheck, renew, SequenceTracker
from smart_tire.errors import CommandError, LateCommandError
from smart_tire.samples import NS_PER_S, VelocityCommand

NOW = 1_700_000_000 * NS_PER_S
HALF = NS_PER_S // 2
MARGINS = st.sampled_from((-NS_PER_S, -1, 0, 1, NS_PER_S))  # ns, around a limit
INPUTS = (('b', 2, 0.5), ('a', 7, 1.0), ('c', 5, 0.25))


@pytest.mark.parametrize(('age', 'waited', 'text'), [
    (HALF + 1, 0, 'cmd_vel: 0.5 s old, expected at most 0.5 s'),
    (-HALF - 1, 0, 'cmd_vel: 0.5 s ahead, expected at most 0.5 s'),
    (0, 10 * NS_PER_S, 'cmd_vel: 10 s old, expected at most 0.5 s')])
def test_the_reason_names_topic_age_and_limit(age, waited, text):
    with pytest.raises(LateCommandError) as error:
        check_age('cmd_vel', NOW - age, NOW, waited, 0.5)
    assert str(error.value) == text


@pytest.mark.parametrize('now_ns, reason', [
    (0, 'cmd_vel: this node has no time: use_sim_time is set, but nothing was received on /clock'),
    (5 * NS_PER_S, 's ahead, expected at most 0.5 s: its time is that of a host')])
def test_a_command_of_another_clock_is_refused_with_the_cause(now_ns, reason):
    with pytest.raises(LateCommandError, match=re.escape(reason)):
        check_age('cmd_vel', NOW, now_ns, 0, 0.5)


@given(st.booleans(), MARGINS, st.sampled_from((0, HALF - 1, HALF, HALF + 1)), MARGINS,
       st.sampled_from((0.25, 0.5, math.inf)))
def test_the_age_counts_from_the_earlier_one_of_timestamp_and_arrival(
        stamped, late, waited, margin, timeout):
    limit = round(min(timeout, 0.5) * NS_PER_S)
    age = limit + margin if late else margin - HALF  # around being too old, or too far ahead
    wanted = max(age, waited) if stamped else waited
    if wanted <= limit and (not stamped or age >= -HALF):
        assert check_age('x', stamped * (NOW - age), NOW, waited, 0.5, timeout) == wanted
    else:
        with pytest.raises(LateCommandError):
            check_age('x', stamped * (NOW - age), NOW, waited, 0.5, timeout)


def test_a_negative_timestamp_is_refused_even_near_the_epoch():
    with pytest.raises(CommandError, match='negative'):
        check_age('cmd_vel', -1, 0, 0, 0.5)


def test_messages_right_after_a_stall_may_be_queued():
    stall = StallDetector(0)
    stall.tick(MIN_STALL_NS)
    assert stall.stalls == 0
    assert not stall.may_be_queued(MIN_STALL_NS, NS_PER_S)
    resumed = 2 * MIN_STALL_NS + 1
    stall.tick(resumed)
    assert stall.stalls == 1
    assert stall.may_be_queued(resumed, 0)
    assert stall.may_be_queued(resumed + QUEUE_DRAIN_NS - 1, 0)
    assert not stall.may_be_queued(resumed + QUEUE_DRAIN_NS, QUEUE_DRAIN_NS)
    assert stall.may_be_queued(resumed + NS_PER_S, NS_PER_S + 1)  # sent before the process resumed
    stall.tick(resumed + MIN_STALL_NS)
    assert stall.stalls == 1


def test_without_reception_time_messages_are_queued_while_the_backlog_of_a_stall_is_handled():
    begin, length = 5 * NS_PER_S, 2 * NS_PER_S
    stall = StallDetector(begin)
    assert stall.waited_ns(begin) == 0
    stall.tick(begin + length)
    assert stall.waited_ns(begin + length) == length
    busy = begin + length + MIN_STALL_NS + 1
    stall.tick(busy)  # handling it: the stall goes on
    assert stall.waited_ns(busy + length) == busy + length - begin
    again = 2 * busy - begin + REPAIR_NS
    assert stall.waited_ns(again - 1) == again - 1 - begin
    assert stall.waited_ns(again) == 0
    for now in range(busy, again + 1, MIN_STALL_NS):
        stall.tick(now)
    stall.tick(again)
    stall.tick(again + MIN_STALL_NS + 1)
    assert stall.waited_ns(again + MIN_STALL_NS + 1) == MIN_STALL_NS + 1


def test_a_stall_counts_from_the_shortest_that_is_given_on():
    stall = StallDetector(0)
    stall.tick(NS_PER_S, NS_PER_S)
    assert stall.waited_ns(NS_PER_S) == 0
    stall.tick(2 * NS_PER_S + 1, NS_PER_S)
    assert stall.waited_ns(2 * NS_PER_S + 1) == NS_PER_S + 1


def test_the_value_of_the_publisher_that_is_silent_for_longest_is_forgotten():
    known = {}
    for publisher in (*range(MAX_PUBLISHERS), 0, 'new'):
        renew(known, publisher, 5)
    assert list(known) == [*range(2, MAX_PUBLISHERS), 0, 'new']


@given(st.lists(st.tuples(st.sampled_from('abc'), st.sampled_from(
    (0, 1, HALF, NS_PER_S, NS_PER_S + 1)))))
def test_publishers_conflict_while_several_have_sent_within_the_window(messages):
    check, now_ns, latest = PublisherCheck('cmd_vel', 1.0, dict), 0, {}
    for publisher, pause in messages:
        now_ns += pause
        check.record(publisher, now_ns)
        latest[publisher] = now_ns
        active = [one for one, sent in latest.items() if now_ns - sent <= NS_PER_S]
        assert sorted(check.conflicting(now_ns)) == (sorted(active) if len(active) > 1 else [])


@pytest.mark.parametrize(('numbers', 'publishers'), [
    ((7, 8, 9, 20, 21, 21 + MAX_SEQUENCE_GAP), [0] * 6),  # with or without losses
    ((500, 1, 501, 2, 502, 3), [0, 1, 0, 1, 0, 1]), ((100, 50, 101, 51, 103), [0, 1, 0, 1, 0]),
    ((5, 5, 6 + MAX_SEQUENCE_GAP), [0, 1, 2]),
    ((1, 2, 3, 1, 2, 3, 4, 5, 4), [0, 0, 0, 1, 1, 1, 1, 1, 0])])  # restarted
def test_a_number_that_continues_no_sequence_is_another_publisher(numbers, publishers):
    tracker = SequenceTracker()
    assert [tracker.publisher(number) for number in numbers] == publishers


@given(st.integers(1, 5000), st.integers(1, 5000), st.lists(st.sampled_from('ab')))
def test_a_publisher_that_sends_again_after_another_one_is_distinguished(first, second, before):
    tracker = SequenceTracker()
    numbers = {'a': itertools.count(first), 'b': itertools.count(second)}
    indices = [tracker.publisher(next(numbers[one])) for one in (*before, 'a', 'b', 'a')]
    assert len({*indices[-3:]}) > 1


def test_of_many_publishers_the_sequence_of_the_one_that_is_silent_for_longest_is_forgotten():
    tracker = SequenceTracker()
    assert [tracker.publisher(-number) for number in range(MAX_PUBLISHERS + 1)] == [
        *range(MAX_PUBLISHERS + 1)]
    assert tracker.publisher(1) == 1  # 0 would have been followed more closely by 1


@given(st.lists(st.tuples(
    st.sampled_from(('set', 'set', 'block', 'unblock', 'discard')), st.sampled_from('abc'),
    st.sampled_from((0, NS_PER_S // 4, NS_PER_S // 4 + 1, HALF)))))
@example([('set', 'a', 0), ('block', 'a', 0), ('unblock', 'a', 0)])  # the command is discarded
@example([('set', 'b', 0), ('block', 'a', 0), ('unblock', 'a', 0)])
def test_the_valid_input_with_the_highest_priority_is_selected_unless_one_above_it_is_blocked(
        steps):
    mux, now_ns, held = VelocityMux(list(INPUTS)), 0, {}  # name -> command and time, or blocked
    for action, name, pause in steps:
        now_ns += pause
        if action == 'set':
            held[name] = VelocityCommand(now_ns, 0.1, 0.0), now_ns
            mux.set_command(name, *held[name])
        elif action == 'discard':
            held = {one: state for one, state in held.items() if state == 'blocked'}
            mux.discard()
        elif action == 'block':
            held[name] = 'blocked'
            mux.block(name)
        else:
            if held.get(name) == 'blocked':
                del held[name]
            mux.unblock(name)
        wanted = None
        for other, timeout in (('a', 1.0), ('c', 0.25), ('b', 0.5)):  # by priority
            state = held.get(other)
            if state == 'blocked':
                break
            if state is not None and now_ns - state[1] <= timeout * NS_PER_S:
                wanted = other, state[0]
                break
        assert mux.selected(now_ns) == wanted
