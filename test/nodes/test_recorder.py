# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recorder: requested profiles and counts of lost messages."""

from __future__ import annotations

from functools import partial
import itertools

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from smart_tire.bags import Bag, BagWriter
from smart_tire.control.publishers import MessageInfo
from smart_tire.messages import TOPICS
from smart_tire.nodes.base import with_info
from smart_tire.nodes.compat import new_executor
from smart_tire.nodes.qos import FOREIGN_DEPTH, MIN_RECORDED_DEPTH
from smart_tire.nodes.recorder import (
    matching_qos, recorded_qos, Recorder, requests_less, SequenceGaps)
from smart_tire.samples import ImuSample
from std_msgs.msg import Int64
from support.virtual_node import virtual
from support.waiting import wait_for

pytestmark = pytest.mark.processes

RELIABLE = QoSProfile(depth=5)
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_the_recorder_requests_the_strictest_profile_that_all_publishers_offer():
    assert matching_qos('/a', [RELIABLE]).reliability == ReliabilityPolicy.RELIABLE
    assert matching_qos('/a', [RELIABLE]).durability == DurabilityPolicy.VOLATILE
    assert [matching_qos(name, [RELIABLE]).depth for name in ('/a', '/cmd_vel')] == [
        max(FOREIGN_DEPTH, MIN_RECORDED_DEPTH), MIN_RECORDED_DEPTH]
    assert matching_qos('/a', [LATCHED, LATCHED]).durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert matching_qos('/a', [LATCHED, RELIABLE]).durability == DurabilityPolicy.VOLATILE
    assert matching_qos('/a', [RELIABLE, BEST_EFFORT]).reliability == ReliabilityPolicy.BEST_EFFORT


@pytest.mark.parametrize(('had', 'needs', 'new'), [
    ([RELIABLE], [RELIABLE, RELIABLE], False),
    ([RELIABLE], [RELIABLE, BEST_EFFORT], True),
    ([LATCHED], [LATCHED, RELIABLE], True),
    ([RELIABLE, BEST_EFFORT], [RELIABLE], False),
    ([BEST_EFFORT], [BEST_EFFORT, BEST_EFFORT], False)])
def test_the_recorder_resubscribes_only_for_a_publisher_that_offers_less(had, needs, new):
    assert requests_less(matching_qos('/a', needs), matching_qos('/a', had)) is new


def test_the_bag_stores_the_offered_profiles():
    assert recorded_qos(LATCHED).durability == 'transient_local'
    assert recorded_qos(BEST_EFFORT).reliability == 'best_effort'
    assert (recorded_qos(RELIABLE).reliability, recorded_qos(RELIABLE).durability) == (
        'reliable', 'volatile')


def info(number, publisher=1):
    return MessageInfo(0, 0, number, publisher and bytes([publisher]))


def test_gaps_in_the_sequence_numbers_of_a_publisher_are_lost_messages():
    gaps = SequenceGaps()
    logged = [gaps.count(info(number)) for number in (7, 8, 10, 11, 13, 14, 16, 17, 21)]
    assert gaps.lost == 1 + 1 + 1 + 3
    assert logged == [False, False, True, False, True, False, False, False, True]
    assert not gaps.count(info(100, publisher=2))
    assert not gaps.count(info(101, publisher=2))
    assert not gaps.count(info(22))


def test_a_publisher_is_counted_from_its_first_received_message_on():
    gaps = SequenceGaps()
    for publisher in (1, 2):  # the second one was discovered long after the recorder began
        assert not gaps.count(info(143_260, publisher))
        assert not gaps.count(info(143_261, publisher))
    assert gaps.lost == 0
    assert gaps.count(info(143_263, publisher=1))
    assert gaps.lost == 1


