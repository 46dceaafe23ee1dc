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

"""Parameters of several nodes as the text of one ROS parameter file, as stored in a bag."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from smart_tire.parameters import known_names, NODE_PARAMS, RobotParams, specs
from smart_tire.parameters.files import Block
from smart_tire.parameters.spec import is_known
from smart_tire.parameters.yaml_writer import value_text

ALL_NODES = '/**'


def snapshot_text(nodes: Mapping[str, Mapping[str, Any]]) -> str:
    """
    Return the text of a parameter file with the flat parameters of ``nodes``, by node name.

    Parameters of the robot that are equal in all nodes are written once, for all nodes.
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


def nodes_in(blocks: list[Block]) -> list[str]:
    """Return the nodes whose parameters are in ``blocks``."""
    names = (block.rsplit('/', 1)[-1] for block, _ in blocks)
    return [name for name in names if name in NODE_PARAMS]


def unknown_names(blocks: list[Block]) -> list[str]:
    """Return the parameters in ``blocks`` that no node of this version has."""
    known = known_names(NODE_PARAMS.values())
    return sorted({name for _, parameters in blocks for name in parameters
                   if not is_known(name, known)})
