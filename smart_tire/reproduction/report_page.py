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

"""The report as one self-contained HTML file."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path

from smart_tire.reproduction.report_section import Section

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 60rem; margin: 2rem auto;
       padding: 0 1rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.25rem; margin-top: 3.5rem;
     border-top: 1px solid #ccc; padding-top: 1rem; }
img { width: 100%; height: auto; }
table { border-collapse: collapse; margin: 1rem 0; width: 100%; }
th, td { text-align: left; padding: .25rem .8rem .25rem 0; border-bottom: 1px solid #ddd;
         vertical-align: top; }
.agrees { border-left: 4px solid #0072b2; padding-left: .8rem; }
.differs { border-left: 4px solid #d55e00; padding-left: .8rem; }
nav a { margin-right: .9rem; white-space: nowrap; }
@media print { section { break-before: page; } nav { display: none; } }
"""


def write_report(path: Path, introduction: Sequence[str], sections: Sequence[tuple[Section, Path]]
                 ) -> None:
    """Write the sections, each with its PNG file, to one self-contained file."""
    path.write_text('\n'.join(_document(introduction, sections)) + '\n', encoding='utf-8')


def _document(introduction: Sequence[str],
              sections: Sequence[tuple[Section, Path]]) -> Iterator[str]:
    yield '<!DOCTYPE html>'
    yield '<html lang="en"><head><meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield f'<title>Reproduced figures and tables</title><style>{STYLE}</style></head><body>'
    yield '<h1>Reproduced figures and tables</h1>'
    for paragraph in introduction:
        yield f'<p>{escape(paragraph)}</p>'
    links = (f'<a href="#{section.name}">{escape(section.title.split(":")[0])}</a>'
             for section, _ in sections)
    yield f'<nav>{" ".join(links)}</nav>'
    for section, picture in sections:
        yield from _section(section, picture)
    yield '</body></html>'


def _section(section: Section, picture: Path) -> Iterator[str]:
    image = base64.b64encode(picture.read_bytes()).decode('ascii')
    yield f'<section id="{section.name}"><h2>{escape(section.title)}</h2>'
    yield f'<img alt="{escape(section.title)}" src="data:image/png;base64,{image}">'
    if section.rows:
        yield '<table><tr><th>quantity</th><th>paper</th><th>here</th></tr>'
        for row in section.rows:
            yield '<tr>' + ''.join(f'<td>{escape(cell)}</td>' for cell in row) + '</tr>'
        yield '</table>'
    for kind, sentences in (('agrees', section.agrees), ('differs', section.differs)):
        if sentences:
            label = 'Agrees' if kind == 'agrees' else 'Differs, or cannot be compared'
            yield f'<div class="{kind}"><strong>{label}</strong>'
            yield from (f'<p>{escape(sentence)}</p>' for sentence in sentences)
            yield '</div>'
    yield '</section>'
