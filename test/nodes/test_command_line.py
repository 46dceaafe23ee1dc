# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``--help`` and ``--version`` of the nodes."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
import smart_tire
from smart_tire.launching import OPTIONAL, SEPARATE, TEST_STAND
from smart_tire.messages.describe import NODE_TABLE
from smart_tire.nodes.command_line import answer, started_module
from smart_tire.parameters import NODE_PARAMS, RobotParams, specs
from smart_tire.parameters.files import foreign_arguments, value_text

pytestmark = pytest.mark.processes

SLOW = 'rclpy', 'numpy', 'scipy', 'rosbags'


def run(*words):
    """Run Python with ``words``."""
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)


@pytest.mark.parametrize('name', NODE_TABLE)
def test_help_has_all_topics_services_and_parameters(name):
    text = answer([f'/opt/lib/{name}', '--help'])
    node = NODE_TABLE[name]
    for topic in (*node.subscribes, *node.publishes, '/diagnostics'):
        assert f'\n  {topic}  [' in text
    for title, topics in (('subscribes to', node.subscribes), ('publishes', node.publishes)):
        assert (f'\n\n{title}\n  {topics[0]}  [' in text) if topics else title not in text
    assert f'\n\nusage: ros2 run smart_tire {name} [--help]' in text
    for service in node.services:
        assert f'\n  {service.name}  [{service.type}]' in text
    robot = specs(RobotParams)
    for parameter, spec in specs(NODE_PARAMS[name]).items():
        if parameter in robot or '.patches.' not in parameter:
            unit = '' if spec.unit == '-' else f' {spec.unit}'
            assert f'\n  {parameter} = {value_text(spec.default)}{unit}\n' in text
    assert text.index('parameters (config/') < text.index('wheel_radius = ')
    assert 'exit status\n  0  ended by SIGINT or SIGTERM' in text


def test_the_layout_of_the_help():
    text = answer(['motor_driver', '-h'])
    titles = [part.partition('\n')[0] for part in text.split('\n\n') if part[0] != ' ']
    assert [title.split()[0] for title in titles] == [
        'motor_driver', 'usage:', 'subscribes', 'publishes', 'services', 'parameters',
        'parameters', 'exit']
    for part in (
            '\nOutput stage', '...]\n       ROS arguments: ', '(fig8, state)\n',
            'services\n  emergency_stop  [std_srvs/srv/SetBool]\n      true latches',
            '\n  arm  [std_srvs/srv/SetBool], only with require_arming: true\n      enables',
            'parameters (config/hardware.yaml)\n  port = /dev/ttyACM0\n      serial',
            '(0 to 10)\n\n  encoder.counts_per_revolution = ',
            'front and rear (2 values, 128 to 135)\n  rate'):
        assert part in text
    assert '\n  ground.patches.<name>.surface = ' in answer(['robot_simulator', '-h'])


def test_meaning_limits_and_liveness_of_a_parameter_are_shown():
    text = ' '.join(answer(['wheel_controller', '-h']).split())
    assert 'rate = 16.0 Hz' in text
    assert '(1 to 200)' in text
    assert text.count('(can be changed while the node runs)') == sum(
        spec.live for spec in specs(NODE_PARAMS['wheel_controller']).values()) > 0


@pytest.mark.parametrize(('words', 'module', 'answered'), [
    (['slip_estimator', '--help'], '', True),
    (['slip_estimator', 'words', '-h'], '', True),
    (['composed', 'slip_estimator', '--help'], '', True),
    (['slip_estimator', '--help', '--ros-args', '-p', 'rate:=1'], '', True),
    (['-m', '--version'], 'smart_tire.nodes.imu_driver', True),
    (['slip_estimator'], '', False),
    (['slip_estimator', '--helpful'], '', False),
    (['slip_estimator', '--ros-args', '--help'], '', False),
    (['slip_estimator', '--ros-args', '-p', 'x:=1', '--', '--help'], '', True),
    (['pytest', '--help'], '', False),
    (['-m', '--help'], 'smart_tire.cli.main', False)])
def test_only_help_and_version_of_nodes_outside_of_ros_arguments_are_answered(
        words, module, answered):
    assert (answer(words, module) is not None) == answered


def test_the_help_of_several_nodes_in_one_process_names_them():
    text = answer(['composed', '--help'])
    assert text.startswith('composed (smart_tire ')
    assert set(re.findall(r'\w+_\w+', text)) >= NODE_TABLE.keys() - {
        *TEST_STAND, *SEPARATE, *OPTIONAL}
    assert 'wheel_controller' not in text
    begins = [line.split()[0] if line else '' for line in text.splitlines()[1:]]
    assert [one for one in begins if not one.endswith((',', ';'))] == [
        'runs', '', 'usage:', 'NODE:', 'ROS', '', 'exit', *'012']


def test_the_version_is_that_of_the_package():
    version = smart_tire.__version__
    assert answer(['imu_driver', '--version']) == f'imu_driver (smart_tire {version})\n'


def test_words_between_ros_args_and_its_end_are_not_foreign():
    words = ['node', 'a', '--ros-args', 'b', '--', 'c', '--ros-args', 'd']
    assert foreign_arguments(words) == ['a', 'c']


def test_the_module_that_python_runs_is_found():
    assert started_module(['python3', '-X', 'dev', '-m', 'a.b', '--help']) == 'a.b'
    assert started_module(['python3', 'script', '--help']) == ''
    assert started_module(['python3', '-m']) == ''
    assert started_module(['python3', '-m', 'a.b']) == 'a.b'


def test_help_is_printed_without_starting_the_node_or_importing_rclpy():
    done = run('-X', 'importtime', '-m', 'smart_tire.nodes.slip_estimator', '--help')
    assert done.returncode == 0
    assert done.stdout == answer(['slip_estimator', '--help'])
    imported = {line.rpartition('|')[2].strip() for line in done.stderr.splitlines()}
    assert 'smart_tire.nodes.command_line' in imported
    assert [name for name in SLOW if name in imported] == []
