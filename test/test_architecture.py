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
The layout of the package, by the tables of ``docs/architecture.md``.

Each rule yields its offenses, one ``file:line: what`` each; its test lists those of all files. The
last test shows for each rule a source that it refuses.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from fnmatch import fnmatch
import re
import sys

from architecture_tables import DOCUMENT, imported_modules, names, read_exceptions, read_levels, \
    read_rooms, room_of, room_of_module, table
import pytest
from smart_tire.cli.main import VERBS
from support.sources import assert_kept, read_sources, Rule, Source

TEXT = DOCUMENT.read_text(encoding='utf-8')
LEVELS = read_levels(TEXT)
ALLOWED, FORBIDDEN = read_exceptions(TEXT, 'may'), read_exceptions(TEXT, 'never')
PARTS = read_rooms(TEXT, 'estimation')     # part of estimation -> parts that it may import
LIBRARIES = read_rooms(TEXT, 'libraries')  # library, a pattern -> rooms that may import it
ONLY_IN = {cell: names(rooms) for cell, rooms, _ in table(TEXT, 'rules')}
SOURCES = read_sources('smart_tire', 'benchmarks')

EVERY_ROOM = {'every', 'room'}
BROAD = {'Exception', 'BaseException'}
GUARD = 'smart_tire/nodes/base.py'  # no message of another node ends a node: one broad handler
PART = re.compile(r'smart_tire[./]estimation[./](\w+)')
PACKAGE_INIT, PUBLIC_ROOM = 'smart_tire/__init__.py', 'api'
COMMAND = 'main'  # of cli/


def imports(source: Source) -> list[tuple[int, str, str]]:
    """Return line, room and dotted name of each import from another room."""
    here = room_of(source.name)
    found = [(line, room_of_module(module), module)
             for line, module in imported_modules(source.tree)]
    return [(line, room, module) for line, room, module in found if room and room != here]


def imports_of_the_package(source: Source) -> Iterator[str]:
    """Yield what ``smart_tire/__init__.py`` imports from other rooms than that of its names."""
    if source.name == PACKAGE_INIT:
        for line, room, _ in imports(source):
            if room != PUBLIC_ROOM:
                yield source.at(line, f'the package imports {room}')


def rooms_without_level(source: Source) -> Iterator[str]:
    """Yield a file in a room that the table of levels lacks."""
    if source.name != PACKAGE_INIT and room_of(source.name) not in LEVELS:
        yield source.at(1, f'room {room_of(source.name)} has no level')


def upward_imports(source: Source) -> Iterator[str]:
    """Yield imports from the same or a higher level that are not an exception."""
    here = room_of(source.name)
    if source.name == PACKAGE_INIT:
        return
    for line, room, _ in imports(source):
        if LEVELS[room] >= LEVELS[here] and (here, room) not in ALLOWED:
            yield source.at(line, f'{here} imports {room}')


def forbidden_imports(source: Source) -> Iterator[str]:
    """Yield imports that an exception forbids although they go to a lower level."""
    here = room_of(source.name)
    for line, room, _ in imports(source):
        if (here, room) in FORBIDDEN:
            yield source.at(line, f'{here} never imports {room}')


def relative_imports(source: Source) -> Iterator[str]:
    """Yield relative imports."""
    for line, module in imported_modules(source.tree):
        if module.startswith('.'):
            yield source.at(line, 'relative import')


def imports_between_parts(source: Source) -> Iterator[str]:
    """Yield imports between parts of estimation that their table lacks."""
    here = PART.match(source.name)
    if here is None or here[1] == '__init__':
        return
    if here[1] not in PARTS:
        yield source.at(1, f'estimation/{here[1]} is not in the table')
    for line, module in imported_modules(source.tree):
        other = PART.match(module)
        if other and other[1] != here[1] and other[1] not in PARTS.get(here[1], ()):
            yield source.at(line, f'estimation/{here[1]} imports {other[1]}')


