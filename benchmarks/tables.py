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

"""Formatting of the benchmark tables."""

from __future__ import annotations

from collections.abc import Iterable
import math

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

CONSOLE_WIDTH = 160  # characters without a terminal; enough for all tables


def new_console() -> Console:
    """Return a console for the terminal, or a wide one without a terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=CONSOLE_WIDTH)


def print_all(console: Console, notes: str, tables: Iterable[Table]) -> None:
    """Print the notes, then all tables."""
    console.print(Text(notes))
    for table in tables:
        console.print(table)


def new_table(title: str, first: str, *columns: str) -> Table:
    """Return an empty table with a label column and number columns."""
    table = Table(title=Text(title), title_justify='left', title_style='bold', box=SIMPLE_HEAD,
                  pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column(first, no_wrap=True)
    for column in columns:
        table.add_column(Text(column, justify='right'), justify='right', no_wrap=True)
    return table


def markdown(table: Table) -> str:
    """
    Return ``table`` as a Markdown table under its title.

    A column without a group in its header belongs to that of the column before it.
    """
    group, headers = '', list[str]()
    for column in table.columns:
        first, _, second = str(column.header).partition('\n')
        group = first if first.endswith(':') else group if not first else ''
        whole = f'{first} {second}'.replace('- ', '').strip()  # hyphenated at the line break
        headers.append(f'{group} {second}'.strip() if group else whole)
    cells = [[str(cell).strip() for cell in column.cells] for column in table.columns]
    lines = [headers, ['---'] * len(headers), *([*row] for row in zip(*cells))]
    return f'{table.title}\n\n' + '\n'.join(
        f'| {" | ".join(line)} |' for line in lines) + '\n'


def number(value: float, digits: int) -> str:
    """Return ``value`` with ``digits`` decimals; a dash if it is not finite."""
    return f'{value:.{digits}f}' if math.isfinite(value) else '-'
