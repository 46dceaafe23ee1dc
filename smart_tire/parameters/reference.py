# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Writes docs/parameters.md, the reference of all ROS parameters, from the parameter classes.

``python -m smart_tire.parameters.reference FILE`` writes it; a test checks that it is current.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import sys

from smart_tire.parameters import NODE_PARAMS, RobotParams
from smart_tire.parameters.spec import NAMES, Spec, specs
from smart_tire.parameters.yaml_writer import FILES, value_text

INTRODUCTION = """\
# Parameters

All ROS parameters with their defaults, from the parameter classes in `smart_tire/parameters/`;
`make config` writes this document and the parameter files in `config/`.

* The type is that of the default; integers are accepted for floats. An unknown name or an invalid
  value ends a node with a message that names the parameter and the expected value.
* If several files or command line arguments set a parameter, the last one applies. This differs
  from rcl, where a block for a node takes precedence over `/**`.
* `<name>` stands for each name in the list parameter `names` of the same group; the defaults given
  are those of the instances in the default list. Instances that are not listed are ignored.
* Parameters are read-only while a node runs, except those marked *live*.
"""
HEADER = '| name | default | range | meaning |\n| --- | --- | --- | --- |'


def reference_text() -> str:
    """Return the text of docs/parameters.md."""
    sections = [INTRODUCTION]
    for file, (_, nodes) in FILES.items():
        for node in nodes:
            sections.append('\n'.join(_section(file, node)) + '\n')
    return '\n'.join(sections)


def _section(file: str, node: str) -> Iterator[str]:
    """Yield the lines of the section of a node; '' is the robot, for all nodes."""
    described = specs(NODE_PARAMS[node] if node else RobotParams)
    shared = specs(RobotParams) if node else {}
    yield f'## {node or "Robot"}'
    yield ''
    yield f'`config/{file}`' + ('' if node else ', for all nodes and the offline analysis.')
    yield ''
    yield HEADER
    for name, shown, spec in zip(described, placeholder_names(described), described.values()):
        if name not in shared:
            yield _row(shown, spec)


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


def _row(name: str, spec: Spec) -> str:
    meaning = spec.meaning + (' (*live*)' if spec.live else '')
    return f'| `{name}` | {default_cell(spec)} | {range_cell(spec)} | {meaning} |'


def default_cell(spec: Spec) -> str:
    """Return the default of a parameter with its unit, and its type if it is an empty list."""
    parts = [f'`{value_text(spec.default)}`', spec.kind if spec.default == () else '',
             '' if spec.unit == '-' else spec.unit]
    return ' '.join(part for part in parts if part)


def range_cell(spec: Spec) -> str:
    """Return the allowed values of a parameter in short, '' if there is no limit."""
    if spec.choices:
        return ', '.join(f'`{choice}`' for choice in spec.choices)
    parts = [] if spec.length is None else [f'{spec.length} values']
    if spec.is_number:
        parts.append(f'{spec.low:g} to {spec.high:g}')
    return ', '.join(parts)


if __name__ == '__main__':
    Path(sys.argv[1]).write_text(reference_text(), encoding='utf-8')