def test_losses_of_unknown_publishers_are_counted_while_there_is_one():
    gaps = SequenceGaps()
    assert not gaps.count(info(None))
    assert not gaps.count(info(None, publisher=None))
    for number in (1, 9):  # of any publisher
        assert not gaps.count(info(number, publisher=None))
    gaps.only_publisher = b'1'
    for number in (1, 20, 10):  # of that one or others that are not discovered yet
        assert not gaps.count(info(number, publisher=None))
    gaps.discovered = True
    assert [gaps.count(info(number, publisher=None)) for number in (12, 21, 22, 25)] == [
        False, False, False, True]
    gaps.only_publisher = None
    assert not gaps.count(info(40, publisher=None))
    gaps.only_publisher = b'2'  # after a restart
    assert [gaps.count(info(number, publisher=None)) for number in (3, 4, 6)] == [
        False, False, False]
    assert gaps.lost == 3


@pytest.fixture
def node():
    """Return a node in the default context, which executors without a context use."""
    rclpy.init(args=[])
    node = rclpy.create_node('test')
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


@pytest.mark.parametrize('executor', [new_executor, SingleThreadedExecutor])
def test_sequence_numbers_reveal_an_overflow_of_the_subscription_queue(node, executor):
    gaps, numbers = SequenceGaps(), []

    def on_message(data, info):
        if info.publisher is None:  # rclpy of Jazzy
            gaps.only_publisher, gaps.discovered = b'publisher', True
        gaps.count(info)
        numbers.append(int.from_bytes(data[4:12], 'little'))

    def publish(count):
        for _ in range(count):
            publisher.publish(Int64(data=next(counter)))
        own_executor.spin_once(timeout_sec=0.02)

    counter = itertools.count()
    subscription = node.create_subscription(
        Int64, 'burst', with_info(on_message), QoSProfile(depth=5), raw=True)
    publisher = node.create_publisher(Int64, 'burst', QoSProfile(depth=100))
    own_executor = executor()
    own_executor.add_node(node)

    wait_for(lambda: numbers, lambda: publish(1))
    wait_for(lambda: numbers[-1] + 1 - numbers[0] > len(numbers), lambda: publish(50))
    assert numbers == sorted({*numbers})
    assert gaps.lost == numbers[-1] + 1 - numbers[0] - len(numbers)
    own_executor.remove_node(node)
    own_executor.shutdown()
    node.destroy_subscription(subscription)


def test_the_diagnostics_have_the_messages_the_losses_and_what_is_missing(tmp_path, isolated_ros):
    progress, name = [], '/imu/data'
    with BagWriter(tmp_path / 'bag') as writer:
        make = partial(Recorder, writer, ('imu/data', 'odom'), None,
                       lambda counts, lost: progress.append((dict(counts), lost)))
        with virtual(make) as node:
            node.get_topic_names_and_types = lambda: [(one, []) for one in node.publishers_of]
            assert node.health().message == 'no /imu/data; no /odom'
            for other in (name, '/other', '/odom'):
                node.types_of[other] = TOPICS['imu/data'].type
                node.publishers_of[other] = {} if other == '/odom' else {b'one': 'imu'}
            node.run(0.2)
            assert node.log.lines[-1] == f'recording {name}' and not node.receives('/other')
            for skipped in (0, 0, 3, 1):
                node._number += skipped
                node.publish(name, ImuSample(node.now_ns(), (0.0,) * 3, (0.0,) * 3),
                             topic='imu/data', publisher=b'one')
            health = node.health()
            assert {key: health.values[key] for key in (
                'topics', 'messages', 'messages_lost', f'{name}.messages_lost')} == {
                'topics': '1', 'messages': '4', 'messages_lost': '4',
                f'{name}.messages_lost': '4'}
            assert health.message == f'lost 4 messages of {name}; no /odom'
            assert node.health().message == 'no /odom'  # reported once
            assert [line for line in node.log.lines if 'lost' in line] == [
                f'warning: lost {count} messages of {name} so far' for count in (3, 4)]
            assert node.losses == [f'lost 4 messages of {name}']
            assert not progress
            node.run(0.8)
            assert progress == [({name: 4}, 4)]
    with Bag(tmp_path / 'bag') as bag:
        assert [ns for ns, _, _ in bag.raw([name])] == [node.now_ns() - 800_000_000] * 4
