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
The data set of many drives: Parquet files by table, robot and date, and what is done of it.

``TABLE/robot=NAME/date=YYYY-MM-DD/DRIVE.parquet`` has the rows of one drive. What is not known is
null, also robot and date. ``_state/DRIVE.json`` has the key of what the files were computed from.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
import json
import os
from pathlib import Path
from typing import Any, BinaryIO, TYPE_CHECKING
from urllib.parse import quote, unquote

import numpy as np

import smart_tire
from smart_tire.analysis.export import tables
from smart_tire.errors import OutputError
from smart_tire.fleet.sources import FLEET_EXTRA
from smart_tire.messages.describe import describe
from smart_tire.paths import read_file
from smart_tire.recording import SampleArrays
from smart_tire.yaml_text import load_own

if TYPE_CHECKING:
    import pyarrow as pa

SCHEMA = 1  # version; a column that is added is no other version
DRIVES, STATE, PAGE, REPORTS = 'drives', '_state', 'index.html', 'reports'
ESTIMATES = 'odom', 'wheel_slip', 'icr', 'ground_state', 'tire_friction'
UNKNOWN = '__HIVE_DEFAULT_PARTITION__'  # null, for all that read such folders
COMPRESSION = 'zstd'
MAX_STATE = 100_000  # bytes; a file has 2000
UNITS = {'x': 'm', 'y': 'm', 'yaw': 'rad', 'v_x': 'm/s', 'v_y': 'm/s', 'yaw_rate': 'rad/s',
         'ratio': '-', 'sigma': '-', 'velocity': 'm/s', 'wheel': '', 'drive': '', 'schema': '',
         'stamp_ns': 'ns'}

# Columns of the drives: name -> type of Arrow, unit, meaning.
COLUMNS: Mapping[str, Sequence[str]] = load_own(
    Path(__file__).with_name('columns.yaml').read_text(encoding='utf-8'))
KINDS = {'drive': 'string', 'wheel': 'string', 'schema': 'int32', 'stamp_ns': 'int64'}


def schema_of(table: str, names: Sequence[str] = ()) -> pa.Schema:
    """Return the schema of a table with the columns ``names``, with units as metadata."""
    import pyarrow as pa
    kinds = {'list': pa.list_(pa.string()), 'string': pa.string(), 'int64': pa.int64(),
             'int32': pa.int32(), 'float64': pa.float64()}
    columns: Mapping[str, Sequence[str]] = COLUMNS if table == DRIVES else {
        name: (KINDS.get(name, 'float64'), unit_of(table, name), '')
        for name in ('drive', 'schema', 'stamp_ns', *names)}
    return pa.schema([pa.field(name, kinds[kind], metadata={'unit': unit, 'meaning': meaning})
                      for name, (kind, unit, meaning) in columns.items()],
                     metadata={'smart_tire.schema': str(SCHEMA),
                               'smart_tire.version': smart_tire.__version__})


def unit_of(table: str, column: str) -> str:
    """Return the unit of a column of estimates."""
    name = column.partition('.')[0].removesuffix('_sigma')
    described = describe(table)
    quantities = {} if described is None else {one.name: one.unit for one in described.quantities}
    return quantities.get(column.replace('.', '_')) or quantities.get(name) or UNITS[name]


def estimate_tables(drive: str, estimates: SampleArrays) -> dict[str, pa.Table]:
    """Return one row per estimate, by table; what is not observable is null."""
    import pyarrow as pa
    found = {}
    for name, one in tables(estimates):
        columns = {column: np.asarray(values) for column, values in one.columns().items()}
        schema = schema_of(name, list(columns))
        arrays = [pa.array([drive] * len(one)), pa.array(np.full(len(one), SCHEMA, np.int32)),
                  pa.array(one.stamp_ns)]
        arrays += [pa.array(values) if values.dtype.kind == 'U' else
                   pa.array(values, mask=~np.isfinite(values)) for values in columns.values()]
        found[name] = pa.table(arrays, pa.schema(
            [field.with_name(field.name.replace('.', '_')) for field in schema], schema.metadata))
    return found


