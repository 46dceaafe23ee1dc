# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire record`` over DDS, with ``smart_tire replay`` as the robot."""

from __future__ import annotations

from contextlib import suppress
import os
from pathlib import Path
import re
import signal
import textwrap
import time

from loaded_demo import busy
import pytest
from smart_tire.bags import Bag
from smart_tire.cli.main import main
from support.command import command, Python
from support.machine import exclusive_cores
from support.recordings import stream, write_bag
from support.stack import count
from support.waiting import wait_for
import yaml

pytestmark = pytest.mark.processes

pytest.importorskip('rclpy')
LOSS_LINE = re.compile(r'(?:lost|and) \d+ (?:later )?messages of /flood so far')
READY = 'recording /diagnostics'  # its own topic: then it looks for other topics, too


@pytest.fixture(scope='module')
def source(tmp_path_factory):
    """Return a bag of two seconds."""
    return write_bag(tmp_path_factory.mktemp('source') / 'bag', stream(2.0))


def contents(path: Path):
    """Return topic -> the messages in a bag."""
    found: dict[str, list[bytes]] = {}
    with Bag(path) as bag:
        for _, channel, data in bag.raw():
            found.setdefault(channel.topic, []).append(data)
    return found


def test_every_message_of_topics_that_appear_later_is_recorded(source, tmp_path):
    with command('record', '--out', tmp_path / 'bag') as recorder:
        recorder.wait_for(READY)
        with command('replay', source, '--all', '--wait', 20) as player:
            assert player.end() == 0
        recorder.signal(signal.SIGINT)
        assert recorder.end() == 0
    recorded, played = contents(tmp_path / 'bag'), contents(source)
    assert {name: recorded[name] for name in played} == played
    with Bag(tmp_path / 'bag') as bag:
        assert not bag.warnings
        for name, topic in bag.topics.items():
            assert f'{topic.messages} {name}' in recorder.output


def test_a_killed_recorder_leaves_a_readable_bag(source, tmp_path):
    file = tmp_path / 'bag' / 'bag_0.mcap'
    with command('record', '--out', tmp_path / 'bag') as recorder:
        recorder.wait_for(READY)
        with command('replay', source, '--all', '--rate', 0.5, '--wait', 20):
            wait_for(lambda: file.stat().st_size > 20_000)
            recorder.signal(signal.SIGKILL)
            assert recorder.end() == -signal.SIGKILL
    assert (tmp_path / 'bag' / 'metadata.yaml').exists()
    with Bag(tmp_path / 'bag') as bag:
        assert len(list(bag.raw(['/tire_samples']))) > 100
        assert any('truncated' in line for line in bag.losses.lines())
    recorded, played = contents(tmp_path / 'bag'), contents(source)
    for name, messages in played.items():
        assert recorded[name] == messages[:len(recorded[name])]


def test_only_the_given_topics_are_recorded(source, tmp_path):
    with command('record', '--out', tmp_path / 'bag', '--topics', 'imu/data', '/odom',
                 '--ros-args', '-r', '__node:=clerk') as recorder:
        with command('replay', source, '--all', '--rate', 4, '--wait', 3) as player:
            assert player.end() == 0
        recorder.signal(signal.SIGTERM)
        assert recorder.end() == 0
    recorded, played = contents(tmp_path / 'bag'), contents(source)
    assert recorded == {name: played[name] for name in ('/imu/data', '/odom')}


LATCHED = textwrap.dedent("""
    import rclpy
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
    from nav_msgs.msg import Path
    from geometry_msgs.msg import PoseStamped
    rclpy.init()
    node = rclpy.create_node('planner')
    path = node.create_publisher(Path, 'path', QoSProfile(
        depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    path.publish(Path())
    goal = node.create_publisher(PoseStamped, 'goal_pose', QoSProfile(
        depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
    node.create_timer(0.05, lambda: goal.publish(PoseStamped()))
    print('ready', flush=True)
    rclpy.spin(node)
    """)


