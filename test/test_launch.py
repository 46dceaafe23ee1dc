# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Launch files: nodes, arguments, parameter files and behavior at the end.

Most tests replace the launch system by a stand-in that records calls. The last ones run
``ros2 launch`` if a ROS distribution is sourced, and most of them visit the description in the
stand-in if not.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
import os
from pathlib import Path
import re
import runpy
import signal
import subprocess
import sys
import tempfile
import time
from types import SimpleNamespace
from typing import Any

import pytest

from smart_tire.cli._stack import PORTS
from smart_tire.cli.policy import policy
from smart_tire.errors import ParameterError
from smart_tire.launching import (
    CAMERA, check_arguments, FILM, FILM_SIMULATOR, hold_interrupts, MAPPER, OPTIONAL, SEPARATE,
    TEST_STAND, view_of)
from smart_tire.nodes.command_line import COMPOSED_NODES
from smart_tire.parameters import build, load_node, NODE_PARAMS, RobotParams, specs
from smart_tire.parameters.urdf_writer import urdf_text
from support.launch_stand_in import Call, calls, CLASSES, of_kind, StandIn, started

pytestmark = pytest.mark.processes

ROOT = Path(__file__).resolve().parents[1]
LAUNCH = ROOT / 'launch'
IS_REAL = find_spec('launch_ros') is not None and find_spec('ros2launch') is not None
DEFAULTS = {'namespace': '', 'description': 'true', 'rviz': 'false', 'simulated': 'false',
            'composed': 'false', 'camera': 'false', 'drivers': 'true', 'control': 'true',
            'use_sim_time': 'false', 'imu': 'imu/data', 'wheel_states': 'wheel_states',
            'robot': str(ROOT / 'config' / 'robot.yaml'),
            'tuning': str(ROOT / 'config' / 'tuning.yaml'), 'calibration': '/tmp/film.yaml'}
TUNING = DEFAULTS['tuning']
# without options
SIMULATION = NODE_PARAMS.keys() - {*OPTIONAL, *CAMERA, FILM_SIMULATOR}
CALIBRATION = f'calibration:={ROOT / "config" / "film.yaml"}'  # any file
HUSKY = f'params:={ROOT / "config" / "platforms" / "husky.yaml"}'
VIEW = ROOT / 'config' / 'view' / 'smart_tire.rviz'
WITH_BASE = 'estimators.launch.py'
CONTROLLERS = {'wheel_controller', 'trajectory_controller'}
ESTIMATORS = {'slip_estimator', 'friction_estimator'}
# arguments of robot.launch.py with another base
OF_OTHER_BASES = {'drivers', 'control', 'use_sim_time', 'imu', 'wheel_states'}
INCLUDED = LAUNCH / 'description.py'  # starts no nodes of this package

every_file = pytest.mark.parametrize('path', sorted(LAUNCH.glob('*.py')),
                                     ids=lambda path: path.name)
every_start = pytest.mark.parametrize('path', sorted(LAUNCH.glob('*.launch.py')),
                                      ids=lambda path: path.name)


@pytest.fixture
def stand_ins(monkeypatch, tmp_path):
    """Replace the launch system by the stand-in; no package is installed."""
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))  # of the view for RViz
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    for name in CLASSES:
        monkeypatch.setitem(sys.modules, name, StandIn(name))


@pytest.fixture
def installed(monkeypatch, tmp_path):
    """Return a function that makes packages appear as installed."""
    def install(*packages: str) -> None:
        index = tmp_path / 'share' / 'ament_index' / 'resource_index' / 'packages'
        index.mkdir(parents=True)
        for package in packages:
            (index / package).touch()
        monkeypatch.setenv('AMENT_PREFIX_PATH', f'/no/such:{tmp_path}')

    return install


