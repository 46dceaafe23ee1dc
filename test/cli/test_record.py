# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire record`` over DDS, with the node of the test as the robot."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
import re
import shutil
import signal
import textwrap
import time
from types import SimpleNamespace
from typing import Any

import pytest
from smart_tire.bags import Bag, BagWriter, channel_of
from smart_tire.cli.main import main
from smart_tire.samples import NS_PER_S
from support.command import command, Python
from support.stack import count
from support.verdict import assert_within, RunQueues
from support.waiting import wait_for
import yaml

pytestmark = pytest.mark.processes

pytest.importorskip('rclpy')
BURST = 3000  # messages, more than all queues hold
GAP = re.compile(r'(?:lost|and) \d+ (?:later )?messages of /flood so far')


class Robot:
    """Publishers of the node of the test."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.sent: dict[str, int] = {}

    def publisher(self, kind: type[Any], topic: str, **qos: Any) -> Any:
        """Return a publisher; a profile has a depth of 100 messages if nothing else is given."""
        from rclpy.qos import QoSProfile
        return self.graph.node.create_publisher(kind, topic, QoSProfile(**{'depth': 100, **qos}))

    def send(self, publisher: Any, number: int = 1) -> None:
        """Publish the next integers, from 1 on."""
        first = self.sent.get(publisher.topic_name, 0) + 1
        self.sent[publisher.topic_name] = first + number - 1
        for value in range(first, first + number):
            publisher.publish(publisher.msg_type(data=value))

    def until_stored(self, bag: Path, topic: str, do: Any, number: int = 1) -> None:
        """Call ``do`` now and then until a bag has a number of messages more than now."""
        wanted = count(bag, topic) + number
        self.graph.until(lambda: count(bag, topic) >= wanted, do)


@pytest.fixture
def robot(tmp_path, isolated_ros):
    """Return the publishers of a node."""
    from support.graph import Graph
    with Graph(tmp_path) as graph:
        yield Robot(graph)


@contextmanager
def recording(bag: Path, *words: object) -> Iterator[Python]:
    """Run a recorder until the end of the context, which interrupts it."""
    with command('record', '--out', bag, *words) as recorder:
        yield recorder
        recorder.signal(signal.SIGINT)
        assert recorder.end() == 0, recorder.output


@contextmanager
def stopped(recorder: Python) -> Iterator[None]:
    """Stop the process while the context lasts."""
    recorder.signal(signal.SIGSTOP)
    yield
    recorder.signal(signal.SIGCONT)


def contents(path: Path) -> dict[str, list[bytes]]:
    """Return topic -> the messages in a bag."""
    found: dict[str, list[bytes]] = {}
    with Bag(path) as bag:
        for _, channel, data in bag.raw():
            found.setdefault(channel.topic, []).append(data)
    return found


def integers(messages: list[bytes]) -> list[int]:
    """Return the values of serialized ``Int64`` messages."""
    return [int.from_bytes(data[4:12], 'little') for data in messages]


@pytest.fixture(scope='module')
def everything(tmp_path_factory, isolated_ros):
    """Return the recording of latched, lost, early and differently typed messages."""
    from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
    from nav_msgs.msg import Path as PathMessage
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
    from std_msgs.msg import Int64
    from support.graph import Graph
    folder = tmp_path_factory.mktemp('everything')
    bag = folder / 'bag'
    with Graph(folder) as graph, Graph(folder) as other:
        robot = Robot(graph)
        path = robot.publisher(
            PathMessage, 'path', depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        path.publish(PathMessage())  # before the recorder starts
        goal = robot.publisher(
            PoseStamped, 'goal_pose', depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        idle = Robot(other).publisher(TwistStamped, 'cmd_vel')
        flood = robot.publisher(Int64, 'flood')
        with recording(bag) as recorder:
            recorder.wait_for('recording /cmd_vel')
            twists = robot.publisher(Twist, 'cmd_vel')
            robot.until_stored(bag, 'cmd_vel', lambda: twists.publish(Twist()))
            robot.until_stored(bag, 'goal_pose', lambda: goal.publish(PoseStamped()))
            idle.publish(TwistStamped())
            robot.until_stored(bag, 'cmd_vel', lambda: twists.publish(Twist()))
            robot.until_stored(bag, 'flood', lambda: robot.send(flood))
            wait_for(lambda: count(bag, 'diagnostics') >= 4)  # one per second: on Jazzy, losses
            # are counted from 2 s after the start on

            def overrun() -> None:
                with stopped(recorder):
                    robot.send(flood, BURST)
                robot.send(flood)  # what follows a gap reveals it
                graph.spin(0.2)

            wait_for(lambda: GAP.search(recorder.output), overrun)
            wait_for(lambda: count(bag, 'path'))
            with stopped(recorder):
                early = robot.publisher(Int64, 'early')
                robot.send(early, 500)
            robot.until_stored(bag, 'early', lambda: robot.send(early))
    return SimpleNamespace(bag=bag, messages=contents(bag), recorder=recorder)


def test_the_bag_of_a_recorder_that_was_interrupted_is_complete(everything):
    with Bag(everything.bag) as bag:
        assert not bag.warnings
        for name, topic in bag.topics.items():
            assert f'{topic.messages} {name}' in everything.recorder.output
    assert '/diagnostics' in everything.messages  # of a topic that appeared later: its own


def test_latched_and_best_effort_messages_are_recorded(everything):
    assert len(everything.messages['/path']) == 1
    assert everything.messages['/goal_pose']
    output = yaml.safe_load((everything.bag / 'metadata.yaml').read_text())
    profiles = {entry['topic_metadata']['name']: entry['topic_metadata']['offered_qos_profiles'][0]
                for entry in output['rosbag2_bagfile_information']['topics_with_message_count']}
    assert profiles['/path']['durability'] == 'transient_local'
    assert profiles['/goal_pose']['reliability'] == 'best_effort'


def test_messages_that_overrun_the_queue_are_counted(everything):
    numbers = integers(everything.messages['/flood'])
    lost = numbers[-1] - numbers[0] + 1 - len(numbers)
    assert lost > 0 and numbers == sorted(set(numbers))
    output = everything.recorder.output
    line, = re.findall(r'^lost .*messages of /flood$', output, re.MULTILINE)
    assert line == f'lost {lost} messages of /flood'
    warnings = output.count('messages of /flood so far')
    assert 0 < warnings <= (numbers[-1] - len(numbers)).bit_length()


def test_messages_published_before_the_connection_are_no_losses(everything):
    assert integers(everything.messages['/early'])[0] > 500
    assert 'messages of /early' not in everything.recorder.output


def test_cmd_vel_is_recorded_in_the_type_that_is_sent(everything):
    line, = (line for line in everything.recorder.lines if 'is published as' in line)
    assert line.endswith('/cmd_vel is published as geometry_msgs/msg/Twist and geometry_msgs/msg/'
                         'TwistStamped: only geometry_msgs/msg/Twist is recorded')
    with Bag(everything.bag) as bag:
        assert bag.types['/cmd_vel'] == 'geometry_msgs/msg/Twist'
        assert all(len(data) == 4 + 6 * 8 for _, _, data in bag.raw(['/cmd_vel']))


def test_only_the_given_topics_are_recorded(robot, tmp_path):
    from std_msgs.msg import Int64
    publishers = [robot.publisher(Int64, name) for name in ('one', 'robot/two', 'three')]
    bag = tmp_path / 'bag'
    with command('record', '--out', bag, '--topics', 'one', '/robot/two', '--ros-args', '-r',
                 '__node:=clerk') as recorder:
        robot.graph.until(lambda: count(bag, 'one') and count(bag, 'robot/two'),
                          lambda: [robot.send(publisher) for publisher in publishers])
        assert robot.graph.node.count_subscribers('/three') == 0
        recorder.signal(signal.SIGTERM)
        assert recorder.end() == 0
    assert contents(bag).keys() == {'/one', '/robot/two'}


@pytest.mark.parametrize('seconds', [0.3, 1.5])
def test_a_killed_recorder_loses_at_most_a_fifth_of_a_second(seconds, robot, tmp_path):
    from std_msgs.msg import Int64
    clocks = [robot.publisher(Int64, f'time_{number}') for number in range(10)]

    def publish() -> None:
        for clock in clocks:
            clock.publish(Int64(data=time.time_ns()))

    def lost() -> tuple[float, float]:
        bag = tmp_path / f'bag{len(list(tmp_path.glob("bag*")))}'
        with command('record', '--out', bag, '--max-duration', 1) as recorder:
            robot.until_stored(bag, 'time_9', publish)
            queues, end = RunQueues(recorder.pid), time.monotonic() + seconds
            robot.graph.until(lambda: time.monotonic() > end, publish)
            waited = queues.seconds()
            killed_ns = time.time_ns()
            recorder.signal(signal.SIGKILL)
            assert recorder.end() == -signal.SIGKILL
        assert (bag / 'metadata.yaml').exists()
        files = sorted(path.name for path in bag.glob('*.mcap'))
        assert files == [f'{bag.name}_{number}.mcap' for number in range(len(files))]
        assert len(files) > 1 or seconds < 1.0
        with Bag(bag) as opened:
            stamps = [int.from_bytes(data[4:12], 'little') for _, channel, data in opened.raw()
                      if 'time_' in channel.topic]
            assert any('truncated' in line for line in opened.losses.lines())
        return (killed_ns - max(stamps)) / NS_PER_S, waited

    assert_within(0.2, lost)


class Timers:
    """The timers of a recorder in this process, on a virtual clock [ms]."""

    def __init__(self, folder: Path, monkeypatch: Any) -> None:
        import rclpy
        from smart_tire.nodes import recorder
        self.now, self.ended, self.free = 0, None, 1e12
        self._timers: list[tuple[int, Any]] = []
        self.writer = BagWriter(folder / 'bag')
        self.writer.add_topic(channel_of('/time', 'std_msgs/msg/Int64'))
        rclpy.init(args=[])
        self.node = recorder.Recorder(self.writer)
        monkeypatch.setattr(self.node, 'call_every', lambda period, callback: self._timers.append(
            (round(1e3 * period), callback)))
        monkeypatch.setattr(recorder.shutil, 'disk_usage',
                            lambda path: SimpleNamespace(free=self.free))
        monkeypatch.setattr(recorder.signal, 'raise_signal', self._end)
        self.node.start()

    def close(self) -> None:
        """Destroy the node."""
        import rclpy
        self.node.destroy_node()
        rclpy.try_shutdown()
        self.writer.close()

    def _end(self, number: int) -> None:
        assert number == signal.SIGTERM and self.ended is None
        self.ended = self.now

    def run(self, milliseconds: int, *, late: bool = False) -> None:
        """Let time pass, and write a message with the time every 10 ms; timers may be late."""
        for _ in range(milliseconds):
            self.now += 1
            if self.now % 10 == 0:
                self.writer.write('/time', self.now * 1_000_000, bytes(4) + self.now.to_bytes(
                    8, 'little'))
            for period, callback in self._timers:
                if self.now % period == 0 and not late:
                    callback()


@pytest.fixture
def timers(tmp_path, monkeypatch, isolated_ros):
    """Return the timers of a recorder that writes a bag in the folder of the test."""
    made = Timers(tmp_path, monkeypatch)
    yield made
    made.close()


@pytest.mark.parametrize('late', [False, True])
def test_at_any_time_the_file_ends_less_than_a_fifth_of_a_second_ago(late, timers, tmp_path):
    timers.run(100)
    for number in range(50):
        timers.run(17, late=late)
        killed = shutil.copytree(tmp_path / 'bag', tmp_path / f'killed{number}')
        assert timers.now - integers(contents(killed)['/time'])[-1] < 200


def test_the_bag_names_the_distribution_of_ros(tmp_path, monkeypatch):
    from smart_tire.nodes import recorder
    monkeypatch.setattr(recorder, 'run', lambda make, own_arguments, images: 0)
    monkeypatch.setenv('ROS_DISTRO', 'jazzy')
    assert recorder.record(tmp_path / 'bag').status == 0
    with Bag(tmp_path / 'bag') as bag:
        assert bag.ros_distro == 'jazzy'


@pytest.mark.parametrize('phase', range(10, 1000, 90))
def test_a_recording_ends_within_a_second_after_the_disk_is_almost_full(phase, timers):
    timers.free = 200e6
    timers.run(2000 + phase)
    assert timers.ended is None and not timers.node.problem
    timers.free = 200e6 - 1
    timers.run(2000)
    assert timers.ended is not None and timers.ended - 2000 - phase <= 1000
    assert timers.node.problem.endswith('has 200 MB left, needed are 200 MB')


FULL_DISK = textwrap.dedent("""
    import sys
    from types import SimpleNamespace
    from smart_tire.cli.main import main
    from smart_tire.nodes import recorder
    calls = []
    recorder.shutil.disk_usage = lambda path: calls.append(path) or SimpleNamespace(
        free=2e8 if len(calls) < 3 else 199e6)
    sys.exit(main())
    """)


def test_a_recording_ends_before_the_disk_is_full(tmp_path):
    bag = tmp_path / 'bag'
    with Python('-c', FULL_DISK, 'record', '--out', bag) as recorder:
        assert recorder.end() == 2
    line, = (line for line in recorder.lines if 'disk' in line)
    assert line == (f'smart_tire record: {bag}: the recording ended, its disk has 199 MB left, '
                    'needed are 200 MB')
    assert 'Traceback' not in recorder.output
    with Bag(bag) as found:
        assert not found.warnings


@pytest.mark.parametrize(('option', 'value'), [
    ('--max-size', '0.9'), ('--max-duration', '0.9'), ('--max-size', '0'),
    ('--max-duration', 'nan'), ('--max-duration', '-5')])
def test_absurd_limits_of_a_file_are_refused(option, value, tmp_path, capsys):
    with suppress(SystemExit):
        assert main(['record', '--out', str(tmp_path / 'bag'), option, value]) == 2
    assert option in capsys.readouterr().err
    assert not (tmp_path / 'bag').exists()
