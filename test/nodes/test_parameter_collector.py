# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters of the running nodes in a recorded bag."""

from __future__ import annotations

import signal
import time
from types import SimpleNamespace

import pytest
from rclpy.task import Future
from smart_tire.analysis.pipeline import bag_params, EstimatorParams
from smart_tire.bags import Bag
from smart_tire.nodes.parameters import ParameterCollector
from smart_tire.parameters.files import blocks_in, values_for
from support.command import command
from support.waiting import wait_for

pytestmark = pytest.mark.processes


def stored(bag, node):
    """Return the parameters of a node in a bag that is being written."""
    with Bag(bag) as opened:
        return values_for(node, blocks_in(opened.parameters or '{}', 'bag'), ['*'])


def test_parameters_of_nodes_that_appear_and_change_outlive_a_killed_recorder(graph, tmp_path):
    bag = tmp_path / 'bag'
    with command('record', '--out', bag) as recorder:
        wait_for((bag / 'metadata.yaml').exists)
        assert stored(bag, 'slip_estimator') == {}
        with graph.start('wheel_controller', wheel_radius=0.1, pid__integral=0.2), \
                graph.start('slip_estimator', wheel_radius=0.1, film__positions='[0.0, 0.03]'):
            wait_for(lambda: stored(bag, 'wheel_controller').get('pid.integral') == 0.2)
            wait_for(lambda: 'slope_sigma' in stored(bag, 'slip_estimator'))
            assert graph.set_parameter('wheel_controller', 'pid.integral', 0.3)
            wait_for(lambda: stored(bag, 'wheel_controller')['pid.integral'] == 0.3)
        recorder.signal(signal.SIGKILL)
        recorder.end()
    for path in (bag, bag / 'bag_0.mcap'):  # metadata.yaml, and the file alone
        with Bag(path) as opened:
            source = bag_params(opened)
        assert source.origins == ('slip_estimator', 'wheel_controller')
        robot = source.params.robot
        assert (robot.wheel_radius, robot.film.positions) == (0.1, (0.0, 0.03))
        assert (source.params.friction.robot.wheel_radius, source.unknown) == (0.1, ())
    assert 'use_sim_time' not in stored(bag, 'slip_estimator')


def test_a_recording_without_nodes_carries_the_parameters_of_a_file(graph, tmp_path):
    file, bag = tmp_path / 'robot.yaml', tmp_path / 'bag'
    file.write_text('/**: {ros__parameters: {track_width: 0.5, film.wheels: [rear_left]}}')
    with command('record', '--out', bag, '--params', file) as recorder:
        wait_for((bag / 'metadata.yaml').exists)
        wait_for(lambda: stored(bag, 'slip_estimator'))
        recorder.signal(signal.SIGINT)
        assert recorder.end() == 0
    with Bag(bag) as opened:
        assert bag_params(opened).params == EstimatorParams.load([file])


class Node:
    """A node in a graph with one other node, whose services are those of the test."""

    def __init__(self):
        self.clients, self.is_ready = [], False

    def get_namespace(self):
        return '/'

    def get_node_names_and_namespaces(self):
        return [('wheel_controller', '/')]

    def create_subscription(self, *_):
        pass

    def create_client(self, _, name):
        self.clients.append(SimpleNamespace(
            srv_name=name, service_is_ready=lambda: self.is_ready,
            call_async=lambda request: Future()))
        return self.clients[-1]

    def destroy_client(self, client):
        self.clients.remove(client)


@pytest.mark.parametrize('is_ready', [False, True], ids=['absent', 'silent'])
def test_a_node_that_does_not_answer_is_asked_again_when_the_time_for_it_is_over(
        monkeypatch, is_ready):
    now_ns, node = [7 * 10**9], Node()
    node.is_ready = is_ready
    monkeypatch.setattr(time, 'monotonic_ns', lambda: now_ns[0])
    collector = ParameterCollector(node)
    collector.poll()
    first = list(node.clients)
    assert [one.srv_name for one in first] == [
        '/wheel_controller/list_parameters', '/wheel_controller/get_parameters']
    for passed_ns, is_same in ((5_000_000_000, True), (1, False)):
        now_ns[0] += passed_ns
        collector.poll()
        assert len(node.clients) == 2
        assert (node.clients == first) == is_same
    assert collector.values == {}
