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
The rules of style that ruff and mypy do not check.

Each rule yields its offenses, one ``file:line: what`` each; its test lists those of all files. The
last test shows for each rule a source that it refuses.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
import re
import sys

import pytest
from support.groups import group_of, GROUPS, is_in_real_time
from support.sources import assert_kept, read_sources, Rule, Source

PRODUCT = read_sources('smart_tire', 'benchmarks')
TESTS = read_sources('test')
PYTHON = [*PRODUCT, *TESTS, *read_sources('setup.py', 'launch', 'docs', 'examples')]
SUFFIXES = ('.py', '.yaml', '.md', '.txt', '.toml')
THIS = 'test/test_style.py'
PROSE = [source for source in read_sources(
    'README.md', 'CONTRIBUTING.md', 'Makefile', 'pyproject.toml', 'smart_tire', 'benchmarks',
    'config', 'docs', 'examples', 'launch', 'test', suffixes=SUFFIXES) if source.name != THIS]

LICENSE_HEADER = '\n'.join(TESTS[0].text.splitlines()[1:9])
COPYRIGHT = re.compile(r'(#!.*\n)?# Copyright \d{4} The smart_tire developers\n')

FILES = {source.name: source for source in TESTS}

# Names of constants that say neither which quantity nor which role.
SUPERLATIVES = {
    'ALIKE', 'BIGGEST', 'DOUBT', 'FEW', 'FEWEST', 'GREATEST', 'HIGHEST', 'LARGEST', 'LEAST',
    'LONGEST', 'LOST', 'LOWEST', 'MARGIN', 'MEMORY', 'MOST', 'OUTLIER', 'SETTLED', 'SHORTEST',
    'SIDEWAYS', 'SMALLEST', 'STEP', 'STRETCH', 'TURNING', 'UNSEEN'}

# Words of an older dialect of this repository; the standard term of the field replaces them.
DIALECT = (
    'told', 'tell', 'tells', 'telling', 'anew', 'likewise', 'misfit', 'misfits',
    'what is usual', 'what was usual', 'inertial unit', 'inertial units', 'can not',
    'nobody knows', 'feign', 'feigns', 'one sigma', 'goes by', 'go by', 'as far as',
    'sighting', 'sightings', 'sighter', 'wander', 'wanders', 'errs', 'beside')
DIALECT_WORD = re.compile(  # an underscore ends a word; a line may end within a phrase
    r'(?<![A-Za-z])(' + '|'.join(words.replace(' ', r'\s+(?:#\s*)?') for words in DIALECT)
    + r')(?![A-Za-z])', re.IGNORECASE)

Import = ast.Import | ast.ImportFrom


def blocks(tree: ast.Module) -> Iterator[list[Import]]:
    """Yield the runs of import statements at the top level."""
    block: list[Import] = []
    for node in tree.body:
        if isinstance(node, Import):
            block.append(node)
        elif block:
            yield block
            block = []
    if block:
        yield block


def imported(node: Import) -> str:
    """Return the name of the module that ``node`` imports or imports from."""
    return node.names[0].name if isinstance(node, ast.Import) else node.module or ''


def group(name: str) -> int:
    """Return the group of a module: future, standard library, all others (also own ones)."""
    root = name.split('.')[0]
    return 0 if root == '__future__' else 1 if root in sys.stdlib_module_names else 2


def unsorted_imports(source: Source) -> Iterator[str]:
    """Yield imports that are not in the order of ament_flake8: Google style, no own group."""
    for block in blocks(source.tree):
        last = (0, '')
        for node in block:
            names = [(alias.name.lower(), alias.name) for alias in node.names]
            if names != sorted(names):
                yield source.at(node.lineno, 'names are not sorted')
            now = (group(imported(node)), imported(node).lower())
            if now < last:
                yield source.at(node.lineno, f'import of {imported(node)} comes too late')
            last = now


def missing_docstring(source: Source) -> Iterator[str]:
    """Yield a module that does not say what it is for."""
    if not ast.get_docstring(source.tree):
        yield source.at(1, 'no docstring')


def missing_license(source: Source) -> Iterator[str]:
    """Yield a file without the header that ament_copyright looks for."""
    found = COPYRIGHT.match(source.text)
    if found is None or not source.text.startswith(LICENSE_HEADER, found.end()):
        yield source.at(1, 'no copyright and license header')


