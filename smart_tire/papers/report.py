# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Sections of the report: a figure, its numbers, and statements derived from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from smart_tire.analysis.figure import Figure, Panel
from smart_tire.yaml_text import load_own

TEXTS: dict[str, Any] = load_own(
    Path(__file__).with_name('sections.yaml').read_text(encoding='utf-8'))


@dataclass(frozen=True)
class PaperSection:
    """One figure or table of a paper, reproduced."""

    figure: Figure
    numbers: Sequence[Sequence[str]]  # quantity, in the paper, here
    agrees: Sequence[str]
    differs: Sequence[str]            # also what cannot be reproduced or compared


def section(name: str, panels: Sequence[Sequence[Panel]], cell: tuple[float, float],
            checks: Mapping[str, bool], **values: Any) -> PaperSection:
    """Return the section ``name`` of ``sections.yaml`` with ``values`` inserted."""
    texts = TEXTS[name]
    agrees: list[str] = []
    differs: list[str] = []
    for statement in texts['statements']:
        if isinstance(statement, str):
            differs.append(statement.format(**values))
            continue
        for check, (agreement, disagreement) in statement.items():
            (agrees if checks[check] else differs).append(
                (agreement if checks[check] else disagreement).format(**values))
    numbers = [[cell.format(**values) for cell in row] for row in texts['numbers']]
    title = f'{texts["title"]} (simulated)'  # also in each picture, which is shown alone
    return PaperSection(Figure(name, title, title, panels, cell, panel_legends=True), numbers,
                        agrees, differs)
