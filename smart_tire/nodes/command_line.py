# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Command line of the nodes: ``--help`` and ``--version``, answered without importing rclpy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
import sys

import smart_tire
from smart_tire.launching import OPTIONAL, SEPARATE, TEST_STAND
from smart_tire.messages.describe import (
    columns, describe, DIAGNOSTICS, NODE_TABLE, NodeEntry, paragraph, plain, topic_lines)
from smart_tire.parameters import FILES, NODE_PARAMS, RobotParams, Spec, specs
from smart_tire.parameters.files import foreign_arguments, value_text
from smart_tire.parameters.spec import NAMES

HELP, VERSION = ('-h', '--help'), ('--version',)
INDENT = '  '
COMPOSED = 'composed'  # executable of several nodes in one process
# All but those of a test stand, the mapper, and those that are processes of their own, for safety:
COMPOSED_NODES = tuple(
    name for name in NODE_TABLE if name not in (*SEPARATE, *TEST_STAND, *OPTIONAL))
EXIT_STATUSES = (
    ('0', 'ended by SIGINT or SIGTERM'),
    ('1', 'ended by an uncaught exception, which is printed'),
    ('2', 'refused: unknown argument, unknown parameter or invalid value'))


def answer(words: Sequence[str], module: str = '') -> str | None:
    """
    Return the text that answers ``--help`` or ``--version`` on a node's command line, or None.

    ``module`` is that of ``python -m``, which the first word does not name.
    """
    name = module.rpartition('.')[2] or Path(words[0]).name
    if name not in (*NODE_TABLE, COMPOSED):
        return None
    foreign = foreign_arguments(words)
    if any(word in HELP for word in foreign):
        lines = help_lines(NODE_TABLE[name]) if name in NODE_TABLE else _composed_lines()
        return '\n'.join(lines) + '\n'
    if any(word in VERSION for word in foreign):
        return f'{name} (smart_tire {smart_tire.__version__})\n'
    return None


def started_module(command: Sequence[str] = ()) -> str:
    """Return the module of ``python -m MODULE`` in the command line of Python, '' without -m."""
    words = list(command or sys.orig_argv)
    return words[words.index('-m') + 1] if '-m' in words[1:-1] else ''


def help_lines(node: NodeEntry) -> Iterator[str]:
    """Yield the lines of the help of a node."""
    yield f'{node.name} (smart_tire {smart_tire.__version__})'
    yield from paragraph(node.purpose, '')
    yield ''
    yield f'usage: ros2 run smart_tire {node.name} [--help] [--version] [--ros-args ...]'
    yield '       ROS arguments: --params-file FILE, -p NAME:=VALUE, -r FROM:=TO and others'
    for title, topics in (('subscribes to', node.subscribes),
                          ('publishes', (*node.publishes, DIAGNOSTICS))):
        yield from _topics(title, topics)
    yield from _services(node)
    yield from _parameters(node.name)
    yield ''
    yield 'exit status'
    yield from columns(list(EXIT_STATUSES), INDENT)


def _composed_lines() -> Iterator[str]:
    yield f'{COMPOSED} (smart_tire {smart_tire.__version__})'
    yield from paragraph('runs nodes in one process, with direct hand-over between them', '')
    yield ''
    yield f'usage: ros2 run smart_tire {COMPOSED} [--help] [--version] [NODE ...] [--ros-args ...]'
    yield from paragraph(f'NODE: one of {", ".join(COMPOSED_NODES)}; all by default', INDENT)
    yield from paragraph('ROS arguments as for a single node; -p NODE:NAME:=VALUE and '
                         '-r NODE:FROM:=TO are for one of them', INDENT)
    yield ''
    yield 'exit status'
    yield from columns(list(EXIT_STATUSES), INDENT)


def _topics(title: str, names: Sequence[str]) -> Iterator[str]:
    for number, name in enumerate(names):
        yield ''
        if number == 0:
            yield title
        topic = describe(name)
        assert topic is not None, name
        yield from topic_lines(topic, indent=INDENT)


def _services(node: NodeEntry) -> Iterator[str]:
    if node.services:
        yield ''
        yield 'services'
    for service in node.services:
        condition = f', {plain(service.condition)}' if service.condition else ''
        yield f'{INDENT}{service.name}  [{service.type}]{condition}'
        yield from paragraph(service.meaning, INDENT * 3)


def _parameters(node: str) -> Iterator[str]:
    described, shared = specs(NODE_PARAMS[node]), specs(RobotParams)
    file = next(name for name, nodes in FILES.items() if node in nodes)
    own = {name: spec for name, spec in described.items() if name not in shared}
    robot = {name: spec for name, spec in described.items() if name in shared}
    for title, group in ((f'parameters (config/{file})', own),
                         ('parameters of the robot, the same for all nodes (config/robot.yaml)',
                          robot)):
        if group:
            yield ''
            yield title
            yield from _parameter_lines(group)


def _parameter_lines(group: dict[str, Spec]) -> Iterator[str]:
    last = ''
    for name, spec in zip(placeholder_names(group), group.values()):
        prefix = name.rpartition('.')[0]
        if prefix != last and last:
            yield ''
        last = prefix
        unit = '' if spec.unit == '-' else f' {spec.unit}'
        allowed = limits(spec)
        yield f'{INDENT}{name} = {value_text(spec.default)}{unit}'
        yield from paragraph(spec.meaning + (f' ({allowed})' if allowed else '')
                             + (' (can be changed while the node runs)' if spec.live else ''),
                             INDENT * 3)


def placeholder_names(described: dict[str, Spec]) -> list[str]:
    """Return the names of parameters, with ``<name>`` for the name of an instance."""
    instances = _instance_prefixes(described)
    return [_placeholder_name(name, instances) for name in described]


def _instance_prefixes(described: dict[str, Spec]) -> dict[str, str]:
    """Return the prefix of each instance of a ``named`` field -> prefix with a placeholder."""
    groups = {name.removesuffix(NAMES): spec.default for name, spec in described.items()
              if spec.instances}
    return {f'{group}{instance}.': f'{group}<name>.'
            for group, names in groups.items() for instance in names}


def _placeholder_name(name: str, instances: dict[str, str]) -> str:
    for prefix, placeholder in instances.items():
        if name.startswith(prefix):
            return placeholder + name.removeprefix(prefix)
    return name


def limits(spec: Spec) -> str:
    """Return the allowed values of a parameter in short, '' if there is no limit."""
    if spec.choices:
        return ', '.join(spec.choices)
    parts = [] if spec.length is None else [f'{spec.length} values']
    if spec.is_number:
        parts.append(f'{spec.low:g} to {spec.high:g}')
    return ', '.join(parts)
