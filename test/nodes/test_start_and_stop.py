# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Start, refusal of invalid parameters and arguments, and shutdown of nodes."""

from __future__ import annotations

import os
from pathlib import Path
import signal
import sys
import threading

import pytest
from rcl_interfaces.msg import Parameter
from rclpy.parameter import get_parameter_value, parameter_value_to_python
from sensor_msgs.msg import Imu
from smart_tire.drivers.serial_port import open_port
from smart_tire.errors import ParameterError
from smart_tire.launching import CAMERA
from smart_tire.nodes import composed, robot_simulator, tire_receiver, wheel_controller
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.imu_driver import ImuDriver
from smart_tire.nodes.qos import subscriber_qos
from smart_tire.nodes.robot_simulator import RobotSimulator
from smart_tire.nodes.wheel_controller import WheelController
from smart_tire.parameters import NODE_PARAMS
from support.films import write_calibration
from support.graph import Process
from support.virtual_node import local, virtual
from support.waiting import PATIENCE, wait_for
import yaml

pytestmark = pytest.mark.processes

# libraries that nodes use later, or never, and parameters of other nodes
SLOW = ('argcomplete', 'cv2', 'difflib', 'lz4', 'matplotlib', 'mcap', 'pandas', 'plotly', 'rich',
        'rosbags', 'scipy', 'statistics', 'zstandard', *(
            f'smart_tire.parameters.{name}' for name in (
                'control', 'film', 'mapping', 'overhead', 'simulation', 'tuning')))
NEEDED = {**dict.fromkeys(CAMERA, ['cv2']), 'film_sensor': ['statistics'],
          'film_simulator': ['difflib', 'scipy']}
CODE = f"""import sys
from smart_tire.nodes.{{name}} import main
status = main()
print('imported:', [name for name in {SLOW} if name in sys.modules])
sys.exit(status)
"""


def threads(process):
    """Return the threads of a process."""
    return [int(path.name) for path in Path(f'/proc/{process.popen.pid}/task').iterdir()]


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


def ports(folder):
    """Return parameters with the ports of a simulator."""
    return {f'ports__{port}': folder / port for port in ('tire_radio', 'imu', 'motors')}


@pytest.mark.parametrize('name', NODE_PARAMS)
def test_every_node_publishes_diagnostics_imports_little_and_ends_cleanly_after_repeated_signals(
        name, graph, tmp_path):
    words = ['-p', 'center_of_mass:=[5.0e-05, 0.0, 0.023]']
    if name == 'robot_simulator':
        words += [word for key, path in ports(tmp_path).items()
                  for word in ('-p', f'{key.replace("__", ".")}:={path}')]
    if name == 'film_sensor':
        film = write_calibration(tmp_path / 'film.yaml')
        words += ['-p', f'calibration_file:={film}']
    if name == 'overhead_localizer':
        words += ['-p', 'overhead.camera_position:=[0.0, 0.0, 3.0]',
                  '-p', 'overhead.camera_rotation:=[3.14, 0.0, 0.0]']
    with Process(['-c', CODE.format(name=name), '--ros-args', *words], tmp_path / 'log') as node:
        graph.until(lambda: name in graph.health)
        assert_dump_can_be_loaded(graph, name)
        assert {os.sched_getscheduler(one) for one in threads(node)} == {os.SCHED_OTHER}
        assert node.end(signal.SIGINT, signal.SIGINT, signal.SIGTERM) == 0
        assert 'Traceback' not in node.output
        assert 'realtime_priority' not in node.output
        needed = [NODE_PARAMS[name].__module__, *NEEDED.get(name, [])]
        assert node.output.splitlines()[-1] == f'imported: {[n for n in SLOW if n in needed]}'


def test_sigterm_ends_a_node_cleanly_and_integers_are_accepted_for_floats(graph):
    with graph.start('wheel_controller', rate=20, imu__position='[0, 0, 1]') as node:
        graph.until(lambda: graph.health)
        assert node.end(signal.SIGTERM) == 0
        assert [line for line in node.output.splitlines() if 'waiting for' not in line] == []


@pytest.mark.parametrize(('parameters', 'message'), [
    ({'rate': 'fast'}, "parameter rate: 'fast', expected a float"),
    ({'rate': 1000}, 'parameter rate: 1000.0, expected 1 to 200 Hz'),
    ({'imu__position': '[1, 2]'}, 'parameter imu.position: '),
    ({'use_sim_time': 'maybe'}, "parameter use_sim_time: 'maybe', expected a bool"),
])
def test_an_invalid_parameter_is_refused_by_its_name(parameters, message, isolated_ros):
    with pytest.raises(ParameterError) as error, virtual(WheelController, **parameters):
        pass
    assert message in str(error.value)


@pytest.fixture
def refused(monkeypatch, capfd):
    """Return a function that runs a node with arguments and returns the line that refuses them."""
    def line(module, *words):
        monkeypatch.setattr(sys, 'argv', [module.__name__, *words])
        capfd.readouterr()
        assert module.main() == 2
        found = [one for one in ''.join(capfd.readouterr()).splitlines() if one]
        assert len([one for one in found if '[rcl]' not in one]) == 1, found
        return found[-1]

    monkeypatch.setattr(threading, 'excepthook', threading.excepthook)
    monkeypatch.setattr(SmartTireNode, 'exchange', None)
    interval = sys.getswitchinterval()
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield line
    sys.setswitchinterval(interval)
    for number, handler in handlers.items():
        signal.signal(number, handler)


