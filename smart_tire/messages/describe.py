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

"""Description of topics as text for a terminal, from ``TOPICS``, ``STATE_TOPICS`` and nodes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from textwrap import wrap

from smart_tire.messages.contents import Content, Field
from smart_tire.messages.node_table import NODE_TABLE, publishers_of, subscribers_of
from smart_tire.messages.states import STATE_TOPICS, StateTopic
from smart_tire.messages.topics import find_topic, Topic, TOPICS

WIDTH = 99             # characters of a line
MAX_NAME_COLUMN = 28   # characters; longer names have a line of their own
FROM_USER = ('path', 'goal_pose', 'cmd_vel')  # published from outside of this package
TOPIC_NAMES = (*TOPICS, *STATE_TOPICS)


@dataclass(frozen=True)
class Described:
    """What a user reads about a topic."""

    name: str
    type: str  # noqa: A003
    rate: str
    frame: str          # header.frame_id in words; '' if there is none
    publishers: str
    subscribers: str
    content: Content


def describe(name: str) -> Described | None:
    """Return the description of a topic, also with a namespace; None if it is not known."""
    topic = _find_state(name) or find_topic(name)
    if topic is None:
        return None
    content = topic.content
    if isinstance(topic, Topic):
        rate, frame = content.rate or f'{topic.rate:g} Hz', topic.frame or 'name of the wheel'
    else:
        rate, frame = content.rate, topic.frame or ''
    return Described(topic.name, topic.type, rate, frame, _publishers(topic.name),
                     ', '.join(subscribers_of(topic.name)), content)


def _find_state(name: str) -> StateTopic | None:
    return next((topic for topic in STATE_TOPICS.values()
                 if f'/{name}'.endswith('/' + topic.name.strip('/'))), None)


def _publishers(topic: str) -> str:
    nodes = publishers_of(topic)
    if topic in FROM_USER:
        return ', '.join(('user', 'navigation', *nodes))
    return 'every node' if len(nodes) == len(NODE_TABLE) else ', '.join(nodes) or 'recordings'


def plain(text: str) -> str:
    """Return ``text`` without the backquotes of literal names."""
    return text.replace('`', '')


def topic_lines(topic: Described, *, indent: str = '', width: int = WIDTH) -> Iterator[str]:
    """Yield the lines that describe ``topic``: summary, rate, frame, fields and quantities."""
    yield f'{indent}{topic.name}  [{topic.type}]'
    inner = indent + '    '
    yield from paragraph(topic.content.summary, inner, width)
    yield from paragraph(f'rate: {topic.rate}', inner, width)
    if topic.frame:
        yield f'{inner}header.frame_id: {topic.frame}'
    yield from field_lines(topic.content.fields, inner, width)
    if topic.content.quantities:
        yield f'{inner}Quantities, by name:'
        yield from field_lines(topic.content.quantities, inner + '  ', width)


def field_lines(fields: tuple[Field, ...], indent: str, width: int = WIDTH) -> Iterator[str]:
    """Yield a line per field, its meaning wrapped in a column of its own."""
    labels = [field.name + (f' [{field.unit}]' if field.unit else '') for field in fields]
    rows = zip(labels, (field.meaning for field in fields))
    yield from columns(rows, indent, width)


def columns(rows: Iterator[tuple[str, str]] | list[tuple[str, str]], indent: str,
            width: int = WIDTH) -> Iterator[str]:
    """Yield lines in two columns: labels, and wrapped texts."""
    table = list(rows)
    column = min(MAX_NAME_COLUMN, max((len(label) for label, _ in table), default=0)) + 2
    for label, text in table:
        lines = wrap(plain(text), max(20, width - len(indent) - column)) or ['']
        if len(label) > column - 2:
            yield indent + label
        else:
            lines[0] = f'{label:{column}}{lines[0]}'
        for number, line in enumerate(lines):
            shifted = number or len(label) > column - 2
            yield (indent + ' ' * column * bool(shifted) + line).rstrip()


def paragraph(text: str, indent: str, width: int = WIDTH) -> Iterator[str]:
    """Yield the wrapped lines of ``text``."""
    yield from wrap(plain(text), width, initial_indent=indent, subsequent_indent=indent)
