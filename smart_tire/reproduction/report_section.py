"""A page of the report: a figure, its numbers, and sentences that follow from them."""

from __future__ import annotations

from dataclasses import dataclass, field

Row = tuple[str, str, str]  # quantity, in the paper, here


@dataclass
class Section:
    """What is said of one figure or table."""

    name: str   # of the PNG file
    title: str
    rows: list[Row] = field(default_factory=list)
    agrees: list[str] = field(default_factory=list)
    differs: list[str] = field(default_factory=list)

    def row(self, quantity: str, paper: str, here: str) -> None:
        """Add a number."""
        self.rows.append((quantity, paper, here))

    def claim(self, holds: bool, agreement: str, disagreement: str) -> None:
        """Say what agrees if it does, else what does not."""
        if holds:
            self.agrees.append(agreement)
        else:
            self.differs.append(disagreement)

    def cannot(self, sentence: str) -> None:
        """Say what can not be matched, and why."""
        self.differs.append(sentence)
