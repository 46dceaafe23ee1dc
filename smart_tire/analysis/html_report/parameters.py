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

"""The parameters of an analysis and where they come from."""

from __future__ import annotations

from pathlib import Path

from smart_tire.analysis.bag_params import BAG, BagParams, FILES
from smart_tire.analysis.html_report.tables import Table
from smart_tire.parameters import known_names, load_files, NODE_PARAMS, Spec, specs
from smart_tire.parameters.files import value_text

NODES = 'slip_estimator', 'friction_estimator'
HEAD = ('parameter', 'value', 'unit', 'from', 'node', 'meaning')
DEFAULT = 'default'
FROM_BAG = 'the bag'
BOTH = 'both'
CAPTIONS = {FILES: 'Parameters set in files. Of several files the last one counts.',
            BAG: 'Parameters in the bag that differ from the default values.'}


def parameter_tables(used: BagParams) -> tuple[Table, Table]:
    """Return the table of the parameters that were set, and that of the default values."""
    rows: dict[tuple[str, str, str], tuple[Spec, list[str]]] = {}
    for node, values in used.params.by_node().items():
        described = specs(NODE_PARAMS[node], values)
        origins = _origins(used, node, described)
        for name, spec in described.items():
            value = value_text(values[name])
            source = origins.get(name, FROM_BAG if used.source == BAG
                                 and value != value_text(spec.default) else DEFAULT)
            rows.setdefault((name, value, source), (spec, []))[1].append(node)
    cells = [[name, value, spec.unit, source, BOTH if len(nodes) == len(NODES) else nodes[0],
              spec.meaning] for (name, value, source), (spec, nodes) in sorted(
                  rows.items(), key=lambda item: item[0])]
    given = [row for row in cells if row[3] != DEFAULT]
    default = [row for row in cells if row[3] == DEFAULT]
    return (Table(CAPTIONS.get(used.source, 'No parameters were given.'), HEAD, given, len(HEAD)),
            Table('Parameters with their default values.', HEAD, default, len(HEAD)))


def _origins(used: BagParams, node: str, own: dict[str, Spec]) -> dict[str, str]:
    """Return the parameters of ``node`` that are set in files: name -> file."""
    if used.source != FILES:
        return {}
    known = known_names(NODE_PARAMS.values())
    return {name: file for file in used.origins
            for name in load_files([Path(file)], node, known, own)}