@pytest.fixture
def described(stand_ins):
    """Return a function that returns all calls of a launch file with some arguments."""
    def describe(path: Path, **arguments: str) -> list[Call]:
        context = SimpleNamespace(launch_configurations={**DEFAULTS, **arguments})
        return list(described_by(runpy.run_path(str(path))['generate_launch_description'](),
                                 context))

    return describe


def described_by(value: Any, context: Any) -> Iterator[Call]:
    """Yield the calls in ``value``, and those returned by its functions in ``context``."""
    for call in calls(value):
        yield call
        if call.kind == 'OpaqueFunction' and not call.options.get('args') \
                and call.options['function'] is not hold_interrupts:
            yield from described_by(call.options['function'](context), context)


def executables(found: list[Call]) -> list[str]:
    """Return the executables that are started as nodes, all of this package."""
    nodes = of_kind(found, 'Node')
    assert all(node.options['package'] == 'smart_tire' for node in nodes)
    return [node.options['executable'] for node in nodes]


def used(found: list[Call]) -> set[str]:
    """Return the names of the launch arguments that are read."""
    return {call.args[0] for call in of_kind(found, 'LaunchConfiguration')}


@every_file
def test_arguments_that_are_used_are_declared_and_described(path, described):
    found = described(path)
    declared = {call.args[0]: call.options for call in of_kind(found, 'DeclareLaunchArgument')}
    assert all(options['description'] for options in declared.values())
    by_function = {'calibration', 'simulated', 'respawn', 'composed', 'camera', 'drivers',
                   'control', 'use_sim_time'}
    assert used(found) >= declared.keys() - by_function or path == INCLUDED
    assert used(found) <= declared.keys() or path == INCLUDED


@every_file
def test_all_arguments_are_checked_before_any_process_starts(path, described):
    found = described(path)
    declared = {call.args[0] for call in of_kind(found, 'DeclareLaunchArgument')}
    check, following = of_kind(found, 'OpaqueFunction')[:2]
    assert check.options['function'] is check_arguments
    assert check.options['args'][0].keys() == declared
    assert found.index(check) < found.index(following)
    assert (following.options['function'] is hold_interrupts) == (path != INCLUDED)
    assert all(found.index(following) < found.index(node) for node in of_kind(found, 'Node'))


@pytest.mark.parametrize(('name', 'argument'), [
    ('robot.launch.py', 'hardware'), ('simulation.launch.py', 'simulation')])
def test_a_file_without_ports_is_refused_and_that_of_the_package_is_not(name, argument, stand_ins):
    convert = runpy.run_path(str(LAUNCH / name))['ARGUMENTS'][argument]
    with pytest.raises(ValueError, match='no parameters of'):
        convert(TUNING)
    for file in {argument, 'simulation'}:
        convert(str(ROOT / 'config' / f'{file}.yaml'))


@every_file
def test_default_files_exist(path, described):
    for declared in of_kind(described(path), 'DeclareLaunchArgument'):
        for place in of_kind(list(calls(declared)), 'PathJoinSubstitution'):
            name = place.args[0][-1]
            if name.endswith('.yaml'):
                assert declared.args[0] == name.removesuffix('.yaml')
                assert (ROOT / 'config' / name).is_file()


@every_start
def test_each_node_gets_the_robot_file_and_its_own(path, described):
    own = {'slip_estimator': 'tuning', 'friction_estimator': 'tuning',
           'wheel_controller': 'tuning', 'trajectory_controller': 'tuning',
           MAPPER: 'mapping', **dict.fromkeys(TEST_STAND, 'simulation'),
           **dict.fromkeys((*FILM, FILM_SIMULATOR), 'film')}
    nodes = [node for node in of_kind(described(path), 'Node')
             if node.options['executable'] != 'smart_tire']
    for node in nodes:
        files = {call.args[0] for call in node.options['parameters'] if isinstance(call, Call)}
        assert {'robot', own.get(node.options['executable'], 'hardware')} <= files


def test_the_robot_consists_of_all_nodes_except_the_simulator(described):
    found = described(LAUNCH / 'robot.launch.py')
    assert sorted(executables(found)) == sorted(NODE_PARAMS.keys() - {*TEST_STAND, *OPTIONAL})


