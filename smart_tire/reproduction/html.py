"""The report as one HTML file with everything in it."""

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


def write_report(path: Path, introduction: Sequence[str], pages: Sequence[tuple[Section, Path]]
                 ) -> None:
    """Write the pages, each with its PNG file, into one file that needs no other."""
    path.write_text('\n'.join(_document(introduction, pages)) + '\n', encoding='utf-8')


def _document(introduction: Sequence[str], pages: Sequence[tuple[Section, Path]]) -> Iterator[str]:
    yield '<!DOCTYPE html>'
    yield '<html lang="en"><head><meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield f'<title>Figures and tables, computed anew</title><style>{STYLE}</style></head><body>'
    yield '<h1>Figures and tables, computed anew</h1>'
    for paragraph in introduction:
        yield f'<p>{escape(paragraph)}</p>'
    links = (f'<a href="#{page.name}">{escape(page.title.split(":")[0])}</a>'
             for page, _ in pages)
    yield f'<nav>{" ".join(links)}</nav>'
    for page, picture in pages:
        yield from _section(page, picture)
    yield '</body></html>'


def _section(page: Section, picture: Path) -> Iterator[str]:
    image = base64.b64encode(picture.read_bytes()).decode('ascii')
    yield f'<section id="{page.name}"><h2>{escape(page.title)}</h2>'
    yield f'<img alt="{escape(page.title)}" src="data:image/png;base64,{image}">'
    if page.rows:
        yield '<table><tr><th>quantity</th><th>paper</th><th>here</th></tr>'
        for row in page.rows:
            yield '<tr>' + ''.join(f'<td>{escape(cell)}</td>' for cell in row) + '</tr>'
        yield '</table>'
    for kind, sentences in (('agrees', page.agrees), ('differs', page.differs)):
        if sentences:
            label = 'Agrees' if kind == 'agrees' else 'Differs, or can not be compared'
            yield f'<div class="{kind}"><strong>{label}</strong>'
            yield from (f'<p>{escape(sentence)}</p>' for sentence in sentences)
            yield '</div>'
    yield '</section>'
