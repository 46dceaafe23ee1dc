# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recordings of a film on a test stand (CSV)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
import re

import numpy as np
from smart_tire.arrays import Array
from smart_tire.errors import ParameterError
from smart_tire.models.film.hysteresis import series
from smart_tire.paths import csv_rows, explained, is_number

COLUMNS = ('time_s', 'deflection_m', 'charge_C')
MIN_SAMPLES = 20  # of a recording
MAX_TABLE_SIZE = 1 << 28  # bytes of a CSV file, which is read into memory: 6 million samples
SEPARATORS = ';\t '  # of other tables than CSV
PREFIXES = {'m': 1e-3, 'u': 1e-6, 'n': 1e-9, 'p': 1e-12, 'µ': 1e-6, 'c': 1e-2}  # of units
MIN_UNIT_RATIO = 2.0  # of a magnitude over the largest plausible one: less is no other unit
MAX_STEP = 0.5     # s between samples; assumed: the amplifier loses the charge of slower motion
MAX_CHARGE = 1e-6  # C; assumed: thirty times the gain of the film of paper A, Table I


@dataclass(frozen=True)
class FilmRecording:
    """Samples of one experiment, in SI units unless other columns are selected."""

    time: Array    # s, increasing
    input: Array   # m, deflection from the flat film  # noqa: A003
    output: Array  # C

    def __post_init__(self) -> None:
        check_series(self.time, input=self.input, output=self.output)


def check_series(time: Array, **others: Array) -> None:
    """Raise ParameterError unless ``time`` increases and all are finite and of equal length."""
    sizes = {name: series(name, values).size for name, values in {'time': time, **others}.items()}
    if len(set(sizes.values())) > 1:
        raise ParameterError(f'the numbers of samples differ: {sizes}')
    if sizes['time'] < MIN_SAMPLES:
        raise ParameterError(f'{sizes["time"]} samples, expected at least {MIN_SAMPLES}')
    decreasing = np.flatnonzero(np.diff(time) <= 0.0)
    if decreasing.size:
        row = int(decreasing[0]) + 1
        raise ParameterError(f'time[{row}] is {time[row]} after {time[row - 1]}, '
                             'expected increasing times')


def header_of(path: Path) -> list[str]:
    """Return the names of the columns of a CSV file."""
    with csv_rows(path, MAX_TABLE_SIZE, 'text file') as rows:
        return [name.strip() for name in next(rows, [])]


def read_columns(path: Path, columns: Sequence[str], only: bool) -> list[Array]:
    """Return the named columns of a CSV file; with ``only``, others are an error."""
    header = header_of(path)
    indices = _column_indices(path, header, columns, only)
    with csv_rows(path, MAX_TABLE_SIZE, 'text file') as rows:
        next(rows)
        table = [_numbers(path, rows.line_num, row, header, indices) for row in rows if row]
    return list(np.array(table, dtype=float).reshape(-1, len(indices)).T.copy())


def check_units(columns: Sequence[str], values: Sequence[Array], units: Mapping[str, float]
                ) -> None:
    """
    Raise ParameterError if columns are in units with a prefix, such as ms, mm and pC.

    ``units`` are the one that is expected of each column, and the largest plausible magnitude in
    it; of s, that of the steps. A column is in another unit by the end of its name (``d_mm``,
    ``Charge [pC]``) or by its magnitude.
    """
    wrong = []
    for column, series_of, (unit, limit) in zip(columns, values, units.items()):
        others = {prefix + unit: factor for prefix, factor in PREFIXES.items()}
        named = re.split(r'[^\wµ]|_', column.rstrip(')] '))[-1]
        largest = float(np.median(np.diff(series_of)) if unit == 's' else
                        np.abs(series_of).max()) if len(series_of) > 1 else 0.0
        if named.casefold() in map(str.casefold, others):
            wrong.append(f'{column} is in {named}, expected {unit}')
        elif largest > limit:
            other = next((name for name, factor in others.items() if factor * largest <= limit
                          and largest >= MIN_UNIT_RATIO * limit), '')
            wrong.append(f'{column} {"advances by" if unit == "s" else "is up to"} {largest:.3g}, '
                         f'expected at most {limit:.3g} {unit}' + (f': in {other}?' * bool(other)))
    if wrong:
        raise ParameterError('; '.join(wrong))


def read_recording(path: Path, columns: Sequence[str] = COLUMNS) -> FilmRecording:
    """Return the recording in a CSV file; extra columns are allowed if ``columns`` are given."""
    if len(columns) != len(COLUMNS):
        raise ParameterError(f'columns are {",".join(columns)}, expected time, input and output')
    values = read_columns(path, columns, only=tuple(columns) == COLUMNS)
    try:
        return FilmRecording(*values)
    except ParameterError as error:
        raise ParameterError(f'{path}: {error}') from error


def write_columns(path: Path, columns: Sequence[str], values: Sequence[Array]) -> None:
    """Write arrays (n,) as the columns of a CSV file, with nine digits."""
    with explained(path, 'written'):
        np.savetxt(path, np.column_stack(list(values)), fmt='%.9g', delimiter=',',
                   header=','.join(columns), comments='')


def _column_indices(path: Path, header: list[str], columns: Sequence[str],
                    only: bool) -> list[int]:
    missing = [name for name in columns if header.count(name) != 1]
    if missing:
        separator = next((one for one in SEPARATORS if len(header) == 1 and one in header[0]), '')
        raise ParameterError(
            f'{path}: has columns {",".join(header) or "none"}, expected {", ".join(missing)} once'
            + (f'; they are separated by {separator!r}, expected commas' if separator else
               '; name those to read with --columns'))
    extra = [name for name in header if name not in columns]
    if extra and only:
        raise ParameterError(f'{path}: has column {extra[0]} in addition to {",".join(columns)}; '
                             'name the columns to read')
    return [header.index(name) for name in columns]


def _numbers(path: Path, line: int, row: list[str], header: list[str], indices: list[int]
             ) -> list[float]:
    if len(row) != len(header):
        raise ParameterError(f'{path}: line {line} has {len(row)} fields, expected {len(header)}')
    try:
        return [float(row[index]) for index in indices]
    except ValueError as error:
        texts = [f'{header[index]} is {row[index]!r}' for index in indices
                 if not is_number(row[index])]
        raise ParameterError(
            f'{path}: line {line}: {", ".join(texts)}, expected numbers') from error
