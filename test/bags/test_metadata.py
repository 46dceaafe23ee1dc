# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Metadata of bags: what is written, what is read of invalid ones, and the text of losses."""

from __future__ import annotations

import pytest
from smart_tire.bags.metadata import (
    Channel, Contents, Losses, Metadata, metadata_in, metadata_text, Qos, qos_text, read_metadata,
    Span, write_metadata)
from smart_tire.errors import BagError
from support.yaml_attacks import ATTACKS
import yaml

FOREVER = {'sec': 9223372036, 'nsec': 854775807}


def test_losses_are_one_line_and_counted_once():
    losses = Losses()
    assert losses.lines() == []
    for reason in 'aabcde':
        losses.add(reason, 2)
    assert losses.lines() == ['10 messages or more are missing: a; b; c; and 2 more']
    losses.missing = 11
    assert losses.lines() == ['11 messages or more are missing: a; b; c; and 2 more']
    unknown = Losses()
    unknown.add('a')
    assert unknown.lines() == ['messages are missing: a']
    for reason in 'bc':
        unknown.add(reason)
    assert unknown.lines() == ['messages are missing: a; b; c']


def test_a_span_covers_messages_in_any_order():
    span = Span()
    assert span.entries() == {'duration': {'nanoseconds': 0}, 'message_count': 0,
                              'starting_time': {'nanoseconds_since_epoch': 9223372036854775807}}
    for ns in (50, 20, 70, 30):
        span.add(ns)
    assert span.entries() == {'duration': {'nanoseconds': 50}, 'message_count': 4,
                              'starting_time': {'nanoseconds_since_epoch': 20}}
    assert Span(1, 5, 5).entries()['duration'] == {'nanoseconds': 0}
    assert Span(1, 6, 5).entries()['duration'] == {'nanoseconds': 0}


def test_profiles_are_written_as_rosbag2_does():
    assert qos_text([]) == ''
    profile, other = yaml.safe_load(qos_text([Qos('best_effort', 'transient_local', 7), Qos()]))
    assert profile == {
        'history': 'keep_last', 'depth': 7, 'reliability': 'best_effort',
        'durability': 'transient_local', 'deadline': FOREVER, 'lifespan': FOREVER,
        'liveliness': 'automatic', 'liveliness_lease_duration': FOREVER,
        'avoid_ros_namespace_conventions': False}
    assert other == {**profile, 'depth': 10, 'reliability': 'reliable', 'durability': 'volatile'}
    assert '&' not in qos_text([Qos(), Qos()])  # no aliases, which other parsers lack


CONTENTS = Contents(
    'jazzy', {'a_0.mcap': Span(3, 5, 9), 'a_1.mcap': Span(1, 12, 12)},
    {Channel('/a', 'a/msg/A', qos=qos_text([Qos()]), type_hash='RIHS01_0'): 3,
     Channel('/b', 'b/msg/B', 'json', qos='[{'): 1}, {'key': 'one\ntwo'})


def test_all_contents_are_in_the_file(tmp_path):
    write_metadata(tmp_path, CONTENTS)
    assert [path.name for path in tmp_path.iterdir()] == ['metadata.yaml']
    entry = yaml.safe_load((tmp_path / 'metadata.yaml').read_text())[
        'rosbag2_bagfile_information']
    assert entry == yaml.safe_load(metadata_text(CONTENTS))
    first, second = entry['topics_with_message_count']
    assert (first['message_count'], second['message_count']) == (3, 1)
    assert second['topic_metadata'] == {
        'name': '/b', 'type': 'b/msg/B', 'serialization_format': 'json',
        'offered_qos_profiles': [], 'type_description_hash': ''}
    assert first['topic_metadata']['offered_qos_profiles'][0]['depth'] == 10
    assert first['topic_metadata']['type_description_hash'] == 'RIHS01_0'
    assert entry['files'] == [
        {'path': name, **span.entries()} for name, span in CONTENTS.files.items()]
    assert entry['message_count'] == 4 and entry['version'] == 9
    assert (entry['compression_format'], entry['compression_mode']) == ('', '')
    assert read_metadata(tmp_path) == metadata_in(metadata_text(CONTENTS)) == Metadata(
        ('a_0.mcap', 'a_1.mcap'), 4, 'jazzy', {'key': 'one\ntwo'})


