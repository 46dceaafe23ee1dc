# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages handed over between nodes of one process, in order, and counted if they are lost."""

from __future__ import annotations

import threading

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from smart_tire.nodes.compat import new_executor
from smart_tire.nodes.hand_over import Exchange, Mailbox
from support.waiting import PATIENCE, wait_for

pytestmark = pytest.mark.processes


@pytest.fixture(params=[new_executor, SingleThreadedExecutor], ids=['default', 'wait_sets'])
def rig(request, isolated_ros):
    """Return a mailbox and a function that spins its node once, as the runner does."""
    rclpy.init(args=[])
    node, executor = rclpy.create_node('reader'), request.param()
    executor.add_node(node)
    mailbox = Mailbox(node)

    def spin(timeout=2.0 * PATIENCE):
        executor.spin_once(timeout_sec=timeout)  # ended by a message that arrives
        mailbox.handle()

    yield mailbox, spin
    executor.remove_node(node)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def route():
    return Exchange(live=False).publish('/odom', '/writer')


def test_a_topic_is_handed_over_once_a_node_publishes_it():
    exchange = Exchange(live=True)
    assert exchange.published('/odom') is None
    route = exchange.publish('/odom', '/a')
    assert exchange.publish('/odom', '/b') is route is exchange.published('/odom')
    assert route.publishers == {'/a', '/b'}
    assert exchange.published('/r1/odom') is None


def test_messages_are_handled_by_the_thread_of_the_reader_in_order(rig, route):
    mailbox, spin = rig
    handled = []
    mailbox.add('odom', route, handled.append, 10)
    sent = [bytes([k]) for k in range(9)]
    for data in sent[:5]:
        route.hand_over(data)
    assert not handled
    wait_for(lambda: handled == sent[:5], spin)
    for data in sent[5:]:
        route.hand_over(data)
    wait_for(lambda: handled == sent, spin)


def test_the_newest_messages_wait_and_others_are_counted_as_lost(rig, route):
    mailbox, spin = rig
    handled = []
    inbox = mailbox.add('odom', route, handled.append, 3)
    for k in range(5):
        route.hand_over(bytes([k]))
    assert (inbox.lost, handled) == (2, [])
    wait_for(lambda: len(handled) == 3, spin)
    assert handled == [b'\2', b'\3', b'\4']
    route.hand_over(b'5')
    wait_for(lambda: handled[-1] == b'5', spin)
    assert inbox.lost == 2


def test_a_message_that_arrives_while_one_is_handled_is_handled_too(rig, route):
    mailbox, spin = rig
    handled = []

    def on_message(data):
        handled.append(data)
        if len(handled) < 4:
            route.hand_over(data + b'.')

    mailbox.add('odom', route, on_message, 3)
    route.hand_over(b'')
    wait_for(lambda: handled == [b'', b'.', b'..', b'...'], spin)


def test_every_reader_gets_the_message_until_its_input_ends(rig, route):
    mailbox, spin = rig
    first, second = [], []
    mailbox.add('odom', route, first.append, 3)
    mailbox.add('other', route, second.append, 3)
    route.hand_over(b'1')
    wait_for(lambda: first and second, spin)
    mailbox.remove('odom')
    route.hand_over(b'2')
    wait_for(lambda: second == [b'1', b'2'], spin)
    assert first == [b'1']


def test_messages_that_are_not_urgent_wait_for_the_next_event_and_are_handled_first(rig, route):
    mailbox, spin = rig
    handled, other = [], Exchange(live=True).publish('/tire_samples', '/writer')
    mailbox.add('odom', route, handled.append, 3)
    mailbox.add('tire_samples', other, handled.append, 3, urgent=False)
    route.hand_over(b'0')
    wait_for(lambda: handled, spin)
    other.hand_over(b'1')
    other.hand_over(b'2')
    route.hand_over(b'3')
    wait_for(lambda: len(handled) == 4, spin)
    assert handled == [b'0', b'1', b'2', b'3']
    other.hand_over(b'4')
    spin(0.1)  # until its time-out
    assert handled[-1] == b'4'


def test_an_exception_of_the_reader_ends_its_spin(rig, route):
    mailbox, spin = rig
    mailbox.add('odom', route, lambda data: 1 / 0, 3)
    route.hand_over(b'')
    with pytest.raises(ZeroDivisionError):
        wait_for(lambda: False, spin)


def test_a_message_ends_the_wait_of_the_reader(rig, route):
    mailbox, spin = rig
    handled, spins = [], []
    mailbox.add('odom', route, handled.append, 3)

    def spin_until_handled():
        while not handled:
            spins.append(1)
            spin()  # longer than the patience of this test

    thread = threading.Thread(target=spin_until_handled, daemon=True)
    thread.start()
    wait_for(lambda: spins)
    route.hand_over(b'')
    wait_for(lambda: handled)
    thread.join()