def test_a_simulation_is_the_simulator_and_the_robot_connected_to_it(described):
    found = described(LAUNCH / 'simulation.launch.py')
    assert executables(found) == ['robot_simulator']
    include, = of_kind(found, 'IncludeLaunchDescription')
    place, = include.args
    assert (LAUNCH / place.args[0][-1]).name == 'robot.launch.py'
    given = {name: call if isinstance(call, str) else call.args[0]
             for name, call in include.options['launch_arguments']}
    taken = {call.args[0] for call in of_kind(described(LAUNCH / 'robot.launch.py'),
                                              'DeclareLaunchArgument')}
    assert given == {**{name: name for name in taken - OF_OTHER_BASES}, 'hardware': 'simulation',
                     'simulated': 'true'}
    simulator, = of_kind(found, 'Node')
    ports = simulator.options['parameters'][-1]  # whatever the parameter files say
    robot = described(LAUNCH / 'robot.launch.py', simulated='true')
    drivers = {node.options['executable'] for node in of_kind(robot, 'Node')
               if {'port': 'simulated'} in node.options['parameters']}
    assert drivers == {name for name, cls in NODE_PARAMS.items() if 'port' in specs(cls)
                       and name not in (*FILM, FILM_SIMULATOR)}
    assert ports == {f'ports.{name}': f'simulated:{name}' for name in PORTS}


def test_a_simulation_with_a_camera_has_it_and_its_localizer(described):
    found = described(LAUNCH / 'simulation.launch.py', camera='true')
    assert executables(found) == ['robot_simulator', *CAMERA]
    place = load_node([ROOT / 'config' / 'simulation.yaml'], 'overhead_localizer').overhead
    image = load_node([ROOT / 'config' / 'simulation.yaml'], 'overhead_camera_simulator').image
    assert (place.camera_position, place.camera_rotation) == (image.position, image.rotation)


@pytest.mark.parametrize('simulated', ['true', 'false'])
def test_a_composed_robot_has_two_nodes_in_processes_of_their_own(simulated, described, installed):
    installed('robot_state_publisher')
    found = described(LAUNCH / 'robot.launch.py', composed='true', simulated=simulated)
    assert sorted(executables(found)) == ['composed', 'motor_driver', 'wheel_controller']
    assert {*SEPARATE, *COMPOSED_NODES} == NODE_PARAMS.keys() - {*TEST_STAND, *OPTIONAL}
    port = [{'port': 'simulated'}] if simulated == 'true' else []
    own = {node.options['executable']: [part for part in node.options['parameters']
                                        if isinstance(part, dict)]
           for node in of_kind(found, 'Node')}
    assert own == {'composed': [*port, {'publish_imu_tf': False}], 'motor_driver': port,
                   'wheel_controller': []}


@pytest.mark.parametrize('composed', ['true', 'false'])
@pytest.mark.parametrize(('words', 'missing'), [
    ([], set()), (['drivers:=false'], {'motor_driver', 'imu_driver', 'tire_receiver'}),
    (['control:=false'], CONTROLLERS),
    (['drivers:=false', 'control:=false'], NODE_PARAMS.keys() - ESTIMATORS)])
def test_drivers_and_controllers_are_left_out_if_they_are_not_wanted(
        words, missing, composed, stand_ins):
    nodes = list(started(LAUNCH / 'robot.launch.py', f'composed:={composed}', *words))
    running = [name for node in nodes
               for name in node.options['arguments'] or [node.options['executable']]]
    assert sorted(running) == sorted(NODE_PARAMS.keys() - {*TEST_STAND, *OPTIONAL} - missing)
    assert all((node.options['executable'] == 'composed') == bool(node.options['arguments'])
               for node in nodes)


