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

"""The page: the report as one HTML file that needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files
import json
from string import Template
from typing import Any

from plotly.offline import get_plotlyjs

from smart_tire.analysis.html_report.decimation import bucket_count, MAX_POINTS
from smart_tire.analysis.html_report.layout import Figure, plotly_spec
from smart_tire.analysis.html_report.model import Block, Folded, Report, Section
from smart_tire.analysis.html_report.tables import Table

NARROW_COLUMNS = 3  # of a table that is not as wide as the page
ABOUT = (
    'Estimates are those of "smart_tire analyze" with the same parameters. Times are seconds '
    'after the first estimate. σ is one standard deviation as reported by the estimator; bands, '
    'bars and ellipses show 2σ.',
    f'A curve has at most {MAX_POINTS} points. Where it has more values, the smallest and largest '
    'value and the largest σ of each interval are kept, here of up to $interval s, so that '
    'extremes are shown, but less detail than in the bag. Every point is an original value. '
    'Tables are computed from all values.',
    'Drag to zoom, double-click to reset; plots over time have linked axes. This file makes no '
    'network requests. The plots are drawn by plotly.js (MIT license), which it contains.')


def html_page(report: Report) -> str:
    """Return the report as the text of an HTML file."""
    facts = report.facts
    specs = Specs(report.time_range)
    sections = '\n'.join(_section(section, specs) for section in report.sections)
    links = [(section.anchor, section.short) for section in report.sections]
    return Template(_resource('page.html')).substitute(
        name=escape(facts.name), version=escape(facts.version), css=_resource('page.css'),
        range=escape(json.dumps(report.time_range)),
        facts='\n'.join(f'<div><dt>{escape(label)}</dt><dd>{escape(value)}</dd></div>'
                        for label, value in facts.items()),
        links='\n'.join(f'<li><a href="#{escape(anchor)}">{escape(title)}</a></li>'
                        for anchor, title in [*links, ('about', 'About')]),
        zoom=_zoom(report), notes=_notes(report.notes), sections=sections,
        tiles='\n'.join(f'<div><dt>{escape(label)}</dt><dd class="value">{escape(value)}</dd>'
                        f'<dd>{escape(note)}</dd></div>' for label, value, note in report.tiles),
        about=_about(report),
        plotly=get_plotlyjs(), script=_resource('page.js'))


def _about(report: Report) -> str:
    start, end = report.time_range
    interval = f'{(end - start) / bucket_count(MAX_POINTS):.2g}'
    return ''.join(f'<p>{escape(Template(text).substitute(interval=interval))}</p>'
                   for text in ABOUT)


class Specs:
    """Converts figures to JSON, with the common time range."""

    def __init__(self, time_range: tuple[float, float]) -> None:
        self._range = time_range

    def text(self, figure: Figure) -> str:
        """Return the specification of ``figure`` as JSON that a script element may contain."""
        spec = plotly_spec(figure)
        if figure.over_time:
            spec['layout']['xaxis']['range'] = list(self._range)
        return script_json(spec)


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
    return ('<div class="zoom" role="group" aria-label="Time range of the plots">Show ' + ''.join(
        f'<button type="button" data-range="{escape(json.dumps(limits))}">{escape(label)}'
        '</button>' for label, limits in buttons) + '</div>')


def _notes(notes: Sequence[str]) -> str:
    return ('<div class="notes" role="note">' + ''.join(f'<p>{escape(text)}</p>' for text in notes)
            + '</div>') if notes else ''


def _section(section: Section, specs: Specs) -> str:
    anchor = escape(section.anchor)
    blocks = '\n'.join(_block(block, specs) for block in section.blocks)
    return (f'<section aria-labelledby="{anchor}">\n<h2 id="{anchor}">{escape(section.title)}'
            f'</h2>\n{blocks}\n</section>')


def _block(block: Block, specs: Specs) -> str:
    if isinstance(block, Figure):
        return _figure(block, specs)
    if isinstance(block, Table):
        return _table(block)
    if isinstance(block, Folded):
        return (f'<details>\n<summary>{escape(block.title)}</summary>\n{_table(block.table)}\n'
                '</details>')
    if isinstance(block, str):
        return f'<p>{escape(block)}</p>'
    return '<ul>' + ''.join(f'<li>{escape(text)}</li>' for text in block) + '</ul>'


def _figure(figure: Figure, specs: Specs) -> str:
    name = escape(figure.name)
    time = ' data-time' if figure.over_time else ''
    return (f'<figure>\n<div class="plot" id="{name}_plot" role="img" '
            f'aria-label="{escape(figure.alt)}" data-spec="{name}_spec"{time} '
            f'style="min-height: {figure.height}px"></div>\n'
            f'<script type="application/json" id="{name}_spec">{specs.text(figure)}</script>\n'
            f'<figcaption>{escape(figure.caption)}</figcaption>\n</figure>')


def _table(table: Table) -> str:
    def cell(tag: str, column: int, text: str, scope: str = '') -> str:
        style = ' class="text"' if column < table.text_columns else ''
        return f'<{tag}{style}{scope}>{escape(text)}</{tag}>'

    narrow = ' class="narrow"' if len(table.head) <= NARROW_COLUMNS else ''
    head = ''.join(cell('th', i, text, ' scope="col"') for i, text in enumerate(table.head))
    rows = '\n'.join(
        '<tr>' + ''.join(cell('td' if i else 'th', i, text, '' if i else ' scope="row"')
                         for i, text in enumerate(row)) + '</tr>' for row in table.rows)
    return (f'<div class="scroll">\n<table{narrow}>\n<caption>{escape(table.caption)}</caption>\n'
            f'<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>\n</div>')
