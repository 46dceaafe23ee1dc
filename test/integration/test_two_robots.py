# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Two robots in two namespaces of one domain."""

from __future__ import annotations

from contextlib import ExitStack
import os
import time

import numpy as np
import pytest
from smart_tire.cli._stack import NODES, PORTS, Stack
from smart_tire.cli.policy import policy
from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.qos import subscriber_qos
from smart_tire.samples import NS_PER_S, VelocityCommand, WheelSample
from support.graph import Graph
from support.policies import rules_in
from support.stack import parameter_file

pytestmark = pytest.mark.processes

ROBOTS = ('r1', 'r2')
DRIVERS = dict(zip(('tire_receiver', 'imu_driver', 'motor_driver'), PORTS))
OUTPUTS = ('odom', 'wheel_slip', 'ground_state', 'wheel_states', 'imu/data', 'tire_samples',
           'wheel_commands', 'motor_commands')
SPEED = 0.4  # m/s


def subscribe(graph, *topics):
    """Receive topics of both robots."""
    for name in ROBOTS:
        for topic in topics:
            graph.node.create_subscription(
                message_class(TOPICS[topic].type), f'/{name}/{topic}',
                graph.received[f'/{name}/{topic}'].append, subscriber_qos(topic, wheels=4))


def assert_permitted(observer, robot, nodes):
    """Assert that the policy of a robot allows all that its nodes have created."""
    ask = {('topics', 'publish'): observer.get_publisher_names_and_types_by_node,
           ('topics', 'subscribe'): observer.get_subscriber_names_and_types_by_node,
           ('services', 'reply'): observer.get_service_names_and_types_by_node,
           ('services', 'request'): observer.get_client_names_and_types_by_node}
    rules = rules_in(policy(robot))
    assert not {(node, rule, name) for node in nodes for rule, names_and_types in ask.items()
                for name, _ in names_and_types(node, f'/{robot}') if name not in rules[node][rule]}


def test_commands_and_stops_reach_the_robot_of_their_namespace_only(tmp_path, isolated_ros):
    with ExitStack() as robots, Graph(tmp_path) as graph:
        for name, node in (('r1', 'wheel_controller'), ('r2', 'wheel_controller'),
                           ('r2', 'motor_driver')):
            robots.enter_context(graph.start(node, namespace=f'/{name}'))
        subscribe(graph, 'wheel_commands')

        def drive(until):
            def publish():
                for name in ROBOTS:
                    graph.publish_as(f'/{name}/wheel_states', 'wheel_states',
                                     WheelSample(time.time_ns(), (0.0,) * 4))
                graph.publish_as('/r1/cmd_vel', 'cmd_vel', VelocityCommand(0, SPEED, 0.0))
            graph.until(until, publish)

        def speed(name):
            return [max(msg.velocity) for msg in graph.received[f'/{name}/wheel_commands']]

        drive(lambda: any(speed('r1')) and speed('r2'))
        graph.call('std_srvs/srv/SetBool', '/r2/emergency_stop', data=True)  # without boards
        drive(lambda: graph.value('r2/wheel_controller', 'emergency_stop') == 'True')
        graph.received['/r1/wheel_commands'].clear()
        drive(lambda: any(speed('r1')))
        assert not any(speed('r2'))
        drive(lambda: graph.value('r1/wheel_controller', 'emergency_stop'))
        assert graph.value('r1/wheel_controller', 'emergency_stop') == 'False'
        assert_permitted(graph.node, 'r1', ['wheel_controller'])
        assert_permitted(graph.node, 'r2', ['wheel_controller', 'motor_driver'])


@pytest.mark.long
def test_a_robot_is_driven_while_the_other_one_stands(tmp_path, isolated_ros):
    params = parameter_file(tmp_path / 'params.yaml', {
        f'/**/{node}': {'port': f'simulated:{port}'} for node, port in DRIVERS.items()})
    with ExitStack() as robots, Graph(tmp_path) as graph:
        stacks = {name: robots.enter_context(Stack(tmp_path / name, os.environ))
                  for name in ROBOTS}
        for name, stack in stacks.items():
            for node in NODES:
                stack.node(node, [params], '-r', f'__ns:=/{name}')
        subscribe(graph, *OUTPUTS)
        graph.until(lambda: all(graph.received.values()))

        def drive(until):
            # without stamp: its age is not checked
            graph.until(until, lambda: graph.publish_as(
                '/r1/cmd_vel', 'cmd_vel', VelocityCommand(0, SPEED, 0.0)))

        def is_moving(name):
            return abs(graph.received[f'/{name}/odom'][-1].twist.twist.linear.x) > 0.9 * SPEED

        drive(lambda: is_moving('r1'))
        for topic, messages in graph.received.items():
            assert len(graph.node.get_publishers_info_by_topic(topic)) == 1, topic
            stamps = [msg.header.stamp.sec * NS_PER_S + msg.header.stamp.nanosec
                      for msg in messages if topic.endswith('odom')]
            assert stamps == sorted(set(stamps)), topic  # those of one robot
        assert_permitted(graph.node, 'r1', NODES)
        assert graph.call('std_srvs/srv/SetBool', '/r2/emergency_stop', data=True).success
        stacks['r2'].stop()
        later = len(graph.received['/r1/odom']) + 250
        drive(lambda: len(graph.received['/r1/odom']) > later)

        assert is_moving('r1')
        assert not np.any([msg.velocity for msg in graph.received['/r2/wheel_states']])
        assert stacks['r1'].died() == {}
        states = [state for stack in stacks.values() for state in stack.stop().values()]
        assert states == [0] * 2 * len(NODES)
        assert 'Traceback' not in ''.join(map(stacks['r1'].log, NODES))