class Dataset:
    """The data set in ``folder``, which several processes may write at a time."""

    def __init__(self, folder: Path) -> None:
        try:
            import pyarrow
        except ModuleNotFoundError as error:
            raise OutputError(f'--dataset needs pyarrow ({FLEET_EXTRA})') from error
        del pyarrow
        self.folder = folder

    def key_of(self, drive: str) -> str:
        """Return the key of a drive that is done, '' if it is not."""
        return str(self._state(drive).get('key', ''))

    def write(self, drive: str, key: str, robot: str, date: str, row: Mapping[str, Any],
              estimates: Mapping[str, pa.Table], report: str = '') -> None:
        """
        Write a drive in place of what there is of it; with an empty ``key`` it is not done.

        A reader finds complete files only, and the row of a drive after its estimates. Raises
        OutputError if a file cannot be written.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq
        place = f'robot={quote(robot, safe="") or UNKNOWN}/date={date or UNKNOWN}'
        schema = schema_of(DRIVES)
        rows = pa.Table.from_pylist([{**row, 'drive': drive, 'schema': SCHEMA,
                                      'version': smart_tire.__version__}], schema)
        written = {f'{name}/{place}/{drive}.parquet': one.replace_schema_metadata(
            {**one.schema.metadata, 'smart_tire.key': key})
            for name, one in {**estimates, DRIVES: rows}.items()}
        names = [*written, *([self.report(drive)] if report else [])]
        before = self._state(drive).get('files', [])
        self._write_state(drive, '', sorted({*before, *names}))
        if report:
            self.replace(self.report(drive), lambda file: file.write(report.encode()))
        for name, one in written.items():
            self.replace(name, partial(pq.write_table, one, compression=COMPRESSION))
        for name in {*before} - {*names}:
            (self.folder / name).unlink(missing_ok=True)
        self._write_state(drive, key, names)

    @staticmethod
    def report(drive: str) -> str:
        """Return the name of the report of a drive."""
        return f'{REPORTS}/{drive}.html'

    def drives(self) -> list[dict[str, Any]]:
        """Return the rows of all drives with robot and date, by robot and start."""
        import pyarrow.parquet as pq
        rows: list[dict[str, Any]] = []
        # one at a time: pyarrow.dataset keeps 0.1 MB of each file
        for path in (self.folder / DRIVES).glob('robot=*/date=*/*.parquet'):
            robot, date = (None if (value := part.partition('=')[2]) == UNKNOWN else unquote(value)
                           for part in path.parts[-3:-1])
            rows += [{**dict.fromkeys(COLUMNS), **row, 'robot': robot, 'date': date}
                     for row in pq.ParquetFile(path).read().to_pylist()]
        return sorted(rows, key=lambda row: (
            row['robot'] or '', row['start_ns'] or 0, row['drive']))

    def replace(self, name: str, write: Callable[[BinaryIO], object]) -> None:
        """Write a file of the data set, or leave it as it is; raise OutputError."""
        path = self.folder / name
        draft = path.with_name(f'.{path.name}.{os.getpid()}')
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            try:
                with draft.open('wb') as file:
                    write(file)
                    file.flush()
                    os.fsync(file.fileno())
                draft.replace(path)
            finally:
                draft.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f'{path}: cannot be written ({error.strerror or error}); what was '
                              'computed before is kept') from error

    def _state(self, drive: str) -> dict[str, Any]:
        try:
            found = json.loads(read_file(self._state_file(drive), MAX_STATE))
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def _write_state(self, drive: str, key: str, files: Sequence[str]) -> None:
        text = json.dumps({'key': key, 'files': list(files)}, indent=1) + '\n'
        self.replace(f'{STATE}/{drive}.json', lambda file: file.write(text.encode()))

    def _state_file(self, drive: str) -> Path:
        return self.folder / STATE / f'{drive}.json'