@pytest.mark.parametrize('words', [
    ['--bogus'], ['use_sim_time:=maybe'], ['--ros-args', '-p', 'rate:=20', '--', '--bogus']])
def test_unknown_arguments_are_refused_in_one_line(words, refused):
    assert f'unknown arguments: {words[-1]} (ROS arguments come after' in refused(
        wheel_controller, *words)


@pytest.mark.parametrize(('module', 'words', 'message'), [
    (wheel_controller, ['-p', 'ratee:=16.0'], 'unknown parameter ratee, did you mean rate?'),
    (wheel_controller, ['--bogus'], "ROS arguments: unknown '--bogus'"),
    (composed, ['--', 'motor_driver'], 'unknown arguments: motor_driver (nodes: tire_receiver, '),
    (composed, ['-p', 'imu_driver:baud_rate:=fast', '--', 'imu_driver'], "baud_rate: 'fast'")])
def test_what_is_refused_is_named_in_one_line(module, words, message, refused, isolated_ros):
    assert message in refused(module, '--ros-args', *words)


@pytest.mark.parametrize(('text', 'message'), [
    ('/**:\n  ros__parameters:\n    wheel_radios: 0.1\n', 'did you mean wheel_radius?'),
    ('/**:\n  ros__parameters:\n    qos_overrides./tf.publisher.depth: 9\n',
     'qualities of service are fixed'),
    ('/**:\n  ros__parameters:\n    units: [broken]\n', "units: 'broken', expected 16 hex digits"),
    ('/**: [', 'params.yaml: not a YAML file'),
    ('/**: &a {a: *a}', 'params.yaml: not a YAML file: line 1: aliases and tags are not read'),
    ('[' * 100_000, 'params.yaml: not a YAML file: line 1: more than 50 nested levels'),
])
def test_an_invalid_parameter_file_is_refused(text, message, refused, isolated_ros, tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_text(text)
    assert message in refused(tire_receiver, '--ros-args', '--params-file', str(path))


def test_a_parameter_file_that_is_a_fifo_is_refused(refused, isolated_ros, tmp_path):
    os.mkfifo(tmp_path / 'params.yaml')
    line = refused(tire_receiver, '--ros-args', '--params-file', str(tmp_path / 'params.yaml'))
    assert line.endswith('params.yaml: cannot be read (not a regular file)')


def test_a_node_that_is_refused_ends_with_status_2(graph):
    with graph.start('wheel_controller', ratee=16.0) as node:
        assert node.ended() == 2
        assert node.output.count('\n') == 1


@pytest.mark.parametrize(('node_class', 'warnings'), [(WheelController, 1), (ImuDriver, 0)])
def test_the_node_whose_name_is_misspelled_in_a_file_warns_of_it(
        node_class, warnings, isolated_ros, tmp_path):
    path = tmp_path / 'params.yaml'
    path.write_text('wheel_controler: {ros__parameters: {rate: 20.0}}')
    with virtual(node_class, '--params-file', str(path)) as node:
        assert str(node.log.lines).count(
            'params.yaml: wheel_controler is ignored, did you mean wheel_controller?') == warnings


def test_simulated_robots_in_two_namespaces_have_ports_of_their_own(graph):
    received = [], []
    for name, messages in zip(('/r1', '/r2'), received):
        graph.node.create_subscription(
            Imu, f'{name}/imu/data', messages.append, subscriber_qos('imu/data'))
    with graph.start('robot_simulator', namespace='/r1'), \
            graph.start('robot_simulator', namespace='/r2') as second, \
            graph.start('imu_driver', namespace='/r1', port='simulated:imu'), \
            graph.start('imu_driver', namespace='/r2', port='simulated:imu'):
        graph.until(lambda: all(received))
        with pytest.raises(ParameterError) as error, virtual(RobotSimulator, '-r', '__ns:=/r2'):
            pass
        assert f'another simulator uses it (process {second.popen.pid})' in str(error.value)
        assert second.end() == 0
        count = len(received[0])
        graph.until(lambda: len(received[0]) > count + 20)  # the first one goes on


@pytest.mark.parametrize('patience', [PATIENCE, 0.0])
def test_the_simulator_removes_its_ports_after_the_drivers_have_closed_them(
        patience, isolated_ros, monkeypatch, tmp_path):
    """Ctrl-C ends all nodes at once; a port removed before its driver closes it is an error."""
    monkeypatch.setattr(robot_simulator, 'PORT_CLOSE_TIMEOUT', patience)
    with local(RobotSimulator, **ports(tmp_path)) as node, open_port(
            str(tmp_path / 'imu'), 115200) as port:
        wait_for(lambda: port.read(100))
        ending = threading.Thread(target=node.stop)
        ending.start()
        if patience:
            wait_for(lambda: port.read(100))  # the simulation goes on
            assert ending.is_alive() and (tmp_path / 'imu').exists()
            port.close()
        ending.join()
        assert not (tmp_path / 'imu').exists()
