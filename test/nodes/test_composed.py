# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Several nodes in one process: hand-over, parameters, diagnostics, start and end."""

from __future__ import annotations

import signal

import pytest
from sensor_msgs.msg import JointState
from smart_tire.nodes.command_line import COMPOSED_NODES
from support.graph import Process

pytestmark = pytest.mark.processes

HANDED_OVER = ('imu/data', 'tire_samples', 'ground_state', 'odom', 'wheel_slip')


@pytest.fixture
def composed(tmp_path, isolated_ros):
    """Return a function that starts nodes in one process."""
    def start(*words):
        return Process(['-m', 'smart_tire.nodes.composed', *words], tmp_path / 'composed.log')

    return start


def test_all_nodes_run_under_their_names_without_dds_between_them(graph, composed):
    with composed('--ros-args', '-r', '__ns:=/r1', '-p', 'port:=/no/such/port',
                  '-p', 'imu_driver:port:=/none') as process:
        names = {f'r1/{name}' for name in COMPOSED_NODES}
        graph.until(lambda: graph.health.keys() >= names)
        graph.until(lambda: graph.node.count_subscribers('/r1/wheel_states') == 3 and all(
            graph.node.count_publishers(f'/r1/{topic}') == 1 for topic in HANDED_OVER))
        assert {graph.node.count_subscribers(f'/r1/{topic}') for topic in HANDED_OVER} == {0}
        assert {graph.value(f'r1/{name}', 'messages_lost') for name in (
            'slip_estimator', 'friction_estimator', 'trajectory_controller')} == {'0'}
        graph.until(lambda: '/no/such/port' in graph.status_message('r1/tire_receiver')
                    and '/none' in graph.status_message('r1/imu_driver'))
        assert process.end(signal.SIGINT, signal.SIGINT, signal.SIGTERM) == 0
        assert 'Traceback' not in process.output


def test_a_publisher_of_another_process_is_reported_where_messages_are_handed_over(
        graph, composed):
    with composed('slip_estimator', 'friction_estimator') as process:
        graph.until(lambda: graph.health.keys() >= {'slip_estimator', 'friction_estimator'})
        publisher = graph.node.create_publisher(JointState, 'ground_state', 10)
        graph.until(lambda: 'ground_state: /test not received, expected /friction_estimator only'
                    in graph.status_message('slip_estimator'))
        assert 'not received' not in graph.status_message('friction_estimator')
        graph.node.destroy_publisher(publisher)
        graph.until(lambda: 'not received' not in graph.status_message('slip_estimator'))
        assert process.end() == 0
        assert process.output.count('ground_state: /test not received') == 1
