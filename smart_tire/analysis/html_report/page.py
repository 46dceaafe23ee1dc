# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The page: a report as one HTML file that needs no network."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from html import escape
from importlib.resources import files
from itertools import zip_longest
import json
from pathlib import Path
from string import Template
from typing import Any

from plotly.offline import get_plotlyjs

from smart_tire.analysis.figure import Figure, Segments
from smart_tire.analysis.html_report.plots import height, plotly_spec
from smart_tire.analysis.tables import Table

NARROW_COLUMNS = 3  # of a table that is not as wide as the page
NO_SCRIPT = ('<noscript><p class="error">The plots need JavaScript; the tables are complete '
             'without it.</p></noscript>')


@dataclass(frozen=True)
class Folded:
    """A table that is shown on demand."""

    title: str
    table: Table


@dataclass(frozen=True)
class Picture:
    """A PNG file, which the page contains."""

    title: str  # what it shows, for readers who do not see it
    path: Path


@dataclass(frozen=True)
class Note:
    """Sentences that a reader should not miss."""

    sentences: Sequence[str]


Block = Figure | Table | Folded | Picture | Note | str | list[str]


@dataclass(frozen=True)
class Section:
    """A section of the report; ``short`` is its title in the navigation."""

    anchor: str
    short: str
    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class Report:
    """The whole report."""

    name: str
    facts: Sequence[tuple[str, str]]   # label, text; below the title
    sections: Sequence[Section]
    about: Sequence[str]
    tiles: Sequence[tuple[str, str, str]] = ()    # label, value with unit, note
    notes: Sequence[str] = ()                     # what a reader should know first
    time_range: tuple[float, float] = (0.0, 1.0)  # s, of all plots over time
    segments: Segments = ()                       # proposed for a closer look


def html_page(report: Report) -> str:
    """Return the report as the text of an HTML file."""
    links = [(section.anchor, section.short) for section in report.sections]
    interactive = any(isinstance(block, Figure) for section in report.sections
                      for block in section.blocks)
    scripts = {'plotly': get_plotlyjs(), 'page': _resource('page.js')} if interactive else {}
    return Template(_resource('page.html')).substitute(
        hashes=' '.join(map(_script_hash, scripts.values())) or "'none'",
        name=escape(report.name), css=_resource('page.css'),
        range=escape(json.dumps(report.time_range)),
        facts=_all('<div><dt>{}</dt><dd>{}</dd></div>', report.facts),
        links=_all('<li><a href="#{}">{}</a></li>', [*links, ('about', 'About')]),
        zoom=_zoom(report), notes=_note(report.notes) if report.notes else '',
        sections='\n'.join(_section(section, report.time_range) for section in report.sections),
        tiles=_all('<div><dt>{}</dt><dd class="value">{}</dd><dd>{}</dd></div>', report.tiles),
        about=_all('<p>{}</p>', [[text] for text in report.about]),
        noscript=NO_SCRIPT if interactive else '',
        scripts='\n'.join(f'<script id="{name}">{text}</script>'
                          for name, text in scripts.items()))


def _script_hash(text: str) -> str:
    """Return the source of a content security policy that allows the script ``text`` only."""
    return f"'sha256-{b64encode(sha256(text.encode()).digest()).decode('ascii')}'"


def _all(form: str, items: Sequence[Sequence[str]]) -> str:
    """Return the HTML ``form`` filled with the escaped texts of each item, in lines."""
    return '\n'.join(form.format(*map(escape, item)) for item in items)


def script_json(value: Any) -> str:
    """Return JSON without the character that could end a script element."""
    text = json.dumps(value, allow_nan=False, separators=(',', ':'), ensure_ascii=False)
    return text.replace('<', '\\u003c')


def _resource(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding='utf-8')


def _zoom(report: Report) -> str:
    if not report.segments:
        return ''
    buttons = [('whole', report.time_range), *(
        (f'{first:.0f}–{last:.0f} s', (first, last)) for first, last in report.segments)]
    return ('<div class="zoom" role="group" aria-label="Time range of the plots">Show '
            + _all('<button type="button" data-range="{}">{}</button>',
                   [(json.dumps(limits), label) for label, limits in buttons]) + '</div>')


def _note(sentences: Sequence[str]) -> str:
    return ('<div class="notes" role="note">' + _all('<p>{}</p>', [[text] for text in sentences])
            + '</div>')


def _section(section: Section, time_range: tuple[float, float]) -> str:
    anchor = escape(section.anchor)
    blocks = '\n'.join(_block(block, time_range) for block in section.blocks)
    return (f'<section aria-labelledby="{anchor}">\n<h2 id="{anchor}">{escape(section.title)}'
            f'</h2>\n{blocks}\n</section>')


def _block(block: Block, time_range: tuple[float, float]) -> str:
    if isinstance(block, Figure):
        return _figure(block, time_range)
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Folded):
        return (f'<details>\n<summary>{escape(block.title)}</summary>\n{_table(block.table)}\n'
                '</details>')
    if isinstance(block, Picture):
        image = b64encode(block.path.read_bytes()).decode('ascii')
        return (f'<figure><img alt="{escape(block.title)}" src="data:image/png;base64,{image}">'
                '</figure>')
    if isinstance(block, Note):
        return _note(block.sentences)
    if isinstance(block, str):
        return f'<p>{escape(block)}</p>'
    return '<ul>' + _all('<li>{}</li>', [[text] for text in block]) + '</ul>'


def _figure(figure: Figure, time_range: tuple[float, float]) -> str:
    name = escape(figure.name)
    time = ' data-time' if figure.panels[0].over_time else ''
    return (f'<figure>\n<div class="plot" id="{name}_plot" role="img" '
            f'aria-label="{escape(figure.title)}" data-spec="{name}_spec"{time} '
            f'style="min-height: {height(figure)}px"></div>\n'
            f'<script type="application/json" id="{name}_spec">'
            f'{script_json(plotly_spec(figure, time_range))}</script>\n'
            f'<figcaption>{escape(figure.caption)}</figcaption>\n</figure>')


def _table(table: Table) -> str:
    def cell(tag: str, column: int, text: str, scope: str = '', link: str | None = None) -> str:
        style = ' class="text"' if column < table.text_columns else ''
        shown = f'<a href="{escape(link)}">{escape(text)}</a>' if link else escape(text)
        return f'<{tag}{style}{scope}>{shown}</{tag}>'

    narrow = ' class="narrow"' if len(table.head) <= NARROW_COLUMNS else ''
    head = ''.join(cell('th', i, text, ' scope="col"') for i, text in enumerate(table.head))
    rows = '\n'.join(
        '<tr>' + ''.join(cell('td' if i else 'th', i, text, '' if i else ' scope="row"',
                              None if i else link)
                         for i, text in enumerate(row)) + '</tr>'
        for row, link in zip_longest(table.rows, table.links))
    caption = f'{table.title}. {table.note}'.strip()
    return (f'<div class="scroll">\n<table{narrow}>\n<caption>{escape(caption)}</caption>\n'
            f'<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>\n</div>')
