"""What the tables of the benchmarks have in common."""

from __future__ import annotations

from collections.abc import Iterable
import math

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

WIDTH = 160  # columns where there is no terminal; no table needs so many


def new_console() -> Console:
    """Return the terminal, or standard output with room for the tables."""
    console = Console()
    return console if console.is_terminal else Console(width=WIDTH)


def print_all(console: Console, notes: str, tables: Iterable[Table]) -> None:
    """Print what the tables mean, and them one below the other."""
    console.print(Text(notes))
    for table in tables:
        console.print(table)


def new_table(title: str, first: str, *columns: str) -> Table:
    """Return an empty table; all columns but the ``first`` are of numbers."""
    table = Table(title=Text(title), title_justify='left', title_style='bold', box=SIMPLE_HEAD,
                  pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column(first, no_wrap=True)
    for column in columns:
        table.add_column(Text(column, justify='right'), justify='right', no_wrap=True)
    return table


def number(value: float, digits: int) -> str:
    """Return ``value`` with so many digits behind the point; a dash where it is none."""
    return f'{value:.{digits}f}' if math.isfinite(value) else '-'