def numeric_constants(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield line and name of the constants of a module whose value is made of numbers."""
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else \
            [node.target] if isinstance(node, ast.AnnAssign) and node.value else []
        for target in targets:
            for one in target.elts if isinstance(target, ast.Tuple) else [target]:
                if isinstance(one, ast.Name) and one.id.isupper() and _is_numeric(node.value):
                    yield node.lineno, one.id


def _is_numeric(value: ast.expr) -> bool:
    """Return whether an expression has numbers, and no strings, sets or mappings."""
    nodes = list(ast.walk(value))
    return any(isinstance(node, ast.Constant) and type(node.value) in (int, float)
               for node in nodes) and not any(
        isinstance(node, ast.Dict | ast.Set) or isinstance(node, ast.Constant)
        and isinstance(node.value, str) for node in nodes)


def wrongly_grouped(source: Source) -> Iterator[str]:
    """Yield modules in real time without a marker, others with one, and marked single tests."""
    group = group_of(source.text)
    if set(re.findall(rf'\bmark\.({"|".join(GROUPS)})\b', source.text)) - {group}:
        yield source.at(1, 'mark the module, with one group')
    elif is_in_real_time(source, FILES) != bool(group):
        yield source.at(1, f'{group}, but neither clock nor process' if group else
                        f'no pytestmark of {" or ".join(GROUPS)}')


def bare_superlatives(source: Source) -> Iterator[str]:
    """Yield numeric constants whose name is a superlative alone."""
    for line, name in numeric_constants(source.tree):
        if name.strip('_') in SUPERLATIVES:
            yield source.at(line, f'{name}: name quantity and role')


def dialect(source: Source) -> Iterator[str]:
    """Yield words that are not the field's."""
    for match in DIALECT_WORD.finditer(source.text):
        line = source.text.count('\n', 0, match.start()) + 1
        yield source.at(line, ' '.join(match[1].replace('#', ' ').split()).lower())


def test_imports_are_in_the_order_of_ament_flake8():
    assert_kept(unsorted_imports, PYTHON)


def test_every_module_has_a_docstring():
    assert_kept(missing_docstring, PYTHON)


def test_every_file_has_the_license_header():
    assert_kept(missing_license, PYTHON)


def test_tests_in_real_time_are_in_a_group_and_others_are_not():
    assert_kept(wrongly_grouped, [source for name, source in FILES.items()
                                  if '/test_' in name and name != THIS])


def test_no_constant_is_named_by_a_superlative_alone():
    assert_kept(bare_superlatives, PRODUCT)


def test_words_are_those_of_the_field():
    assert_kept(dialect, PROSE)


@pytest.mark.parametrize(('rule', 'text', 'offense'), [
    (unsorted_imports, '"""A."""\nimport sys\nimport os', '3: import of os comes too late'),
    (unsorted_imports, 'import yaml\n\nimport smart_tire',
     '3: import of smart_tire comes too late'),
    (unsorted_imports, 'from a import b, B', '1: names are not sorted'),
    (missing_docstring, 'import os', '1: no docstring'),
    (missing_license, '"""A."""', '1: no copyright and license header'),
    (missing_license, '# Copyright 2026 The smart_tire developers\n"""A."""',
     '1: no copyright and license header'),
    (bare_superlatives, '\n_MEMORY: float = 2.0 * math.pi', '2: _MEMORY: name quantity and role'),
    (bare_superlatives, 'MIN_SPEED, STEP = 1.0, 2.0', '1: STEP: name quantity and role'),
    (dialect, 'as nobody\n# knows', '1: nobody knows'),
    (dialect, '\nslip_told = 1', '2: told'),
])
def test_a_rule_finds_its_offense(rule: Rule, text: str, offense: str):
    assert list(rule(Source('x.py', text))) == [f'x.py:{offense}']


@pytest.mark.parametrize(('text', 'offense'), [
    ('import subprocess', 'no pytestmark of processes or safety'),
    ('from smart_tire.nodes.runner import NodeRunner', 'no pytestmark of processes or safety'),
    ('def test_a(): time.sleep(1.0)', 'no pytestmark of processes or safety'),
    ('from support.motor_rig import MotorRig', 'no pytestmark of processes or safety'),
    ('def test_a(graph): pass', 'no pytestmark of processes or safety'),
    ('@pytest.mark.safety\ndef test_a(): pass', 'mark the module, with one group'),
    ('pytestmark = pytest.mark.safety', 'safety, but neither clock nor process'),
])
def test_a_wrong_group_is_found(text: str, offense: str):
    name = 'test/nodes/test_x.py'
    assert list(wrongly_grouped(Source(name, text))) == [f'{name}:1: {offense}']


@pytest.mark.parametrize(('rule', 'text'), [
    (unsorted_imports, 'import os\nimport sys\n\nimport numpy\n\nimport smart_tire\nimport yaml'),
    (missing_docstring, '"""What it is for."""'),
    (missing_license, f'#!/usr/bin/env python3\n# Copyright 2027 The smart_tire developers\n'
     f'{LICENSE_HEADER}\n'),
    (wrongly_grouped, 'import rclpy\npytestmark = [pytest.mark.slow, pytest.mark.safety]'),
    (wrongly_grouped, "def test_a(monkeypatch): monkeypatch.setattr(time, 'monotonic', clock)"),
    (bare_superlatives, "MIN_SPEED = 1.0\nMOST = 'a word'\nSTEP = {1: 2.0}"),
    (dialect, 'intellect, besides, untold'),
])
def test_a_rule_accepts_what_is_allowed(rule: Rule, text: str):
    assert list(rule(Source('x.py', text))) == []
