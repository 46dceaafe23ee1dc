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
A stand-in for the launch system of ROS, where it is not installed.

Its classes record their arguments, and refuse those that the real ones do not have. ``started``
visits a launch file as ``ros2 launch`` does: it sets launch arguments and calls functions, but
starts nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import inspect
from pathlib import Path
import runpy
from types import ModuleType, SimpleNamespace
from typing import Any

from smart_tire.launching import hold_interrupts

ROOT = Path(__file__).resolve().parents[2]
CLASSES: dict[str, dict[str, Callable[..., None]]] = {  # module -> class -> its signature
    'launch': {'LaunchDescription': lambda initial_entities=None: None},
    'launch.actions': {
        'DeclareLaunchArgument':
            lambda name, *, default_value=None, description=None, choices=None: None,
        'IncludeLaunchDescription':
            lambda launch_description_source, *, launch_arguments=None: None,
        'LogInfo': lambda *, msg: None,
        'OpaqueFunction': lambda *, function, args=None, kwargs=None: None,
        'Shutdown': lambda *, reason='': None,
        'TimerAction': lambda *, period, actions: None},
    'launch.substitutions': {
        'LaunchConfiguration': lambda variable_name, *, default=None: None,
        'PathJoinSubstitution': lambda substitutions: None},
    'launch_ros': {},
    'launch_ros.actions': {
        'Node': lambda *, executable, package=None, name=None, namespace=None, parameters=None,
        remappings=None, ros_arguments=None, arguments=None, output='log', on_exit=None: None},
    'launch_ros.parameter_descriptions': {
        'ParameterValue': lambda value, *, value_type=None: None},
    'launch_ros.substitutions': {'FindPackageShare': lambda package: None},
}


@dataclass
class Call:
    """A recorded call of a class of the launch system."""

    kind: str
    args: tuple[Any, ...]
    options: dict[str, Any]

    def inside(self) -> Iterator[Call]:
        """Yield this call and all those in its arguments."""
        yield self
        yield from calls([self.args, self.options])

    def perform(self, context: Any) -> str:
        """Return what this substitution stands for."""
        return str(_resolved(self, context.launch_configurations))

    @property
    def name(self) -> str:
        """Return the name of a launch argument."""
        return str(self.args[0])

    @property
    def description(self) -> str | None:
        """Return the description of a launch argument."""
        return self.options.get('description')

    def get_launch_arguments(self) -> list[Call]:
        """Return those that a description declares."""
        return of_kind(self.args[0], 'DeclareLaunchArgument')


class StandIn(ModuleType):
    """A module of the launch system, whose classes record calls."""

    def __getattr__(self, name: str) -> Callable[..., Call]:
        if name not in CLASSES[self.__name__]:
            raise AttributeError(f'no {name} in the stand-in for {self.__name__}')
        signature = inspect.signature(CLASSES[self.__name__][name])

        def record(*args: Any, **options: Any) -> Call:
            signature.bind(*args, **options)  # raises TypeError as the class does
            return Call(name, args, options)

        return record


def calls(value: Any) -> Iterator[Call]:
    """Yield the calls in ``value``, at any depth."""
    if isinstance(value, Call):
        yield from value.inside()
    elif isinstance(value, dict):
        yield from calls(list(value.items()))
    elif hasattr(value, '__iter__') and not isinstance(value, (str, type)):
        for item in value:
            yield from calls(item)


def of_kind(found: list[Call], kind: str) -> list[Call]:
    """Return the calls of one class."""
    return [call for call in found if call.kind == kind]


class Context:
    """What functions of a launch file get, while the file at ``path`` is visited."""

    is_shutdown = False

    def __init__(self, path: Path, words: tuple[str, ...]) -> None:
        source = SimpleNamespace(location=str(path))
        self._event = SimpleNamespace(launch_description=SimpleNamespace(
            entities=[SimpleNamespace(launch_description_source=source)]))
        self.path, self.argv = path, words
        self.launch_configurations = dict(word.split(':=', 1) for word in words)

    def get_locals_as_dict(self) -> dict[str, Any]:
        """Return the event that the launch began with, and the file."""
        return {'event': self._event, 'current_launch_file_path': str(self.path)}


def started(path: Path, *words: str) -> Iterator[Call]:
    """
    Yield the nodes that ``ros2 launch`` starts with ``words``, ``name:=value`` each.

    Their options have texts in place of substitutions.
    """
    yield from _visited(described(path), Context(path, words))


def described(path: Path) -> Call:
    """Return the description in a launch file."""
    description: Call = runpy.run_path(str(path))['generate_launch_description']()
    return description


def _visited(call: Call, context: Context) -> Iterator[Call]:
    """Visit an action; yield the nodes that start."""
    chosen, path, inner = context.launch_configurations, context.path, []
    if call.kind == 'Node':
        yield Call(call.kind, call.args, _resolved(call.options, chosen))
    elif call.kind == 'DeclareLaunchArgument' and call.name not in chosen:
        if 'default_value' not in call.options:
            raise RuntimeError(f'required launch argument {call.name} was not provided')
        chosen[call.name] = _resolved(call.options['default_value'], chosen)
    elif call.kind == 'IncludeLaunchDescription':
        context.path = Path(_resolved(call.args[0], chosen))
        chosen.update(_resolved(dict(call.options['launch_arguments']), chosen))
        inner = [described(context.path)]
    elif call.kind == 'OpaqueFunction' and call.options['function'] is not hold_interrupts:
        inner = call.options['function'](context, *call.options.get('args', ())) or []
    elif call.kind == 'LaunchDescription':
        inner = call.args[0]
    elif call.kind == 'TimerAction':
        inner = call.options['actions']
    for action in inner:
        yield from _visited(action, context)
    context.path = path


def _resolved(value: Any, chosen: dict[str, str]) -> Any:
    """Return ``value`` with texts in place of substitutions."""
    if isinstance(value, dict):
        return {name: _resolved(inner, chosen) for name, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(_resolved(inner, chosen) for inner in value)
    kind = value.kind if isinstance(value, Call) else ''
    if kind == 'LaunchConfiguration':
        return chosen[value.args[0]]
    if kind == 'FindPackageShare':
        return str(ROOT)
    return '/'.join(_resolved(value.args[0], chosen)) if kind == 'PathJoinSubstitution' else value
