# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Opening of bags: which files belong to one, what each of them is, and what is reported."""

from __future__ import annotations

import os
from pathlib import Path
import tempfile

import pytest
from smart_tire.bags import Bag, BagWriter, channel_of
from smart_tire.bags.mcap_file import McapFile
from smart_tire.bags.metadata import Losses
from smart_tire.bags.opening import OpenFiles
from smart_tire.bags.sqlite_file import SqliteFile
from smart_tire.errors import BagError
from smart_tire.samples import NS_PER_S
from support.recordings import stream, write_with_rosbags
from support.special_files import KINDS, special_file
import zstandard

LISTED = 'rosbag2_bagfile_information: {{relative_file_paths: [{}], message_count: 8}}'


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """Return the bytes of an MCAP and of an sqlite3 file."""
    folder = tmp_path_factory.mktemp('files')
    with BagWriter(folder / 'one') as writer:
        writer.add_topic(channel_of('/a', 'a_msgs/msg/A'))
        writer.write('/a', 5, b'x')
    database, = write_with_rosbags(folder / 'two', stream(0.1)).glob('*.db3')
    return {'mcap': (folder / 'one' / 'one_0.mcap').read_bytes(), 'db3': database.read_bytes()}


@pytest.fixture
def opened(tmp_path):
    """Return a function that opens a path; its files are closed at the end."""
    found = []

    def opener(path=tmp_path):
        warnings, losses = [], Losses()
        found.append(OpenFiles(path, warnings, losses))
        return found[-1], warnings, losses.reasons
    yield opener
    for files in found:
        files.close()


def test_files_are_in_the_order_of_their_numbers(files, opened, tmp_path):
    names = ['a_2.mcap', 'a_10.mcap', 'a_9.mcap', 'a_1.mcap']
    for name in names:
        (tmp_path / name).write_bytes(files['mcap'])
    (tmp_path / 'notes.txt').write_text('text')
    bag, warnings, losses = opened()
    assert [file.path.name for file in bag.files] == [
        'a_1.mcap', 'a_2.mcap', 'a_9.mcap', 'a_10.mcap']
    assert warnings == [f'{tmp_path}: metadata.yaml is missing']
    assert losses == []
    (tmp_path / 'metadata.yaml').write_text(LISTED.format('a_10.mcap, old/a_2.mcap, a_3.mcap'))
    bag, warnings, losses = opened()
    assert [file.path.name for file in bag.files] == ['a_10.mcap', 'a_2.mcap']
    assert bag.metadata.messages == 8
    assert (warnings, losses) == ([], [f'{tmp_path}/a_3.mcap: file is missing'])


def test_a_bag_whose_listed_files_are_all_missing_is_what_its_folder_has(files, opened, tmp_path):
    (tmp_path / 'b.mcap').write_bytes(files['mcap'])
    (tmp_path / 'metadata.yaml').write_text(LISTED.format('a.mcap'))
    bag, _, losses = opened()
    assert [file.path.name for file in bag.files] == ['b.mcap']
    assert losses == [f'{tmp_path}/a.mcap: file is missing']


@pytest.mark.parametrize('names', [
    '..', "''", '.', '/', 'b', 'b.mcap/', '../b.txt', '3', '~', '[b.mcap]', '"b\\0"',
    'b.mcap, ..'])
def test_a_folder_is_read_itself_if_its_metadata_list_what_is_no_file_of_a_bag(
        files, opened, tmp_path, names):
    (tmp_path / 'b.mcap').write_bytes(files['mcap'])
    (tmp_path / 'metadata.yaml').write_text(LISTED.format(names))
    bag, (warning,), losses = opened()
    assert [file.path.name for file in bag.files] == ['b.mcap']
    assert 'relative_file_paths has ' in warning
    assert losses == []


@pytest.mark.parametrize(('names', 'missing'), [
    ('x' * 300 + '.mcap', 1), ('"\\0.mcap"', 1), ('/etc/passwd.mcap', 1), ('../other.mcap', 1),
    (', '.join(f'{number}.mcap' for number in range(50_000)), 50_000),
    ('b.mcap, ' * 100_000 + 'b.mcap', 0)],
    ids=['long', 'NUL', 'absolute', 'above', 'many', 'same'])