def misplaced_libraries(source: Source) -> Iterator[str]:
    """Yield imports of libraries in rooms that the table of libraries does not name."""
    here = room_of(source.name)
    for line, module in imported_modules(source.tree):
        root = module.partition('.')[0]
        if not root or root in sys.stdlib_module_names or root == 'smart_tire' \
                or room_of_module(module):
            continue  # the package itself has the version
        rooms: set[str] = set().union(
            *(rooms for library, rooms in LIBRARIES.items() if fnmatch(root, library)))
        if rooms != EVERY_ROOM and here not in rooms:
            yield source.at(line, f'{here} imports {root}')


def misplaced_clocks(source: Source) -> Iterator[str]:
    """Yield imports of clocks in rooms to which time is an argument."""
    for line, module in imported_modules(source.tree):
        rooms = ONLY_IN.get(f'import {module.partition(".")[0]}')
        if rooms is not None and room_of(source.name) not in rooms:
            yield source.at(line, f'{room_of(source.name)} imports {module}')


def misplaced_prints(source: Source) -> Iterator[str]:
    """Yield calls of print in rooms that do not write to a terminal."""
    for node in ast.walk(source.tree) if 'print' in source.text else ():
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) \
                and node.func.id == 'print' and room_of(source.name) not in ONLY_IN['print']:
            yield source.at(node.lineno, f'{room_of(source.name)} calls print')


def broad_excepts(source: Source) -> Iterator[str]:
    """Yield handlers of all exceptions, except the one of ``GUARD``."""
    allowed = source.name == GUARD
    for node in ast.walk(source.tree) if 'except' in source.text else ():
        if isinstance(node, ast.ExceptHandler):
            caught = {name.id for name in ast.walk(node.type) if isinstance(name, ast.Name)} \
                if node.type else BROAD
            if caught & BROAD and not allowed:
                yield source.at(node.lineno, 'broad except')
            allowed &= not caught & BROAD


def product_named_test(source: Source) -> Iterator[str]:
    """Yield modules of the product that pytest or a reader takes for tests."""
    if source.name.rpartition('/')[2].startswith('test_'):
        yield source.at(1, 'a module of the product is named test_*')


def misplaced_helpers_of_the_command(source: Source) -> Iterator[str]:
    """Yield modules of cli that are neither a verb nor begin with an underscore."""
    folder, _, file = source.name.rpartition('/')
    name = file.removesuffix('.py')
    if folder != 'smart_tire/cli' or name.startswith('_') or name == COMMAND:
        return
    if name not in VERBS:
        yield source.at(1, f'{name} is neither a verb nor begins with an underscore')
    elif 'run' not in {getattr(node, 'name', '') for node in source.tree.body}:
        yield source.at(1, f'the verb {name} lacks run')


def verbs_that_import_verbs(source: Source) -> Iterator[str]:
    """Yield imports of a verb elsewhere: what several verbs need is a helper."""
    for line, module in imported_modules(source.tree):
        for verb in VERBS:
            name = f'smart_tire.cli.{verb}'
            if source.name.startswith('smart_tire/') and f'{module}.'.startswith(f'{name}.'):
                yield source.at(line, f'imports the verb {verb}')


def test_every_room_has_a_level():
    assert_kept(rooms_without_level, SOURCES)


def test_imports_only_go_down():
    assert_kept(upward_imports, SOURCES)


def test_the_package_imports_only_its_public_names():
    assert_kept(imports_of_the_package, SOURCES)


def test_forbidden_imports_do_not_occur():
    assert_kept(forbidden_imports, SOURCES)


def test_no_import_is_relative():
    assert_kept(relative_imports, SOURCES)


def test_parts_of_estimation_import_only_what_their_table_allows():
    assert_kept(imports_between_parts, SOURCES)


def test_every_library_is_imported_in_its_rooms_only():
    assert_kept(misplaced_libraries, SOURCES)


def test_time_is_an_argument():
    assert_kept(misplaced_clocks, SOURCES)


def test_only_the_command_line_prints():
    assert_kept(misplaced_prints, SOURCES)


