# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Checks of launch arguments and signal handling, without the launch system."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace

import pytest

from smart_tire.errors import ParameterError
from smart_tire.launching import (
    boolean, check_arguments, enclave, file, INDEX, is_described, is_installed, parameters_of,
    path, positive, text, topic, view_of, viewer)
from smart_tire.parameters import build, RobotParams
from support.waiting import PATIENCE
import yaml

pytestmark = pytest.mark.processes

NOBODY = 65534  # user without rights
LAUNCHED = '/opt/share/smart_tire/launch/robot.launch.py'
CONVERTERS = {'namespace': text, 'respawn': boolean}


def context(configurations=None, command_line=(), launched=LAUNCHED):
    """Return a launch context as it is when ``ros2 launch`` visits ``robot.launch.py``."""
    source = SimpleNamespace(location=launched)
    root = SimpleNamespace(entities=[SimpleNamespace(launch_description_source=source)])
    known = {'current_launch_file_path': LAUNCHED, 'event': SimpleNamespace(
        launch_description=root)}
    return SimpleNamespace(
        argv=command_line, get_locals_as_dict=lambda: known,
        launch_configurations={'namespace': '', 'respawn': 'false', **(configurations or {})})


@pytest.mark.parametrize(('name', 'message'), [
    ('respwan', 'unknown argument respwan:=, did you mean respawn:=?'),
    ('use_sim_time', 'unknown argument use_sim_time:=, expected one of namespace, respawn'),
])
def test_an_argument_that_launch_would_ignore_is_refused(name, message):
    with pytest.raises(ParameterError) as error:
        check_arguments(context(command_line=[f'{name}:=true']), CONVERTERS)
    assert str(error.value) == message


@pytest.mark.parametrize('word', ['respawn:=false', 'namespace:=a:=b', 'launch-prefix:=gdb',
                                  'sigterm_timeout:=9'])
def test_arguments_of_the_file_and_of_launch_itself_are_accepted(word):
    check_arguments(context(command_line=[word]), CONVERTERS)


def test_arguments_of_an_including_launch_file_are_not_checked():
    included = context(command_line=['speed:=3'], launched='/home/me/my.launch.py')
    check_arguments(included, CONVERTERS)


def test_a_description_launched_by_a_program_is_not_checked():
    no_event = context(command_line=['speed:=3'])
    no_event.get_locals_as_dict = dict
    check_arguments(no_event, CONVERTERS)


def test_the_error_names_argument_value_and_expectation():
    with pytest.raises(ParameterError) as error:
        check_arguments(context({'respawn': 'maybe'}), CONVERTERS)
    assert str(error.value) == 'respawn:=maybe: expected true or false'


@pytest.mark.parametrize(('converter', 'value', 'message'), [
    (file, '/no/such.yaml', 'no such file or directory'),
    (file, '/tmp', 'is a directory, expected a file'),
    (path, '/no/such/bag', 'no such file or directory'),
    (boolean, '1', 'expected true or false'),
    (positive, 'fast', 'expected a positive number'),
    (positive, '0', 'expected a positive number'),
    (positive, 'inf', 'expected a positive number'),
    (positive, 'nan', 'expected a positive number'),
])
def test_an_invalid_value_is_refused_with_the_reason(converter, value, message):
    with pytest.raises(ValueError, match=message):
        converter(value)


def test_a_parameter_file_without_the_nodes_that_it_is_for_is_refused(tmp_path):
    """Their defaults would be used silently, the ports of real devices among them."""
    given = tmp_path / 'some.yaml'
    convert = parameters_of('robot_simulator', 'imu_driver')
    given.write_text('/**/robot_simulatr: {ros__parameters: {seed: 2}}')
    with pytest.raises(ValueError, match='no parameters of robot_simulator or imu_driver in this'):
        convert(str(given))
    for block in ('/**', '/r1/robot_simulator', 'imu_driver'):
        given.write_text(f'{block}: {{ros__parameters: {{}}}}')
        assert convert(str(given)) == given
    with pytest.raises(ValueError, match='no such file'):
        convert('/no/such.yaml')


@pytest.fixture
def without_privileges():
    """Let ``os.access``, which asks for the rights of the real user, not ask for those of root."""
    user = os.getuid()
    os.setresuid(user or NOBODY, -1, -1)
    yield
    os.setresuid(user, -1, -1)


def test_an_unreadable_file_is_refused(tmp_path, without_privileges):
    secret = tmp_path / 'secret.yaml'
    secret.touch(mode=0)
    with pytest.raises(ValueError, match='no permission'):
        file(str(secret))


@pytest.fixture
def prefixes(tmp_path, monkeypatch):
    """Return an overlay and an underlay of ROS, in this order in AMENT_PREFIX_PATH."""
    found = [tmp_path / 'overlay', tmp_path / 'underlay']
    for prefix in found:
        (prefix / INDEX).mkdir(parents=True)
    monkeypatch.setenv('AMENT_PREFIX_PATH', os.pathsep.join(map(str, found)))
    return found


