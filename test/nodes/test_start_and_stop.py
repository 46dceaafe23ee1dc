# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Start, refusal of invalid parameters, and shutdown of nodes."""

from __future__ import annotations

import signal

import pytest
from rcl_interfaces.msg import Parameter
from rclpy.parameter import get_parameter_value, parameter_value_to_python
from sensor_msgs.msg import Imu
from smart_tire.nodes.qos import subscriber_qos
from smart_tire.parameters import NODE_PARAMS
from support.graph import node_arguments, Process
import yaml

pytestmark = pytest.mark.processes


def assert_dump_can_be_loaded(graph, name):
    """Set all parameters to their values by way of YAML, as ros2 param dump and load do."""
    names = graph.call('rcl_interfaces/srv/ListParameters', f'{name}/list_parameters').result.names
    values = graph.call('rcl_interfaces/srv/GetParameters', f'{name}/get_parameters',
                        names=names).values
    dumped = {key: parameter_value_to_python(value) for key, value in zip(names, values)}
    values = {key: value if isinstance(value, (str, bool, int, float)) else list(value)
              for key, value in dumped.items()}
    loaded = [Parameter(name=key, value=get_parameter_value(str(value)))  # as rclpy does
              for key, value in yaml.safe_load(yaml.safe_dump(values)).items()]
    results = graph.call('rcl_interfaces/srv/SetParameters', f'{name}/set_parameters',
                         parameters=loaded).results
    assert {key: result.reason for key, result in zip(names, results)
            if not result.successful} == {}


@pytest.mark.parametrize('name', NODE_PARAMS)
def test_every_node_publishes_diagnostics_and_ends_cleanly_after_repeated_signals(
        name, graph, tmp_path):
    ports = {f'ports__{port}': tmp_path / port for port in ('tire_radio', 'imu', 'motors')} \
        if name == 'robot_simulator' else {}
    with graph.start(name, center_of_mass='[5.0e-05, 0.0, 0.023]', **ports) as node:
        graph.until(lambda: name in graph.health)
        assert_dump_can_be_loaded(graph, name)
        assert node.end(signal.SIGINT, signal.SIGINT, signal.SIGTERM) == 0
        assert 'Traceback' not in node.output


def test_sigterm_ends_a_node_cleanly(graph):
    with graph.start('wheel_controller') as node:
        graph.until(lambda: graph.health)
        assert node.end(signal.SIGTERM) == 0
        assert [line for line in node.output.splitlines() if 'waiting for' not in line] == []


@pytest.mark.parametrize(('parameters', 'message'), [
    ({'ratee': 16.0}, 'unknown parameter ratee, did you mean rate?'),
    ({'rate': 'fast'}, "parameter rate: 'fast', expected a float"),
    ({'rate': 1000}, 'parameter rate: 1000.0, expected 1 to 200 Hz'),
    ({'imu__position': '[1, 2]'}, 'parameter imu.position: '),
    ({'use_sim_time': 'maybe'}, "parameter use_sim_time: 'maybe', expected a bool"),
])
def test_an_invalid_parameter_is_refused_in_one_line_that_names_it(parameters, message, graph):
    with graph.start('wheel_controller', **parameters) as node:
        assert node.ended() == 2
        assert message in node.output
        assert node.output.count('\n') == 1


@pytest.mark.parametrize('words', [
    ['--bogus'], ['use_sim_time:=maybe'], ['--ros-args', '-p', 'rate:=20', '--', '--bogus']])
def test_unknown_arguments_are_refused_in_one_line(words, graph, tmp_path):
    with Process(['-m', 'smart_tire.nodes.wheel_controller', *words], tmp_path / 'log') as node:
        assert node.ended() == 2
        assert f'unknown arguments: {words[-1]} (ROS arguments come after' in node.output
        assert node.output.count('\n') == 1


def test_an_unknown_ros_argument_is_refused_by_its_name(graph, tmp_path):
    with Process([*node_arguments('wheel_controller'), '--bogus'], tmp_path / 'log') as node:
        assert node.ended() == 2
        assert "ROS arguments: unknown '--bogus'" in node.output
        assert node.output.count('\n') == 1


@pytest.mark.parametrize(('text', 'message'), [
    ('/**:\n  ros__parameters:\n    wheel_radios: 0.1\n', 'did you mean wheel_radius?'),
    ('/**:\n  ros__parameters:\n    qos_overrides./tf.publisher.depth: 9\n',
     'qualities of service are fixed'),
    ('/**:\n  ros__parameters:\n    units: [broken]\n', "units: 'broken', expected 16 hex digits"),
    ('/**: [', 'params.yaml'),
])
def test_an_invalid_parameter_file_is_refused(text, message, graph, tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_text(text)
    with Process([*node_arguments('tire_receiver'), '--params-file', str(path)],
                 tmp_path / 'log') as node:
        assert node.ended() == 2
        assert message in node.output
        assert 'Traceback' not in node.output


def test_the_node_whose_name_is_misspelled_in_a_file_warns_of_it(graph, tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_text('wheel_controler: {ros__parameters: {rate: 20.0}}')
    for name, warnings in (('wheel_controller', 1), ('imu_driver', 0)):
        with Process([*node_arguments(name), '--params-file', str(path)], tmp_path / name) as node:
            graph.until(lambda name=name: name in graph.health)
            assert node.output.count('params.yaml: wheel_controler is ignored, did you mean '
                                     'wheel_controller?') == warnings
            assert node.end() == 0


def test_integers_are_accepted_for_floats(graph):
    with graph.start('wheel_controller', rate=20, imu__position='[0, 0, 1]') as node:
        graph.until(lambda: graph.health)
        assert node.end() == 0


def test_simulated_robots_in_two_namespaces_have_ports_of_their_own(graph, tmp_path):
    received = [], []
    for name, messages in zip(('/r1', '/r2'), received):
        graph.node.create_subscription(
            Imu, f'{name}/imu/data', messages.append, subscriber_qos('imu/data'))
    with graph.start('robot_simulator', namespace='/r1'), \
            graph.start('robot_simulator', namespace='/r2') as second, \
            graph.start('imu_driver', namespace='/r1', port='simulated:imu'), \
            graph.start('imu_driver', namespace='/r2', port='simulated:imu'):
        graph.until(lambda: all(received))
        with graph.start('robot_simulator', namespace='/r2') as third:
            assert third.ended() == 2
            assert f'another simulator uses it (process {second.popen.pid})' in third.output
        assert second.end() == 0
        graph.until(lambda: (received[0][-1].header.stamp.sec
                             > received[1][-1].header.stamp.sec + 2))  # the first one goes on


def test_the_simulator_removes_its_ports_after_the_drivers_have_closed_them(graph, tmp_path):
    """Ctrl-C ends all nodes at once; a port removed before its driver closes it is an error."""
    ports = {name: tmp_path / name for name in ('tire_radio', 'imu', 'motors')}
    graph.subscribe('imu/data')
    with graph.start('robot_simulator', **{f'ports__{name}': path for name, path in ports.items()}
                     ) as simulator, graph.start('imu_driver', port=ports['imu']) as driver:
        graph.until(lambda: graph.received['imu/data'])
        simulator.popen.send_signal(signal.SIGINT)
        count_before = len(graph.received['imu/data'])
        graph.until(lambda: len(graph.received['imu/data']) > count_before + 60)  # 0.6 s at 100 Hz
        assert driver.end() == 0
        assert simulator.ended() == 0
        assert 'lost' not in driver.output
    assert not ports['imu'].exists()
