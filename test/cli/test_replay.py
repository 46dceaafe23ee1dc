# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire replay``: topics, rate and awaited nodes."""

from __future__ import annotations

from collections import Counter, defaultdict
import signal

import pytest
from smart_tire.bags import Bag, BagWriter, channel_of, Qos
from smart_tire.bags.cdr import empty, Encoder
from smart_tire.cli.main import main
from smart_tire.cli.replay import find, without_commands
from smart_tire.estimation.streams import INPUTS, REPLAYED
from smart_tire.messages import TOPICS
from smart_tire.samples import MotorCommand, VelocityCommand, WheelCommand
from support.command import command
from support.foreign import Foreign
from support.recordings import START_NS, stream, typed, write_bag
from support.waiting import PATIENCE

pytestmark = pytest.mark.processes

COMMANDS = {'cmd_vel': VelocityCommand(START_NS, 1.0, 0.0),
            'wheel_commands': WheelCommand(START_NS, (1.0,) * 4),
            'motor_commands': MotorCommand(START_NS, (1.0,) * 4)}
PATH = 'nav_msgs/msg/Path'
STRANGE = 'strange_msgs/msg/Thing'


@pytest.fixture(scope='module')
def source(tmp_path_factory):
    """Return a bag with inputs, estimates, commands, a path and an unknown type."""
    path = tmp_path_factory.mktemp('source') / 'bag'
    with BagWriter(path) as writer:
        latched = (Qos('reliable', 'transient_local', 1),)
        writer.add_topic(channel_of('/robot/path', PATH, latched))
        writer.add_topic(channel_of('/strange', STRANGE))
        for receive_ns, topic, sample in stream(1.0):
            writer.write_sample(topic, receive_ns, sample)
            if topic == 'wheel_states':
                for name, order in COMMANDS.items():
                    writer.write_sample(name, receive_ns, order)
        writer.write('/robot/path', START_NS + 10**9, Encoder(PATH)(empty(PATH)))
        writer.write('/strange', START_NS + 10**9, b'\x00\x01\x00\x00strange!')
    return path


@pytest.fixture
def ros_source(source):
    """Return the bag for a replay, which needs ROS."""
    pytest.importorskip('rclpy')
    return source


class Listener:
    """A node of the test that receives what the replayer publishes."""

    def __init__(self, graph):
        self.graph, self.received, self.published = graph, defaultdict(list), set()
        graph.node.create_timer(0.1, self._look)

    def subscribe(self, *names, **types):
        """Receive all messages of topics of ``TOPICS``, or of types, however many wait."""
        from smart_tire.nodes.compat import message_class
        for name, kind in ({name: TOPICS[name].type for name in names} | types).items():
            self.graph.node.create_subscription(
                message_class(kind), name, self.received[f'/{name}'].append, 2000, raw=True)

    def _look(self):
        """Note the topics that the replayer publishes, except those of every node."""
        node = self.graph.node
        if ('replayer', '/') in node.get_node_names_and_namespaces():
            found = node.get_publisher_names_and_types_by_node('replayer', '/')
            self.published |= {name for name, _ in found} - {
                '/rosout', '/parameter_events', '/_replay_lockstep'}

    def play(self, source, *options):
        """Replay a bag to its end; return the output."""
        with command('replay', source, '--wait', PATIENCE, *options) as player:
            self.graph.until(lambda: not player.running)
            assert player.end() == 0, player.output
        return player.output


@pytest.fixture
def listener(tmp_path, isolated_ros):
    """Return a node that receives messages."""
    pytest.importorskip('rclpy')
    from support.graph import Graph
    with Graph(tmp_path) as graph:
        yield Listener(graph)


def test_by_default_the_inputs_of_the_estimators_are_published(source, listener):
    listener.subscribe(*INPUTS)
    output = listener.play(source, '--rate', 4)
    assert listener.published == {f'/{name}' for name in INPUTS}
    with Bag(source) as bag:
        for name in listener.published:
            sent = [data for _, _, data in bag.raw([name])]
            assert listener.received[name] == sent
            assert f'{len(sent)} {name}' in output


def test_all_publishes_everything_except_commands(source, listener):
    listener.subscribe(*INPUTS, 'odom', clock='rosgraph_msgs/msg/Clock')
    output = listener.play(source, '--all', '--clock', '--rate', 2)
    assert listener.published == {
        '/imu/data', '/wheel_states', '/tire_samples', '/odom', '/clock'}
    assert f'skipped: /strange ({STRANGE} is not installed)' in output
    clock = [int.from_bytes(data[4:8], 'little') * 10**9 + int.from_bytes(data[8:12], 'little')
             for data in listener.received['/clock']]
    assert clock == sorted(set(clock))
    assert START_NS <= clock[0] < clock[-1] <= START_NS + 1.1e9
    assert len(clock) > 20