@pytest.mark.parametrize('clock', ['true', 'false'])
def test_the_estimators_run_with_another_base_on_its_topics_and_parameters(clock, stand_ins):
    nodes = list(started(
        LAUNCH / WITH_BASE, HUSKY, 'namespace:=a200', 'imu:=sensors/imu_0/data',
        'wheel_states:=platform/joint_states', f'use_sim_time:={clock}'))
    assert set(executables(nodes)) == ESTIMATORS
    for node in nodes:
        options = node.options
        assert options['namespace'] == 'a200'
        assert options['remappings'] == [
            ('imu/data', 'sensors/imu_0/data'), ('wheel_states', 'platform/joint_states'),
            ('/tf', 'tf'), ('/tf_static', 'tf_static')]
        files = [part for part in options['parameters'] if isinstance(part, str)]
        # defaults, such as the place of the IMU, would pass for those of the base
        assert set(files) - {str(ROOT / 'config' / 'hardware.yaml')} == {HUSKY.partition(':=')[2]}
        assert files[-1] == HUSKY.partition(':=')[2]
        assert ({'use_sim_time': True} in options['parameters']) == (clock == 'true')
        assert options['ros_arguments'] == ['--enclave', f'/a200/{options["executable"]}']


def test_the_wheels_of_another_base_are_those_of_joint_state_broadcaster_by_default(stand_ins):
    for node in started(LAUNCH / WITH_BASE, HUSKY):
        assert node.options['remappings'][:2] == [
            ('imu/data', 'imu/data'), ('wheel_states', 'joint_states')]


def exited(node: Call, status: int = -9, shutdown: bool = False, respawn: str = 'true',
           simulated: str = 'false') -> list[Call]:
    """Return the actions of ``robot.launch.py`` when a node has ended with ``status``."""
    context = SimpleNamespace(is_shutdown=shutdown, launch_configurations={
        'namespace': '', 'respawn': respawn, 'simulated': simulated})
    return node.options['on_exit'](SimpleNamespace(returncode=status), context)


@pytest.mark.parametrize('simulated', ['true', 'false'])
@pytest.mark.parametrize('composed', ['true', 'false'])
def test_nodes_that_died_restart_and_motor_driver_with_the_stop_latched(
        composed, simulated, described):
    found = described(LAUNCH / 'robot.launch.py', simulated=simulated, composed=composed)
    respawn, = (call for call in of_kind(found, 'DeclareLaunchArgument')
                if call.args[0] == 'respawn')
    assert respawn.options['default_value'] == 'true'
    for first in of_kind(found, 'Node'):
        assert 'respawn' not in first.options
        assert {'start_stopped': True} not in first.options['parameters']
        for ended in ({'status': 0}, {'status': 2}, {'shutdown': True}, {'respawn': 'false'}):
            assert exited(first, **ended) == []
        node = first
        for _ in range(3):
            timer, = exited(node, simulated=simulated)  # cancelled by launch at shutdown
            assert timer.kind == 'TimerAction'
            node, = timer.options['actions']
            is_driver = node.options['executable'] == 'motor_driver'
            assert node.options['parameters'] == first.options['parameters'] + (
                [{'start_stopped': True}] if is_driver else [])
            assert node.options.keys() == first.options.keys()


@pytest.mark.parametrize('namespace', ['', 'r1', '/r1/a/'])
@pytest.mark.parametrize('composed', ['true', 'false'])
def test_the_enclave_of_a_program_is_that_of_the_policy(
        composed, namespace, stand_ins, installed):
    installed('robot_state_publisher', 'rviz2')
    nodes = list(started(LAUNCH / 'simulation.launch.py', f'namespace:={namespace}',
                         f'composed:={composed}', 'rviz:=true', 'camera:=true'))
    assert len(nodes) == (8 if composed == 'true' else len(SIMULATION) + len(CAMERA) + 2)
    for node in nodes:
        option, enclave = node.options['ros_arguments']
        assert option == '--enclave'
        assert f'<enclave path="{enclave}">' in policy(namespace.strip('/'))


