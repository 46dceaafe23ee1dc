# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Lockstep: inputs are handled in recorded order, whatever their order of arrival."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import rclpy
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import Imu
from smart_tire.messages import stamp_in
from smart_tire.nodes.lockstep import ControlMessage, Follower, Leader, TOPIC
from std_msgs.msg import String
from support.waiting import wait_for

pytestmark = pytest.mark.processes


def imu(stamp_ns):
    """Return a message with a stamp."""
    message = Imu()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    return message


class FollowerNode:
    """A node with a follower; records the inputs it handles and publishes its outputs."""

    def __init__(self, name, inputs, outputs=()):
        self.node = rclpy.create_node(name)
        self.handled, self.restarts = [], 0
        self.finished_after = []  # numbers of inputs handled at the end of each replay
        self.follower = Follower(self.node, self._restart,
                                 lambda: self.finished_after.append(len(self.handled)))
        for topic in inputs:
            callback = self.follower.add_input(
                topic, lambda message, topic=topic: self._handle(topic, message))
            self.node.create_subscription(Imu, topic, callback, 100, raw=True)
        self.outputs = {}
        for topic in outputs:
            self.follower.add_output(topic)
            self.outputs[topic] = self.node.create_publisher(Imu, topic, 100)

    def _restart(self):
        self.restarts += 1
        self.handled.clear()

    def _handle(self, topic, message):
        self.handled.append((topic, stamp_in(message)))
        for output, publisher in self.outputs.items():
            publisher.publish(message)
            self.follower.published(output, stamp_in(message))


class Rig:
    """A replayer and followers in one executor."""

    def __init__(self):
        self.executor = SingleThreadedExecutor()
        self.replayer = rclpy.create_node('replayer')
        self.leader = Leader(self.replayer)
        self.nodes = []
        self.add(self.replayer)

    def add(self, node):
        self.executor.add_node(node)
        self.nodes.append(node)

    def follower(self, *arguments, **options):
        made = FollowerNode(*arguments, **options)
        self.add(made.node)
        return made

    def publishers(self, *topics):
        return {topic: self.replayer.create_publisher(Imu, topic, 100) for topic in topics}

    def until(self, condition):
        wait_for(condition, lambda: self.executor.spin_once(timeout_sec=0.01))

    def spin(self):
        """Handle callbacks for 0.2 s."""
        for _ in range(20):
            self.executor.spin_once(timeout_sec=0.01)

    def begin(self, topics, *followers):
        """Announce the replay until all followers are ready, then begin."""
        def ready():
            self.leader.announce(topics)
            return self.leader.followers == sorted(followers) and not self.leader.unready()

        self.until(ready)
        self.leader.begin()

    def completed(self, number):
        """Wait until all followers have acknowledged a step."""
        self.until(lambda: not self.leader.behind(number))

    def close(self):
        for node in self.nodes:
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()


@pytest.fixture
def rig():
    rclpy.init(args=[])
    made = Rig()
    yield made
    made.close()
    rclpy.try_shutdown()


def test_without_a_replay_inputs_are_handled_on_arrival(rig):
    follower = rig.follower('a', ['/x', '/y'])
    publishers = rig.publishers('/x')
    rig.until(lambda: publishers['/x'].publish(imu(5)) or ('/x', 5) in follower.handled)


def test_inputs_are_handled_in_the_order_of_the_leader(rig):
    follower = rig.follower('a', ['/x', '/y'])
    publishers = rig.publishers('/x', '/y')
    rig.begin(['/x', '/y'], '/a')
    order = [('/y', 7), ('/x', 1), ('/x', 2), ('/y', 3), ('/z', 4), ('/x', 9)]
    for topic in ('/x', '/y'):  # one topic after the other
        for other, stamp_ns in order:
            if other == topic:
                publishers[topic].publish(imu(stamp_ns))
    rig.spin()
    assert follower.handled == []
    rig.leader.step(0, order[:3])
    rig.completed(0)
    assert follower.handled == order[:3]
    rig.leader.step(1, order[3:])
    rig.completed(1)
    assert follower.handled == [*order[:4], order[5]]


def test_a_step_is_acknowledged_after_its_last_message_has_arrived(rig):
    rig.follower('a', ['/x'])
    publisher = rig.publishers('/x')['/x']
    rig.begin(['/x'], '/a')
    publisher.publish(imu(1))
    rig.leader.step(0, [('/x', 1), ('/x', 2)])
    rig.spin()
    assert rig.leader.behind(0) == ['/a']
    publisher.publish(imu(2))
    rig.completed(0)


def test_a_downstream_node_handles_estimates_before_the_input_that_completed_them(rig):
    rig.follower('a', ['/x'], outputs=['/made'])
    downstream = rig.follower('b', ['/made', '/y', '/x'])
    publishers = rig.publishers('/x', '/y')
    rig.begin(['/x', '/y'], '/a', '/b')
    order = [('/y', 1), ('/x', 2), ('/y', 3), ('/y', 4), ('/x', 5)]
    rig.leader.step(0, order)
    for topic, stamp_ns in order:
        publishers[topic].publish(imu(stamp_ns))
    rig.completed(0)
    assert downstream.handled == [('/y', 1), ('/made', 2), ('/x', 2), ('/y', 3), ('/y', 4),
                                  ('/made', 5), ('/x', 5)]


def test_messages_from_elsewhere_are_dropped_and_counted_during_a_replay(rig):
    follower = rig.follower('a', ['/x'])
    publisher = rig.publishers('/x')['/x']
    rig.begin(['/x'], '/a')
    for stamp_ns in (1, 100, 2):
        publisher.publish(imu(stamp_ns))
    rig.leader.step(0, [('/x', 1), ('/x', 2)])
    rig.completed(0)
    assert follower.handled == [('/x', 1), ('/x', 2)]
    assert follower.follower.foreign == 1


