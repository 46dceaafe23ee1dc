# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Sphinx extension: the reference of the command, written from its argument parsers.

Each page with ``MARKER`` gets the text of all verbs in its place.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
import re
from typing import Any

from smart_tire.cli.main import new_parser

MARKER = '<!-- verbs -->'


def verbs_text() -> str:
    """Return the reference of all verbs in Markdown."""
    return '\n'.join(line for verb, parser in _subparsers(new_parser()).items()
                     for line in _parser_lines(parser, f'smart_tire {verb}', 2))


def _subparsers(parser: argparse.ArgumentParser) -> dict[str, Any]:
    """Return name -> parser of the verbs or kinds of ``parser``."""
    return {name: inner for action in parser._actions
            if isinstance(action, argparse._SubParsersAction)
            for name, inner in action.choices.items()}


def _parser_lines(parser: argparse.ArgumentParser, title: str, level: int) -> Iterator[str]:
    """Yield heading, description, usage and arguments of a parser, and those of its kinds."""
    inner = _subparsers(parser)
    yield f'{"#" * level} {title}\n'
    if parser.description:
        yield f'{_sentence(parser.description)}\n'
    if not inner:
        usage = re.sub(r'\s+', ' ', parser.format_usage()).removeprefix('usage: ').strip()
        yield f'```text\n{_wrapped(usage)}\n```\n'
        yield '| argument | meaning |\n| --- | --- |'
        yield from (_row(action) for action in parser._actions
                    if action.help != argparse.SUPPRESS and action.dest != 'help')
        yield ''
    for name, kind in inner.items():
        yield from _parser_lines(kind, f'{title} {name}', level + 1)


def _sentence(text: str) -> str:
    """Return ``text`` with a capital letter and a full stop."""
    return _escaped(text[0].upper() + text[1:].rstrip('.') + '.')


def _row(action: argparse.Action) -> str:
    """Return the table row of an argument."""
    values = action.metavar or (
        '{' + ','.join(map(str, action.choices)) + '}' if action.choices
        else action.dest.upper() if action.nargs != 0 else '')
    value = ' '.join(values) if isinstance(values, tuple) else str(values)
    names = ', '.join(f'`{name} {value}`'.replace(' `', '`') for name in action.option_strings)
    expanded = (action.help or '') % {**vars(action), 'prog': 'smart_tire'}
    return f'| {names or f"`{value}`"} | {_escaped(expanded)} |'


def _escaped(text: str) -> str:
    """Return ``text`` without the special characters of Markdown."""
    return re.sub(r'([|*_<>$\[\]])', r'\\\1', text)


def _wrapped(usage: str, width: int = 95) -> str:
    """Return a usage line in lines of at most ``width`` characters."""
    lines = ['']
    for word in re.findall(r'\[(?:[^][]|\[[^]]*\])*\]|\S+', usage):
        if len(lines[-1]) + len(word) >= width:
            lines.append('   ')
        lines[-1] += f'{" " if lines[-1] else ""}{word}'
    return '\n'.join(lines)


def _insert(app: Any, docname: str, source: list[str]) -> None:
    """Write the verbs into a page with the marker."""
    source[0] = source[0].replace(MARKER, verbs_text())


def setup(app: Any) -> dict[str, bool]:
    """Fill pages as they are read."""
    app.connect('source-read', _insert)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