def test_the_restarts_of_a_node_become_rare_until_it_lasts(described, monkeypatch):
    node, *_ = of_kind(described(LAUNCH / 'robot.launch.py'), 'Node')
    now, delays = time.monotonic(), []
    monkeypatch.setattr(time, 'monotonic', lambda: now)
    for lasted in (*[50.0] * 7, 70.0, 50.0, 50.0):  # s
        now += lasted
        timer, = exited(node)
        delays.append(timer.options['period'])
        node, = timer.options['actions']
        now += delays[-1]
    assert delays == [2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0, 2.0, 4.0, 8.0]


def test_a_replay_starts_the_estimators_and_requires_a_bag(described):
    found = described(LAUNCH / 'replay.launch.py')
    assert sorted(executables(found)) == sorted([*ESTIMATORS, 'smart_tire'])
    bag, = (call for call in of_kind(found, 'DeclareLaunchArgument') if call.args[0] == 'bag')
    assert 'default_value' not in bag.options
    player, = (node for node in of_kind(found, 'Node') if 'arguments' in node.options)
    assert player.options['executable'] == 'smart_tire'
    words = [word if isinstance(word, str) else word.args[0]
             for word in player.options['arguments']]
    assert words[:5] == ['replay', 'bag', '--rate', 'rate', '--wait']
    assert float(words[5]) >= 10.0
    assert (words[6], set(words[7:])) == ('--wait-for', ESTIMATORS)


@pytest.mark.parametrize(('status', 'shutdown', 'actions'), [
    (0, False, ['Shutdown']), (1, False, ['OpaqueFunction']), (1, True, [])])
def test_the_launch_ends_with_the_replay_and_fails_with_it(
        status, shutdown, actions, stand_ins):
    replay = runpy.run_path(str(LAUNCH / 'replay.launch.py'))
    player, = (node for node in of_kind(list(calls(replay['generate_launch_description']())),
                                        'Node') if 'on_exit' in node.options)
    timers = player.options['on_exit'](SimpleNamespace(returncode=status),
                                       SimpleNamespace(is_shutdown=shutdown))
    found = [action for timer in timers for action in timer.options['actions']]
    assert [action.kind for action in found] == actions
    for action in of_kind(found, 'OpaqueFunction'):
        with pytest.raises(RuntimeError, match='the replay failed'):
            action.options['function'](None)


@pytest.mark.parametrize('name', ['robot.launch.py', 'replay.launch.py'])
@pytest.mark.parametrize(('description', 'packages', 'own'), [
    ('true', ['robot_state_publisher'], [{'publish_imu_tf': False}]),
    ('false', ['robot_state_publisher'], []), ('true', ['rviz2'], []), ('true', [], [])])
def test_the_static_transform_is_left_to_robot_state_publisher_only_if_it_starts(
        name, description, packages, own, described, installed):
    installed(*packages)
    found = described(LAUNCH / name, description=description)
    estimator, = (node for node in of_kind(found, 'Node')
                  if node.options['executable'] == 'slip_estimator')
    assert [part for part in estimator.options['parameters'] if isinstance(part, dict)] == own
    include, = of_kind(found, 'IncludeLaunchDescription')
    assert (LAUNCH / include.args[0].args[0][-1]) == INCLUDED
    given = {key: call.args[0] for key, call in include.options['launch_arguments']}
    taken = {call.args[0] for call in of_kind(described(INCLUDED), 'DeclareLaunchArgument')}
    assert given == {key: key for key in (taken if name == 'robot.launch.py'
                                          else taken - OF_OTHER_BASES)}
    programs = of_kind(described(INCLUDED, description=description), 'Node')
    assert bool(programs) == bool(own)


@pytest.fixture
def mine(tmp_path):
    """Return an argument with a parameter file."""
    file = tmp_path / 'mine.yaml'
    file.write_text('/**: {ros__parameters: {wheel_radius: 0.1, mass: 20.0, frame_prefix: r1/}}')
    return f'tuning:={file}'