def test_no_except_is_broad():
    assert_kept(broad_excepts, SOURCES)


def test_no_module_of_the_product_is_named_like_a_test():
    assert_kept(product_named_test, SOURCES)


def test_the_folder_of_the_command_has_one_module_per_verb_and_helpers_with_underscore():
    assert_kept(misplaced_helpers_of_the_command, SOURCES)
    modules = {source.name for source in SOURCES}
    assert [verb for verb in VERBS if f'smart_tire/cli/{verb}.py' not in modules] == []


def test_no_verb_imports_another_one():
    assert_kept(verbs_that_import_verbs, SOURCES)


def test_every_exception_is_needed():
    found = {(room_of(source.name), room) for source in SOURCES for _, room, _ in imports(source)}
    assert sorted(ALLOWED - found) == []
    assert [pair for pair in sorted(FORBIDDEN) if LEVELS[pair[1]] >= LEVELS[pair[0]]] == []


def test_tables_name_rooms_that_have_a_level():
    listed = [*LIBRARIES.values(), *ONLY_IN.values(), *ALLOWED, *FORBIDDEN]
    assert set().union(*listed) - EVERY_ROOM <= LEVELS.keys()
    assert set().union(*PARTS.values()) <= PARTS.keys()


def test_every_row_of_the_tables_is_used():
    rooms = {room_of(source.name) for source in SOURCES if source.name != PACKAGE_INIT}
    roots = {(module.partition('.')[0], room_of(source.name))
             for source in SOURCES for _, module in imported_modules(source.tree)}
    unused = [f'{library} in {room}' for library, where in LIBRARIES.items() for room in where
              if where != EVERY_ROOM and not any(
                  fnmatch(root, library) and room == found for root, found in roots)]
    unused += [f'{what} in {room}' for what, where in ONLY_IN.items() for room in where
               if what != 'print' and (what.removeprefix('import '), room) not in roots]
    parts = {(here[1], other[1]) for source in SOURCES if (here := PART.match(source.name))
             for _, module in imported_modules(source.tree) if (other := PART.match(module))}
    unused += [f'estimation/{part} imports {other}' for part, others in PARTS.items()
               for other in others if (part, other) not in parts]
    unused += [f'level of {room}' for room in LEVELS if room not in rooms]
    assert unused == []


def circles(sources: list[Source]) -> list[str]:
    """Return the modules that import each other, directly or through others."""
    modules = {source.name.removesuffix('.py').removesuffix('/__init__').replace('/', '.'):
               source for source in sources if source.name != PACKAGE_INIT}
    edges: dict[str, set[str]] = {}
    for name, source in modules.items():
        found = {module if module in modules else module.rpartition('.')[0]
                 for _, module in imported_modules(source.tree)}
        edges[name] = (found & modules.keys()) - {name}
    # repeatedly leave out modules that import none of those that are left, or that none imports
    while edges:
        imported = set[str]().union(*edges.values())
        kept = {name: others & edges.keys() for name, others in edges.items()
                if others & edges.keys() and name in imported}
        if kept == edges:
            break
        edges = kept
    return sorted(edges)


def shared_names(sources: list[Source]) -> set[str]:
    """Return the names that several public classes have."""
    names = Counter(node.name for source in sources for node in source.tree.body
                    if isinstance(node, ast.ClassDef) and not node.name.startswith('_'))
    return {name for name, count in names.items() if count > 1}


def test_each_public_class_of_the_product_has_a_name_of_its_own():
    assert not shared_names([source for source in SOURCES
                             if source.name.startswith('smart_tire/')])
    assert shared_names([Source('a.py', 'class A: ...\nclass B: ...\nclass _C: ...'),
                         Source('b.py', 'class B: ...\nclass _C: ...')]) == {'B'}


