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

"""Parts of a report: facts, sections and what they contain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from smart_tire.analysis.html_report.layout import Figure
from smart_tire.analysis.html_report.tables import Table


@dataclass(frozen=True)
class Facts:
    """What the analysis does not know about its recording and itself."""

    name: str       # of the bag
    path: str
    recorded: str   # date and time
    created: str    # date and time of the report
    version: str    # of the software

    def items(self) -> list[tuple[str, str]]:
        """Return what is written below the title: label, text."""
        return [('Recorded', self.recorded), ('Bag', self.path), ('Report', self.created),
                ('Software', f'smart_tire {self.version}')]


@dataclass(frozen=True)
class Folded:
    """A table that is shown on demand."""

    title: str
    table: Table


Block = Figure | Table | Folded | str | list[str]


@dataclass
class Section:
    """A section of the report."""

    anchor: str
    short: str  # title in the navigation
    title: str
    blocks: list[Block] = field(default_factory=list)


@dataclass(frozen=True)
class Report:
    """The whole report."""

    facts: Facts
    tiles: list[tuple[str, str, str]]  # label, value with unit, note
    notes: list[str]                   # what a reader should know first
    sections: list[Section]
    time_range: tuple[float, float]      # s, of all plots over time
    segments: Sequence[tuple[float, float]]  # s, proposed for a closer look