@pytest.mark.parametrize('name', ['description.py', 'robot.launch.py'])
def test_the_description_is_the_urdf_of_the_parameter_files_with_wheel_states_as_joints(
        name, stand_ins, installed, mine):
    installed('robot_state_publisher')
    program, = (node for node in started(
        LAUNCH / name, mine, 'namespace:=r1', 'wheel_states:=platform/joints')
        if node.options['package'] == 'robot_state_publisher')
    assert program.options['namespace'] == 'r1'
    assert program.options['executable'] == 'robot_state_publisher'
    assert program.options['remappings'] == [
        ('joint_states', 'platform/joints'), ('/tf', 'tf'), ('/tf_static', 'tf_static')]
    assert program.options['ros_arguments'] == ['--enclave', '/r1/robot_state_publisher']
    assert program.options['parameters'][0]['frame_prefix'] == 'r1/'
    assert program.options['parameters'][1] == {'use_sim_time': False}
    value = program.options['parameters'][0]['robot_description']  # as text: XML is not YAML
    assert (value.kind, value.options) == ('ParameterValue', {'value_type': str})
    assert value.args == (urdf_text(build(RobotParams, {'wheel_radius': 0.1, 'mass': 20.0})),)


def test_programs_that_do_not_unblock_sigint_start_later(described, installed):
    installed('robot_state_publisher', 'rviz2')
    found = described(INCLUDED, rviz='true')
    timer, = of_kind(found, 'TimerAction')
    assert timer.options['period'] > 0.0
    assert timer.options['actions'] == of_kind(found, 'Node')
    assert [node.options['package'] for node in timer.options['actions']] \
        == ['robot_state_publisher', 'rviz2']


@pytest.mark.parametrize('description', ['true', 'false'])
def test_rviz_shows_the_view_of_this_package_in_the_frames_of_the_robot(
        description, stand_ins, installed, mine):
    installed('rviz2')
    node, = started(INCLUDED, 'rviz:=true', f'description:={description}', mine)
    flag, place = node.options['arguments']
    assert (node.options['package'], flag) == ('rviz2', '-d')
    assert node.options['ros_arguments'] == ['--enclave', '/operator']
    assert Path(place).read_text(encoding='utf-8') == view_of(
        VIEW.read_text(encoding='utf-8'), build(RobotParams, {
            'wheel_radius': 0.1, 'frame_prefix': 'r1/'}))
    assert not list(started(INCLUDED, 'description:=false'))


@pytest.mark.parametrize(('packages', 'description', 'logged'), [
    ([], 'true', 1), ([], 'false', 0), (['robot_state_publisher'], 'true', 0)])
def test_a_missing_robot_state_publisher_is_logged_and_the_launch_continues(
        packages, description, logged, described, installed):
    installed(*packages)
    lines = of_kind(described(INCLUDED, description=description), 'LogInfo')
    assert len(lines) == logged
    assert all('robot_state_publisher is not installed' in line.options['msg'] for line in lines)


@pytest.fixture
def launch_system(request):
    """Replace the launch system by the stand-in where it is not installed."""
    if not IS_REAL:
        request.getfixturevalue('stand_ins')


@every_file
def test_the_launch_system_accepts_the_file(path, launch_system):
    description = runpy.run_path(str(path))['generate_launch_description']()
    assert all(argument.description for argument in description.get_launch_arguments())
    assert {argument.name for argument in description.get_launch_arguments()} == \
        runpy.run_path(str(path))['ARGUMENTS'].keys()


