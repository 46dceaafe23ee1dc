# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Descriptions of topics and nodes: they agree with messages, parameters, source and document."""

from __future__ import annotations

import ast
from pathlib import Path
import re
from types import SimpleNamespace
from typing import Any

from draw_architecture import read_nodes
import pytest
from smart_tire.bags.cdr import empty
from smart_tire.estimation.streams import FRICTION, SLIP, Streams
from smart_tire.messages import ALL_TOPICS, TOPICS, TYPED
from smart_tire.messages.describe import (
    columns, describe, NODE_TABLE, publishers_of, subscribers_of, topic_lines, TOPIC_NAMES)
from smart_tire.messages.joint_state import GROUND_QUANTITIES
from smart_tire.parameters import NODE_PARAMS
from smart_tire.samples import FRICTION_QUANTITIES, WHEELS
from topics_page import (
    DEFINITIONS, described, DOCUMENT, GROUPS, MARKER, message_files, read_examples, same_fields,
    written)
import yaml

ROOT = Path(__file__).resolve().parents[1]
TEXT = DOCUMENT.read_text(encoding='utf-8')
EXAMPLES = read_examples()
TRANSFORMS = {'/tf', '/tf_static'}  # only where tf2_msgs is installed
CAMERA = [name for name in TOPIC_NAMES if name.startswith('overhead_camera/')]  # of megabytes
WITHOUT_EXAMPLE = {*TRANSFORMS, *CAMERA, *(topic.name for topic in TYPED.values()),
                   *(name for name in TOPIC_NAMES if same_fields(described(name)))}


def value_at(msg: Any, path: str) -> Any:
    """Return the part of a message at a path such as 'twist.twist.linear'."""
    for name in path.split('.'):
        msg = getattr(msg, name)
    return msg


def shape(value: Any) -> Any:
    """Return the names of the fields of a message, or of a mapping, with their order."""
    if isinstance(value, SimpleNamespace):
        value = vars(value)
    return {key: shape(inner) for key, inner in value.items()} if isinstance(value, dict) else None


def namespace(value: Any) -> Any:
    """Return a parsed example as a message."""
    if isinstance(value, dict):
        return SimpleNamespace(**{key: namespace(inner) for key, inner in value.items()})
    return [namespace(one) for one in value] if isinstance(value, list) else value


def parsed(name: str) -> Any:
    """Return the example of a topic; ``ros2 topic echo`` ends each message with ---."""
    message, nothing = yaml.safe_load_all(EXAMPLES[name.lstrip('/')])
    assert nothing is None
    return message


@pytest.mark.parametrize('name', [name for name in TOPIC_NAMES if name not in TRANSFORMS])
def test_every_described_field_is_in_the_message_and_described_once(name):
    topic = describe(name)
    msg = empty(topic.type)
    paths = [field.name for field in topic.fields]
    assert len(set(paths)) == len(paths)
    for path in paths:
        value_at(msg, path)


@pytest.mark.parametrize('name', TOPICS)
def test_every_field_that_carries_a_value_is_described(name):
    name = same_fields(described(name)) or name
    fields = [field.name for field in described(name).fields]
    filled, blank = namespace(parsed(name)), empty(TOPICS[name].type)

    def changed(path: str, value: Any, default: Any) -> list[str]:
        if isinstance(value, SimpleNamespace):
            return [found for key, inner in vars(value).items()
                    for found in changed(f'{path}.{key}', inner, getattr(default, key))]
        return [path[1:]] if value != default and value == value else []

    assert [path for path in changed('', filled, blank)
            if not path.startswith(('header', 'child_frame_id', 'present', 'orientation.w'))
            and not any(path == field or path.startswith(f'{field}.')
                        for field in fields)] == []


@pytest.mark.parametrize('name', [name for name in TOPIC_NAMES if name not in WITHOUT_EXAMPLE])
def test_every_topic_has_an_example_with_the_fields_of_its_message(name):
    assert shape(parsed(name)) == shape(empty(describe(name).type))


@pytest.mark.parametrize('name', [name for name in TOPICS if name not in WITHOUT_EXAMPLE])
def test_every_example_is_a_valid_message_with_the_documented_frame(name):
    topic, message = TOPICS[name], namespace(parsed(name))
    sample = topic.from_msg(message)
    assert message.header.frame_id == (topic.frame or sample.wheel)


def test_names_in_the_examples_are_those_described():
    for name, names in (
            ('wheel_states', WHEELS), ('wheel_slip', WHEELS),
            ('tire_friction', FRICTION_QUANTITIES), ('ground_state', GROUND_QUANTITIES)):
        assert tuple(parsed(name)['name']) == names
    for name in ('tire_friction', 'ground_state'):
        assert [field.name for field in described(name).quantities] == parsed(name)['name']
    text = described('wheel_states').fields[0].meaning
    assert all(f'`{wheel}`' in text for wheel in WHEELS)


def test_empty_fields_are_empty_in_the_examples():
    for name in TOPICS.keys() - WITHOUT_EXAMPLE:
        for field in described(name).fields:
            if field.meaning == 'empty':
                assert value_at(namespace(parsed(name)), field.name) == [], name


