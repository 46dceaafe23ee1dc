# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contents of a recording of the viewer, read back from its file."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader

from smart_tire.view.writer import TIMELINE


class RerunFile:
    """Entities of a file: values by component over time, and static ones."""

    def __init__(self, path: Path) -> None:
        self._rows: dict[str, dict[str, list[tuple[int, Any]]]] = defaultdict(
            lambda: defaultdict(list))
        self._static: dict[str, dict[str, Any]] = defaultdict(dict)
        self._reader = RrdReader(str(path))
        for chunk in self._reader.stream():
            self._add(chunk)

    def _add(self, chunk: Any) -> None:
        table = chunk.to_record_batch().to_pydict()
        path = chunk.entity_path.strip('/')
        for name, column in table.items():
            if ':' not in name:
                continue
            if chunk.is_static:
                self._static[path][name] = column[0]
                continue
            for time, value in zip(table.get(TIMELINE, ()), column):
                if value is not None:
                    self._rows[path][name].append((nanoseconds(time), value))

    @property
    def paths(self) -> set[str]:
        """Return the paths of all entities."""
        return {*self._rows, *self._static}

    def rows(self, path: str, component: str) -> list[tuple[int, Any]]:
        """Return time [ns] and value of each row of a component."""
        return sorted(self._rows[path][component], key=lambda row: row[0])

    def scalars(self, path: str) -> list[tuple[int, list[float]]]:
        """Return time [ns] and values of a series."""
        return self.rows(path, 'Scalars:scalars')

    def static(self, path: str, component: str) -> Any:
        """Return the value of a component at all times."""
        return self._static[path][component]

    def blueprint(self) -> dict[str, dict[str, Any]]:
        """Return path -> component -> value of the arrangement of the views."""
        found: dict[str, dict[str, Any]] = defaultdict(dict)
        for store in self._reader.blueprints():
            for chunk in self._reader.stream(store=store):
                for name, column in chunk.to_record_batch().to_pydict().items():
                    if ':' in name:
                        found[chunk.entity_path][name] = column[-1]
        return found


def nanoseconds(time: Any) -> int:
    """Return a time of a table [ns]."""
    return int(getattr(time, 'value', None) or round(time.total_seconds() * 1e9))
