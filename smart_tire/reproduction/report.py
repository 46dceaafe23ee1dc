# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A section of the report: a figure, its numbers, and statements derived from them."""

from __future__ import annotations

from dataclasses import dataclass, field

Row = tuple[str, str, str]  # quantity, in the paper, here


@dataclass
class Section:
    """Numbers and statements on one figure or table."""

    name: str  # of the PNG file
    title: str
    rows: list[Row] = field(default_factory=list)
    agrees: list[str] = field(default_factory=list)
    differs: list[str] = field(default_factory=list)

    def row(self, quantity: str, paper: str, here: str) -> None:
        """Add a row to the table of numbers."""
        self.rows.append((quantity, paper, here))

    def check(self, holds: bool, agreement: str, disagreement: str) -> None:
        """Add ``agreement`` if the check holds, else ``disagreement``."""
        if holds:
            self.agrees.append(agreement)
        else:
            self.differs.append(disagreement)

    def limitation(self, sentence: str) -> None:
        """Add what cannot be reproduced or compared, with the reason."""
        self.differs.append(sentence)
