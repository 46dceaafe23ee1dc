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
Sphinx extension: the reference of all ROS parameters, written from the parameter classes.

Each page with ``MARKER`` gets the tables of all nodes in its place.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import Any

from smart_tire.nodes.command_line import limits, placeholder_names
from smart_tire.parameters import FILES, RobotParams, Spec, specs
from smart_tire.parameters.files import value_text

MARKER = '<!-- parameters -->'
HEADER = '| name | default | range | meaning |\n| --- | --- | --- | --- |'


def parameters_text() -> str:
    """Return the tables of the robot and of all nodes in Markdown."""
    robot = _section('Robot', RobotParams, {},
                     '`config/robot.yaml`, for all nodes and the offline analysis.')
    nodes = (line for file, nodes in FILES.items() for node, cls in nodes.items()
             for line in _section(node, cls, specs(RobotParams), f'`config/{file}`'))
    return '\n'.join([*robot, *nodes])


def _section(title: str, cls: type, shared: Container[str], place: str) -> Iterator[str]:
    """Yield the lines of the section of a parameter class, without the ``shared`` parameters."""
    described = specs(cls)
    yield f'## {title}\n'
    yield f'{place}\n'
    yield HEADER
    for name, shown, spec in zip(described, placeholder_names(described), described.values()):
        if name not in shared:
            meaning = spec.meaning + (' (*live*)' if spec.live else '')
            yield f'| `{shown}` | {_default(spec)} | {limits(spec)} | {meaning} |'
    yield ''


def _default(spec: Spec) -> str:
    """Return the default of a parameter with its unit, and its type if it is an empty list."""
    parts = [f'`{value_text(spec.default)}`', spec.kind if spec.default == () else '',
             '' if spec.unit == '-' else spec.unit]
    return ' '.join(part for part in parts if part)


def _insert(app: Any, docname: str, source: list[str]) -> None:
    """Write the tables into a page with the marker."""
    source[0] = source[0].replace(MARKER, parameters_text())


def setup(app: Any) -> dict[str, bool]:
    """Fill pages as they are read."""
    app.connect('source-read', _insert)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