def test_commands_are_published_if_named(source, listener):
    listener.subscribe('cmd_vel', **{'robot/path': PATH})
    output = listener.play(source, '--topics', 'cmd_vel', 'path', '--rate', 4)
    assert listener.published == {'/cmd_vel', '/robot/path'}
    assert len(listener.received['/robot/path']) == 1 and '16 /cmd_vel' in output


def test_a_replay_ends_on_interrupt(ros_source):
    with command('replay', ros_source, '--rate', 0.001, '--wait', 0) as player:
        player.wait_for('no subscribers on /tire_samples')
        player.signal(signal.SIGINT)
        assert player.end() == 0
    assert 'published in part' in player.output


def follow(listener):
    """Let the node of the test follow replays as an estimator does."""
    from smart_tire.nodes.compat import message_class
    from smart_tire.nodes.lockstep import Follower
    handle = Follower(listener.graph.node, lambda: None).add_input(
        '/imu/data', listener.received['/imu/data'].append)
    listener.graph.node.create_subscription(
        message_class(TOPICS['imu/data'].type), 'imu/data', handle, 1000, raw=True)


def test_the_replay_fails_if_an_estimator_ends_early(source, listener):
    follow(listener)
    with command('replay', source, '--rate', 0.02, '--wait', PATIENCE, '--wait-for',
                 'test') as player:
        listener.graph.until(lambda: listener.received['/imu/data'])
        listener.graph.node.destroy_node()
        assert player.end() == 1
    assert 'smart_tire replay: /test ended during the replay' in player.lines
    assert 'published in part' in player.output


@pytest.mark.parametrize('name', ['imu/data', '/imu/data', 'path', 'robot/path', '/robot/path'])
def test_a_topic_is_found_with_or_without_its_namespace(source, name):
    with Bag(source) as bag:
        assert find(bag, name) in ('/imu/data', '/robot/path')


def test_ground_truth_is_not_found_as_odometry(tmp_path):
    kind = TOPICS['odom'].type
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic(channel_of('/ground_truth/odom', kind))
    with Bag(tmp_path / 'bag') as bag:
        assert find(bag, 'odom') is None
        assert find(bag, 'ground_truth/odom') == '/ground_truth/odom'


def test_commands_are_excluded_for_any_type_and_namespace(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        for name in ('/robot/cmd_vel', '/cmd_vel', '/robot/motor_commands', '/odom', '/clock'):
            writer.add_topic(channel_of(name, 'geometry_msgs/msg/Twist'))
    with Bag(tmp_path / 'bag') as bag:
        assert without_commands(bag, clock=False) == ['/odom', '/clock']
        assert without_commands(bag, clock=True) == ['/odom']


def test_a_topic_missing_in_the_bag_is_a_usage_error(source, capsys):
    assert main(['replay', str(source), '--topics', 'imu/data', 'smell']) == 2
    output = capsys.readouterr().err
    assert 'has no smell; its topics: ' in output
    assert '/robot/path' in output


def test_a_bag_without_inputs_is_not_replayed(tmp_path, capsys):
    events = [event for event in stream(0.2) if event[1] == 'odom']
    assert main(['replay', str(write_bag(tmp_path / 'bag', events))]) == 1
    assert (f'has none of {", ".join(REPLAYED)}; its topics: /odom'
            in capsys.readouterr().err)


def test_inputs_of_other_names_are_published_under_the_standard_ones(tmp_path, listener):
    events = stream(0.5)
    names_in_bag = {'imu/data': 'mti30/imu', 'wheel_states': 'base/joint_states'}
    bag = Foreign(names_in_bag, omitted=('odom',)).write(tmp_path / 'bag', events)
    listener.subscribe(*INPUTS)
    output = listener.play(bag, '--remap', 'wheel_states:=/base/joint_states')
    assert listener.published == {'/imu/data', '/wheel_states', '/tire_samples'}
    count = sum(topic == 'wheel_states' for _, topic, _ in events)
    assert len(listener.received['/wheel_states']) == count
    assert '/base/joint_states was published as wheel_states' in output
    assert '/mti30/imu was published as imu/data' in output


def test_typed_inputs_are_published_as_the_standard_ones(tmp_path, listener):
    """smart_tire_msgs need not be installed; a robot keeps its namespace."""
    events = stream(0.5)
    bag = Foreign({'imu/data': 'robot/imu/data', 'wheel_states': 'robot/wheel_states',
                   'tire_samples/typed': 'robot/tire_samples/typed'},
                  omitted=('odom',)).write(tmp_path / 'bag', typed(events))
    names = [f'robot/{name}' for name in INPUTS]
    listener.subscribe(**{name: TOPICS[name.removeprefix('robot/')].type for name in names})
    output = listener.play(bag)
    assert listener.published == {f'/{name}' for name in names}
    expected = Counter(topic for _, topic, _ in events)
    for name in INPUTS:
        assert len(listener.received[f'/robot/{name}']) == expected[name]
    assert '/robot/tire_samples/typed was published as /robot/tire_samples' in output