def test_listed_files_are_those_of_the_folder_once(files, opened, tmp_path, names, missing):
    folder = tmp_path / 'bag'
    folder.mkdir()
    for path in (folder / 'b.mcap', tmp_path / 'other.mcap'):
        path.write_bytes(files['mcap'])
    (folder / 'metadata.yaml').write_text(LISTED.format(names))
    bag, warnings, losses = opened(folder)
    assert [file.path for file in bag.files] == [folder / 'b.mcap']
    assert (warnings, len(losses)) == ([], missing)


@pytest.mark.parametrize('kind', KINDS)
def test_only_regular_files_of_a_folder_are_read(files, opened, tmp_path, kind):
    folder = tmp_path / 'bag'
    folder.mkdir()
    (folder / 'b.mcap').write_bytes(files['mcap'])
    with special_file(kind, tmp_path) as special:
        (folder / 'a.mcap').symlink_to(special)
        (folder / 'metadata.yaml').symlink_to(special)
        bag, warnings, losses = opened(folder)
        assert [file.path.name for file in bag.files] == ['b.mcap']
        reason = 'cannot be read (not a regular file)'
        assert warnings == [f'{folder}/metadata.yaml: {reason}']
        assert losses == [f'{folder}/a.mcap: {reason}']


@pytest.mark.parametrize('name', ['a.mcap', 'a.db3', 'a.mcap.zstd', 'a.db3.zstd', 'a'])
@pytest.mark.parametrize('content', ['mcap', 'db3'])
def test_a_file_is_what_its_content_is(files, opened, tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(zstandard.compress(files[content]) if name.endswith('zstd')
                     else files[content])
    bag, warnings, losses = opened(path)
    file, = bag.files
    assert type(file) is {'mcap': McapFile, 'db3': SqliteFile}[content]
    assert sum(file.counts().values()) == sum(1 for _ in file.messages()) > 0
    assert (warnings, losses) == ([], [])


@pytest.mark.parametrize(('name', 'content'), [('a.mcap', 'mcap'), ('a.db3', 'db3')])
def test_a_file_whose_first_bytes_are_damaged_is_what_its_name_is(
        files, opened, tmp_path, name, content):
    (tmp_path / name).write_bytes(bytes(3) + files[content][3:])
    file, = opened(tmp_path / name)[0].files
    assert list(file.messages())


def test_errors_name_the_compressed_file(files, opened, tmp_path):
    path = tmp_path / 'a.db3.zstd'
    packed = zstandard.compress(files['db3'])
    for content, problem in (
            (packed[:len(packed) // 2], r'compressed file is truncated \(0 of \d+ bytes\)'),
            (packed[:5] + bytes(9), r'compressed file is (damaged|truncated) \(.*\)'),
            (zstandard.compress(b'a note' * 99), r'not an sqlite3 bag \(.*\)')):
        path.write_bytes(content)
        with pytest.raises(BagError, match=f'^{path}: {problem}$'):
            opened(path)


def open_files(folder):
    """Return the open files of this process below a folder."""
    found = [os.readlink(path) for path in Path('/proc/self/fd').iterdir() if path.is_symlink()]
    return [path for path in found if path.startswith(str(folder))]


@pytest.mark.parametrize('name', ['a.mcap', 'a.db3'])
def test_files_are_closed(files, tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b'a note' * 99)
    with pytest.raises(BagError) as refused:
        OpenFiles(path, [], Losses())
    assert open_files(tmp_path) == []  # while the error keeps its frames
    del refused
    path.write_bytes(files[name[2:]])
    bag = OpenFiles(path, [], Losses())
    assert open_files(tmp_path) == [str(path)]
    bag.close()
    assert open_files(tmp_path) == []


def test_what_is_no_bag_is_refused_without_traces(files, opened, tmp_path, monkeypatch):
    traces = tmp_path / 'traces'
    traces.mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(traces))
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'a.txt').write_text('text of a note')
    (tmp_path / 'a.bag').write_bytes(b'#ROSBAG V2.0\n' + bytes(100))
    (tmp_path / 'a.csv').write_text('t,x,y')
    for name, message in (('nowhere', 'no such file or directory'),
                          ('empty', r'not a rosbag2 directory \(contains no .mcap or .db3 file\)'),
                          ('a.bag', f'a ROS 1 bag; convert it: rosbags-convert --src '
                           f'{tmp_path}/a.bag --dst {tmp_path}/a --dst-storage mcap'),
                          ('a.csv', 'a table, expected a bag; write its rows as samples with .*'),
                          ('a.txt', r'not a bag file \(neither MCAP nor sqlite3\)')):
        with pytest.raises(BagError, match=f'^{tmp_path}/{name}: {message}$'):
            opened(tmp_path / name)
    (tmp_path / 'empty' / 'a.mcap').write_text('')
    with pytest.raises(BagError, match='a.mcap: file is empty'):
        opened(tmp_path / 'empty')
    (tmp_path / 'empty' / 'b.mcap').write_bytes(files['mcap'])
    (tmp_path / 'empty' / 'c.mcap').mkdir()
    bag, _, losses = opened(tmp_path / 'empty')
    assert losses == [f'{tmp_path}/empty/a.mcap: file is empty',
                      f'{tmp_path}/empty/c.mcap: cannot be read (Is a directory)']
    bag.close()
    assert not list(traces.iterdir())


def written(path, start_ns, count=20, topic='/imu/data'):
    """Write a bag file of messages each 0.1 s from ``start_ns`` on; return it."""
    with BagWriter(path.with_suffix('')) as writer:
        writer.add_topic(channel_of(topic, 'sensor_msgs/msg/Imu'))
        for k in range(count):
            writer.write(topic, start_ns + k * NS_PER_S // 10, b'\0\1\0\0')
    file, = path.with_suffix('').glob('*.mcap')
    return file.rename(path)


@pytest.mark.parametrize('start, topic, allowed', [
    (2.05, '/imu/data', True), (86400.0, '/imu/data', False), (10.0, '/imu/data', False),
    (0.0, '/imu/data', True), (-3600.0, '/imu/data', False), (1.0, '/other', True)])
def test_files_of_several_recordings_in_a_folder_are_refused(tmp_path, start, topic, allowed):
    folder = tmp_path / 'folder'
    folder.mkdir()
    begin = 1_700_000_000 * NS_PER_S
    written(tmp_path / 'a.mcap', begin).rename(folder / 'a.mcap')
    written(tmp_path / 'b.mcap', begin + round(start * NS_PER_S), topic=topic).rename(
        folder / 'b.mcap')
    if allowed:
        with Bag(folder) as bag:
            assert sum(one.messages for one in bag.topics.values()) == 40
    else:
        with pytest.raises(BagError, match='2 files, which are not of one recording: [ab].mcap'):
            Bag(folder)


@pytest.mark.parametrize('lost', [False, True])
def test_a_renamed_file_is_no_loss_if_it_has_all_messages(tmp_path, lost):
    file = written(tmp_path / 'a.mcap', NS_PER_S)
    bag = tmp_path / 'a'
    file.rename(bag / 'other.mcap')
    if lost:
        metadata = bag / 'metadata.yaml'
        metadata.write_text(metadata.read_text().replace('count: 20', 'count: 21'))
    with Bag(bag) as opened:
        assert sum(one.messages for one in opened.topics.values()) == 20
        assert bool(opened.losses.lines()) == lost
        assert any('renamed since' in text for text in opened.warnings) != lost


def test_the_metadata_of_a_bag_as_argument_name_its_folder(tmp_path):
    written(tmp_path / 'a.mcap', NS_PER_S)
    with pytest.raises(BagError, match='describes a bag: give its folder'):
        Bag(tmp_path / 'a' / 'metadata.yaml')
