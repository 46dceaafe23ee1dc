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

from copy import deepcopy
from functools import lru_cache, partial
from itertools import cycle
import math

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
import pytest
from sensor_msgs.msg import JointState
from smart_tire.errors import MAX_REASON
from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.friction_estimator import FrictionEstimatorNode
from smart_tire.nodes.slip_estimator import SlipEstimatorNode
from smart_tire.nodes.trajectory_controller import TrajectoryController
from smart_tire.nodes.wheel_controller import WheelController
from smart_tire.parameters import SimulatorParams
from smart_tire.samples import (
    Friction, GoalPose, GroundState, NS_PER_S, PlannedPath, VelocityCommand)
from smart_tire.simulation.offline import simulate
from smart_tire.uncertain import Uncertain
from support.virtual_node import EPOCH_NS, virtual

pytestmark = [pytest.mark.processes, pytest.mark.slow]

HOSTILE = (math.nan, math.inf, -math.inf, 1e308, -1e308, 1e30, -1e9, 5e-324, 0.0)
SPEEDS = [(1.0, 0.0, 0.0), (1.5, 60.0, 60.0), (3.5, 80.0, 40.0), (5.0, 0.0, 0.0),
          (6.0, 40.0, 60.0)]  # s, rpm
SECONDS = 8.0


def ground(stamp_ns):
    return GroundState(stamp_ns, Uncertain(50.0, 5.0), *(
        Uncertain(value, sigma) for value, sigma in (
            (0.4, 0.1), (0.02, 0.01), (0.5, 0.2), (0.8, 0.2), (0.0, 0.005), (0.0, 0.005),
            (0.05, 0.01), (0.02, 0.01), (1.0, 0.3), (1.0, 0.05))))


OTHERS = {  # sample of a stamp, and the period of its topic [s]
    'ground_state': (ground, 0.05),
    'path': (lambda ns: PlannedPath(ns, 'odom', ((0.0, 0.0, 0.0), (4.0, 0.0, 0.0))), 0.05),
    'goal_pose': (lambda ns: GoalPose(ns, 'odom', (4.0, 0.0, 0.0)), 0.05),
    'cmd_vel': (lambda ns: VelocityCommand(ns, 0.4, 0.1), 0.05),
    'tire_friction': (lambda ns: Friction(
        ns, 'front_right', Uncertain(0.4, 0.1), normal_load=Uncertain(26.0, 1.0),
        stiffness=Uncertain(50.0, 5.0)), 0.05),
}


@lru_cache
def drive():
    """Return stamp, topic and message of a drive, with those of ``OTHERS``."""
    found = [(ns, topic.removeprefix('ground_truth/'), sample) for ns, topic, sample in
             simulate(SimulatorParams(seed=1), SPEEDS, SECONDS)]
    for topic, (sample_at, period) in OTHERS.items():
        stamps = (EPOCH_NS + round(i * period * NS_PER_S) for i in range(round(SECONDS / period)))
        found += [(ns, topic, sample_at(ns)) for ns in stamps]
    return [(ns, topic, TOPICS[topic].to_msg(message_class(TOPICS[topic].type)(), sample))
            for ns, topic, sample in sorted(found, key=lambda event: event[0])]


def places(msg, path=()):
    """Yield the path of each number in a message: attributes and indices."""
    if hasattr(msg, 'get_fields_and_field_types'):
        for name in msg.get_fields_and_field_types():
            yield from places(getattr(msg, name), (*path, name))
    elif isinstance(msg, float):
        yield path
    elif not isinstance(msg, (str, int)):
        for i, item in enumerate(msg):
            yield from places(item, (*path, i))


def part_of(msg, path):
    for part in path:
        msg = msg[part] if isinstance(part, int) else getattr(msg, part)
    return msg


def with_number(msg, path, number):
    """Return a copy of a message with another number at a place."""
    owner = part_of(msg := deepcopy(msg), path[:-1])
    if isinstance(path[-1], int):
        owner[path[-1]] = number
    else:
        setattr(owner, path[-1], number)
    return msg


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
