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
The tables of ``docs/topics.md`` and ``smart_tire_msgs/msg/`` from the topics of the package.

Run it after a change of ``smart_tire/messages``: it writes the overview between the markers of the
document, and the definitions of messages; a test checks that they are current. As a Sphinx
extension it writes the fields of all topics in the place of ``MARKER``, with the examples in
``docs/topic_examples.yaml``. ``python docs/topics_page.py BAG`` takes new ones from BAG, as
``ros2 topic echo --flow-style`` prints them, and requires a ROS distribution.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
import re
import sys
from typing import Any

from smart_tire.messages.describe import describe, Described, DescribedField, NODE_TABLE, paragraph
from smart_tire.messages.topics import TOPICS, TYPED
from smart_tire.messages.typed import definitions, ESTIMATE, PACKAGE

DOCUMENT = Path(__file__).parent / 'topics.md'
EXAMPLES = DOCUMENT.with_name('topic_examples.yaml')
DEFINITIONS = DOCUMENT.parents[1] / PACKAGE / 'msg'
MARKER = '<!-- fields -->'
GROUPS = {  # marker in the document -> topics of its table
    'measurements': [name for name, topic in TOPICS.items() if topic.quality == 'sensor'],
    'estimates': ['odom', '/tf', '/tf_static', 'wheel_slip', 'icr', 'ground_state',
                  'tire_friction', 'friction_map', 'film_deflection'],
    'commands': ['path', 'goal_pose', 'path_progress', 'cmd_vel', 'wheel_commands',
                 'motor_commands', 'emergency_stop_active', 'motors_enabled', '/diagnostics'],
    'camera': ['overhead_camera/image_raw', 'overhead_camera/image_raw/compressed',
               'overhead_camera/camera_info'],
    'reference': [name for name, topic in TOPICS.items() if topic.quality == 'truth'],
    'typed': [topic.name for topic in TYPED.values()]}
HEADER = '| topic | type | publisher | rate | content |\n| --- | --- | --- | --- | --- |'
EXAMPLE = re.compile(r'^# (\S+)\n(.*?^---\n)', re.MULTILINE | re.DOTALL)
EMPTY = 'empty'  # meaning of a field that no message fills
ESTIMATED = Described('', ESTIMATE, '', '', '', '', 'an estimated quantity', (
    DescribedField('value', '', 'in the unit of the quantity; NaN if it is not observable'),
    DescribedField('sigma', '',
                   'standard deviation in the same unit; infinite if value is NaN')), ())
EXAMPLE_TIME_NS = 12_000_000_000  # ns after the start of the bag, on the first leg of the demo
PREFERRED_NODE = 'slip_estimator'  # of which to show the diagnostics
IN_BLOCK_STYLE = ('diagnostics',)  # nested lists are not readable on one line


def described(name: str) -> Described:
    """Return the description of a topic that is known to exist."""
    topic = describe(name)
    assert topic is not None, name
    return topic


def anchor(name: str) -> str:
    """Return the anchor of a heading as GitHub makes it."""
    return re.sub(r'[^\w\- ]', '', name.lower())


def cell(text: str) -> str:
    """Return ``text`` for a cell of a table."""
    return text.replace('|', '\\|')


def overview(names: Iterable[str]) -> str:
    """Return the table of topics."""
    rows = [HEADER]
    for topic in map(described, names):
        rows.append(f'| `{topic.name}` | `{topic.type}` | '
                    f'{topic.publishers} | {cell(topic.rate)} | {cell(topic.summary)} |')
    return '\n'.join(rows)


def services() -> str:
    """Return the table of services."""
    rows = ['| service | type | node | effect |\n| --- | --- | --- | --- |']
    for node in NODE_TABLE.values():
        for service in node.services:
            condition = f', {service.condition}' if service.condition else ''
            rows.append(f'| `{service.name}` | `{service.type}` | `{node.name}`{condition} | '
                        f'{cell(service.meaning)} |')
    return '\n'.join(rows)


def field_table(fields: Iterable[DescribedField], title: str) -> str:
    """Return the table of fields or quantities."""
    rows = [f'| {title} | unit | meaning |', '| --- | --- | --- |']
    rows += [f'| `{field.name}` | {field.unit} | {cell(field.meaning)} |' for field in fields
             if field.meaning != EMPTY]
    return '\n'.join(rows)


def same_fields(topic: Described) -> str | None:
    """Return the first topic of the document with the same fields, if it is another one."""
    first = next(name for names in GROUPS.values() for name in names
                 if described(name).fields == topic.fields)
    return None if first == topic.name else first


def details(examples: dict[str, str]) -> str:
    """Return a section for each topic: fields, quantities and an example."""
    return '\n\n'.join('\n\n'.join(_section(described(name), examples))
                       for names in GROUPS.values() for name in names)


