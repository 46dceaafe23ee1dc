# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A simulated robot over DDS: type, rate, frame and timestamps of every topic, and its end."""

from __future__ import annotations

from collections import defaultdict
import os
from pathlib import Path
import signal
from types import SimpleNamespace

import numpy as np
import pytest
from smart_tire.bags import Bag
from smart_tire.bags.cdr import Decoder
from smart_tire.cli._stack import Stack, UNITS
from smart_tire.cli.demo import EXPECTED_TOPICS
from smart_tire.drivers.clock_sync import MIN_TIMESTAMP_RATE
from smart_tire.launching import SEPARATE
from smart_tire.messages import TOPICS
from smart_tire.nodes.command_line import COMPOSED, COMPOSED_NODES
from smart_tire.samples import NS_PER_S, VelocityCommand
from support.graph import Graph
from support.stack import children, parameter_file
from support.waiting import wait_for

pytestmark = pytest.mark.processes

WHEELS = ['front_left', 'front_right']
FILMS = {'front_left': ['front_left_pvdf_1', 'front_left_pvdf_2'],
         'front_right': ['front_right_pvdf_1', 'front_right_pvdf_2']}
SLIPS = 600  # estimates of the moving robot, 5 s
NAMES = {'robot_simulator', *SEPARATE, *COMPOSED_NODES}


@pytest.fixture(scope='module')
def run(tmp_path_factory, isolated_ros):
    """Return the bag of a short drive, processes, exit states and logs of a simulated robot."""
    folder = tmp_path_factory.mktemp('stack')
    bag = folder / 'bag'
    params = parameter_file(folder / 'stack.yaml', {
        '/**': {'film.wheels': WHEELS},
        'robot_simulator': {'ground.base': 'concrete', 'units': list(UNITS)},
        'tire_receiver': {'units': list(UNITS)}})
    with Graph(folder) as graph, Stack(folder / 'logs', os.environ) as stack:
        stack.start('recorder', 'smart_tire.cli.main', 'record', '--out', str(bag))
        stack.start('robot', 'smart_tire.cli.main', 'robot', '--simulated', '--params',
                    str(params))
        graph.subscribe('odom', 'wheel_slip', 'tire_friction')
        graph.until(lambda: graph.health.keys() >= NAMES and graph.received['odom'])
        released = graph.value('motor_driver', 'emergency_stop')

        def command():
            # a simulator that a busy machine holds up has no encoder counts, which stops the
            # motors until commands pause
            if 'commands pause' not in graph.status_message('motor_driver'):
                # without timestamp: its age is not checked
                graph.publish('cmd_vel', VelocityCommand(0, 0.8, -1.4))
        timer = graph.node.create_timer(0.1, command)

        def has_moved():
            slips = graph.received['wheel_slip']
            return len(slips) > SLIPS and np.all(np.isfinite(slips[-SLIPS].position))

        graph.until(lambda: has_moved() and {
            msg.header.frame_id for msg in graph.received['tire_friction']} == set(WHEELS))
        graph.node.destroy_timer(timer)
        before = children(stack.processes['robot'].pid)
        os.kill(before['motor_driver'], signal.SIGKILL)
        graph.until(lambda: graph.value('motor_driver', 'emergency_stop') == 'True')
        after = children(stack.processes['robot'].pid)
        states = stack.stop('robot') | stack.stop('recorder')
        wait_for(lambda: not any(Path(f'/proc/{pid}').exists() for pid in after.values()))
        logs = {name: stack.log(name) for name in stack.processes}
    return SimpleNamespace(bag=bag, released=released, before=before, after=after, states=states,
                           logs=logs)


@pytest.fixture(scope='module')
def messages(run):
    """Return topic -> list of (receive_ns, stamp_ns, frame, names) and the counts."""
    found = defaultdict(list)
    with Bag(run.bag) as bag:
        names = bag.match(TOPICS)
        contract = {name: topic for topic, name in names.items()}
        readers = {name: Decoder(TOPICS[topic].type) for name, topic in contract.items()}
        for receive_ns, channel, data in bag.raw(readers):
            msg = readers[channel.topic](data)
            stamp = msg.header.stamp.sec * NS_PER_S + msg.header.stamp.nanosec
            found[contract[channel.topic]].append(
                (receive_ns, stamp, msg.header.frame_id, list(getattr(msg, 'name', []))))
    return found


