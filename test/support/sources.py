# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Source files as the rules of style and architecture see them: name, text, syntax tree."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Source:
    """A file of the repository, or a text that a test treats as one."""

    name: str  # path in the repository, with forward slashes
    text: str

    @cached_property
    def tree(self) -> ast.Module:
        """Return the syntax tree of a Python file."""
        return ast.parse(self.text)

    def at(self, line: int, what: str) -> str:
        """Return an offense as ``file:line: what``."""
        return f'{self.name}:{line}: {what}'


Rule = Callable[[Source], Iterator[str]]  # yields the offenses in one file


def read_sources(*names: str, suffixes: Iterable[str] = ('.py',)) -> list[Source]:
    """Return the files of ``names``, and all files with ``suffixes`` in folders of ``names``."""
    paths = [path for name in names for path in
             (sorted((ROOT / name).rglob('*')) if (ROOT / name).is_dir() else [ROOT / name])
             if not (ROOT / name).is_dir() or path.suffix in suffixes]
    return [Source(path.relative_to(ROOT).as_posix(), path.read_text(encoding='utf-8'))
            for path in paths]


def assert_kept(rule: Rule, sources: Iterable[Source]) -> None:
    """Raise AssertionError with all that ``rule`` finds in ``sources``."""
    __tracebackhide__ = True
    found = [offense for source in sources for offense in rule(source)]
    if found:
        raise AssertionError(f'{len(found)} offenses\n' + '\n'.join(found))
