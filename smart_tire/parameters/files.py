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
ROS command lines and parameter files, without ROS.

A parameter file is YAML with ``<node>: {ros__parameters: {...}}``.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
import sys
from typing import Any

from smart_tire.errors import ParameterError, printable
from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import (
    is_known, known_name, Spec, specs, unknown_name_error)
from smart_tire.paths import explained, read_file
from smart_tire.yaml_text import BASE, MAX_SIZE, parse_yaml
import yaml

PARAMETERS = 'ros__parameters'  # key of the parameters of a block
ROS_ARGS, END_OF_ROS_ARGS = '--ros-args', '--'  # on a command line
ALL_NODES = '/**'
PARAMS_FILE = '--params-file'  # option of a ROS command line
SIMILARITY = 0.8  # of the name of a block and of a node, difflib: one or two wrong letters in ten
ROS_NAMES = ('use_sim_time', 'start_type_description_service')  # declared by rclpy on every node


Block = tuple[str, dict[str, Any]]  # name of the node or pattern, flat parameters


def load_files(paths: Iterable[str | Path], node: str, known: Iterable[str],
               own: Mapping[str, Spec], nodes: Collection[str] = ()) -> dict[str, Any]:
    """
    Return the flat parameters that ``paths`` set for ``node``; later files and blocks win.

    ``known`` are the parameter names of all nodes of this package; any other name is an error, but
    with ``nodes``, those of this package, not in blocks for others, such as of Nav2.
    ``own`` are those of this node; others are ignored. Both are results of ``known_names``.
    Raises ParameterError, naming the file, if one is missing, not a parameter file, or has a value
    that is not of the described kind and range.
    """
    known, values = set(known), dict[str, Any]()
    for path in paths:
        for block, parameters in read_blocks(Path(path)):
            if not nodes or any(_matches(block, one) for one in nodes):
                check_names(parameters, known, f'{path}: ')
            found = values_for(node, [(block, parameters)], own)
            _check_values(found, own, f'{path}: ')
            values.update(found)
    return values


def _check_values(values: Mapping[str, Any], own: Mapping[str, Spec], where: str) -> None:
    for name, value in values.items():
        pattern = known_name(name, own)
        assert pattern is not None
        try:
            replace(own[pattern], name=name).check(value)
        except ParameterError as error:
            raise ParameterError(f'{where}{error}') from error


def from_arguments(words: Sequence[str], node: str) -> dict[str, Any]:
    """
    Return the flat parameters that a ROS command line sets for ``node`` (fully qualified name).

    Later arguments win, files and ``-p`` alike. This differs from rcl, where a block for a node
    in an earlier file takes precedence over ``/**`` in a later file and over ``-p``.
    """
    values: dict[str, Any] = {}
    for option, given in _options(words):
        if option == PARAMS_FILE:
            for block, parameters in read_blocks(Path(given)):
                if _matches(block, node):
                    values.update(parameters)
        else:
            name, _, text = given.partition(':=')
            owner, _, name = name.rpartition(':')
            if name and owner in ('', node.rsplit('/', 1)[-1]):
                values[name] = _load(text)
    return values


def foreign_arguments(words: Sequence[str]) -> list[str]:
    """Return the arguments that are not for ROS; rclpy would ignore most of them silently."""
    in_ros_args, foreign = False, []
    for word in words[1:]:
        if word in (ROS_ARGS, END_OF_ROS_ARGS):
            in_ros_args = word == ROS_ARGS
        elif not in_ros_args:
            foreign.append(word)  # also ``from:=to``, which rcl takes for a deprecated remapping
    return foreign


def ros_arguments(words: Sequence[str]) -> list[str]:
    """
    Return the ROS arguments of a command line, for ``rclpy.init``.

    With the whole command line, rcl would take any ``from:=to``, such as that of the option
    ``--remap`` of this package, for a deprecated remapping.
    """
    return list(words[words.index(ROS_ARGS):]) if ROS_ARGS in words else []


