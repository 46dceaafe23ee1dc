# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Description of topics and nodes for users: the text of ``topics.yaml``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any

from smart_tire.messages.topics import ALL_TOPICS, find_topic
from smart_tire.yaml_text import load_own

WIDTH = 99             # characters of a line
MAX_NAME_COLUMN = 28   # characters; longer names have a line of their own
FROM_USER = ('path', 'goal_pose', 'cmd_vel')  # published from outside of this package
DIAGNOSTICS = '/diagnostics'  # published by every node


@dataclass(frozen=True)
class DescribedField:
    """A field of a message, or a quantity in its list of names."""

    name: str     # path in the message, such as 'twist.twist.linear', or the name of a quantity
    unit: str     # '-' if dimensionless, '' if it is no number
    meaning: str


@dataclass(frozen=True)
class Described:
    """What a user reads about a topic."""

    name: str
    type: str  # noqa: A003
    rate: str
    frame: str          # header.frame_id in words; '' if there is none
    publishers: str
    subscribers: str
    summary: str
    fields: tuple[DescribedField, ...]
    quantities: tuple[DescribedField, ...]  # of a JointState that lists quantities by name


@dataclass(frozen=True)
class Service:
    """A service of a node."""

    name: str
    type: str  # noqa: A003
    meaning: str
    condition: str = ''  # under which the node offers it


@dataclass(frozen=True)
class NodeEntry:
    """One node; its topics are names in ``TOPIC_NAMES``."""

    name: str
    purpose: str
    subscribes: tuple[str, ...] = ()
    publishes: tuple[str, ...] = ()
    services: tuple[Service, ...] = ()


def _node(name: str, purpose: str, services: dict[str, Any] | None = None,
          **topics: list[str]) -> NodeEntry:
    return NodeEntry(name, purpose, services=tuple(
        Service(service, **entry) for service, entry in (services or {}).items()),
        **{role: tuple(names) for role, names in topics.items()})


_TEXT = load_own(Path(__file__).with_name('topics.yaml').read_text(encoding='utf-8'))
TOPIC_NAMES = tuple(_TEXT['topics'])
STATE_TOPICS = tuple(name for name in TOPIC_NAMES if name not in ALL_TOPICS)  # without samples
NODE_TABLE = {name: _node(name, **entry) for name, entry in _TEXT['nodes'].items()}


def publishers_of(topic: str) -> tuple[str, ...]:
    """Return the nodes that publish ``topic``."""
    standard = ALL_TOPICS[topic].standard if topic in ALL_TOPICS else topic
    return tuple(node.name for node in NODE_TABLE.values()
                 if standard in (*node.publishes, DIAGNOSTICS))


def subscribers_of(topic: str) -> tuple[str, ...]:
    """Return the nodes that subscribe to ``topic``."""
    return tuple(node.name for node in NODE_TABLE.values() if topic in node.subscribes)


def describe(name: str) -> Described | None:
    """Return the description of a topic, also with a namespace; None if it is not known."""
    state = next((state for state in STATE_TOPICS
                  if f'/{name}'.endswith('/' + state.strip('/'))), None)
    if state is not None:
        return _described(state)
    if (topic := find_topic(name)) is None:
        return None
    return _described(topic.name, topic.type, f'{topic.rate:g} Hz',
                      topic.frame or 'name of the wheel')


def _described(name: str, kind: str = '', rate: str = '', frame: str = '') -> Described:
    """Return the text of a topic; ``kind``, ``rate`` and ``frame`` where it gives none."""
    text = _TEXT['topics'][name]
    return Described(
        name, text.get('type', kind), text.get('rate', rate), text.get('frame', frame),
        text.get('publishers', _publishers(name)), ', '.join(subscribers_of(name)),
        text['summary'], _fields(text['fields']), _fields(text.get('quantities', {})))


def _fields(texts: dict[str, str]) -> tuple[DescribedField, ...]:
    labels = (label.removesuffix(']').partition(' [') for label in texts)
    return tuple(DescribedField(name, unit, meaning)
                 for (name, _, unit), meaning in zip(labels, texts.values()))


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
    yield from paragraph(topic.summary, inner, width)
    yield from paragraph(f'rate: {topic.rate}', inner, width)
    if topic.frame:
        yield f'{inner}header.frame_id: {topic.frame}'
    yield from field_lines(topic.fields, inner, width)
    if topic.quantities:
        yield f'{inner}Quantities, by name:'
        yield from field_lines(topic.quantities, inner + '  ', width)


def field_lines(fields: Iterable[DescribedField], indent: str,
                width: int = WIDTH) -> Iterator[str]:
    """Yield a line per field, its meaning wrapped in a column of its own."""
    return columns([(field.name + (f' [{field.unit}]' if field.unit else ''), field.meaning)
                    for field in fields], indent, width)


def columns(rows: Sequence[tuple[str, str]], indent: str, width: int = WIDTH) -> Iterator[str]:
    """Yield lines in two columns: labels, and wrapped texts."""
    column = min(MAX_NAME_COLUMN, max((len(label) for label, _ in rows), default=0)) + 2
    for label, text in rows:
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
