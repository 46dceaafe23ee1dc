# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Reading of MCAP files: intact, truncated, damaged, and of other writers."""

from __future__ import annotations

from mcap.writer import CompressionType, IndexType, Writer
import pytest
from smart_tire.bags.mcap_file import McapFile
from smart_tire.errors import BagError
from support.recordings import stream, write_bag

CHUNK = b'\x06'


@pytest.fixture(scope='module')
def whole(tmp_path_factory):
    """Return the bytes of a file of several chunks."""
    bag = write_bag(tmp_path_factory.mktemp('mcap') / 'bag', stream(1.5))
    return (bag / 'bag_0.mcap').read_bytes()


@pytest.fixture
def read(tmp_path):
    """Return a function that reads messages and warnings from the bytes of a file."""
    def reader(data, topics=None):
        path = tmp_path / 'some.mcap'
        path.write_bytes(data)
        file = McapFile(path)
        try:
            return [(ns, channel.topic, message) for ns, channel, message
                    in file.messages(topics)], [*file.losses.reasons, *file.warnings]
        finally:
            file.close()
    return reader


def simple(path, times, **options):
    """Write numbered messages with receive ``times``."""
    with path.open('wb') as file:
        writer = Writer(file, **options)
        writer.start('ros2')
        schema = writer.register_schema('strange_msgs/msg/Thing', 'ros2msg', b'int32 a')
        channel = writer.register_channel('/a', 'cdr', schema)
        for number, time in enumerate(times):
            writer.add_message(channel, time, str(number).encode(), time)
            if options.get('chunk_size') == 0:
                writer.flush()
        writer.finish()
    return path


def test_a_truncated_file_yields_the_messages_before_the_cut(whole, read):
    complete, warnings = read(whole)
    assert not warnings
    lengths = []
    for size in [*range(100, len(whole), 997), len(whole) - 1]:
        found, warnings = read(whole[:size])
        assert found == complete[:len(found)]
        assert found == complete or any('truncated' in warning for warning in warnings)
        lengths.append(len(found))
    assert lengths == sorted(lengths)
    assert lengths[-1] == len(complete)


def test_the_start_of_a_truncated_chunk_is_read(tmp_path, read):
    path = simple(tmp_path / 'a.mcap', range(2000), compression=CompressionType.NONE)
    data = path.read_bytes()
    found, warnings = read(data[:data.index(CHUNK) + 20_000])
    assert 100 < len(found) < 2000
    assert warnings


def test_trailing_zeros_end_the_file(whole, read):
    complete, _ = read(whole)
    cut = whole[:len(whole) * 2 // 3]
    assert read(cut + bytes(4096))[0] == read(cut)[0] == complete[:len(read(cut)[0])]


def test_a_damaged_chunk_does_not_affect_other_chunks(tmp_path, read):
    path = simple(tmp_path / 'a.mcap', range(10), chunk_size=0)
    data = bytearray(path.read_bytes())
    complete, _ = read(bytes(data))
    packed = [number for number in range(len(data)) if data[number:number + 4] == b'zstd'][6]
    data[packed + 20] ^= 0xFF
    found, warnings = read(bytes(data))
    assert len(complete) == 10
    assert len(found) == 9
    assert len(warnings) == 1
    assert 'damaged at byte' in warnings[0]


@pytest.mark.parametrize('where', range(8, 400, 7))
def test_a_damaged_summary_loses_no_message(whole, read, where):
    data = bytearray(whole)
    data[-where] ^= 0x55
    complete, _ = read(whole)
    found, _ = read(bytes(data))
    assert found == complete


@pytest.mark.parametrize('where', range(8, 3000, 61))
def test_any_damage_gives_a_warning_or_a_bag_error(whole, read, where):
    for mask in (0xFF, 0x01):
        data = bytearray(whole)
        data[where] ^= mask
        try:
            found, warnings = read(bytes(data))
        except BagError:
            continue
        assert len(found) == len(read(whole)[0]) or warnings


@pytest.mark.parametrize('options', [
    {'use_chunking': False}, {'use_chunking': False, 'index_types': IndexType.NONE},
    {'index_types': IndexType.NONE}, {'compression': CompressionType.LZ4},
    {'compression': CompressionType.NONE}, {'use_statistics': False},
    {'repeat_channels': False}, {'repeat_schemas': False}, {'enable_crcs': False}], ids=str)
def test_files_of_other_writers_are_read(tmp_path, options):
    file = McapFile(simple(tmp_path / 'a.mcap', range(10_000), **options))
    read = list(file.messages())
    assert [ns for ns, _, _ in read] == list(range(10_000))
    assert [message for _, _, message in read] == [b'%d' % number for number in range(10_000)]
    (channel, count), = file.counts().items()
    assert (channel.topic, channel.type, channel.definition) == (
        '/a', 'strange_msgs/msg/Thing', 'int32 a')
    assert count == 10_000
    assert file.span() == (0, 9_999)
    assert not file.warnings and not file.losses.lines()
    file.close()


@pytest.mark.parametrize('options', [{'chunk_size': 0}, {'chunk_size': 200},
                                     {'use_chunking': False}, {}], ids=str)
def test_messages_are_sorted_by_receive_time(tmp_path, options):
    times = [7, 3, 9, 1, 8, 8, 2, 30, 20, 10, 11, 5]
    file = McapFile(simple(tmp_path / 'a.mcap', times, **options))
    assert [(ns, int(message)) for ns, _, message in file.messages()] == sorted(
        (time, number) for number, time in enumerate(times))
    file.close()


def test_a_second_type_on_a_topic_is_skipped_with_a_warning(tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        for number, name in enumerate(('one_msgs/msg/One', 'two_msgs/msg/Two')):
            schema = writer.register_schema(name, 'ros2msg', b'')
            writer.add_message(writer.register_channel('/a', 'cdr', schema), number, b'x', 0)
        writer.finish()
    mcap = McapFile(path)
    assert [channel.type for _, channel, _ in mcap.messages()] == ['one_msgs/msg/One']
    assert any('two_msgs/msg/Two' in warning for warning in mcap.warnings)
    mcap.close()


def test_a_file_that_is_being_written_is_read_up_to_its_end(tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        channel = writer.register_channel('/a', 'cdr', writer.register_schema('a', '', b''))
        writer.add_message(channel, 1, b'x', 1)
        writer.flush()
        writer.add_message(channel, 2, b'y', 2)
        mcap = McapFile(path)
        assert [message for _, _, message in mcap.messages()] == [b'x']
        assert mcap.losses.lines()
        mcap.close()


@pytest.mark.parametrize('data', [b'', b'\x89MCAP', b'PK\x03\x04' + bytes(100)])
def test_a_file_that_is_not_mcap_is_rejected(tmp_path, data):
    path = tmp_path / 'a.mcap'
    path.write_bytes(data)
    with pytest.raises(BagError, match=r'a\.mcap: (file is empty|not an MCAP file)'):
        McapFile(path)