def _options(words: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the options of a ROS command line for parameters, and their values."""
    inside, flags = False, iter(words)
    for word in flags:
        if word in (ROS_ARGS, END_OF_ROS_ARGS):
            inside = word == ROS_ARGS
        elif inside and word in (PARAMS_FILE, '-p', '--param'):
            yield word, next(flags, '')


def files_of(words: Sequence[str]) -> list[Path]:
    """Return the parameter files on a ROS command line."""
    return [Path(given) for option, given in _options(words) if option == PARAMS_FILE]


def misspelled(path: str | Path, nodes: Collection[str]) -> Iterator[tuple[str, str]]:
    """
    Yield one of ``nodes`` and a warning for each block in ``path`` that almost has its name.

    ROS ignores a block for a node that does not exist; that of another package is none of ours.
    Raises ParameterError if ``path`` is not a parameter file.
    """
    for block, _ in read_blocks(Path(path)):
        name = block.rsplit('/', 1)[-1]
        if name not in nodes:
            import difflib  # nodes start without
            for near in difflib.get_close_matches(name, nodes, n=1, cutoff=SIMILARITY):
                yield near, printable(f'{path}: {block} is ignored, did you mean {near}?')


def has_block_for(path: str | Path, nodes: Iterable[str]) -> bool:
    """
    Return whether the parameter file ``path`` has a block that applies to one of ``nodes``.

    Raises ParameterError if it is not a parameter file.
    """
    blocks = read_blocks(Path(path))
    return any(_matches(block, node) for block, _ in blocks for node in nodes)


def _load(text: str) -> Any:
    """Return the value of ``text`` as YAML, ``text`` itself if it is not valid YAML."""
    try:
        return parse_yaml(text)
    except ValueError:
        return text


def check_names(names: Iterable[str], known: Iterable[str], where: str = '') -> None:
    """Raise ParameterError for the first of ``names`` that is neither ``known`` nor of rclpy."""
    known = set(known)
    for name in names:
        if not is_known(name, known) and name not in ROS_NAMES:
            raise unknown_name_error(name, known, where)


def read_blocks(path: Path) -> list[Block]:
    """Return the blocks in a parameter file, as ``blocks_in``; raise ParameterError."""
    with explained(path, 'read'):
        return blocks_in(read_file(path, MAX_SIZE), str(path))


def blocks_in(text: bytes | str, where: str) -> list[Block]:
    """
    Return the blocks in the text of a parameter file: the node of each and its flat parameters.

    Raises ParameterError, with ``where`` the text is from, if it is not a parameter file.
    """
    try:
        document = parse_yaml(text)
    except ValueError as error:
        raise ParameterError(f'{where}: not a YAML file: {error}') from error
    if not isinstance(document, Mapping):
        raise ParameterError(f'{where}: expected "<node>: ros__parameters: ..." at the top')
    return [block for key, value in document.items() for block in _walk(where, str(key), value)]


def lines_in(path: Path) -> dict[str, int]:
    """Return the line of each flat parameter in a valid parameter file, the last of several."""
    lines: dict[str, int] = {}

    def walk(node: Any, names: tuple[str, ...] | None) -> None:
        for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
            inner = (() if key.value == PARAMETERS else None) if names is None else (
                *names, key.value)
            if inner:
                lines['.'.join(inner)] = key.start_mark.line + 1
            walk(value, inner)
    walk(yaml.compose(read_file(path, MAX_SIZE), BASE), None)
    return lines


def values_for(node: str, blocks: Iterable[Block], own: Iterable[str]) -> dict[str, Any]:
    """Return the flat parameters that ``blocks`` set for ``node``, of those in ``own``."""
    own = set(own)
    return {name: value for block, parameters in blocks if _matches(block, node)
            for name, value in parameters.items() if is_known(name, own)}


def _walk(path: str, name: str, value: Any) -> list[Block]:
    if not isinstance(value, Mapping):
        raise ParameterError(f'{path}: {name} has no ros__parameters')
    if PARAMETERS in value:
        inner = value[PARAMETERS] or {}
        if not isinstance(inner, Mapping):
            raise ParameterError(f'{path}: ros__parameters of {name} is not a mapping')
        return [(name, flatten(inner, where=f'{path}: '))]
    return [block for key, deeper in value.items()
            for block in _walk(path, f'{name.rstrip("/")}/{key}', deeper)]


def flatten(tree: Mapping[str, Any], prefix: str = '', where: str = '') -> dict[str, Any]:
    """
    Return a nested mapping as a flat one, keys joined by dots.

    Raises ParameterError, with ``where``, if one is there twice, as ``a: {b: 1}`` and ``a.b: 2``.
    """
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        name = f'{prefix}{key}'
        inner = (flatten(value, f'{name}.', where) if isinstance(value, Mapping)
                 else {name: value})
        for twice in inner.keys() & flat.keys():
            raise ParameterError(f'{where}{twice} is there twice')
        flat |= inner
    return flat


def _matches(block: str, node: str) -> bool:
    """Return whether a block applies to ``node``; a name without ``/`` ignores namespaces."""
    tokens, names = block.strip('/').split('/'), node.strip('/').split('/')
    if not node.startswith('/'):
        tokens = tokens[-1:]
    matched = {0}  # numbers of names that the tokens so far may stand for
    for token in tokens:
        matched = (set(range(min(matched), len(names) + 1)) if token == '**' and matched else
                   {number + 1 for number in matched if number < len(names)
                    and token in ('*', names[number])})
    return len(names) in matched


def value_text(value: object) -> str:
    """Return a parameter value as YAML on one line."""
    plain = list(value) if isinstance(value, tuple) else value
    text = yaml.safe_dump(plain, default_flow_style=True, width=sys.maxsize)
    return text.removesuffix('...\n').strip()


def snapshot_text(nodes: Mapping[str, Mapping[str, Any]]) -> str:
    """
    Return the text of a parameter file with the flat parameters of ``nodes``, by node name.

    A bag holds it. Parameters of the robot that are equal in all nodes are written once.
    """
    common = _common(nodes)
    blocks = {ALL_NODES: common} if common else {}
    for node, values in sorted(nodes.items()):
        blocks[f'{ALL_NODES}/{node}'] = {
            name: value for name, value in values.items() if name not in common}
    return ''.join(
        f'{block}:\n  ros__parameters:\n'
        + ''.join(f'    {name}: {value_text(value)}\n' for name, value in values.items())
        for block, values in blocks.items() if values)


def _common(nodes: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in specs(RobotParams):
        values = [values[name] for values in nodes.values() if name in values]
        if values and all(value == values[0] for value in values):
            found[name] = values[0]
    return found
