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
The tables of ``docs/architecture.md`` and the imports in the source that they describe.

``draw_architecture.py`` and ``test/test_architecture.py`` use this. Source files are parsed with
``ast``, not imported.
"""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / 'smart_tire'
BENCHMARKS = ROOT / 'benchmarks'
DOCUMENT = ROOT / 'docs' / 'architecture.md'

Edges = dict[str, set[str]]


def table(text: str, name: str) -> list[list[str]]:
    """
    Return the cells of the table between the markers ``name``, without the header.

    Raise ValueError where ``text`` lacks the markers.
    """
    begin, end = f'<!-- begin {name} -->', f'<!-- end {name} -->'
    if begin not in text or end not in text:
        raise ValueError(f'{DOCUMENT.name} has no table between the markers {begin} and {end}')
    lines = text.partition(begin)[2].partition(end)[0].strip().splitlines()
    return [[cell.strip().replace('\\*', '*') for cell in line.strip('|').split('|')]
            for line in lines[2:]]


def names(cell: str) -> set[str]:
    """Return the names in a cell, separated by spaces; '-' is an empty set."""
    return set(cell.split()) - {'-'}


def read_levels(text: str) -> dict[str, int]:
    """Return room -> level."""
    return {room: int(level) for level, rooms in table(text, 'levels') for room in rooms.split()}


def read_exceptions(text: str, verb: str) -> set[tuple[str, str]]:
    """Return (importing room, imported room) of the exceptions with ``verb`` may or never."""
    return {(room, other) for room, found, others, _ in table(text, 'exceptions')
            if found == verb for other in names(others)}


def read_rooms(text: str, name: str) -> dict[str, set[str]]:
    """Return each name of the first column of table ``name`` -> names of the second column."""
    return {one: names(rooms) for cell, rooms, _ in table(text, name) for one in cell.split()}


def room_of(name: str) -> str:
    """Return the room of a file, from its path in the repository: a folder or a top module."""
    first, _, rest = name.partition('/')
    return first if first == BENCHMARKS.name else rest.partition('/')[0].removesuffix('.py')


def room_of_module(module: str) -> str | None:
    """Return the room of a dotted module of this repository; None for any other module."""
    first, _, rest = module.partition('.')
    return first if first == BENCHMARKS.name else \
        rest.partition('.')[0] or None if first == PACKAGE.name else None


def source_files() -> list[Path]:
    """Return all modules of the package and the benchmarks, except the package's ``__init__``."""
    return [path for folder in (PACKAGE, BENCHMARKS) for path in sorted(folder.rglob('*.py'))
            if path != PACKAGE / '__init__.py']


@cache
def imported_modules(tree: ast.Module) -> list[tuple[int, str]]:
    """
    Return line and dotted name of each import, wherever it is in the module.

    ``from a import b`` gives ``a.b``; a relative import keeps its leading dots.
    """
    found: list[tuple[int, str]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found += [(node.lineno, '.' * node.level + f'{node.module or ""}.{alias.name}')
                      for alias in node.names]
    return found


def parse(path: Path) -> ast.Module:
    """Return the syntax tree of a source file."""
    return ast.parse(path.read_text(encoding='utf-8'))


def read_imports() -> Edges:
    """Return room -> other rooms that it imports."""
    found: Edges = {}
    for path in source_files():
        room = room_of(path.relative_to(ROOT).as_posix())
        others = {room_of_module(module) for _, module in imported_modules(parse(path))}
        found.setdefault(room, set()).update(other for other in others if other and other != room)
    return found
