"""What the ament linters ask for and ruff does not check."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
import sys

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ('smart_tire', 'benchmarks', 'test', 'launch')
FILES = [ROOT / 'setup.py', *(path for folder in FOLDERS
                              for path in sorted((ROOT / folder).rglob('*.py')))]

OWN = {'smart_tire', 'benchmarks'}
SUPPORT = 'support.'  # what several tests share: third party to some, own to others

Import = ast.Import | ast.ImportFrom
every_file = pytest.mark.parametrize(
    'path', FILES, ids=[str(path.relative_to(ROOT)) for path in FILES])


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


def module(node: Import) -> str:
    """Return the name of the module that ``node`` imports or imports from."""
    return node.names[0].name if isinstance(node, ast.Import) else node.module or ''


def group(name: str) -> int:
    """Return the group of a module: future, standard library, third party, own."""
    root = name.split('.')[0]
    return 0 if root == '__future__' else 1 if root in sys.stdlib_module_names else \
        3 if root in OWN else 2


@every_file
def test_imports_are_in_the_order_of_the_google_style(path):
    for block in blocks(ast.parse(path.read_text(encoding='utf-8'))):
        order = [(group(module(node)), module(node).lower()) for node in block
                 if not module(node).startswith(SUPPORT)]
        assert order == sorted(order)
        for node in block:
            names = [alias.name.lower() for alias in node.names]
            assert names == sorted(names), f'line {node.lineno}'


@every_file
def test_a_module_says_what_it_is_for(path):
    assert ast.get_docstring(ast.parse(path.read_text(encoding='utf-8')))
