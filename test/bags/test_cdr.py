# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Messages without ROS: definitions, encoder and decoder."""

from __future__ import annotations

from functools import partial
from importlib import import_module

from hypothesis import given, settings, strategies as st
from hypothesis.extra import numpy as arrays
import numpy as np
import pytest
from rosbags.interfaces import Nodetype
from smart_tire.bags.cdr import (
    Decoder, definition, empty, Encoder, NUMBERS, SampleDecoder, SampleEncoder, typestore)
from smart_tire.errors import MessageError
from smart_tire.messages import cdr, TOPICS
from smart_tire.messages.joint_names import LAYOUT_CACHE_SIZE
from smart_tire.recording import Faults
from support.samples import SAMPLES

JOINTS = 'sensor_msgs/msg/JointState'
TYPES = sorted({topic.type for topic in TOPICS.values()})
FREQUENT = sorted(cdr.FIELDS)
NAMES = st.lists(st.text(st.characters(min_codepoint=1, codec='utf-8'), max_size=9), max_size=4)
LISTS = (Nodetype.ARRAY, Nodetype.SEQUENCE)
BOUNDS = {'float32': {'width': 32}, 'float64': {'width': 64}}


def fields_of(type_name):
    """Return name and kind of the fields of a type."""
    return typestore().fielddefs[type_name][1]


@st.composite
def messages(draw, type_name):
    """Draw a message of any type of the contract."""
    msg = empty(type_name)
    for name, kind in fields_of(type_name):
        setattr(msg, name, draw(values(kind)))
    return msg


def values(kind):
    """Return a strategy for the values of a field."""
    node, what = kind
    if node == Nodetype.NAME:
        return messages(what)
    if node == Nodetype.BASE:
        return NAMES.map(''.join) if what[0] == 'string' else scalars(what[0])
    item, length = what
    if item[0] == Nodetype.NAME:
        return st.lists(messages(item[1]), max_size=3)
    if item[1][0] == 'string':
        return NAMES
    return arrays.arrays(item[1][0], length if node == Nodetype.ARRAY else st.integers(0, 5),
                         elements=scalars(item[1][0]))


def scalars(kind):
    """Return a strategy for numbers of a kind."""
    if kind in BOUNDS:
        return st.floats(**BOUNDS[kind])
    if kind == 'bool':
        return st.booleans()
    info = np.iinfo(kind)
    return st.integers(int(info.min), int(info.max))


def same(type_name, one, other):
    """Return whether two messages are equal; NaN equals NaN."""
    for name, (node, what) in fields_of(type_name):
        a, b = getattr(one, name), getattr(other, name)
        if node == Nodetype.NAME:
            if not same(what, a, b):
                return False
        elif node in LISTS and what[0][0] == Nodetype.NAME:
            if len(a) != len(b) or not all(map(partial(same, what[0][1]), a, b)):
                return False
        elif isinstance(a, (str, list)) or (node != Nodetype.BASE and what[0][1][0] == 'string'):
            if list(a) != list(b):
                return False
        elif not np.array_equal(np.asarray(a), np.asarray(b), equal_nan=True):
            return False
    return True


@pytest.mark.parametrize('type_name', TYPES)
@given(data=st.data(), little=st.booleans())
@settings(max_examples=20)
def test_messages_are_decoded_as_they_were_encoded(type_name, data, little):
    msg = data.draw(messages(type_name))
    raw = bytes(typestore().serialize_cdr(msg, type_name, little_endian=little))
    assert same(type_name, Decoder(type_name)(raw), msg)


@pytest.mark.parametrize('rest', [b'\x00' * 4, b'\xff' * 11])
def test_trailing_bytes_are_ignored(rest):
    msg = empty(JOINTS)
    msg.name, msg.position = ['a', 'b'], [1.0, 2.0]
    assert list(Decoder(JOINTS)(Encoder(JOINTS)(msg) + rest).position) == [1.0, 2.0]


@pytest.mark.parametrize('type_name', TYPES)
def test_a_truncated_message_is_rejected_at_any_length(type_name):
    raw, decode = Encoder(type_name)(empty(type_name)), Decoder(type_name)
    assert decode(raw) is not None
    for size in range(len(raw)):
        with pytest.raises(MessageError, match=type_name):
            decode(raw[:size])