def test_latched_and_best_effort_messages_are_recorded(tmp_path):
    bag = tmp_path / 'bag'
    with Python('-c', LATCHED) as planner:
        planner.wait_for('ready')
        with command('record', '--out', bag) as recorder:
            recorder.wait_for('recording /path')
            recorder.wait_for('recording /goal_pose')
            wait_for(lambda: count(bag, 'path') and count(bag, 'goal_pose'))
            recorder.signal(signal.SIGINT)
            assert recorder.end() == 0
    recorded = contents(bag)
    assert len(recorded['/path']) == 1
    assert recorded['/goal_pose']
    output = yaml.safe_load((bag / 'metadata.yaml').read_text())
    profiles = {entry['topic_metadata']['name']: entry['topic_metadata']['offered_qos_profiles'][0]
                for entry in output['rosbag2_bagfile_information']['topics_with_message_count']}
    assert profiles['/path']['durability'] == 'transient_local'
    assert profiles['/goal_pose']['reliability'] == 'best_effort'


FLOOD = textwrap.dedent("""
    import sys
    import rclpy
    from rclpy.qos import QoSProfile
    from std_msgs.msg import Int64
    rclpy.init()
    node = rclpy.create_node('flood')
    publisher = node.create_publisher(Int64, 'flood', QoSProfile(depth=100))
    print('ready', flush=True)
    count = 0
    for line in sys.stdin:  # how many to publish
        for count in range(count + 1, count + 1 + int(line)):
            publisher.publish(Int64(data=count))
        print(f'published {count}', flush=True)
    """)


def slowly(flood: Python) -> None:
    """Publish one message and wait a little."""
    flood.write(1)
    time.sleep(0.01)


def test_messages_that_overrun_the_queue_are_counted(tmp_path):
    bag = tmp_path / 'bag'
    with Python('-c', FLOOD) as flood, command('record', '--out', bag) as recorder:
        flood.wait_for('ready')
        wait_for(lambda: count(bag, 'flood'), lambda: slowly(flood))

        def overrun():
            published = len(flood.lines)
            recorder.signal(signal.SIGSTOP)
            flood.write(3000)
            wait_for(lambda: any(int(line.split()[1]) > 3000 for line in flood.lines[published:]))
            recorder.signal(signal.SIGCONT)
            slowly(flood)  # what follows a gap reveals it

        wait_for(lambda: LOSS_LINE.search(recorder.output), overrun)
        recorder.signal(signal.SIGINT)
        assert recorder.end() == 0
    numbers = [int.from_bytes(data[4:12], 'little') for data in contents(bag)['/flood']]
    lost = numbers[-1] - numbers[0] + 1 - len(numbers)
    assert lost > 0
    line, = (line for line in recorder.lines if line.startswith('lost ') and '/flood' in line)
    missed = f'the first {numbers[0] - 1} and {lost} later'  # found late, on a slow machine
    assert line in (f'lost {lost} messages of /flood', f'lost {missed} messages of /flood')
    warnings = recorder.output.count('messages of /flood so far')
    assert 0 < warnings <= (numbers[-1] - len(numbers)).bit_length()


def test_messages_published_before_the_connection_are_counted(tmp_path):
    bag = tmp_path / 'bag'
    with command('record', '--out', bag) as recorder:
        wait_for(lambda: count(bag, 'diagnostics') >= 4)  # one per second: what it finds in the
        # first two seconds may be older than itself
        recorder.signal(signal.SIGSTOP)
        with Python('-c', FLOOD) as flood:
            flood.write(500)
            flood.wait_for('published 500')
            recorder.signal(signal.SIGCONT)
            wait_for(lambda: count(bag, 'flood'), lambda: slowly(flood))
        recorder.signal(signal.SIGINT)
        assert recorder.end() == 0
    first = int.from_bytes(contents(bag)['/flood'][0][4:12], 'little')
    assert first > 500
    assert f'lost the first {first - 1} ' in recorder.output


