# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Test modules in real time: the marker that they have, and what makes them need one."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from functools import cache
from pathlib import PurePosixPath
import re

from support.sources import Source

GROUPS = ('processes', 'safety')  # markers, declared in pyproject.toml
MODULE_MARK = re.compile(rf'^pytestmark = .*\bpytest\.mark\.({"|".join(GROUPS)})\b', re.MULTILINE)


def group_of(text: str) -> str | None:
    """Return the group of a test module from its source; None for a module without group."""
    match = MODULE_MARK.search(text)
    return match[1] if match else None


# With these a test starts programs or nodes, or waits for them.
REAL = {'multiprocessing', 'rclpy', 'smart_tire.cli._stack.Stack', 'smart_tire.nodes.runner',
        'subprocess'}
WAITING = 'test/support/waiting.py'  # for a thread, which takes its time from an argument
CLOCK = re.compile(r'(monotonic|perf_counter|process_time|time)(_ns)?|sleep')  # in ``time``


def is_in_real_time(source: Source, files: Mapping[str, Source]) -> bool:
    """
    Return whether a file reads a clock, sleeps, starts processes or nodes, or uses what does.

    That is a module in ``test``, or a fixture in the ``conftest.py`` of a folder that it takes as
    an argument. ``files`` has all files by their names.
    """
    imported, arguments, has_clock = _facts(source)
    if has_clock or REAL & {*imported, *(name.partition('.')[0] for name in imported)}:
        return True
    used = {f'test/{name.replace(".", "/")}.py' for name in imported}
    for folder in PurePosixPath(source.name).parents:
        conftest = files.get(f'{folder}/conftest.py')
        if conftest and str(folder) != 'test' and arguments & {
                node.name for node in conftest.tree.body if isinstance(node, ast.FunctionDef)}:
            used.add(conftest.name)
    return any(is_in_real_time(files[name], files) for name in used - {source.name, WAITING}
               if name in files)


@cache
def _facts(source: Source) -> tuple[set[str], set[str], bool]:
    """Return modules and names that are imported, arguments, and whether ``time`` is asked."""
    imported, arguments, has_clock = set(), set(), False
    for node in ast.walk(source.tree):
        match node:
            case ast.Import(names=names):
                imported |= {alias.name for alias in names}
            case ast.ImportFrom(module=str(module), names=names):
                imported |= {module, *(f'{module}.{alias.name}' for alias in names)}
            case ast.arg(arg=name):
                arguments.add(name)
            case ast.Attribute(value=ast.Name(id='time'), attr=name):
                has_clock |= CLOCK.fullmatch(name) is not None
    return imported, arguments, has_clock