def test_every_process_ran_and_ended_cleanly(run):
    assert run.before.keys() == {'robot_simulator', COMPOSED, *SEPARATE}
    assert run.states == {'robot': 0, 'recorder': 0}, run.logs
    assert not any('Traceback' in log for log in run.logs.values()), run.logs


def test_a_motor_driver_that_dies_starts_again_with_the_emergency_stop_engaged(run):
    assert run.released == 'False'
    assert {name for name in run.before if run.before[name] != run.after[name]} == {'motor_driver'}


def test_every_topic_has_messages_of_its_documented_type(run):
    with Bag(run.bag) as bag:
        topics = {name.lstrip('/'): topic for name, topic in bag.topics.items()}
    for name in EXPECTED_TOPICS:
        assert topics[name.lstrip('/')].messages > 0, name
        if name in TOPICS:
            assert topics[name].channel.type == TOPICS[name].type
    assert topics['diagnostics'].channel.type == 'diagnostic_msgs/msg/DiagnosticArray'


@pytest.mark.parametrize('topic', [topic for topic in EXPECTED_TOPICS if topic in TOPICS])
def test_frame_ids_are_the_documented_ones(messages, topic):
    frames = {frame for _, _, frame, _ in messages[topic]}
    assert frames == ({TOPICS[topic].frame} if TOPICS[topic].frame else set(WHEELS))


@pytest.mark.parametrize('topic, rate', [
    ('imu/data', 100.0), ('wheel_states', 16.0), ('odom', 125.0), ('wheel_slip', 125.0),
    ('wheel_commands', 16.0), ('motor_commands', 16.0), ('ground_truth/odom', 100.0),
    ('ground_truth/wheel_slip', 100.0)])
def test_timestamps_advance_at_the_nominal_rate(messages, topic, rate):
    stamps = np.array([stamp for _, stamp, _, _ in messages[topic]])
    assert np.all(np.diff(stamps) > 0)
    assert NS_PER_S / np.median(np.diff(stamps)) == pytest.approx(rate, rel=0.05)


def test_tire_samples_arrive_at_400_hz_per_wheel_with_film_names(messages):
    for wheel in WHEELS:
        own = [(stamp, names) for _, stamp, frame, names in messages['tire_samples']
               if frame == wheel]
        steps = np.diff([stamp for stamp, _ in own])
        assert np.median(steps) == pytest.approx(2.5e6, rel=0.01)
        # the least rate: a receiver that starts late reads the first batches all at once
        assert np.all(steps > 0.99 * MIN_TIMESTAMP_RATE * 2.5e6)
        assert all(names == FILMS[wheel] for _, names in own)


@pytest.mark.parametrize('topic', [topic for topic in EXPECTED_TOPICS
                                   if topic in TOPICS and topic != 'cmd_vel'])
def test_no_message_arrives_before_its_timestamp(messages, topic):
    receive, stamp = np.array([message[:2] for message in messages[topic]]).T / NS_PER_S
    # a stall of the host disturbs the clocks of the devices for a moment
    assert np.quantile(receive - stamp, 0.1) > -0.02


def test_wheels_are_in_the_documented_order(messages):
    wheels = ['front_left', 'front_right', 'rear_left', 'rear_right']
    for topic in ('wheel_states', 'wheel_slip', 'wheel_commands', 'motor_commands',
                  'ground_truth/wheel_slip'):
        assert all(names == wheels for _, _, _, names in messages[topic])


def test_the_slip_in_a_turn_and_the_friction_are_estimated(run):
    slips, frictions = [], []
    with Bag(run.bag) as bag:
        for _, topic, sample in bag.samples(['wheel_slip', 'tire_friction']):
            (slips if topic == 'wheel_slip' else frictions).append(sample)
    moving = [(slip.ratio, slip.sigma) for slip in slips if np.all(np.isfinite(slip.ratio))]
    ratio, sigma = np.median(moving[:SLIPS], axis=0)[:, 0]  # later the robot stops
    # a starved host loses readings of the wheels: then the estimate is as uncertain
    assert ratio == pytest.approx(0.11, abs=max(0.04, 2.0 * sigma))
    assert sigma < 0.2
    assert len({friction.wheel for friction in frictions}) == 2


def test_diagnostics_of_every_node_were_recorded(run):
    with Bag(run.bag) as bag:
        read = Decoder('diagnostic_msgs/msg/DiagnosticArray')
        names = {status.name for _, _, data in bag.raw(['/diagnostics'])
                 for status in read(data).status}
    assert names >= NAMES
