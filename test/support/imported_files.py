# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Which files of a checkout a Python file imports, itself or through others."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path


@cache
def reached(root: Path, file: str) -> frozenset[str]:
    """Return ``file`` and all files that it imports, relative to ``root``."""
    found, todo = {file}, [file]
    while todo:
        new = set(imported(root, todo.pop())) - found
        found |= new
        todo += new
    return frozenset(found)


@cache
def imported(root: Path, file: str) -> tuple[str, ...]:
    """Return the files imported by ``file``; tests import from ``root`` and ``root/test``."""
    places = [(root / folder / name.replace('.', '/')).with_suffix('.py')
              for name in _names(ast.parse((root / file).read_text(encoding='utf-8')))
              for folder in ('', 'test')]
    return tuple(path.relative_to(root).as_posix() for path in places if path.is_file())


def _names(tree: ast.Module) -> Iterator[str]:
    """Yield the dotted names that may be modules."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f'{node.module}.{alias.name}' for alias in node.names)
            yield f'{node.module}.__init__'
