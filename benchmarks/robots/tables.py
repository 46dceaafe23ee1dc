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

"""Tables of the benchmark of drawn robots: reached, required and before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import json
import math
from pathlib import Path
from typing import Any

from benchmarks.robots.draws import DISTRIBUTIONS, ROWS
from benchmarks.robots.scoring import Figures, LATERAL, MU, QUANTITIES, SLIP, SPEED
from benchmarks.tables import new_table, number
from rich.table import Table

FOLDER = Path(__file__).parent
PERCENT, MILLI = 100.0, 1000.0
POOLED = 'all rows'
NOTES = ('Robots drawn at random. <: required, was: the estimators before. mu: relative error of '
         'the fused\ncoefficient from the fifth revolution on each ground, median and 90 % over '
         'crossings; robots 90 %: of the\nmedians of the robots; est.: share of crossings with '
         'an estimate. Slip while steady, speeds in motion: rms.\n2 s.: share within two sigma; '
         'NEES: normalized error squared; both means over robots.')

RowFigures = Mapping[str, Figures]


def before_path(variant: Sequence[str] = ()) -> Path:
    """Return the file of the figures before, of robots with nominal or known ``variant``."""
    return FOLDER / ('_'.join(['before', *sorted(variant)]) + '.json')


def before(variant: Sequence[str] = ()) -> Mapping[str, RowFigures]:
    """Return the figures of each row before; empty without the file."""
    path = before_path(variant)
    if not path.exists():
        return {}
    found: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    return {row: {name: {part: math.nan if value is None else value
                         for part, value in figures.items()}
                  for name, figures in quantities.items()}
            for row, quantities in found['rows'].items()}


def tables(rows: Mapping[str, RowFigures], variant: Sequence[str] = ()) -> Iterator[Table]:
    """Return the tables of mu, of the motion, and of what was drawn."""
    old = {name: row for name, row in before(variant).items() if name in rows}
    yield _friction_table(rows, old)
    yield _motion_table(rows, old)
    yield _distributions_table()


def pooled(rows: Mapping[str, RowFigures], name: str, part: str) -> float:
    """Return the mean over rows, weighted by their robots."""
    values = [(one[name][part], one['run']['robots']) for one in rows.values()
              if math.isfinite(one[name][part])]
    count = sum(robots for _, robots in values)
    return sum(value * robots for value, robots in values) / count if count else math.nan


def _friction_table(rows: Mapping[str, RowFigures], old: Mapping[str, RowFigures]) -> Table:
    table = new_table('Friction', 'row', 'robots', 'mu median\n[%]', '90 %\n[%]', '<\n[%]',
                      'was\n[%]', 'robots 90 %\n[%]', 'bias\n[%]', 'est.\n[%]', '2 s.\n[%]',
                      'NEES', 'was 2 s.\n[%]', 'was NEES', 'CPU\n[ms/s]', 'was\n[ms/s]')
    for name, row in rows.items():
        mu, past = row[MU], old.get(name, {})
        required = ROWS[name].mu
        table.add_row(
            ROWS[name].title, f'{row["run"]["robots"]:.0f}',
            number(PERCENT * mu['median'], 1), number(PERCENT * mu['q90'], 1),
            _pair(*required) if required else '-',
            _pair(past[MU]['median'], past[MU]['q90'], 1) if past else '-',
            number(PERCENT * mu['robots_90'], 1), number(PERCENT * mu['bias'], 1),
            number(PERCENT * mu['finite'], 0), number(PERCENT * mu['within_two'], 0),
            number(mu['nees'], 1), _past(past, MU, 'within_two', PERCENT),
            _past(past, MU, 'nees', 1.0, 1), number(MILLI * row['run']['load'], 0),
            _past(past, 'run', 'load', MILLI))
    table.add_row(POOLED, *[''] * 8, number(PERCENT * pooled(rows, MU, 'within_two'), 0),
                  number(pooled(rows, MU, 'nees'), 1),
                  number(PERCENT * pooled(old, MU, 'within_two'), 0),
                  number(pooled(old, MU, 'nees'), 1), '', '')
    return table


def _motion_table(rows: Mapping[str, RowFigures], old: Mapping[str, RowFigures]) -> Table:
    heads = (('slip', ''), ('u', '\n[mm/s]'), ('v_y', '\n[mm/s]'))
    table = new_table('Motion', 'row', *(
        f'{name}: {column}' if column == 'rms' else column
        for name, unit in heads for column in ('rms', '<', 'was', '2 s.', 'NEES')))
    for name, row in rows.items():
        own, past = ROWS[name], old.get(name, {})
        cells: list[str] = []
        for quantity, required, scale, digits in (
                (SLIP, own.slip, 1.0, 4), (SPEED, own.speed, MILLI, 1),
                (LATERAL, own.lateral, MILLI, 1)):
            cells += [number(scale * row[quantity]['rms'], digits),
                      '-' if required is None else f'{scale * required:g}',
                      _past(past, quantity, 'rms', scale, digits),
                      number(PERCENT * row[quantity]['within_two'], 0),
                      number(row[quantity]['nees'], 1)]
        table.add_row(own.title, *cells)
    table.add_row(POOLED, *(
        cell for name in QUANTITIES[1:] for cell in (
            '', '', '', number(PERCENT * pooled(rows, name, 'within_two'), 0),
            number(pooled(rows, name, 'nees'), 1))))
    return table


def _distributions_table() -> Table:
    table = new_table('Drawn', 'property', 'values', 'distribution', 'parameters', 'nominal',
                      'unit', 'origin')
    for name, one in DISTRIBUTIONS.items():
        low, high = one.parameters
        table.add_row(name, str(one.count), one.kind, f'{low:g}, {high:g}',
                      f'{one.nominal:g}', one.unit, one.origin)
    return table


def _pair(first: float, second: float, digits: int = 0) -> str:
    return f'{number(PERCENT * first, digits)} / {number(PERCENT * second, digits)}'


def _past(past: RowFigures, name: str, part: str, scale: float, digits: int = 0) -> str:
    return number(scale * past[name][part], digits) if past else '-'


def compact(rows: Mapping[str, RowFigures], seeds: Sequence[int]) -> str:
    """Return the text of ``before.json``: one line per quantity, four digits."""
    def rounded(figures: Figures) -> str:
        return json.dumps({part: float(f'{value:.4g}') if math.isfinite(value) else None
                           for part, value in figures.items()})
    blocks = [f'    "{row}": {{\n' + ',\n'.join(
        f'      "{name}": {rounded(figures)}' for name, figures in quantities.items()) + '\n    }'
        for row, quantities in rows.items()]
    return (f'{{\n  "seeds": [{seeds[0]}, {seeds[-1]}],\n  "rows": {{\n' + ',\n'.join(blocks)
            + '\n  }\n}\n')