def test_every_number_has_a_unit():
    for name in TOPIC_NAMES:
        content = described(name)
        for field in (*content.fields, *content.quantities):
            assert field.unit or field.name in (
                'name', 'data', 'status', 'transforms', 'location', 'header.stamp', 'saturated',
                'encoding', 'format', 'distortion_model') \
                or field.meaning == 'empty' or content.quantities, (name, field.name)
        assert all(quantity.unit for quantity in content.quantities)


def test_the_document_is_current():
    assert written(TEXT) == TEXT, 'run docs/topics_page.py'
    assert MARKER in TEXT
    assert sorted(name for names in GROUPS.values() for name in names) == sorted(TOPIC_NAMES)


def test_the_definitions_of_messages_are_current():
    assert {path: path.read_text(encoding='utf-8') for path in DEFINITIONS.iterdir()} \
        == message_files(), 'run docs/topics_page.py'


@pytest.mark.parametrize('name', [topic.name for topic in TYPED.values()])
def test_every_field_of_a_typed_message_is_described(name):
    fields = {field.name for field in described(name).fields} | {'header'}
    assert fields - {'header.stamp'} == vars(empty(ALL_TOPICS[name].type)).keys()


def test_a_topic_is_described_with_any_namespace():
    assert describe('/robot/odom').name == 'odom'
    assert describe('ground_truth/odom').name == 'ground_truth/odom'
    assert describe('diagnostics').name == '/diagnostics'
    assert describe('/robot/motors_enabled').name == 'motors_enabled'
    assert describe('/robot/wheel_slip/typed').name == 'wheel_slip/typed'
    assert describe('/odometry') is None


def test_text_of_a_topic_has_every_field_with_its_unit_within_the_width():
    lines = list(topic_lines(describe('tire_friction'), indent='  ', width=70))
    assert lines[0] == '  tire_friction  [sensor_msgs/msg/JointState]'
    assert max(map(len, lines)) <= 70
    for quantity in described('tire_friction').quantities:
        assert any(line.strip().startswith(f'{quantity.name} [{quantity.unit}]')
                   for line in lines)
    assert '`' not in ''.join(lines)


def test_columns_wrap_texts_and_give_long_labels_a_line_of_their_own():
    assert list(columns([('a', 'one two'), ('bb', '')], ' ', 40)) == [' a   one two', ' bb']
    assert list(columns([('a' * 29, 'text')], '', 60)) == ['a' * 29, ' ' * 30 + 'text']
    assert list(columns([('a', 'word ' * 6)], '', 26)) == ['a  word word word word',
                                                           '   word word']


def test_the_table_of_nodes_agrees_with_the_architecture():
    rows = read_nodes((ROOT / 'docs' / 'architecture.md').read_text(encoding='utf-8'))
    assert {row.name for row in rows} == NODE_TABLE.keys() == NODE_PARAMS.keys()
    for row in rows:
        node = NODE_TABLE[row.name]
        assert set(node.subscribes) - TRANSFORMS == set(row.subscribes), row.name
        assert set(node.publishes) - TRANSFORMS == set(row.publishes), row.name
        assert {*node.subscribes, *node.publishes} <= set(TOPIC_NAMES)


@pytest.mark.parametrize(('name', 'streams'), [
    ('slip_estimator', SLIP), ('friction_estimator', FRICTION)])
def test_the_topics_of_the_estimators_are_those_of_their_streams(name, streams: Streams):
    node = NODE_TABLE[name]
    assert set(node.subscribes) == set(streams.inputs.values())
    assert set(node.publishes) - TRANSFORMS == set(streams.outputs.values())


@pytest.mark.parametrize('name', NODE_TABLE)
def test_services_are_those_that_the_node_creates(name):
    text = (ROOT / 'smart_tire' / 'nodes' / f'{name}.py').read_text(encoding='utf-8')
    tree = ast.parse(text)
    created = {(node.args[1].value, node.args[0].id) for node in ast.walk(tree)
               if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
               and node.func.attr == 'create_service'}
    created |= {(re.sub(r'(?<=.)([A-Z])', r'_\1', kind).lower(), kind)
                for kind in re.findall(r"installed_class\('\w+/action/(\w+)'\)", text)}
    assert {(service.name, service.type.rpartition('/')[2])
            for service in NODE_TABLE[name].services} == created


def test_publishers_and_subscribers_of_a_topic():
    assert publishers_of('odom') == ('slip_estimator',)
    assert publishers_of('/diagnostics') == tuple(NODE_TABLE)
    assert publishers_of('wheel_slip/typed') == ('slip_estimator',)
    assert publishers_of('tire_samples/typed') == ('tire_receiver',)
    assert publishers_of('cmd_vel') == ('trajectory_controller',)
    assert subscribers_of('motor_commands') == ('motor_driver',)
    assert describe('cmd_vel').publishers == 'user, navigation, trajectory_controller'
    assert describe('path').publishers == 'user, navigation'
    assert describe('/diagnostics').publishers == 'every node'
    assert describe('overhead/odom').publishers == 'overhead_localizer'