class Launch:
    """A running ``ros2 launch`` in its own process group, as in a terminal."""

    def __init__(self, name: str, *arguments: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, '-c', 'import sys; from ros2cli.cli import main; sys.exit(main())',
             'launch', str(LAUNCH / name), *arguments], stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
            env={**os.environ, 'PYTHONUNBUFFERED': '1'})
        self.lines: list[str] = []

    def __enter__(self) -> Launch:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._process.stdout.close()

    def until(self, pattern: str) -> None:
        """Read until a line has ``pattern``."""
        for line in self._process.stdout:
            self.lines.append(line)
            if re.search(pattern, line):
                return
        raise AssertionError(f'no {pattern} in:\n' + ''.join(self.lines))

    def interrupt(self) -> None:
        """Send SIGINT to launch and all its children, as Ctrl-C does."""
        os.killpg(self._process.pid, signal.SIGINT)

    def end(self) -> int:
        """Read until the end; return the exit status."""
        self.lines += self._process.stdout
        return self._process.wait()


def given_files(name: str) -> list[str]:
    """Return arguments for all parameter files: the package need not be installed."""
    return [f'{kind}:={ROOT / "config" / kind}.yaml'
            for kind in runpy.run_path(str(LAUNCH / name))['FILES'] if name != WITH_BASE]


def refusal(file: str, *words: str) -> str:
    """Return the one line with which a launch ends before any process has started."""
    if IS_REAL:
        with Launch(file, *words) as launch:
            assert launch.end() == 1
        logged = [line for line in launch.lines if not line.startswith('[INFO] [launch]')]
        assert len(logged) == 1, launch.lines
        return logged[0]
    with pytest.raises(ParameterError) as error:
        next(started(LAUNCH / file, *words))
    return str(error.value)


@pytest.mark.parametrize(('name', 'word', 'message'), [
    ('simulation', 'simulation:=/no/such.yaml', 'no such file'),
    ('simulation', 'robot:=robott.yaml', 'robot:=robott.yaml: no such file'),
    ('robot', 'hardware:=/no/such.yaml', 'no such file'),
    ('robot', 'tuning:=/tmp', 'is a directory, expected a file'),
    ('robot', f'hardware:={TUNING}', 'no parameters of motor_driver'),
    ('simulation', f'simulation:={TUNING}', 'no parameters of robot_simulator in this file'),
    ('replay', 'tuning:=/no/such.yaml', 'no such file'),
    ('replay', 'bag:=/no/such/bag', 'bag:=/no/such/bag: no such file'),
    ('replay', 'rate:=fast', 'expected a positive number'),
    ('simulation', 'simulaton:=x', 'did you mean simulation:=?'),
    ('simulation', 'hardware:=x', 'unknown argument hardware:='),
    ('robot', 'use_sim_tim:=true', 'did you mean use_sim_time:=?'),
    ('robot', 'use_sim_time:=maybe', 'use_sim_time:=maybe: expected true or false'),
    ('robot', 'use_sim_time:=true', 'drivers stamp with the time of the host'),
    ('robot', 'drivers:=none', 'drivers:=none: expected true or false'),
    ('robot', 'control:=none', 'control:=none: expected true or false'),
    ('robot', 'imu:=imu data', 'imu:=imu data: expected the name of a topic'),
    ('estimators', 'wheel_states:=/joint_states/', 'expected the name of a topic'),
    ('estimators', 'imu:=9dof/imu', 'imu:=9dof/imu: expected the name of a topic'),
    ('estimators', 'use_sim_time:=maybe', 'use_sim_time:=maybe: expected true or false'),
    ('estimators', 'params:=husky', 'params:=husky: no such file'),
    ('estimators', 'robot:=husky.yaml', 'unknown argument robot:='),
    ('estimators', 'wheel_state:=x', 'did you mean wheel_states:=?'),
    ('robot', 'respawn:=maybe', 'respawn:=maybe: expected true or false'),
    ('replay', 'description:=maybe', 'description:=maybe: expected true or false'),
    ('simulation', 'rviz:=maybe', 'rviz:=maybe: expected true or false'),
    ('film', 'namespace:=a', 'calibration:= is missing'),
    ('film', 'calibration:=none.yaml', 'calibration:=none.yaml: no such file'),
])
def test_an_invalid_argument_ends_the_launch_in_one_line(
        name, word, message, launch_system, isolated_ros):
    file = f'{name}.launch.py'
    required = {'replay': ['bag:=/tmp'], 'estimators': [HUSKY]}.get(name, [])
    assert message in refusal(file, *given_files(file), *required, word)