CLOCK = textwrap.dedent("""
    import sys
    import time
    import rclpy
    from rclpy.qos import QoSProfile
    from std_msgs.msg import Int64
    rclpy.init()
    node = rclpy.create_node('clock')
    publishers = [node.create_publisher(Int64, f'time_{number}', QoSProfile(depth=100))
                  for number in range(10)]
    print('ready', flush=True)
    while True:
        for publisher in publishers:
            publisher.publish(Int64(data=time.time_ns()))
        time.sleep(0.01)
    """)


@pytest.mark.parametrize('loops', [0, 2 * (os.cpu_count() or 1)])
def test_a_killed_recorder_loses_at_most_a_fifth_of_a_second(loops, tmp_path):
    lost = []
    with exclusive_cores(), busy(loops):
        for number in range(5):
            bag = tmp_path / f'bag{number}'
            # publishers of its own: a killed subscriber can delay those that sent to it
            with Python('-c', CLOCK) as clock, command(
                    'record', '--out', bag, '--max-duration', 1) as recorder:
                clock.wait_for('ready')
                wait_for(lambda bag=bag: count(bag, 'time_9') > 0)
                time.sleep(1.0 + 0.13 * number)
                killed_ns = time.time_ns()
                recorder.signal(signal.SIGKILL)
                recorder.end()
            files = sorted(path.name for path in bag.glob('*.mcap'))
            assert files == [f'{bag.name}_{number}.mcap' for number in range(len(files))]
            latest = [int.from_bytes(data[4:12], 'little') for name, parts in contents(bag).items()
                      if 'time_' in name for data in parts]
            lost.append((killed_ns - max(latest)) * 1e-9)
    assert max(lost) < 0.2, lost


ONE_TYPE = textwrap.dedent("""
    import sys
    import rclpy
    from geometry_msgs.msg import Twist, TwistStamped
    rclpy.init()
    node = rclpy.create_node('teleop' + sys.argv[1])
    publisher = node.create_publisher({'Twist': Twist, 'TwistStamped': TwistStamped}[sys.argv[1]],
                                      'cmd_vel', 10)
    print('ready', flush=True)
    if sys.argv[2] == 'publish':
        node.create_timer(0.02, lambda: publisher.publish(publisher.msg_type()))
    rclpy.spin(node)
    """)


def test_cmd_vel_is_recorded_in_the_type_that_is_sent(tmp_path):
    with Python('-c', ONE_TYPE, 'TwistStamped', 'idle') as controller, command(
            'record', '--out', tmp_path / 'bag') as recorder:
        controller.wait_for('ready')
        recorder.wait_for('recording /cmd_vel')
        with Python('-c', ONE_TYPE, 'Twist', 'publish'):
            wait_for(lambda: count(tmp_path / 'bag', 'cmd_vel') > 5)
        with Python('-c', ONE_TYPE, 'TwistStamped', 'publish') as other:
            other.wait_for('ready')
            time.sleep(0.5)
        recorder.signal(signal.SIGINT)
        assert recorder.end() == 0
    line, = (line for line in recorder.lines if 'is published as' in line)
    assert line.endswith('/cmd_vel is published as geometry_msgs/msg/Twist and geometry_msgs/msg/'
                         'TwistStamped: only geometry_msgs/msg/Twist is recorded')
    with Bag(tmp_path / 'bag') as bag:
        assert bag.types['/cmd_vel'] == 'geometry_msgs/msg/Twist'
        assert all(len(data) == 4 + 6 * 8 for _, _, data in bag.raw(['/cmd_vel']))


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
        assert found.topics['/diagnostics'].messages
        assert not found.warnings


@pytest.mark.parametrize(('option', 'value'), [
    ('--max-size', '0.9'), ('--max-duration', '0.9'), ('--max-size', '0'),
    ('--max-duration', 'nan'), ('--max-duration', '-5')])
def test_absurd_limits_of_a_file_are_refused(option, value, tmp_path, capsys):
    with suppress(SystemExit):
        assert main(['record', '--out', str(tmp_path / 'bag'), option, value]) == 2
    assert option in capsys.readouterr().err
    assert not (tmp_path / 'bag').exists()
