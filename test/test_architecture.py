"""The layout: imports go down only, one foreign library has one folder, noise has one place."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / 'smart_tire'
FILES = sorted(PACKAGE.rglob('*.py'))
LEVEL = {
    'arrays': 0, 'errors': 0, 'numerics': 0, 'parameters': 0, 'rotation': 0, 'samples': 0,
    'uncertain': 0,
    'launching': 1, 'protocol': 1, 'messages': 1, 'models': 1, 'control': 1,
    'drivers': 2, 'estimation': 2, 'bags': 2, 'vision': 2,
    'calibration': 3, 'simulation': 3,
    'analysis': 4,
    'nodes': 5, 'reproduction': 5,
    'cli': 6,
}
BESIDE = {  # the imports that stay on their level
    ('numerics', 'arrays'), ('numerics', 'errors'), ('parameters', 'errors'),
    ('parameters', 'samples'),
}
ONLY_IN = {
    'serial': ('drivers',), 'filterpy': ('estimation',),
    'rosbags': ('bags',), 'mcap': ('bags',), 'lz4': ('bags',), 'zstandard': ('bags',),
    'cv2': ('vision',), 'matplotlib': ('analysis', 'reproduction'), 'rich': ('cli',),
    'rclpy': ('nodes',),
}
ROS_SUFFIXES = ('_msgs', '_srvs', '_interfaces')
LAUNCH = {'launch', 'launch_ros', 'ament_index_python'}
TIMELESS = {'errors', 'samples', 'rotation', 'numerics', 'parameters', 'protocol', 'messages',
            'models', 'control', 'estimation'}
BROAD = {'Exception', 'BaseException'}

every_file = pytest.mark.parametrize(
    'path', FILES, ids=[str(path.relative_to(PACKAGE)) for path in FILES])


def part_of(path: Path) -> str:
    """Return the part of the package that ``path`` is in: a folder or a top-level module."""
    return path.relative_to(PACKAGE).parts[0].removesuffix('.py')


@cache
def imported(path: Path) -> frozenset[str]:
    """Return the full names that ``path`` imports, wherever in the file."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: a relative import hides where it goes'
            names.update(f'{node.module}.{alias.name}' for alias in node.names)
    return frozenset(names)


def imported_parts(path: Path) -> set[str]:
    """Return the other parts of the package that ``path`` imports."""
    names = (name.split('.') for name in imported(path))
    return {name[1] for name in names if name[0] == 'smart_tire'} - {part_of(path)}


def imported_roots(path: Path) -> set[str]:
    """Return the top-level modules that ``path`` imports."""
    return {name.split('.')[0] for name in imported(path)}


def test_every_part_of_the_package_has_a_level():
    assert {part_of(path) for path in FILES} - {'__init__'} <= LEVEL.keys()


@every_file
def test_imports_only_go_down(path):
    here = part_of(path)
    for other in imported_parts(path):
        assert LEVEL[other] < LEVEL[here] or (here, other) in BESIDE, f'{here} imports {other}'


@every_file
def test_nodes_and_analysis_never_import_each_other(path):
    assert not {part_of(path), *imported_parts(path)} >= {'nodes', 'analysis'} \
        or part_of(path) == 'cli'


@every_file
def test_each_library_is_imported_in_its_own_folder_only(path):
    for library in imported_roots(path) & ONLY_IN.keys():
        assert part_of(path) in ONLY_IN[library], f'{part_of(path)} imports {library}'


@every_file
def test_ros_messages_are_imported_by_nodes_only(path):
    ros = {root for root in imported_roots(path) if root.endswith(ROS_SUFFIXES)}
    assert not ros or part_of(path) == 'nodes', ros


@every_file
def test_the_launch_system_is_not_imported(path):
    assert not imported_roots(path) & LAUNCH


@every_file
def test_time_comes_in_through_the_arguments(path):
    assert part_of(path) not in TIMELESS or not imported_roots(path) & {'time', 'datetime'}


@every_file
def test_only_the_command_line_prints(path):
    tree = ast.parse(path.read_text(encoding='utf-8'))
    calls = [node.lineno for node in ast.walk(tree) if isinstance(node, ast.Call)
             and isinstance(node.func, ast.Name) and node.func.id == 'print']
    assert not calls or part_of(path) == 'cli', calls


@every_file
def test_no_except_is_broad(path):
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.ExceptHandler):
            assert node.type is not None, f'line {node.lineno}: bare except'
            names = {name.id for name in ast.walk(node.type) if isinstance(name, ast.Name)}
            assert not names & BROAD, f'line {node.lineno}: {names & BROAD}'
