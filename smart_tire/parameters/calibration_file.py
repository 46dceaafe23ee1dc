"""Parameter files that identifications write: what a recording told, with its standard error."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from smart_tire.errors import ParameterError
from smart_tire.parameters import NODE_PARAMS
from smart_tire.parameters.spec import specs

Value = float | tuple[float, ...]


@dataclass(frozen=True)
class Identified:
    """A parameter that a recording told."""

    name: str                 # as in the parameter files
    value: Value
    sigma: Value | None = None  # standard errors; None where there is none to tell
    note: str = ''


def identified_text(about: Sequence[str], found: Iterable[Identified]) -> str:
    """
    Return a ROS parameter file for all nodes that gives what was ``found``.

    Each line has unit and standard error behind it. Raises ParameterError for a name that no
    node knows and a value that it does not take.
    """
    lines = [f'# {line}' for line in about]
    return '\n'.join([*lines, '/**:', '  ros__parameters:', *_body(found)]) + '\n'


def _body(found: Iterable[Identified]) -> Iterator[str]:
    known = {name: spec for cls in NODE_PARAMS.values() for name, spec in specs(cls).items()}
    open_group = ''
    for item in sorted(found, key=lambda item: item.name.rpartition('.')[0]):
        if item.name not in known:
            raise ParameterError(f'unknown parameter {item.name}')
        known[item.name].check(item.value)
        group, _, name = item.name.rpartition('.')
        if group != open_group:
            yield f'    {group}:'
            open_group = group
        error = '' if item.sigma is None else f'standard error {_text(item.sigma)} '
        unit = '' if known[item.name].unit == '-' else known[item.name].unit
        comment = ', '.join(part for part in (f'{error}{unit}'.strip(), item.note) if part)
        yield f'    {"  " if group else ""}{name}: {_text(item.value, 7)}' + (
            f'  # {comment}' if comment else '')


def _text(value: Value, digits: int = 2) -> str:
    if isinstance(value, tuple):
        return '[' + ', '.join(_text(item, digits) for item in value) + ']'
    return repr(float(f'{value:.{digits}g}'))


def write_text(path: Path, text: str) -> None:
    """Write ``text`` to ``path``; raise ParameterError if that can not be."""
    try:
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise ParameterError(f'{path}: cannot be written ({error.strerror})') from error