@pytest.mark.parametrize('text', [
    'keep last', '3', '{depth: 7}', '[7]', '[{depth: 7}, 7]', '- &a {depth: *a}',
    '- !!python/name:os', '[' * 100_000, '- depth: \0',
    *(data.decode(errors='replace') for data in ATTACKS.values())])
def test_profiles_that_no_recorder_has_written_are_left_out(text):
    contents = Contents(counts={Channel('/a', 'a/msg/A', qos=text): 1})
    entry, = yaml.safe_load(metadata_text(contents))['topics_with_message_count']
    assert entry['topic_metadata']['offered_qos_profiles'] == []


def test_keys_are_in_the_order_of_rosbag2():
    entry = yaml.safe_load(metadata_text(Contents()))
    assert list(entry) == [
        'version', 'storage_identifier', 'duration', 'starting_time', 'message_count',
        'topics_with_message_count', 'compression_format', 'compression_mode',
        'relative_file_paths', 'files', 'custom_data', 'ros_distro']
    assert entry['custom_data'] is None


@pytest.mark.parametrize(('text', 'found'), [
    ('{', Metadata()), ('- a', Metadata()), ('', Metadata()),
    ('{relative_file_paths: [bag/a.db3, 3, b.db3], message_count: 7}',
     Metadata(('a.db3', 'b.db3'), 7)),
    ('{relative_file_paths: [a.db3, b.db3, a.db3]}', Metadata(('a.db3', 'b.db3'))),
    ('{ros_distro: !!str humble}', Metadata()), ('{custom_data: &a {a: *a}}', Metadata()),
    ('{relative_file_paths: a, message_count: b, ros_distro: 3, custom_data: [c]}', Metadata()),
    ('{ros_distro: humble, custom_data: {a: b, 1: 2, c: [3], d: 0.5}}',
     Metadata((), 0, 'humble', {'a': 'b', '1': '2', 'd': '0.5'}))])
def test_invalid_parts_of_metadata_are_ignored(text, found):
    assert metadata_in(text) == found


@pytest.mark.parametrize(('text', 'message'), [
    ('a: [', 'not valid YAML'), ('- a', 'relative_file_paths is missing'),
    ('rosbag2_bagfile_information: 3', 'relative_file_paths is missing'),
    ('rosbag2_bagfile_information: {relative_file_paths: a}', 'relative_file_paths is missing'),
    ('rosbag2_bagfile_information: {relative_file_paths: [a.mcap, 1]}',
     'relative_file_paths has 1, which is no file of a bag'),
    ('&a {rosbag2_bagfile_information: *a}',
     r'not valid YAML \(line 1: aliases and tags are not read\)')])
def test_an_invalid_file_is_an_error(text, message, tmp_path):
    (tmp_path / 'metadata.yaml').write_text(text)
    with pytest.raises(BagError, match=f'metadata.yaml: {message}'):
        read_metadata(tmp_path)


def test_a_missing_file_is_none_and_one_that_cannot_be_read_an_error(tmp_path):
    assert read_metadata(tmp_path) is None
    (tmp_path / 'metadata.yaml').write_bytes(b'a: \xff')
    with pytest.raises(BagError, match='not valid YAML'):
        read_metadata(tmp_path)
    (tmp_path / 'metadata.yaml').unlink()
    (tmp_path / 'metadata.yaml').mkdir()
    with pytest.raises(BagError, match='cannot be read'):
        read_metadata(tmp_path)
