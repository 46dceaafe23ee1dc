"""The gate: same order whatever the arrival, late samples counted, clock jumps survived."""

from __future__ import annotations

import random

from hypothesis import given, strategies as st
import pytest

from smart_tire.estimation.reorder_buffer import GRID_NS, ReorderBuffer
from smart_tire.samples import NS_PER_S

MS = 1_000_000
START = 1_700_000_000 * NS_PER_S


def feed(gate, messages):
    return [closed for topic, stamp in messages
            for closed in gate.push(topic, START + stamp, (topic, stamp))]


def test_a_grid_instant_closes_when_any_input_is_a_window_later():
    gate = ReorderBuffer(30 * MS)
    assert feed(gate, [('imu', 8 * MS), ('imu', 18 * MS), ('imu', 37 * MS)]) == []
    assert feed(gate, [('wheels', 38 * MS)]) == [(START + 8 * MS, [('imu', 8 * MS)])]


def test_grid_instants_without_samples_are_closed_too():
    gate = ReorderBuffer(0)
    closed = feed(gate, [('imu', 8 * MS), ('imu', 40 * MS)])
    assert [instant - START for instant, _ in closed] == [8 * MS * k for k in range(1, 6)]
    assert [len(samples) for _, samples in closed] == [1, 0, 0, 0, 1]


def test_equal_stamps_come_in_the_order_of_topic_names_and_of_arrival():
    gate = ReorderBuffer(0)
    feed(gate, [('b', 9 * MS)])
    gate.push('a', START + 9 * MS, 'first')
    gate.push('a', START + 9 * MS, 'second')
    (_, samples), = feed(gate, [('c', 16 * MS)])[-1:]
    assert samples == ['first', 'second', ('b', 9 * MS), ('c', 16 * MS)]


@given(st.lists(st.tuples(st.sampled_from('abc'), st.integers(0, 2000)), min_size=5, max_size=60,
                unique=True), st.randoms(use_true_random=False))
def test_arrival_order_within_the_window_does_not_matter(messages, shuffle):
    stamped = sorted((topic, ms * MS) for topic, ms in messages)
    stamped.sort(key=lambda message: message[1])
    jittered = sorted(stamped, key=lambda message: message[1] + shuffle.randrange(30 * MS))
    ends = [('end', 2900 * MS)]
    assert (feed(ReorderBuffer(30 * MS), stamped + ends)
            == feed(ReorderBuffer(30 * MS), jittered + ends))


def test_what_comes_after_its_instant_is_dropped_and_counted():
    gate = ReorderBuffer(30 * MS)
    feed(gate, [('imu', 8 * MS), ('imu', 100 * MS)])
    assert feed(gate, [('tire', 64 * MS)]) == []
    assert gate.late == {'tire': 1}
    assert feed(gate, [('tire', 73 * MS), ('imu', 110 * MS)])[-1][1] == [('tire', 73 * MS)]


def test_one_stamp_from_the_future_does_not_stop_the_stream():
    gate = ReorderBuffer(30 * MS)
    usual = [('imu', 10 * MS * k) for k in range(1, 101)]
    closed = feed(gate, usual[:50] + [('imu', 3600 * NS_PER_S)] + usual[50:])
    assert closed == feed(ReorderBuffer(30 * MS), usual)
    assert gate.late == {'imu': 1}
    assert gate.resets == 0


def test_a_silence_of_all_inputs_is_bridged_on_the_grid():
    gate = ReorderBuffer(30 * MS)
    before = [('imu', 10 * MS * k) for k in range(100)]
    after = [('imu', 5 * NS_PER_S + 10 * MS * k) for k in range(100)]
    closed = feed(gate, before + after)
    instants = [instant for instant, _ in closed]
    assert instants == list(range(instants[0], instants[-1] + 1, GRID_NS))
    assert sum(len(samples) for _, samples in closed) >= 195
    assert not gate.late and gate.resets == 0


@pytest.mark.parametrize('jump', [-10, -3600, 120, 86400])
def test_a_jump_of_the_clock_starts_anew_without_losing_a_sample(jump):
    gate = ReorderBuffer(30 * MS)
    feed(gate, [('imu', 10 * MS * k) for k in range(100)])
    after = [('imu', jump * NS_PER_S + 10 * MS * k) for k in range(200)]
    closed = feed(gate, after)
    assert gate.resets == 1
    assert closed[0][1][0] == after[0]
    assert not gate.late


def test_an_awaited_topic_is_awaited_while_it_flows():
    gate = ReorderBuffer(30 * MS, awaited=['odom'])
    feed(gate, [('odom', 8 * MS), ('tire', 8 * MS)])
    assert feed(gate, [('tire', 500 * MS)]) == [(START + 8 * MS, [('odom', 8 * MS),
                                                                 ('tire', 8 * MS)])]
    closed = feed(gate, [('odom', 16 * MS), ('odom', 24 * MS)])
    assert closed == [(START + k * MS, [('odom', k * MS)]) for k in (16, 24)]
    assert not gate.late


def test_an_awaited_topic_that_fell_silent_is_not_waited_for():
    gate = ReorderBuffer(30 * MS, awaited=['odom'])
    feed(gate, [('odom', 8 * MS), ('tire', 500 * MS)])
    assert feed(gate, [('tire', 960 * MS)])[-1][0] == START + 928 * MS
    feed(gate, [('odom', 100 * MS)])
    assert gate.late == {'odom': 1}


def test_waiting_changes_nothing_where_nothing_is_late():
    messages = [message for k in range(1, 200) for message in (
        ('odom', 8 * MS * k), ('tire', 8 * MS * k + 31 * MS))]
    assert (feed(ReorderBuffer(30 * MS, awaited=['odom']), messages)
            == feed(ReorderBuffer(30 * MS), messages))


def test_a_stream_with_a_wrong_clock_does_not_disturb_the_others():
    gate = ReorderBuffer(30 * MS)
    good = [('imu', 10 * MS * k) for k in range(300)]
    wrong = [('tire', 10 * MS * k - 50 * NS_PER_S) for k in range(300)]
    closed = feed(gate, [message for pair in zip(good, wrong) for message in pair])
    assert closed == feed(ReorderBuffer(30 * MS), good)
    assert gate.late['tire'] >= 299 and gate.resets == 0


def test_the_order_is_stable_over_seeds():
    for seed in range(5):
        rng = random.Random(seed)
        stamps = [('imu', k * 10 * MS) for k in range(200)]
        arrival = sorted(stamps, key=lambda m: m[1] + rng.random() * 25 * MS)
        assert feed(ReorderBuffer(30 * MS), arrival) == feed(ReorderBuffer(30 * MS), stamps)