def test_a_replay_restarts_the_estimator_and_releases_it_at_its_end(rig):
    follower = rig.follower('a', ['/x'])
    publisher = rig.publishers('/x')['/x']
    rig.begin(['/x'], '/a')
    assert follower.follower.leader == '/replayer'
    assert follower.restarts == 1
    publisher.publish(imu(2))
    rig.until(lambda: follower.follower._inputs['/x'].waiting)
    rig.leader.end()
    rig.until(lambda: not follower.follower.leader)
    publisher.publish(imu(3))
    rig.until(lambda: follower.handled == [('/x', 3)])
    rig.leader = Leader(rig.replayer)
    rig.begin(['/x'], '/a')
    assert follower.restarts == 2
    publisher.publish(imu(4))
    rig.leader.step(0, [('/x', 4)])
    rig.completed(0)
    assert follower.handled == [('/x', 4)] and not follower.follower.foreign


def test_the_end_of_a_replay_finishes_the_estimator_after_its_last_input(rig):
    follower = rig.follower('a', ['/x'])
    publisher = rig.publishers('/x')['/x']
    rig.begin(['/x'], '/a')
    rig.leader.step(0, [('/x', 1), ('/x', 2)])
    for stamp_ns in (1, 2):
        publisher.publish(imu(stamp_ns))
    rig.completed(0)
    assert follower.finished_after == []
    rig.leader.end()
    rig.until(lambda: not follower.follower.leader)
    assert follower.finished_after == [2]


def test_a_follower_is_not_ready_while_an_input_has_no_publisher(rig):
    rig.follower('a', ['/x', '/y'])
    publishers = rig.publishers('/x')
    rig.until(lambda: rig.leader.announce(['/x', '/y']) or rig.leader.unready() == {
        '/a': 'has not matched the publisher of /y'})
    assert publishers


def test_a_node_without_a_replayed_input_does_not_follow(rig):
    follower = rig.follower('a', ['/x'])
    rig.until(lambda: '/a' in rig.leader.candidates())
    rig.leader.announce(['/other'])
    rig.spin()
    assert rig.leader.followers == []
    assert not follower.follower.leader


def test_a_follower_leaves_a_replay_when_the_replayer_is_gone(rig):
    follower = rig.follower('a', ['/x'])
    rig.publishers('/x')
    rig.begin(['/x'], '/a')
    assert follower.follower.leave_lost_leader() == ''
    rig.executor.remove_node(rig.replayer)
    rig.nodes.remove(rig.replayer)
    rig.replayer.destroy_node()
    rig.until(lambda: follower.follower.leave_lost_leader() == '/replayer')
    assert not follower.follower.leader


def test_invalid_control_messages_are_ignored(rig):
    follower = rig.follower('a', ['/x'])
    rig.publishers('/x')
    publisher = rig.replayer.create_publisher(String, TOPIC, 10)
    rig.until(publisher.get_subscription_count)
    head = '{"kind": "announce", "sender": "/a", "run": "1", '
    for text in ('', '{', '[]', '{"kind": "announce"}', '{"other": 1}', 'null', '[' * 100_000,
                 head + '"topics": 3}', head + '"topics": [3]}', head + '"upstream": []}',
                 head + '"number": "1"}', head + '"entries": [["/x"]]}',
                 head + '"entries": [["/x", "1"]]}'):
        assert ControlMessage.read(String(data=text)) is None
        publisher.publish(String(data=text))
    rig.begin(['/x'], '/a')
    assert follower.restarts == 1


@pytest.mark.parametrize('order', ['little', 'big'])
def test_the_timestamp_is_read_from_serialized_messages(order):
    data = bytes([0, order == 'little', 0, 0]) + (-3).to_bytes(4, order, signed=True) \
        + (500).to_bytes(4, order)
    assert stamp_in(data) == -3 * 10**9 + 500


def test_the_leader_waits_until_all_followers_know_each_other_and_the_topics():
    sent, waits, receive = [], [], []
    node = SimpleNamespace(
        get_fully_qualified_name=lambda: '/replayer',
        create_publisher=lambda kind, topic, profile: SimpleNamespace(
            publish=lambda data: sent.append(ControlMessage.read(data)),
            wait_for_all_acked=waits.append),
        create_subscription=lambda kind, topic, callback, profile: receive.append(callback))
    leader = Leader(node)

    def answer(sender, *topics, kind='ready', **values):
        values = {'run': sent[0].run, 'inputs': ['/made'], **values}
        receive[0](ControlMessage(kind=kind, sender=sender, topics=topics, **values).message())

    first = {'inputs': ['/x'], 'outputs': ['/made']}
    leader.announce(['/x'])
    answer('/a', '/x', **first)
    answer('/c', run='another')
    answer('/replayer')
    assert leader.followers == ['/a'] and leader.unready() == {}
    answer('/b', '/x', heard=['/a'])
    assert leader.unready() == {'/a': 'has not heard from /b'}
    leader.announce(['/x'])
    answer('/a', '/x', heard=['/b'], **first)  # to the announcement before
    assert leader.unready() == {'/a': 'does not answer', '/b': 'does not answer'}
    answer('/a', *sent[1].topics, heard=['/b'], **first)
    answer('/b', '/made', '/x', heard=['/a'])
    assert leader.unready() == {} and leader.inputs() == {'/x', '/made'}
    leader.begin()
    assert sent[2].upstream == {'/a': '/replayer', '/b': '/a'}
    answer('/a', kind='step', number=0)
    assert [leader.behind(number) for number in (-1, 0, 1)] == [[], ['/b'], ['/a', '/b']]
    leader.end()
    assert sent[3].kind == 'end' and waits == [Duration(seconds=2)]
