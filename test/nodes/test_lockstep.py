"""Inputs in recorded order, whatever the order in which they come."""

from __future__ import annotations

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import Imu
from std_msgs.msg import String
from support.waiting import wait_for

from smart_tire.nodes.lockstep import AHEAD, Follower, Leader, Note, stamp_in, stamp_of, TOPIC

pytestmark = pytest.mark.processes


def imu(stamp_ns):
    """Return a message with a stamp."""
    message = Imu()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    return message


class Station:
    """A follower on a node, what it has handled, and publishers of its inputs."""

    def __init__(self, name, inputs, outputs=(), feedback=()):
        self.node = rclpy.create_node(name)
        self.handled, self.restarts, self.feedback = [], 0, feedback
        self.follower = Follower(self.node, self._restart)
        for topic in inputs:
            callback = self.follower.add_input(
                topic, lambda message, topic=topic: self._handle(topic, message),
                feedback=topic in feedback)
            self.node.create_subscription(Imu, topic, callback, 100)
        self.outputs = {}
        for topic in outputs:
            self.follower.add_output(topic)
            self.outputs[topic] = self.node.create_publisher(Imu, topic, 100)

    def _restart(self):
        self.restarts += 1
        self.handled.clear()

    def _handle(self, topic, message):
        self.handled.append((topic, stamp_of(message)))
        if topic in self.feedback:
            return
        for output, publisher in self.outputs.items():
            publisher.publish(message)
            self.follower.published(output, stamp_of(message))


class Bench:
    """Nodes in one executor."""

    def __init__(self):
        self.executor = SingleThreadedExecutor()
        self.replayer = rclpy.create_node('replayer')
        self.leader = Leader(self.replayer)
        self.nodes = []
        self.add(self.replayer)

    def add(self, node):
        self.executor.add_node(node)
        self.nodes.append(node)

    def station(self, *arguments, **options):
        made = Station(*arguments, **options)
        self.add(made.node)
        return made

    def publishers(self, *topics):
        return {topic: self.replayer.create_publisher(Imu, topic, 100) for topic in topics}

    def until(self, condition):
        wait_for(condition, lambda: self.executor.spin_once(timeout_sec=0.01))

    def turn(self):
        """Handle what is there, and 0.2 s of what may come."""
        for _ in range(20):
            self.executor.spin_once(timeout_sec=0.01)

    def begin(self, topics, *followers):
        """Call until all followers are ready."""
        def ready():
            self.leader.call(topics)
            return self.leader.followers == sorted(followers) and not self.leader.unready()

        self.until(ready)
        self.leader.begin()

    def worked_off(self, number):
        """Wait until all followers have acknowledged a step."""
        self.until(lambda: not self.leader.behind(number))

    def close(self):
        for node in self.nodes:
            self.executor.remove_node(node)
            node.destroy_node()
        self.executor.shutdown()


@pytest.fixture
def bench():
    rclpy.init(args=[])
    made = Bench()
    yield made
    made.close()
    rclpy.try_shutdown()


def test_without_a_replay_an_input_is_handled_at_once(bench):
    station = bench.station('a', ['/x', '/y'])
    publishers = bench.publishers('/x')
    bench.until(publishers['/x'].get_subscription_count)
    publishers['/x'].publish(imu(5))
    bench.until(lambda: station.handled == [('/x', 5)])


def test_inputs_are_handled_in_the_order_of_the_leader(bench):
    station = bench.station('a', ['/x', '/y'])
    publishers = bench.publishers('/x', '/y')
    bench.begin(['/x', '/y'], '/a')
    order = [('/y', 7), ('/x', 1), ('/x', 2), ('/y', 3), ('/z', 4), ('/x', 9)]
    for topic in ('/x', '/y'):  # one topic after the other
        for other, stamp_ns in order:
            if other == topic:
                publishers[topic].publish(imu(stamp_ns))
    bench.turn()
    assert station.handled == []
    bench.leader.step(0, order[:3])
    bench.worked_off(0)
    assert station.handled == order[:3]
    bench.leader.step(1, order[3:])
    bench.worked_off(1)
    assert station.handled == [*order[:4], order[5]]


def test_a_step_is_not_acknowledged_before_its_last_message_has_come(bench):
    bench.station('a', ['/x'])
    publisher = bench.publishers('/x')['/x']
    bench.begin(['/x'], '/a')
    publisher.publish(imu(1))
    bench.leader.step(0, [('/x', 1), ('/x', 2)])
    bench.turn()
    assert bench.leader.behind(0) == ['/a']
    publisher.publish(imu(2))
    bench.worked_off(0)


