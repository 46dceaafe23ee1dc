# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Any number in any field of any input: the node goes on, and what it publishes is finite."""

from __future__ import annotations

from functools import partial
from itertools import cycle
import math

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
import pytest
from sensor_msgs.msg import JointState
from smart_tire.errors import MAX_REASON
from smart_tire.nodes.friction_estimator import FrictionEstimatorNode
from smart_tire.nodes.slip_estimator import SlipEstimatorNode
from smart_tire.nodes.trajectory_controller import TrajectoryController
from smart_tire.nodes.wheel_controller import WheelController
from smart_tire.samples import NS_PER_S
from support.hostile_messages import (
    drive, EPOCH_NS, HOSTILE, part_of, places, SECONDS, with_number)
from support.virtual_node import virtual

pytestmark = [pytest.mark.processes, pytest.mark.slow]


def attack(node, *topics):
    """
    Hand the drive to a node; before each message of ``topics`` some with one number replaced.

    Each number is replaced by each of ``HOSTILE`` at least once.
    """
    attacks, repeats = {}, {}
    for topic in topics:
        given = [msg for _, name, msg in drive() if name == topic]
        found = [(place, number) for place in places(given[-1]) for number in HOSTILE]
        attacks[topic], repeats[topic] = cycle(found), math.ceil(len(found) / len(given))
    for stamp_ns, topic, msg in drive():
        node.run(max(stamp_ns - EPOCH_NS - node.elapsed_ns, 0) / NS_PER_S)
        if node.receives(topic):
            for _ in range(repeats.get(topic, 0)):
                node.publish(topic, with_number(msg, *next(attacks[topic])))
            node.publish(topic, msg)


def check(node, *outputs):
    """Check that no error of the package has occurred and that all numbers sent are finite."""
    assert 'please report' not in '\n'.join(node.log.lines)
    for name in outputs:
        assert node.received[name], name
        for msg in node.received[name]:
            assert all(math.isfinite(part_of(msg, place)) for place in places(msg)), (name, msg)


@pytest.mark.parametrize('topic', ['imu/data', 'wheel_states', 'ground_state'])
def test_slip_estimator(isolated_ros, topic):
    with virtual(SlipEstimatorNode) as node:
        attack(node, topic)
        check(node, 'odom')
        assert len(node.received['odom']) > 100.0 * SECONDS


@pytest.mark.parametrize('topic', ['imu/data', 'wheel_states', 'tire_samples'])
def test_friction_estimator(isolated_ros, topic):
    with virtual(FrictionEstimatorNode) as node:
        attack(node, topic)
        check(node)
        assert node.received['ground_state']


@pytest.mark.parametrize('topic', ['odom', 'wheel_states', 'wheel_slip', 'ground_state', 'path',
                                   'goal_pose'])
def test_trajectory_controller(isolated_ros, topic):
    with virtual(TrajectoryController) as node:
        attack(node, topic)
        check(node, 'cmd_vel')


@pytest.mark.parametrize('topic', ['cmd_vel', 'wheel_states', 'odom', 'tire_friction'])
def test_wheel_controller(isolated_ros, topic):
    with virtual(WheelController, traction__enabled=True) as node:
        attack(node, topic)
        check(node, 'motor_commands', 'wheel_commands')
        assert all(abs(duty) <= 1.0 for msg in node.received['motor_commands']
                   for duty in msg.effort)


@pytest.mark.parametrize('names', [['x' * 10_000_000], ['x'] * 1_000_000, ['x' * 250] * 64])
def test_long_names_are_refused_in_a_short_line_and_not_kept(isolated_ros, names):
    with virtual(SlipEstimatorNode) as node:
        node.publish('wheel_states', JointState(name=names, velocity=[0.0] * len(names)))
        node.publish('ground_state', JointState(name=names, position=[0.0] * len(names)))
        assert node.inputs['ground_state'].bad == 1
        assert all(len(line) < MAX_REASON + 100 for line in node.log.lines)
        assert len(node.health().message) < 2 * MAX_REASON + 200
        assert all(len(value) <= MAX_REASON for value in node.health().values.values())


def test_long_frames_are_refused(isolated_ros):
    path, goal = Path(), PoseStamped()
    path.header.frame_id = goal.header.frame_id = 'f' * 1_000_000
    with virtual(TrajectoryController) as node:
        node.publish('path', path)
        node.publish('goal_pose', goal)
        assert all(len(line) < MAX_REASON + 100 for line in node.log.lines)
        assert node.inputs['path'].bad == node.inputs['goal_pose'].bad == 1


def test_an_unforeseen_error_is_a_rejected_message_and_its_place_is_logged_once(isolated_ros):
    def fail(_):
        raise OverflowError('too large\nfor a float')

    with virtual(SlipEstimatorNode) as node:
        node.guarded('imu/data', node.inputs['imu/data'], partial(fail, None))
        node.guarded('imu/data', node.inputs['imu/data'], partial(fail, None))
        text = '\n'.join(node.log.lines)
        assert text.count('Traceback') == 1 and 'in fail' in text
        assert node.inputs['imu/data'].latest == 'imu/data: OverflowError: too large'
        assert node.inputs['imu/data'].bad == 2
        assert text.count('restarted from the priors') == 2
