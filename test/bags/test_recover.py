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

"""Recovery of damaged bags."""

from __future__ import annotations

from mcap.reader import make_reader
import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from smart_tire.bags import Bag, recover
from smart_tire.errors import BagError
from smart_tire.messages import TOPICS
from support.recordings import stream, write_bag


@pytest.fixture
def broken(tmp_path):
    """Return a bag without metadata whose file is truncated."""
    path = write_bag(tmp_path / 'broken', stream(2.0))
    file = path / 'broken_0.mcap'
    file.write_bytes(file.read_bytes()[:-60_000])
    (path / 'metadata.yaml').unlink()
    return path


def test_all_readable_messages_are_recovered(tmp_path, broken):
    result = recover(broken, tmp_path / 'whole')
    with Bag(broken) as before, Bag(tmp_path / 'whole') as after:
        left = list(before.samples(TOPICS))
        assert list(after.samples(TOPICS)) == left == stream(2.0)[:len(left)]
        assert not after.warnings
        assert result.warnings == before.warnings
        assert result.counts == {name: topic.messages for name, topic in after.topics.items()}
    assert len(left) > 500
    assert any('truncated' in warning for warning in result.warnings)
    assert any('metadata.yaml' in warning for warning in result.warnings)


def test_other_readers_open_a_recovered_bag(tmp_path, broken):
    counts = recover(broken, tmp_path / 'whole').counts
    with AnyReader([tmp_path / 'whole']) as reader:
        assert {topic: info.msgcount for topic, info in reader.topics.items()} == counts
        assert sum(1 for _ in reader.messages()) == sum(counts.values())
    with (tmp_path / 'whole' / 'whole_0.mcap').open('rb') as file:
        assert make_reader(file, validate_crcs=True).get_summary().chunk_indexes


def test_an_intact_bag_is_copied_completely(tmp_path):
    events = stream(0.5)
    assert recover(write_bag(tmp_path / 'bag', events), tmp_path / 'copy').warnings == []
    with Bag(tmp_path / 'copy') as bag:
        assert list(bag.samples(TOPICS)) == events


def test_missing_definitions_are_added(tmp_path):
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        writer.add_connection('/odom', 'nav_msgs/msg/Odometry', msgdef='', rihs01='RIHS01_0')
    recover(tmp_path / 'bag', tmp_path / 'whole')
    with Bag(tmp_path / 'whole') as bag:
        channel = bag.topics['/odom'].channel
        assert 'geometry_msgs/PoseWithCovariance pose' in channel.definition
        assert channel.definition_encoding == 'ros2msg'


def test_an_existing_folder_is_not_overwritten(tmp_path, broken):
    with pytest.raises(BagError, match='File exists'):
        recover(broken, broken)


def test_a_missing_bag_creates_no_output(tmp_path):
    with pytest.raises(BagError, match='no such file'):
        recover(tmp_path / 'nowhere', tmp_path / 'whole')
    assert not (tmp_path / 'whole').exists()