@pytest.mark.parametrize('raw', [
    b'', b'\x00', b'\x00\x02\x00\x00' + bytes(60), b'\x00\x07\x00\x00' + bytes(60),
    b'\x00\x01\x00\x00' + bytes(8) + b'\xff\xff\xff\xff' + bytes(60),
    b'\x00\x01\x00\x00' + bytes(8) + b'\x01\x00\x00\x00\x00\x00\x00\x00\xff\xff\xff\x7f',
    b'\x00\x01\x00\x00' + bytes(8) + b'\x04\x00\x00\x00base'],
    ids=['empty', 'short', 'parameter list', 'second version', 'long string', 'many names',
         'string without end'])
def test_data_that_is_not_plain_cdr_is_rejected(raw):
    with pytest.raises(MessageError, match=JOINTS):
        Decoder(JOINTS)(raw)


def refuse(data):
    pytest.fail(f'{data.hex()} is not understood')


@pytest.mark.parametrize('type_name', FREQUENT)
@given(data=st.data(), little=st.booleans())
@settings(max_examples=20)
def test_frequent_messages_are_those_of_rosbags(type_name, data, little):
    read, write = cdr.LayoutDecoder(type_name, refuse), cdr.LayoutEncoder(type_name)
    for _ in range(2):  # layouts of the first message are used again
        msg = data.draw(messages(type_name))
        raw = bytes(typestore().serialize_cdr(msg, type_name, little_endian=little))
        assert same(type_name, read(raw), msg)
        assert same(type_name, read(raw + b'\x55' * 4), msg)
        if little:
            assert write(msg) == raw
            assert write(read(raw)) == raw


def named(*names):
    msg = empty(JOINTS)
    msg.name, msg.position = list(names), np.arange(len(names), dtype=float)
    return Encoder(JOINTS)(msg)


def test_layouts_of_one_size_are_distinguished_and_their_number_is_bounded():
    read = cdr.LayoutDecoder(JOINTS, refuse)
    names = [f'{i:04d}' for i in range(3 * LAYOUT_CACHE_SIZE)]
    for name in names + names:
        assert tuple(read(named(name)).name) == (name,)
    write = cdr.LayoutEncoder(JOINTS)
    for name in names:
        write.msg.name, write.msg.position = [name], (0.0,)
        assert write(write.msg) == named(name)
    assert sum(map(len, read._layouts.values())) <= LAYOUT_CACHE_SIZE
    assert len(write._layouts) <= LAYOUT_CACHE_SIZE


@pytest.mark.parametrize('type_name', FREQUENT)
def test_other_bytes_are_left_to_another_reader(type_name):
    raw = Encoder(type_name)(empty(type_name))
    read = cdr.LayoutDecoder(type_name, lambda data: data)
    assert read(raw) is not raw
    for size in range(len(raw)):
        assert read(raw[:size]) == raw[:size]
    second = b'\x00\x07' + raw[2:]
    assert read(second) is second
    size = cdr.HEADER_SIZE + 8
    unterminated = raw[:size] + b'\x01\x00\x00\x00a' + raw[size + 5:]
    assert read(unterminated) is unterminated


@pytest.mark.parametrize('topic', TOPICS.values(), ids=lambda topic: topic.name)
def test_the_bytes_of_rclpy_are_read_and_ours_are_read_by_it(topic):
    serialization = pytest.importorskip('rclpy.serialization')
    package, kind, name = topic.type.split('/')
    cls = getattr(import_module(f'{package}.{kind}'), name)
    sample = next(sample for sample in SAMPLES if isinstance(sample, topic.sample))
    theirs = serialization.serialize_message(topic.to_msg(cls(), sample))
    assert [*SampleDecoder(topic.name, Faults())(theirs)] == [sample]
    ours = SampleEncoder(topic)(sample)
    assert topic.from_msg(serialization.deserialize_message(ours, cls)) == sample


@pytest.mark.parametrize('topic', [
    topic for topic in TOPICS.values() if topic.sample in NUMBERS], ids=lambda topic: topic.name)