def test_estimates_are_handled_further_down_before_the_input_that_completed_them(bench):
    bench.station('a', ['/x'], outputs=['/made'])
    below = bench.station('b', ['/made', '/y', '/x'])
    publishers = bench.publishers('/x', '/y')
    bench.begin(['/x', '/y'], '/a', '/b')
    order = [('/y', 1), ('/x', 2), ('/y', 3), ('/y', 4), ('/x', 5)]
    bench.leader.step(0, order)
    for topic, stamp_ns in order:
        publishers[topic].publish(imu(stamp_ns))
    bench.worked_off(0)
    assert below.handled == [('/y', 1), ('/made', 2), ('/x', 2), ('/y', 3), ('/y', 4),
                             ('/made', 5), ('/x', 5)]


def test_feedback_is_handled_at_the_same_place_each_time(bench):
    above = bench.station('a', ['/x', '/back'], outputs=['/made'], feedback=['/back'])
    bench.station('b', ['/made'], outputs=['/back'])
    publisher = bench.publishers('/x')['/x']
    bench.begin(['/x'], '/a', '/b')
    steps = 3 * AHEAD + 2
    for number in range(steps):
        bench.worked_off(number - AHEAD)
        bench.leader.step(number, [('/x', number)])
        publisher.publish(imu(number))
    bench.worked_off(steps - 1)
    assert [handled for handled in above.handled if handled[0] == '/x'] == [
        ('/x', number) for number in range(steps)]
    for number in range(AHEAD, steps):
        place = above.handled.index(('/x', number))
        assert above.handled[place - 1] == ('/back', number - AHEAD)
    assert len(above.handled) == 2 * steps - AHEAD


def test_messages_that_are_not_of_the_replay_are_left_out_and_counted(bench):
    station = bench.station('a', ['/x'])
    publisher = bench.publishers('/x')['/x']
    bench.begin(['/x'], '/a')
    for stamp_ns in (1, 100, 2):
        publisher.publish(imu(stamp_ns))
    bench.leader.step(0, [('/x', 1), ('/x', 2)])
    bench.worked_off(0)
    assert station.handled == [('/x', 1), ('/x', 2)]
    assert station.follower.foreign == 1


def test_each_replay_restarts_the_estimator_and_its_end_lets_it_go(bench):
    station = bench.station('a', ['/x'])
    publisher = bench.publishers('/x')['/x']
    bench.begin(['/x'], '/a')
    assert station.follower.leader == '/replayer'
    assert station.restarts == 1
    bench.leader.end()
    bench.until(lambda: not station.follower.leader)
    publisher.publish(imu(3))
    bench.until(lambda: station.handled == [('/x', 3)])
    bench.leader = Leader(bench.replayer)
    bench.begin(['/x'], '/a')
    assert station.restarts == 2


def test_a_follower_is_not_ready_while_an_input_has_no_publisher(bench):
    bench.station('a', ['/x', '/y'])
    publishers = bench.publishers('/x')
    bench.until(lambda: bench.leader.call(['/x', '/y']) or bench.leader.followers)
    bench.turn()
    assert bench.leader.unready() == {'/a': 'has not matched the publisher of /y'}
    assert publishers


def test_a_node_without_a_replayed_input_does_not_follow(bench):
    station = bench.station('a', ['/x'])
    bench.until(lambda: '/a' in bench.leader.candidates())
    bench.leader.call(['/other'])
    bench.turn()
    assert bench.leader.followers == []
    assert not station.follower.leader


def test_a_follower_leaves_a_replay_whose_replayer_has_vanished(bench):
    station = bench.station('a', ['/x'])
    bench.publishers('/x')
    bench.begin(['/x'], '/a')
    assert station.follower.abandon() == ''
    bench.executor.remove_node(bench.replayer)
    bench.nodes.remove(bench.replayer)
    bench.replayer.destroy_node()
    bench.until(lambda: station.follower.abandon() == '/replayer')
    assert not station.follower.leader


@pytest.mark.parametrize('text', ['', '{', '[]', '{"kind": "call"}', '{"smell": 1}', 'null'])
def test_what_is_not_a_note_is_ignored(bench, text):
    assert Note.read(String(data=text)) is None
    station = bench.station('a', ['/x'])
    bench.publishers('/x')
    publisher = bench.replayer.create_publisher(String, TOPIC, 10)
    bench.until(publisher.get_subscription_count)
    publisher.publish(String(data=text))
    bench.begin(['/x'], '/a')
    assert station.restarts == 1


@pytest.mark.parametrize('order', ['little', 'big'])
def test_the_stamp_is_read_from_serialized_messages(order):
    data = bytes([0, order == 'little', 0, 0]) + (-3).to_bytes(4, order, signed=True) \
        + (500).to_bytes(4, order)
    assert stamp_in(data) == -3 * 10**9 + 500
