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

"""Parameter files with calibrated values and their standard errors."""

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
    """A parameter identified from a recording."""

    name: str                   # as in the parameter files
    value: Value
    sigma: Value | None = None  # standard error; None if not available
    note: str = ''


def identified_text(header: Sequence[str], identified: Iterable[Identified]) -> str:
    """
    Return a ROS parameter file for all nodes with the ``identified`` parameters.

    ``header`` are comment lines. A comment after each value holds standard error and unit. Raises
    ParameterError for an unknown name or an invalid value.
    """
    lines = [f'# {line}' for line in header]
    return '\n'.join([*lines, '/**:', '  ros__parameters:', *_body(identified)]) + '\n'


def _body(identified: Iterable[Identified]) -> Iterator[str]:
    known = {name: spec for cls in NODE_PARAMS.values() for name, spec in specs(cls).items()}
    open_group = ''
    for item in sorted(identified, key=lambda item: item.name.rpartition('.')[0]):
        if item.name not in known:
            raise ParameterError(f'unknown parameter {item.name}')
        known[item.name].check(item.value)
        group, _, name = item.name.rpartition('.')
        if group != open_group:
            yield f'    {group}:'
            open_group = group
        error = '' if item.sigma is None else f'standard error {_number_text(item.sigma)} '
        unit = '' if known[item.name].unit == '-' else known[item.name].unit
        comment = ', '.join(part for part in (f'{error}{unit}'.strip(), item.note) if part)
        yield f'    {"  " if group else ""}{name}: {_number_text(item.value, 7)}' + (
            f'  # {comment}' if comment else '')


def _number_text(value: Value, digits: int = 2) -> str:
    if isinstance(value, tuple):
        return '[' + ', '.join(_number_text(item, digits) for item in value) + ']'
    return repr(float(f'{value:.{digits}g}'))


def write_text(path: Path, text: str) -> None:
    """Write ``text`` to ``path``; raise ParameterError if it cannot be written."""
    try:
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise ParameterError(f'{path}: cannot be written ({error.strerror})') from error