def test_estimates_encoded_by_their_numbers_are_those_encoded_by_messages(topic):
    encode, encode_msg = SampleEncoder(topic), Encoder(topic.type)
    rng, (sample,) = np.random.default_rng(0), (
        one for one in SAMPLES if type(one) is topic.sample)
    for stamp_ns in (sample.stamp_ns, 0, -1, 2**60):
        values = {name: tuple(rng.normal(size=len(value)).tolist())
                  if isinstance(value := getattr(sample, name), tuple) else rng.normal()
                  for name in sample.__dataclass_fields__}
        sample = topic.sample(**values | {'stamp_ns': stamp_ns})
        assert encode(sample) == encode_msg(topic.to_msg(empty(topic.type), sample))


@pytest.mark.parametrize('type_name', TYPES)
def test_a_definition_contains_all_nested_types(type_name):
    text, type_hash = definition(type_name)
    assert type_hash.startswith('RIHS01_')
    assert 'MSG: std_msgs/Header' in text
    assert 'MSG: builtin_interfaces/Time' in text


def test_type_hashes_equal_those_of_ros():
    # As `ros2 topic info -v` of Jazzy prints it.
    assert definition('builtin_interfaces/msg/Time')[1] == (
        'RIHS01_b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197')


def test_an_unknown_type_has_no_definition():
    assert definition('strange_msgs/msg/Thing') == ('', '')


def changed(rng, topic, sample):
    """Return the message of a sample in which, at times, one number is not what it should be."""
    msg = empty(TOPICS[topic].type)
    TOPICS[topic].to_msg(msg, sample)
    number = rng.choice([0.0, np.nan, np.inf, -np.inf, 1e3, -1.0, 1e-9])
    where = rng.integers(8)
    if topic == 'tire_samples':
        msg.header.frame_id = str(rng.choice(['front_left', 'rear_right', 'base_link']))
        msg.name = [f'{msg.header.frame_id}_pvdf_{film}' for film in rng.permutation([1, 2])]
        volts = [1.2, 1.3, number, 1.6]
        msg.position = volts[:2] if where > 1 else volts[1:2 + where]
    else:
        part = str(rng.choice(['linear_acceleration', 'angular_velocity', 'orientation']))
        if where < 2:
            setattr(getattr(msg, part), str(rng.choice(['x', 'z'])), number)
        elif where == 2:
            setattr(msg, f'{part}_covariance', [-1.0, *[0.0] * 8])
        elif where == 3:
            msg.orientation.x, msg.orientation.w = (0.0, 0.6), (0.0, 0.8)[rng.integers(2)]
            msg.orientation.x = msg.orientation.w
    msg.header.stamp.sec = int(rng.integers(-2**31, 2**31))
    msg.header.stamp.nanosec = int(rng.choice([0, 999_999_999, 1_000_000_000]))
    return Encoder(TOPICS[topic].type)(msg)


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('topic', ['tire_samples', 'imu/data'])
def test_messages_decoded_together_are_those_decoded_one_by_one(topic, seed):
    rng = np.random.default_rng(seed)
    sample = next(one for one in SAMPLES if type(one) is TOPICS[topic].sample)
    data = [changed(rng, topic, sample) for _ in range(300)]
    data += [data[0][:-9], data[1] + bytes(3), b'', data[2] + bytes(3)]
    one_by_one, together = Faults(), Faults()
    read, read_block = (SampleDecoder(topic, faults) for faults in (one_by_one, together))
    expected = [read(one) for one in data]
    assert read_block.block(data) == [None] * len(data)  # no layout is known yet
    for one in data:
        read_block(one)  # as ``read`` did
    for faults in (one_by_one, together):
        for counter in (faults.rejected, faults.contradictions, *faults.frames.values()):
            counter.clear()
        faults.reasons.clear()
    for one in data:
        read(one)
    block = read_block.block(data)
    assert 30 < sum(one is not None for one in block) < len(data)
    found = [read_block(one) if known is None else (known,) for one, known in zip(data, block)]
    assert repr(found) == repr(expected)
    assert one_by_one == together
