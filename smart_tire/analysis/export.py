# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Estimates as files of other tools: TUM and KITTI for evo, CSV and Parquet for data frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import math
from pathlib import Path

import numpy as np

from smart_tire.analysis.result import Comparison, SMOOTHED
from smart_tire.arrays import Array, Instants
from smart_tire.errors import ParameterError
from smart_tire.estimates import Tabular
from smart_tire.paths import write_text
from smart_tire.recording import SampleArrays
from smart_tire.samples import NS_PER_S

TUM, KITTI, PARQUET = 'tum', 'kitti', 'parquet'
FORMATS = TUM, KITTI, 'csv', PARQUET
REFERENCE = 'reference'


def export(folder: Path, runs: Mapping[str, Comparison], formats: Sequence[str]) -> None:
    """
    Write the ``runs`` of one analysis into ``folder``, in each of ``formats``.

    TUM and KITTI have the poses, and with a reference its poses in a file with the same rows, at
    its timestamps; the others all estimates. Names of smoothed estimates begin with "smoothed_".
    Raises ParameterError if a file cannot be written.
    """
    for label, one in runs.items():
        prefix = f'{SMOOTHED}_' if label == SMOOTHED else ''
        for form in formats:
            if write := POSES.get(form):
                for name, stamps, poses in _paths(one):
                    write_text(folder / f'{"" if name == REFERENCE else prefix}{name}.{form}',
                               '\n'.join(write(stamps, poses)) + '\n')
                continue
            for name, table in tables(one.estimates):
                write_table(folder / f'{prefix}{name}.{form}', table)


def tables(estimates: SampleArrays) -> Iterator[tuple[str, Tabular]]:
    """Yield the estimates by topic, those that there are."""
    found: tuple[tuple[str, Tabular], ...] = (
        ('odom', estimates.poses()), ('wheel_slip', estimates.slips()),
        ('icr', estimates.centers()), ('ground_state', estimates.grounds()),
        ('tire_friction', estimates.frictions()))
    yield from ((name, table) for name, table in found if len(table))


def _paths(found: Comparison) -> Iterator[tuple[str, Instants, Array]]:
    """Yield name, timestamps and poses (n, 3) of estimate and, if known, reference."""
    compared, raw, own = found.poses, found.raw_reference, found.estimates.poses()
    if len(compared.stamp_ns):
        yield 'odom', compared.stamp_ns, compared.estimated
        yield REFERENCE, raw.stamp_ns, raw.true
    elif len(own):
        yield 'odom', own.stamp_ns, own.pose


def _tum(stamp_ns: Instants, poses: Array) -> Iterator[str]:
    """Yield timestamp [s], x, y, z [m] and quaternion x, y, z, w, as in the TUM data sets."""
    for stamp, (x, y, yaw) in zip(stamp_ns.tolist(), poses.tolist()):
        yield (f'{stamp // NS_PER_S}.{stamp % NS_PER_S:09d} {x:.9f} {y:.9f} 0 0 0 '
               f'{math.sin(0.5 * yaw):.9f} {math.cos(0.5 * yaw):.9f}')


def _kitti(_: Instants, poses: Array) -> Iterator[str]:
    """Yield the rows of the matrices [R t], as in the KITTI data sets."""
    for x, y, yaw in poses.tolist():
        cos, sin = math.cos(yaw), math.sin(yaw)
        yield f'{cos:.9f} {-sin:.9f} 0 {x:.9f} {sin:.9f} {cos:.9f} 0 {y:.9f} 0 0 1 0'


POSES: dict[str, Callable[[Instants, Array], Iterator[str]]] = {TUM: _tum, KITTI: _kitti}


def write_table(path: Path, table: Tabular) -> None:
    """Write a table as CSV or Parquet, by the suffix of ``path``."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == f'.{PARQUET}':
            table.to_pandas().to_parquet(path)
            return
        columns = table.columns()
        with path.open('w', encoding='utf-8') as file:
            file.write(','.join(['stamp_ns', *columns]) + '\n')
            for row in zip(table.stamp_ns.tolist(), *(
                    np.asarray(values).tolist() for values in columns.values())):
                file.write(','.join(map(str, row)) + '\n')
    except OSError as error:
        raise ParameterError(f'{path}: cannot be written ({error.strerror})') from error
    except ImportError as error:
        raise ModuleNotFoundError('Parquet needs pandas and pyarrow', name='pyarrow') from error
