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

from collections.abc import Sequence
from pathlib import Path

from smart_tire.analysis.html_report.tables import Table
from smart_tire.parameters import known_names, load_files, NODE_PARAMS, Spec, specs
from smart_tire.parameters.yaml_writer import value_text

NODES = 'slip_estimator', 'friction_estimator'
HEAD = ('parameter', 'value', 'unit', 'from', 'node', 'meaning')
DEFAULT = 'default'
BOTH = 'both'


def parameter_tables(files: Sequence[Path]) -> tuple[Table, Table]:
    """
    Return the table of the parameters set in ``files``, and that of the default values.

    Raises ParameterError if a file is missing or not a parameter file.
    """
    rows: dict[tuple[str, str, str], tuple[Spec, list[str]]] = {}
    for node in NODES:
        sources = _sources(files, node)
        for name, spec in specs(NODE_PARAMS[node]).items():
            value, source = sources.get(name, (spec.default, DEFAULT))
            rows.setdefault((name, value_text(value), source), (spec, []))[1].append(node)
    cells = [[name, value, spec.unit, source, BOTH if len(nodes) == len(NODES) else nodes[0],
              spec.meaning] for (name, value, source), (spec, nodes) in sorted(
                  rows.items(), key=lambda item: item[0])]
    given = [row for row in cells if row[3] != DEFAULT]
    default = [row for row in cells if row[3] == DEFAULT]
    return (Table('Parameters set in files. Of several files the last one counts.', HEAD, given,
                  len(HEAD)),
            Table('Parameters with their default values.', HEAD, default, len(HEAD)))


def _sources(files: Sequence[Path], node: str) -> dict[str, tuple[object, str]]:
    """Return the parameters that ``files`` set for ``node``: name -> value, file."""
    known, own = known_names(NODE_PARAMS.values()), specs(NODE_PARAMS[node])
    return {name: (value, str(file)) for file in files
            for name, value in load_files([file], node, known, own).items()}