def _section(topic: Described, examples: dict[str, str]) -> Iterator[str]:
    summary = topic.summary
    frame = f' `header.frame_id`: {topic.frame}.' if topic.frame else ''
    subscribers = f' Subscribers: {topic.subscribers}.' if topic.subscribers else ''
    empty = ', '.join(f'`{field.name}`' for field in topic.fields if field.meaning == EMPTY)
    yield f'### {topic.name}'
    text = f'{summary[0].upper()}{summary[1:]}.{frame}{subscribers}'
    if (other := same_fields(topic)) is not None:
        yield f'{text} Fields as in [`{other}`](#{anchor(other)}).'
        return
    yield text + (f' Empty: {empty}.' if empty else '')
    yield field_table(topic.fields, 'field')
    if topic.quantities:
        yield field_table(topic.quantities, 'quantity')
    if (example := examples.get(topic.name.lstrip('/'))) is not None:
        yield f'```yaml\n{example}```'


def written(text: str) -> str:
    """Return the text of the document with new tables."""
    parts = {**{name: overview(topics) for name, topics in GROUPS.items()},
             'services': services()}
    for name, content in parts.items():
        begin, end = f'<!-- begin {name} -->', f'<!-- end {name} -->'
        before, found, rest = text.partition(begin)
        if not found or end not in rest:
            raise ValueError(f'{DOCUMENT.name} lacks the markers {begin} and {end}')
        text = f'{before}{begin}\n{content}\n{end}{rest.partition(end)[2]}'
    return text


def message_files() -> dict[Path, str]:
    """Return file -> definition of a message of ``smart_tire_msgs``, with comments."""
    types = {topic.type: described(topic.name) for topic in reversed(TYPED.values())}
    return {DEFINITIONS / f'{kind.rpartition("/")[2]}.msg': '\n'.join(
                _definition(text, ESTIMATED if kind == ESTIMATE else types[kind])) + '\n'
            for kind, text in definitions().items()}


def _definition(text: str, topic: Described) -> Iterator[str]:
    """Yield the lines of a definition: what the message is, then the fields with comments."""
    comments = {field.name: f'[{field.unit}] {field.meaning}' if field.unit else field.meaning
                for field in topic.fields}
    if topic.name:
        comments['header'] = (f'frame_id: {topic.frame or "the wheel"}; stamp: '
                              + comments.get('header.stamp', 'instant of the estimate'))
    yield from paragraph(f'{topic.summary[0].upper()}{topic.summary[1:]}.', '# ')
    yield '# Written by docs/topics_page.py of smart_tire. Units in brackets; axes as in REP-103.'
    for line in text.splitlines():
        name = line.split()[1]
        if name in comments or name.endswith('=0'):
            yield ''
        if name in comments:
            yield from paragraph(comments[name], '# ')
        yield line


def read_examples() -> dict[str, str]:
    """Return topic -> example."""
    return dict(EXAMPLE.findall(EXAMPLES.read_text(encoding='utf-8')))


def write_examples(examples: dict[str, str]) -> None:
    """Write the examples of topics whose fields the document describes."""
    names = [name for names in GROUPS.values() for name in names
             if name.lstrip('/') in examples and same_fields(described(name)) is None]
    EXAMPLES.write_text(''.join(
        f'# {name.lstrip("/")}\n{examples[name.lstrip("/")]}' for name in names),
        encoding='utf-8')
    print(f'{EXAMPLES.name}: {", ".join(names)}')


def recorded_examples(path: Path) -> dict[str, str]:
    """Return topic -> a message of the bag at ``path``, as ``ros2 topic echo`` prints it."""
    from rclpy.serialization import deserialize_message
    from rosidl_runtime_py import message_to_yaml

    from smart_tire.bags import Bag
    from smart_tire.nodes.compat import message_class
    found: dict[str, str] = {}
    with Bag(path) as bag:
        begin_ns = bag.span_ns[0] + EXAMPLE_TIME_NS
        for receive_ns, channel, data in bag.raw():
            name = channel.topic.strip('/')
            if receive_ns < begin_ns or name in found:
                continue
            if describe(channel.topic) is not None:
                msg: Any = deserialize_message(data, message_class(channel.type))
                if name != 'diagnostics' or msg.status[0].name == PREFERRED_NODE:
                    found[name] = message_to_yaml(
                        msg, flow_style=name not in IN_BLOCK_STYLE) + '---\n'
    return found


def main(words: list[str]) -> None:
    """Write document and definitions, and the examples from the bag in ``words``, if any."""
    if words:
        write_examples(read_examples() | recorded_examples(Path(words[0])))
    DOCUMENT.write_text(written(DOCUMENT.read_text(encoding='utf-8')), encoding='utf-8')
    for path, text in message_files().items():
        path.write_text(text, encoding='utf-8')


def _insert(app: Any, docname: str, source: list[str]) -> None:
    """Write the fields of all topics into a page with the marker."""
    if MARKER in source[0]:
        source[0] = source[0].replace(MARKER, details(read_examples()))


def setup(app: Any) -> dict[str, bool]:
    """Fill pages as they are read."""
    app.connect('source-read', _insert)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}


if __name__ == '__main__':
    main(sys.argv[1:])
