# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Checks of paths: the bag in a folder, files to read, and files to write."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from smart_tire.errors import BagError, ParameterError
from smart_tire.paths import (
    check_file, check_writable, find_bag, open_file, port_url, read_file)
from support.special_files import KINDS, special_file


def made(folder: Path, *files: str) -> Path:
    """Create ``folder`` with empty files and return it."""
    folder.mkdir(parents=True)
    for name in files:
        (folder / name).touch()
    return folder


def test_simulated_ports_differ_by_namespace_and_domain_and_other_ports_are_left(monkeypatch):
    urls = set()
    for domain in ('', '7'):
        monkeypatch.setenv('ROS_DOMAIN_ID', domain)
        urls |= {port_url('simulated:imu', namespace) for namespace in ('/', '/r1', '/r1/a')}
        assert port_url('simulated:imu', '/r1') == port_url('simulated:imu', 'r1/')
    assert len(urls) == 6
    assert all(url.startswith('simulated:/') and url.endswith('/imu') for url in urls)
    for port in ('/dev/ttyUSB0', 'socket://h:1', 'simulated:/x/imu'):
        assert port_url(port, '/r1') == port
    assert port_url('simulated', '/r1', 'imu') == port_url('simulated:imu', '/r1', 'motors')
    assert port_url('/dev/simulated', '/r1', 'imu') == '/dev/simulated'


@pytest.mark.parametrize('file', ['metadata.yaml', 'drive_0.mcap', 'drive_0.db3',
                                  'drive_0.mcap.zstd', 'drive_0.db3.zstd'])
def test_a_folder_with_files_of_a_bag_is_the_bag_also_with_bags_below(file, tmp_path):
    bag = made(tmp_path / 'drive', file)
    made(bag / 'below', 'metadata.yaml')
    assert find_bag(bag) == bag


def test_a_file_is_taken_as_a_bag(tmp_path):
    file = made(tmp_path / 'drive', 'anything') / 'anything'
    assert find_bag(file) == file


def test_the_only_bag_one_level_below_is_found(tmp_path):
    made(tmp_path / 'demo' / 'figures', 'slip.png')
    bag = made(tmp_path / 'demo' / 'bag', 'bag_0.mcap')
    (tmp_path / 'demo' / 'other.mcap').mkdir()  # not a file of a bag
    assert find_bag(tmp_path / 'demo') == bag


def test_several_bags_one_level_below_are_an_error_that_lists_them(tmp_path):
    second, first = made(tmp_path / 'b', 'x.mcap'), made(tmp_path / 'a', 'metadata.yaml')
    with pytest.raises(BagError) as raised:
        find_bag(tmp_path)
    assert str(raised.value) == f'{tmp_path} contains 2 bags, expected one: {first}, {second}'


def test_a_bag_two_levels_below_is_not_found(tmp_path):
    made(tmp_path / 'a' / 'bag', 'metadata.yaml')
    with pytest.raises(BagError, match='not a rosbag2 directory'):
        find_bag(tmp_path)


def test_a_folder_of_a_ros_1_bag_has_a_way_on(tmp_path):
    made(tmp_path / 'old', 'b.bag')
    (tmp_path / 'old' / 'a.bag').touch()
    with pytest.raises(BagError, match=f'{tmp_path}/old/a.bag: a ROS 1 bag; convert'):
        find_bag(tmp_path / 'old')


def test_a_missing_bag_is_an_error_with_its_path(tmp_path):
    with pytest.raises(BagError, match=r'nowhere: no such file or directory$'):
        find_bag(tmp_path / 'nowhere')


def test_a_file_to_read_must_exist_and_be_a_regular_file(tmp_path):
    check_file(made(tmp_path / 'config', 'robot.yaml') / 'robot.yaml')
    (tmp_path / 'link').symlink_to('config/robot.yaml')
    check_file(tmp_path / 'link')
    for name, reason in (('none.yaml', 'No such file or directory'), ('config', 'Is a directory'),
                         ('link/x', 'Not a directory'), ('x' * 300, 'File name too long')):
        with pytest.raises(ParameterError) as raised:
            check_file(tmp_path / name)
        assert str(raised.value) == f'{tmp_path / name}: cannot be read ({reason})'


@pytest.mark.parametrize('kind', KINDS)
def test_only_regular_files_are_opened(kind, tmp_path, monkeypatch):
    with special_file(kind, tmp_path) as path:
        monkeypatch.setattr(os, 'open', None)  # opening resets some devices
        with pytest.raises(OSError, match='not a regular file'):
            open_file(path)


def test_a_file_that_is_replaced_by_a_fifo_before_it_is_opened_does_not_block(
        tmp_path, monkeypatch):
    path, fifo = made(tmp_path / 'folder', 'file') / 'file', tmp_path / 'fifo'
    os.mkfifo(fifo)
    before = len(os.listdir('/proc/self/fd'))
    state = path.stat()
    monkeypatch.setattr(os, 'stat', lambda path: state)
    with pytest.raises(OSError, match='not a regular file'):
        open_file(fifo)
    assert len(os.listdir('/proc/self/fd')) == before


def test_a_file_is_read_up_to_its_size_limit(tmp_path):
    path = tmp_path / 'file'
    path.write_bytes(b'12345')
    assert read_file(path, 5) == b'12345'
    with pytest.raises(OSError, match='more than 4 bytes'):
        read_file(path, 4)


def test_an_output_may_be_new_with_new_folders_or_existing(tmp_path, monkeypatch):
    existing = made(tmp_path / 'results', 'summary.json')
    check_writable(existing)
    check_writable(existing / 'summary.json')
    check_writable(tmp_path / 'new' / 'folder' / 'file')
    monkeypatch.chdir(existing)
    check_writable(Path('figure.png'))


def test_an_output_below_a_file_is_refused(tmp_path):
    file = made(tmp_path / 'results', 'summary.json') / 'summary.json'
    with pytest.raises(ParameterError, match=r'summary.json is not a folder'):
        check_writable(file / 'new' / 'bag')


def test_an_output_below_a_dangling_link_is_refused(tmp_path):
    (tmp_path / 'link').symlink_to(tmp_path / 'nowhere')
    with pytest.raises(ParameterError, match='link is not a folder'):
        check_writable(tmp_path / 'link' / 'bag')


def test_files_without_permission_are_refused(tmp_path, monkeypatch):
    file = made(tmp_path / 'results', 'robot.yaml') / 'robot.yaml'
    asked = []  # root may read and write everything, so that real permissions show nothing
    monkeypatch.setattr(os, 'access', lambda path, mode: bool(asked.append((path, mode))))
    with pytest.raises(ParameterError, match=r'no permission to write to .*results\)$'):
        check_writable(file)
    with pytest.raises(ParameterError, match=r'no permission to write to .*results\)$'):
        check_writable(file.parent)
    with pytest.raises(ParameterError, match=r'no permission to write to .*results\)$'):
        check_writable(file.parent / 'new' / 'folder' / 'file')
    assert asked == [(file.parent, os.W_OK | os.X_OK)] * 3