def test_no_modules_import_each_other():
    assert circles(SOURCES) == []
    texts = {'a': 'import smart_tire.x.b', 'b': 'from smart_tire.x import c', 'd': '',
             'c': 'def f():\n    from smart_tire.x.a import g\n    import smart_tire.x.d'}
    assert circles([Source(f'smart_tire/x/{name}.py', text) for name, text in texts.items()]) == [
        f'smart_tire.x.{name}' for name in 'abc']


@pytest.mark.parametrize(('rule', 'name', 'text', 'expected'), [
    (rooms_without_level, 'smart_tire/attic/x.py', '', '1: room attic has no level'),
    (upward_imports, 'smart_tire/cli/x.py', 'def f():\n    import benchmarks.jobs',
     '2: cli imports benchmarks'),
    (upward_imports, 'smart_tire/bags/x.py', 'from smart_tire import drivers',
     '1: bags imports drivers'),
    (imports_of_the_package, 'smart_tire/__init__.py', 'from smart_tire.bags import Bag',
     '1: the package imports bags'),
    (forbidden_imports, 'smart_tire/nodes/x.py', 'from smart_tire.analysis import metrics',
     '1: nodes never imports analysis'),
    (relative_imports, 'smart_tire/nodes/x.py', 'from . import base', '1: relative import'),
    (imports_between_parts, 'smart_tire/estimation/contact/x.py',
     'from smart_tire.estimation.friction import output',
     '1: estimation/contact imports friction'),
    (imports_between_parts, 'smart_tire/estimation/x.py', '',
     '1: estimation/x is not in the table'),
    (misplaced_libraries, 'smart_tire/models/x.py', 'import matplotlib.pyplot as plt',
     '1: models imports matplotlib'),
    (misplaced_libraries, 'smart_tire/bags/x.py', 'from std_msgs.msg import Bool',
     '1: bags imports std_msgs'),
    (misplaced_clocks, 'smart_tire/estimation/x.py', 'import time', '1: estimation imports time'),
    (misplaced_clocks, 'benchmarks/x.py', 'from datetime import date',
     '1: benchmarks imports datetime.date'),
    (misplaced_prints, 'smart_tire/analysis/x.py', 'print(1)', '1: analysis calls print'),
    (broad_excepts, 'smart_tire/nodes/x.py', 'try:\n    f()\nexcept:\n    pass',
     '3: broad except'),
    (broad_excepts, 'smart_tire/nodes/x.py',
     'try:\n    f()\nexcept (OSError, Exception):\n    pass', '3: broad except'),
    (product_named_test, 'smart_tire/simulation/test_bench.py', '',
     '1: a module of the product is named test_*'),
    (misplaced_helpers_of_the_command, 'smart_tire/cli/output.py', '',
     '1: output is neither a verb nor begins with an underscore'),
    (verbs_that_import_verbs, 'smart_tire/cli/report.py',
     'from smart_tire.cli.analyze import run', '1: imports the verb analyze'),
    (misplaced_helpers_of_the_command, 'smart_tire/cli/replay.py',
     'NAME = 1', '1: the verb replay lacks run'),
])
def test_a_rule_finds_its_offense(rule: Rule, name: str, text: str, expected: str):
    assert list(rule(Source(name, text))) == [f'{name}:{expected}']


@pytest.mark.parametrize(('rule', 'name', 'text'), [
    (upward_imports, 'smart_tire/numerics/x.py', 'from smart_tire.errors import SmartTireError'),
    (upward_imports, 'benchmarks/slip/x.py', 'from smart_tire.cli import main'),
    (imports_between_parts, 'smart_tire/estimation/friction/x.py',
     'from smart_tire.estimation.contact import records'),
    (misplaced_libraries, 'benchmarks/x.py', 'import rich'),
    (misplaced_clocks, 'smart_tire/drivers/x.py', 'import time'),
    (broad_excepts, 'smart_tire/nodes/x.py', 'try:\n    f()\nexcept OSError:\n    pass'),
    (misplaced_helpers_of_the_command, 'smart_tire/cli/_x.py', ''),
])
def test_a_rule_accepts_what_is_allowed(rule: Rule, name: str, text: str):
    assert list(rule(Source(name, text))) == []
