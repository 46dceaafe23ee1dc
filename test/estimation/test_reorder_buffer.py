# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Reorder buffer: order independent of arrival, late samples counted, clock jumps handled."""

from hypothesis import given, strategies as st
import pytest

from smart_tire.estimation.reorder_buffer import GRID_NS, ReorderBuffer
from smart_tire.samples import NS_PER_S

MS = 1_000_000
START = 1_700_000_000 * NS_PER_S


def feed(buffer, messages):
    return [closed for topic, stamp in messages
            for closed in buffer.push(topic, START + stamp, (topic, stamp))]


def test_a_grid_instant_closes_when_any_input_is_one_window_later():
    buffer = ReorderBuffer(30 * MS)
    assert feed(buffer, [('imu', 8 * MS), ('imu', 18 * MS), ('imu', 37 * MS)]) == []
    assert feed(buffer, [('wheels', 38 * MS)]) == [(START + 8 * MS, [('imu', 8 * MS)])]


def test_at_the_end_all_instants_close_without_awaiting_a_topic():
    buffer = ReorderBuffer(30 * MS, awaited={'odom': 0})
    assert buffer.finish() == []
    assert feed(buffer, [('odom', 8 * MS), ('imu', 45 * MS), ('late', 17 * MS)]) == [
        (START + 8 * MS, [('odom', 8 * MS)])]
    assert [(instant - START, [topic for topic, _ in samples])
            for instant, samples in buffer.finish()] == [
        (16 * MS, []), (24 * MS, ['late']), (32 * MS, []), (40 * MS, []), (48 * MS, ['imu'])]
    assert buffer.finish() == []


def test_equal_timestamps_are_ordered_by_topic_and_arrival():
    buffer = ReorderBuffer(0)
    feed(buffer, [('b', 9 * MS)])
    buffer.push('a', START + 9 * MS, 'first')
    buffer.push('a', START + 9 * MS, 'second')
    (_, samples), = feed(buffer, [('c', 16 * MS)])[-1:]
    assert samples == ['first', 'second', ('b', 9 * MS), ('c', 16 * MS)]


@given(st.lists(st.tuples(st.sampled_from('abc'), st.integers(0, 2000)), min_size=5, max_size=60,
                unique=True), st.randoms(use_true_random=False))
def test_order_of_arrival_within_the_window_does_not_matter(messages, shuffle):
    stamped = sorted((topic, ms * MS) for topic, ms in messages)
    stamped.sort(key=lambda message: message[1])
    jittered = sorted(stamped, key=lambda message: message[1] + shuffle.randrange(30 * MS))
    ends = [('end', 2900 * MS)]
    assert (feed(ReorderBuffer(30 * MS), stamped + ends)
            == feed(ReorderBuffer(30 * MS), jittered + ends))


def test_samples_after_their_instant_are_dropped_and_counted():
    buffer = ReorderBuffer(30 * MS)
    feed(buffer, [('imu', 8 * MS), ('imu', 100 * MS)])
    assert feed(buffer, [('tire', 64 * MS)]) == []
    assert buffer.late == {'tire': 1}
    assert feed(buffer, [('tire', 73 * MS), ('imu', 110 * MS)])[-1][1] == [('tire', 73 * MS)]


def test_a_single_timestamp_in_the_future_is_dropped():
    buffer = ReorderBuffer(30 * MS)
    regular = [('imu', 10 * MS * k) for k in range(1, 101)]
    closed = feed(buffer, regular[:50] + [('imu', 3600 * NS_PER_S)] + regular[50:])
    assert closed == feed(ReorderBuffer(30 * MS), regular)
    assert buffer.late == {'imu': 1}
    assert buffer.resets == 0


def test_a_gap_of_all_inputs_is_filled_with_grid_instants():
    buffer = ReorderBuffer(30 * MS)
    before = [('imu', 10 * MS * k) for k in range(100)]
    after = [('imu', 5 * NS_PER_S + 10 * MS * k) for k in range(100)]
    closed = feed(buffer, before + after)
    instants = [instant for instant, _ in closed]
    assert instants == list(range(instants[0], instants[-1] + 1, GRID_NS))
    assert sum(len(samples) for _, samples in closed) >= 195
    assert not buffer.late and buffer.resets == 0


@pytest.mark.parametrize('jump', [-10, -3600, 120, 86400])
def test_a_clock_jump_resets_without_losing_a_sample(jump):
    buffer = ReorderBuffer(30 * MS)
    feed(buffer, [('imu', 10 * MS * k) for k in range(100)])
    after = [('imu', jump * NS_PER_S + 10 * MS * k) for k in range(200)]
    closed = feed(buffer, after)
    assert buffer.resets == 1
    assert closed[0][1][0] == after[0]
    assert not buffer.late


def test_an_active_awaited_topic_delays_closing():
    buffer = ReorderBuffer(30 * MS, awaited={'odom': 0})
    feed(buffer, [('odom', 8 * MS), ('tire', 8 * MS)])
    assert feed(buffer, [('tire', 500 * MS)]) == [(START + 8 * MS, [('odom', 8 * MS),
                                                                    ('tire', 8 * MS)])]
    closed = feed(buffer, [('odom', 16 * MS), ('odom', 24 * MS)])
    assert closed == [(START + k * MS, [('odom', k * MS)]) for k in (16, 24)]
    assert not buffer.late


def test_an_inactive_awaited_topic_does_not_delay_closing():
    buffer = ReorderBuffer(30 * MS, awaited={'odom': 0})
    feed(buffer, [('odom', 8 * MS), ('tire', 500 * MS)])
    assert feed(buffer, [('tire', 960 * MS)])[-1][0] == START + 928 * MS
    feed(buffer, [('odom', 100 * MS)])
    assert buffer.late == {'odom': 1}


def test_awaiting_a_topic_without_lag_changes_nothing():
    messages = [message for k in range(1, 200) for message in (
        ('odom', 8 * MS * k), ('tire', 8 * MS * k + 31 * MS))]
    assert (feed(ReorderBuffer(30 * MS, awaited={'odom': 0}), messages)
            == feed(ReorderBuffer(30 * MS), messages))


def test_a_sample_of_a_periodic_topic_holds_until_the_next_one():
    buffer = ReorderBuffer(30 * MS, awaited={'ground': 64 * MS})
    feed(buffer, [('ground', 64 * MS), ('tire', 64 * MS)])
    assert feed(buffer, [('tire', 300 * MS)])[-1][0] == START + 120 * MS  # 8 ms before the next
    assert feed(buffer, [('ground', 128 * MS)])[0] == (START + 128 * MS, [('ground', 128 * MS)])
    assert not buffer.late


def test_a_topic_with_a_wrong_clock_does_not_disturb_the_others():
    buffer = ReorderBuffer(30 * MS)
    good = [('imu', 10 * MS * k) for k in range(300)]
    wrong = [('tire', 10 * MS * k - 50 * NS_PER_S) for k in range(300)]
    closed = feed(buffer, [message for pair in zip(good, wrong) for message in pair])
    assert closed == feed(ReorderBuffer(30 * MS), good)
    assert buffer.late['tire'] >= 299 and buffer.resets == 0