@pytest.mark.parametrize('layer', [0, 1])
def test_a_package_in_any_layer_is_installed(layer, prefixes):
    (prefixes[layer] / INDEX / 'rviz2').touch()
    assert is_installed('rviz2') and not is_installed('rviz')
    assert viewer('true') is True


def test_rviz_is_refused_where_it_is_not_installed(prefixes):
    assert viewer('false') is False
    with pytest.raises(ValueError, match='rviz2 is not installed'):
        viewer('true')


def test_nothing_is_installed_without_a_distribution(monkeypatch, tmp_path):
    monkeypatch.setenv('AMENT_PREFIX_PATH', '')
    (tmp_path / INDEX).mkdir(parents=True)
    (tmp_path / INDEX / 'rviz2').touch()
    monkeypatch.chdir(tmp_path)
    assert not is_installed('rviz2')
    monkeypatch.delenv('AMENT_PREFIX_PATH')
    assert not is_installed('rviz2')


def test_the_robot_is_described_if_that_is_wanted_and_possible(prefixes):
    assert not is_described('true')
    (prefixes[1] / INDEX / 'robot_state_publisher').touch()
    assert is_described('true') and not is_described('false')


def test_valid_values_are_accepted():
    assert (boolean('True'), boolean('false'), positive('2.5'), text('')) == (True, False, 2.5, '')
    assert file(__file__) == Path(__file__)
    assert path('/tmp') == Path('/tmp')


HOLD = """
import asyncio, os, signal, subprocess, sys
from types import SimpleNamespace
from smart_tire.launching import hold_interrupts

CHILD = "import os, signal; os.kill(os.getpid(), signal.SIGINT); print('alive', flush=True)"

async def launch():
    loop, children = asyncio.get_running_loop(), []

    async def start():
        children.append(subprocess.Popen([sys.executable, '-c', CHILD]))

    hold_interrupts(SimpleNamespace(asyncio_loop=loop, launch_configurations={prefix!r}))
    tasks = [loop.create_task(start()) for _ in range(2)]
    await asyncio.gather(*tasks)
    await asyncio.sleep(0)
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    print([child.wait() for child in children], flush=True)

asyncio.run(launch())
"""


@pytest.mark.parametrize(('configurations', 'survivors'), [
    ({}, 2), ({'launch-prefix': 'gdb'}, 0)])  # a debugger needs the signal
def test_processes_start_with_sigint_blocked_and_launch_unblocks_it_for_itself(
        configurations, survivors):
    result = subprocess.run([sys.executable, '-c', HOLD.format(prefix=configurations)],
                            capture_output=True, text=True, timeout=PATIENCE)
    assert result.stdout.count('alive') == survivors
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize('name', [
    'imu/data', '/imu', 'sensors/imu_0/data_raw', 'a', '/r1/joint_states', 'B2/c3'])
def test_a_topic_may_be_relative_or_absolute(name):
    assert topic(name) == name


@pytest.mark.parametrize('name', [
    '', '/', 'imu/', 'a//b', '0imu', 'imu/0', 'imu data', 'imu-data', 'a:=b', '~/imu', 'a__b',
    'imu\n', 'größe'])
def test_what_ros_does_not_allow_is_no_topic(name):
    with pytest.raises(ValueError, match='expected the name of a topic'):
        topic(name)


@pytest.mark.parametrize('space', ['', 'r1', '/r1/a/'])
def test_an_enclave_has_the_namespace_and_the_name(space):
    names = '/'.join(filter(None, [space.strip('/'), 'node']))
    assert enclave(context({'namespace': space}), 'node') == ['--enclave', f'/{names}']


VIEW = Path(__file__).resolve().parents[1] / 'config' / 'view' / 'smart_tire.rviz'


def viewed(**values):
    """Return the manager of the view for a robot, and class -> display, for single ones."""
    manager = yaml.safe_load(view_of(VIEW.read_text(encoding='utf-8'), build(RobotParams, values))
                             )['Visualization Manager']
    return manager, {one['Class'].rpartition('/')[2]: one for one in manager['Displays']}


def test_the_view_of_the_robot_with_default_parameters_is_that_of_the_file():
    text = VIEW.read_text(encoding='utf-8')
    assert yaml.safe_load(view_of(text, RobotParams())) == yaml.safe_load(text)


def test_the_view_has_the_frames_of_the_robot():
    manager, displays = viewed(frame_prefix='r1/', odom_frame='slip_odom', base_frame='base')
    assert manager['Global Options']['Fixed Frame'] == 'r1/slip_odom'
    assert manager['Views']['Current']['Target Frame'] == 'r1/base'
    assert displays['RobotModel']['TF Prefix'] == 'r1'  # RViz adds /


def test_the_ground_in_the_view_is_below_the_wheels():
    assert viewed(wheel_radius=0.3)[1]['Grid']['Offset'] == {'X': 0, 'Y': 0, 'Z': -0.3}


def test_a_prefix_that_rviz_cannot_show_is_refused():
    for prefix in ('r1/', ''):
        viewed(frame_prefix=prefix)
    with pytest.raises(ParameterError, match="frame_prefix: 'r1_', RViz needs one that ends with"):
        viewed(frame_prefix='r1_')