@pytest.mark.parametrize(('name', 'words', 'count'), [
    ('robot', [], len(SIMULATION) - 1), ('simulation', [], len(SIMULATION)),
    ('simulation', ['camera:=true'], len(SIMULATION) + len(CAMERA)),
    ('simulation', ['composed:=true'], 4),
    ('replay', ['bag:=/tmp'], 3), ('estimators', [HUSKY], 2), ('mapping', [], 1),
    ('film', [CALIBRATION], 2),
    ('film', ['simulated:=true'], 3)])
def test_a_launch_with_defaults_starts_its_processes(name, words, count, stand_ins):
    nodes = list(started(LAUNCH / f'{name}.launch.py', *words))
    assert len(set(executables(nodes))) == len(nodes) == count


@pytest.mark.parametrize('text', [
    'from launch.actions import Node', 'from launch_ros.actions import Node; Node(pakage="a")'])
def test_the_stand_in_refuses_what_the_launch_system_does_not_have(text, stand_ins):
    with pytest.raises((ImportError, TypeError)):
        exec(text)


NEEDED = 'needs a ROS distribution'
real = pytest.mark.skipif(not IS_REAL, reason=NEEDED)


@pytest.fixture
def simulation(tmp_path):
    """Return the arguments of a simulation with its own ports; skip if not installed."""
    index = pytest.importorskip('ament_index_python', reason=NEEDED)
    try:
        index.get_package_prefix('smart_tire')
    except index.PackageNotFoundError:
        pytest.skip(f'{NEEDED}, with smart_tire in a workspace')
    file = tmp_path / 'simulation.yaml'
    file.write_text('robot_simulator: {ros__parameters: {seed: 2}}')  # names no ports
    return f'simulation:={file}'


@real
@pytest.mark.parametrize('moment', ['wheel_controller.*process started', 'motors is open'])
def test_ctrl_c_of_a_simulation_prints_no_errors(moment, simulation, isolated_ros):
    with Launch('simulation.launch.py', simulation, 'description:=false') as launch:
        launch.until(moment)
        launch.interrupt()
        assert launch.end() == 0
    log = ''.join(launch.lines)
    assert not re.search(r'ERROR|FATAL|Traceback|KeyboardInterrupt|has died', log), log
    assert len(re.findall('has finished cleanly', log)) == len(SIMULATION), log


PUBLISHER = """#!/usr/bin/env python3
import os, signal, sys
blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [])
signal.signal(signal.SIGINT, lambda *_: os._exit(0))  # SIGINT comes twice
print('blocked', signal.SIGINT in blocked, 'arguments', *sys.argv[1:], flush=True)
signal.pause()
"""


@real
def test_robot_state_publisher_gets_the_wheels_and_ends_with_ctrl_c(
        simulation, isolated_ros, installed, tmp_path, monkeypatch):
    layers = os.environ['AMENT_PREFIX_PATH']
    installed('robot_state_publisher')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path}:{layers}')
    program = tmp_path / 'lib' / 'robot_state_publisher' / 'robot_state_publisher'
    program.parent.mkdir(parents=True)
    program.write_text(PUBLISHER)
    program.chmod(0o755)
    with Launch('simulation.launch.py', simulation) as launch:
        launch.until('blocked .* arguments .*--params-file .* -r joint_states:=wheel_states')
        assert 'blocked False' in launch.lines[-1]
        launch.until('motors is open')
        launch.interrupt()
        assert launch.end() == 0
    log = ''.join(launch.lines)
    assert 'is not installed' not in log and 'has died' not in log, log
    assert len(re.findall('has finished cleanly', log)) == len(SIMULATION) + 1, log
