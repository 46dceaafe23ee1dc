"""
The files in ``config/``, written from the descriptions of the parameters.

``python -m smart_tire.parameters.yaml_writer FOLDER`` writes them; a test compares.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from inspect import cleandoc
from pathlib import Path
import sys

import yaml

from smart_tire.parameters import NODE_PARAMS, RobotParams
from smart_tire.parameters.spec import Spec, specs

WIDTH = 90  # characters; a list that makes a line longer goes below its name

# File -> what it is about, and the nodes it is for ('' for all of them).
FILES = {
    'robot.yaml': ('The robot itself, for all nodes, the simulator and the analysis.', ('',)),
    'hardware.yaml': ('What is plugged in where.',
                      ('tire_receiver', 'imu_driver', 'motor_driver')),
    'tuning.yaml': ('How estimators and controller work.',
                    ('slip_estimator', 'friction_estimator', 'wheel_controller')),
    'simulation.yaml': ('The simulated robot and its ground; its geometry is in robot.yaml.',
                        ('robot_simulator',)),
}
PLUGGED = {'tire_receiver': 'ports.tire_radio', 'imu_driver': 'ports.imu',
           'motor_driver': 'ports.motors'}  # driver -> the simulator's parameter for its port


def file_text(name: str) -> str:
    """Return the parameter file ``name`` with every parameter at its default, commented."""
    about, nodes = FILES[name]
    lines = [f'# {about}', '# Values are the defaults; "make config" writes this file.']
    for node in nodes:
        cls = NODE_PARAMS[node] if node else RobotParams
        # '/**/' in front: the node may stand in any namespace.
        lines += ['', *_comment(cls, ''), f'/**/{node}:' if node else '/**:',
                  '  ros__parameters:', *_body(cls, '    ')]
    if name == 'simulation.yaml':
        lines += _plugged()
    return '\n'.join(lines) + '\n'


def write_files(folder: Path) -> None:
    """Write all parameter files into ``folder``."""
    for name in FILES:
        (folder / name).write_text(file_text(name), encoding='utf-8')


def _plugged() -> Iterator[str]:
    yield from ('', '# The drivers, in place of hardware.yaml: their ports are the links above.')
    links = specs(NODE_PARAMS['robot_simulator'])
    for node, name in PLUGGED.items():
        port = replace(specs(NODE_PARAMS[node])['port'], default=links[name].default)
        yield from (f'/**/{node}:', '  ros__parameters:', *(f'    {x}' for x in _entry(port)))


def _body(cls: type, indent: str) -> Iterator[str]:
    described = specs(cls)
    for item in fields(cls):
        nested = item.metadata.get('nested')
        if nested is None:
            yield from (indent + line for line in _entry(described[item.name]))
        elif item.metadata['prefix']:
            yield from _comment(nested, indent)
            yield f'{indent}{item.name}:'
            yield from _body(nested, indent + '  ')


def _comment(cls: type, indent: str) -> Iterator[str]:
    for line in cleandoc(cls.__doc__ or '').splitlines():
        yield f'{indent}# {line}'.rstrip()


def _entry(spec: Spec) -> list[str]:
    unit = '' if spec.unit == '-' else f'{spec.unit}, '
    named = all(choice in spec.meaning for choice in spec.choices)
    choices = '' if named else f' ({", ".join(spec.choices)})'
    comment = f'  # {unit}{spec.meaning}{choices}'
    line = f'{spec.name}: {_value(spec.default)}{comment}'
    if len(line) <= WIDTH or not isinstance(spec.default, tuple):
        return [line]
    return [f'{spec.name}:{comment}', *(f'  - {_value(item)}' for item in spec.default)]


def _value(value: object) -> str:
    plain = list(value) if isinstance(value, tuple) else value
    text = yaml.safe_dump(plain, default_flow_style=True, width=sys.maxsize)
    return text.removesuffix('...\n').strip()


if __name__ == '__main__':
    write_files(Path(sys.argv[1]))
