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
Writes the parameter files in ``config/`` from the parameter classes.

``python docs/config_files.py FOLDER`` writes them into FOLDER; a test checks that those in
``config/`` are current.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from inspect import cleandoc
from pathlib import Path
import sys
from typing import Any

from smart_tire.parameters import FILES, NODE_PARAMS, RobotParams, Spec, specs
from smart_tire.parameters.files import value_text
from smart_tire.parameters.overhead import ImageParams

MAX_LINE_LENGTH = 90  # characters; the items of a list that exceeds it get lines of their own

TITLES = {
    'robot.yaml': 'Robot: geometry, tires, films and sensors; for all nodes, the simulator and '
                  'the analysis.',
    'hardware.yaml': 'Drivers: ports and devices.',
    'tuning.yaml': 'Estimators and controllers.',
    'mapping.yaml': 'Friction map of the present drive.',
    'film.yaml': 'Buckling film as a sensor, and its simulation.',
    'overhead.yaml': 'Camera above the floor: its place, the tags on the robot.',
    'simulation.yaml': 'Simulated robot and ground; the geometry of the robot is in robot.yaml.',
}
SIMULATED_PORTS = {  # driver -> parameter of the simulator that names its port
    'tire_receiver': 'ports.tire_radio', 'imu_driver': 'ports.imu',
    'motor_driver': 'ports.motors'}


def file_text(name: str) -> str:
    """Return the text of the parameter file ``name``: all defaults, with comments."""
    lines = [f'# {TITLES[name]}', '# Values are the defaults; "make config" writes this file.']
    # The prefix /**/ matches the node in any namespace.
    blocks = {f'/**/{node}': cls for node, cls in FILES.get(name, {}).items()}
    for block, cls in (blocks or {'/**': RobotParams}).items():
        lines += ['', *_comment(cls, ''), f'{block}:', '  ros__parameters:', *_body(cls, '    ')]
    if name == 'simulation.yaml':
        lines += _simulated_ports()
    return '\n'.join(lines) + '\n'


def write_files(folder: Path) -> None:
    """Write all parameter files into ``folder``."""
    for name in TITLES:
        (folder / name).write_text(file_text(name), encoding='utf-8')


def _simulated_ports() -> Iterator[str]:
    yield from ('', '# The place of the simulated camera, instead of overhead.yaml.',
                '/**/overhead_localizer:', '  ros__parameters:', '    overhead:')
    camera, place = specs(NODE_PARAMS['overhead_localizer']), specs(ImageParams)
    for name in ('position', 'rotation'):
        spec = replace(camera[f'overhead.camera_{name}'], name=f'camera_{name}',
                       default=place[name].default)
        yield from (f'      {line}'.replace('; must be given', '') for line in _entry(spec))
    yield from ('', '# Drivers, instead of hardware.yaml: the ports of the simulated devices.')
    links = specs(NODE_PARAMS['robot_simulator'])
    for node, name in SIMULATED_PORTS.items():
        port = replace(specs(NODE_PARAMS[node])['port'], default=links[name].default)
        yield from (f'/**/{node}:', '  ros__parameters:', *(f'    {x}' for x in _entry(port)))


def _body(cls: type, indent: str) -> Iterator[str]:
    described = specs(cls)
    for item in fields(cls):
        if item.name in described:
            yield from (indent + line for line in _entry(described[item.name]))
        elif 'instances of' in item.metadata:
            yield f'{indent}{item.name}:'
            yield from _instances(item, described, indent + '  ')
        elif item.metadata['prefix']:
            yield from _comment(item.metadata['class'], indent)
            yield f'{indent}{item.name}:'
            yield from _body(item.metadata['class'], indent + '  ')


def _instances(item: Any, described: Mapping[str, Spec], indent: str) -> Iterator[str]:
    """Yield the lines of a field made by ``named``: the list of names, then each instance."""
    prefix = f'{item.name}.'
    lists = {name.removeprefix(prefix): spec for name, spec in described.items()
             if name.startswith(prefix)}
    group = ''
    for name, spec in lists.items():
        instance, _, leaf = name.rpartition('.')
        if instance != group:
            yield f'{indent}{instance}:'
            group = instance
        yield from (indent + '  ' * bool(instance) + line
                    for line in _entry(replace(spec, name=leaf)))


def _comment(cls: type, indent: str) -> Iterator[str]:
    for line in cleandoc(cls.__doc__ or '').splitlines():
        yield f'{indent}# {line}'.rstrip()


def _entry(spec: Spec) -> list[str]:
    unit = '' if spec.unit == '-' else f'{spec.unit}, '
    in_meaning = all(choice in spec.meaning for choice in spec.choices)
    choices = '' if in_meaning else f' ({", ".join(spec.choices)})'
    comment = f'  # {unit}{spec.meaning}{choices}'
    line = f'{spec.name}: {value_text(spec.default)}{comment}'
    if len(line) <= MAX_LINE_LENGTH or not isinstance(spec.default, tuple) \
            or len(spec.default) < 2 or not isinstance(spec.default[0], str):
        return [line]
    return [f'{spec.name}:{comment}', *(f'  - {value_text(item)}' for item in spec.default)]


if __name__ == '__main__':
    write_files(Path(sys.argv[1]))
