# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Custom data of rosbag2: in metadata.yaml and in the files, also after a crash."""

from __future__ import annotations

import sqlite3

from smart_tire.bags import Bag, BagWriter, recover
from support.recordings import stream, write_bag
import yaml

TEXT = '/**:\n  ros__parameters:\n    name: "ä: {x}"\n'


def custom_data(path):
    with Bag(path) as bag:
        return bag.custom_data


def test_custom_data_is_written_as_rosbag2_does(tmp_path):
    with BagWriter(tmp_path / 'bag', custom_data={'operator': 'me'}) as writer:
        writer.set_custom_data('params', TEXT)
    entry = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())[
        'rosbag2_bagfile_information']
    assert entry['custom_data'] == {'operator': 'me', 'params': TEXT}
    assert custom_data(tmp_path / 'bag') == entry['custom_data']
    assert custom_data(tmp_path / 'bag' / 'bag_0.mcap') == entry['custom_data']


def test_without_custom_data_the_entry_is_that_of_rosbag2(tmp_path):
    with BagWriter(tmp_path / 'bag'):
        pass
    assert 'custom_data: null' in (tmp_path / 'bag' / 'metadata.yaml').read_text()
    assert custom_data(tmp_path / 'bag') == {}


def test_custom_data_is_on_the_disk_at_once_and_the_latest_wins(tmp_path):
    writer = BagWriter(tmp_path / 'bag')
    for text in ('old', TEXT):
        writer.set_custom_data('params', text)
        for path in (tmp_path / 'bag', tmp_path / 'bag' / 'bag_0.mcap'):
            assert custom_data(path) == {'params': text}
    size = (tmp_path / 'bag' / 'bag_0.mcap').stat().st_size
    writer.set_custom_data('params', TEXT)
    assert (tmp_path / 'bag' / 'bag_0.mcap').stat().st_size == size  # no change, no record
    writer.close()


def test_custom_data_between_messages_leaves_them_readable(tmp_path):
    events = stream(1.0)
    with BagWriter(tmp_path / 'bag') as writer:
        for number, (receive_ns, topic, sample) in enumerate(events):
            if number % 100 == 0:
                writer.set_custom_data('number', str(number))
            writer.write_sample(topic, receive_ns, sample)
    plain = write_bag(tmp_path / 'plain', events)
    with Bag(tmp_path / 'bag') as bag, Bag(plain) as other:
        assert [(ns, data) for ns, _, data in bag.raw()] == [
            (ns, data) for ns, _, data in other.raw()]
        assert bag.custom_data == {'number': str((len(events) - 1) // 100 * 100)}


def test_a_recovered_bag_keeps_the_custom_data_of_a_truncated_one(tmp_path):
    with BagWriter(tmp_path / 'bag', custom_data={'params': TEXT}) as writer:
        for receive_ns, topic, sample in stream(1.0):
            writer.write_sample(topic, receive_ns, sample)
    file = tmp_path / 'bag' / 'bag_0.mcap'
    file.write_bytes(file.read_bytes()[:-20_000])
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    assert recover(tmp_path / 'bag', tmp_path / 'new').warnings
    assert custom_data(tmp_path / 'new') == {'params': TEXT}


def test_custom_data_in_an_sqlite_file_is_read(tmp_path):
    path = tmp_path / 'bag.db3'
    with sqlite3.connect(path) as connection:
        connection.execute('CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
                           'serialization_format TEXT)')
        connection.execute('CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, '
                           'timestamp INTEGER, data BLOB)')
        assert custom_data(path) == {}  # schemas before version 4
        connection.execute('CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version '
                           'INTEGER, metadata TEXT)')
        for text in ('custom_data: ~', yaml.safe_dump({'custom_data': {'params': TEXT}}), '{'):
            connection.execute('INSERT INTO metadata (metadata_version, metadata) VALUES (9, ?)',
                               (text,))
        connection.commit()
    connection.close()
    assert custom_data(path) == {'params': TEXT}
