"""The launch files start what is installed with what is configured; needs no launch system."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
import runpy
import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from smart_tire.parameters import NODE_PARAMS

ROOT = Path(__file__).resolve().parents[1]
LAUNCH = ROOT / 'launch'
MODULES = ('launch', 'launch.actions', 'launch.substitutions', 'launch_ros',
           'launch_ros.actions', 'launch_ros.substitutions')
ESTIMATORS = {'slip_estimator', 'friction_estimator'}

every_file = pytest.mark.parametrize('path', sorted(LAUNCH.glob('*.py')),
                                     ids=lambda path: path.name)


@dataclass
class Call:
    """A class of the launch system that was called, and with what."""

    kind: str
    args: tuple[Any, ...]
    options: dict[str, Any]

    def inside(self) -> Iterator[Call]:
        """Yield this call and all those in its arguments."""
        yield self
        yield from calls([self.args, self.options])


class Recorder(ModuleType):
    """Stands for a module of the launch system: whatever is taken from it records its calls."""

    def __getattr__(self, name: str) -> Any:
        return lambda *args, **options: Call(name, args, options)


def calls(value: Any) -> Iterator[Call]:
    """Yield the calls in ``value``, however deep."""
    if isinstance(value, Call):
        yield from value.inside()
    elif isinstance(value, dict):
        yield from calls(list(value.items()))
    elif hasattr(value, '__iter__') and not isinstance(value, str):
        for item in value:
            yield from calls(item)


@pytest.fixture
def described(monkeypatch):
    """Return a function that gives all calls that a launch file makes."""
    for name in MODULES:
        monkeypatch.setitem(sys.modules, name, Recorder(name))

    def describe(path: Path) -> list[Call]:
        return list(calls(runpy.run_path(str(path))['generate_launch_description']()))

    return describe


def of_kind(found: list[Call], kind: str) -> list[Call]:
    """Return the calls of one class."""
    return [call for call in found if call.kind == kind]


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
    assert used(found) == declared.keys()
    assert all(options['description'] for options in declared.values())


@every_file
def test_default_files_exist(path, described):
    for declared in of_kind(described(path), 'DeclareLaunchArgument'):
        for place in of_kind(list(calls(declared)), 'PathJoinSubstitution'):
            name = place.args[0][-1]
            if name.endswith('.yaml'):
                assert declared.args[0] == name.removesuffix('.yaml')
                assert (ROOT / 'config' / name).is_file()


@every_file
def test_each_node_gets_the_robot_and_its_own_parameters(path, described):
    own = {'slip_estimator': 'tuning', 'friction_estimator': 'tuning',
           'wheel_controller': 'tuning', 'robot_simulator': 'simulation'}
    nodes = [node for node in of_kind(described(path), 'Node')
             if node.options['executable'] != 'smart_tire']
    for node in nodes:
        files = {call.args[0] for call in node.options['parameters']}
        assert {'robot', own.get(node.options['executable'], 'hardware')} <= files


def test_the_robot_is_all_nodes_but_the_simulator(described):
    found = described(LAUNCH / 'robot.launch.py')
    assert sorted(executables(found)) == sorted(NODE_PARAMS.keys() - {'robot_simulator'})


def test_a_simulation_is_the_simulator_and_the_robot_plugged_into_it(described):
    found = described(LAUNCH / 'simulation.launch.py')
    assert executables(found) == ['robot_simulator']
    include, = of_kind(found, 'IncludeLaunchDescription')
    place, = include.args
    assert (LAUNCH / place.args[0][-1]).name == 'robot.launch.py'
    given = {name: call.args[0] for name, call in include.options['launch_arguments']}
    assert given == {'namespace': 'namespace', 'robot': 'robot', 'hardware': 'simulation',
                     'tuning': 'tuning'}
    taken = {call.args[0] for call in of_kind(described(LAUNCH / 'robot.launch.py'),
                                              'DeclareLaunchArgument')}
    assert given.keys() <= taken


def test_a_replay_is_the_estimators_and_the_bag_which_has_no_default(described):
    found = described(LAUNCH / 'replay.launch.py')
    assert set(executables(found)) == ESTIMATORS | {'smart_tire'}
    bag, = (call for call in of_kind(found, 'DeclareLaunchArgument') if call.args[0] == 'bag')
    assert 'default_value' not in bag.options
    player, = (node for node in of_kind(found, 'Node') if 'arguments' in node.options)
    assert player.options['executable'] == 'smart_tire'
    words = [word if isinstance(word, str) else word.args[0]
             for word in player.options['arguments']]
    assert words[:5] == ['replay', 'bag', '--rate', 'rate', '--wait']
    assert float(words[5]) >= 10.0
    assert (words[6], set(words[7:])) == ('--wait-for', ESTIMATORS)


@pytest.mark.parametrize(('status', 'ending', 'fails'), [
    (0, False, False), (1, False, True), (-9, False, True), (-2, True, False)])
def test_a_replay_that_fails_ends_the_launch_with_an_error(described, status, ending, fails):
    found = described(LAUNCH / 'replay.launch.py')
    player, = (node for node in of_kind(found, 'Node') if 'on_exit' in node.options)
    event, context = SimpleNamespace(returncode=status), SimpleNamespace(is_shutdown=ending)
    if fails:
        with pytest.raises(RuntimeError, match=f'replay failed with status {status}'):
            player.options['on_exit'](event, context)
    else:
        assert of_kind(list(calls(player.options['on_exit'](event, context))), 'Shutdown')


@every_file
def test_the_launch_system_itself_accepts_the_file(path):
    pytest.importorskip('launch_ros.actions', reason='no ROS distribution is sourced')
    from launch import LaunchDescription
    description = runpy.run_path(str(path))['generate_launch_description']()
    assert isinstance(description, LaunchDescription)
    assert all(argument.description for argument in description.get_launch_arguments())
