# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags in folders, by patterns and behind URLs: found, copied completely, tried again."""

from __future__ import annotations

import errno
import os
from pathlib import Path, PurePosixPath
import sys

import pytest

from smart_tire.errors import BagError, ParameterError
from smart_tire.fleet import bags_of, local_bag, path_of
from smart_tire.fleet.sources import bags_in, fingerprint
from support.fleet import serving

pytestmark = pytest.mark.processes

FILES = ['a/metadata.yaml', 'a/a_0.mcap', 'a/a_1.mcap', 'b/b_0.mcap', 'b/b_1.mcap',
         'many/x.mcap', 'many/y.db3', 'many/notes.txt', '.trash/z/z_0.mcap',
         'a_analyzed/summary.json', 'a_analyzed/estimates/estimates_0.mcap',
         'a_analyzed/estimates/metadata.yaml']
BAGS = ['a', 'b', 'many/x.mcap', 'many/y.db3']


@pytest.fixture
def folder(tmp_path):
    """Return a folder with ``FILES``."""
    for name in FILES:
        path = tmp_path / 'bags' / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(name.encode() * 1000)
    return tmp_path / 'bags'


def never(seconds):
    raise AssertionError(f'waits {seconds} s')


def test_a_folder_is_searched_for_bags_but_not_for_results():
    assert list(map(str, bags_in(map(PurePosixPath, FILES)))) == BAGS


def test_arguments_are_bags_folders_patterns_and_file_urls(folder):
    expected = [folder / bag for bag in BAGS]
    assert bags_of([folder]) == expected
    assert bags_of([folder / 'b', folder / 'many' / 'x.mcap']) == expected[1:3]
    assert bags_of([Path(f'{folder}/[ab]')]) == expected[:2]
    assert bags_of([Path(f'{folder}/**/*.db3')]) == expected[3:]
    assert bags_of([f'file://{folder}/a']) == expected[:1]
    assert path_of('https://host/some/drive%201') == Path('/host/some/drive 1')


@pytest.mark.parametrize(('name', 'text'), [
    ('none', 'no such file or directory'), ('none*', 'no file or directory has such a name'),
    ('empty', 'not a rosbag2 directory')])
def test_what_names_no_bag_is_one_line(name, text, tmp_path):
    (tmp_path / 'empty' / 'below').mkdir(parents=True)
    with pytest.raises(BagError, match=text):
        bags_of([tmp_path / name])


def test_a_fingerprint_changes_with_the_file(folder):
    before = fingerprint(folder / 'a')
    assert before == fingerprint(folder / 'a')
    os.utime(folder / 'a' / 'a_1.mcap', (1, 1))
    assert fingerprint(folder / 'a') != before


def content(folder):
    """Return the bytes of all files below a folder, or of a file."""
    return {path.name: path.read_bytes()
            for path in (folder.rglob('*') if folder.is_dir() else [folder]) if path.is_file()}


class TestUrls:
    """A web server that fails, with its waiting times."""

    @pytest.fixture
    def server(self, folder):
        """Return a web server of the folder."""
        pytest.importorskip('fsspec', reason='needs fsspec')
        pytest.importorskip('aiohttp', reason='needs fsspec')
        with serving(folder) as found:
            yield found

    def test_they_are_searched_and_copied_and_copies_are_deleted(self, server, folder):
        assert bags_of([server.url]) == [f'{server.url}/{bag}' for bag in BAGS]
        for bag in BAGS:
            assert bags_of([f'{server.url}/{bag}']) == [f'{server.url}/{bag}']
            server.requests.clear()
            with local_bag(f'{server.url}/{bag}', never) as copy:
                assert copy.name == PurePosixPath(bag).name
                assert content(copy) == content(folder / bag)
            assert not copy.exists()
            assert server.requests

    def test_an_answer_that_ends_halfway_is_read_again(self, server, folder):
        waited = []
        server.cuts = 2
        with local_bag(f'{server.url}/a', waited.append) as copy:
            assert content(copy) == content(folder / 'a')
        assert waited == [1.0, 4.0]

    def test_one_that_always_does_is_one_line_and_leaves_no_copy(
            self, server, tmp_path, monkeypatch):
        monkeypatch.setenv('TMPDIR', str(tmp_path))
        monkeypatch.setattr('tempfile.tempdir', None)
        server.cuts, waited = 99, []
        with pytest.raises(BagError) as raised, local_bag(
                f'{server.url}/many/x.mcap', waited.append):
            pass
        assert str(raised.value).startswith(f'{server.url}/many/x.mcap: not copied in 3 tries (')
        assert waited == [1.0, 4.0]
        assert not list(tmp_path.glob('smart_tire_*'))

    def test_a_full_disk_is_not_tried_again(self, server, monkeypatch):
        from fsspec.implementations.http import HTTPFileSystem

        async def full(*_, **__):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        HTTPFileSystem.clear_instance_cache()  # instances keep their methods
        with monkeypatch.context() as patch:
            patch.setattr(HTTPFileSystem, '_get_file', full)
            with pytest.raises(BagError, match=r'cannot be written \(No space left on device\)'), \
                    local_bag(f'{server.url}/many/x.mcap', never):
                pass
        HTTPFileSystem.clear_instance_cache()

    @pytest.mark.parametrize(('url', 'text'), [
        ('{}/none.mcap', '404'), ('{}/none', '404'),
        ('http://127.0.0.1:9/x.mcap', 'cannot be read'), ('nonsuch://x/y', 'nonsuch')])
    def test_wrong_ones_are_one_line(self, server, url, text):
        with pytest.raises((BagError, ParameterError), match=text) as raised:
            [fingerprint(bag) for bag in bags_of([url.format(server.url)])]
        assert '\n' not in str(raised.value)

    def test_a_fingerprint_changes_with_the_file(self, server, folder):
        url = f'{server.url}/many/x.mcap'
        before = fingerprint(url)
        assert before == fingerprint(url) and before[0][1] == len(FILES[5]) * 1000
        os.utime(folder / 'many' / 'x.mcap', (1e9, 1e9))
        assert fingerprint(url) != before


def test_a_missing_library_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, 'fsspec', None)
    with pytest.raises(ParameterError, match=r'URLs need fsspec \(pip install smart_tire.fleet'):
        bags_of(['https://host/drive.mcap'])


def test_buckets_are_searched_and_copied(folder, monkeypatch):
    pytest.importorskip('s3fs', reason='needs s3fs')
    server = pytest.importorskip('moto.server', reason='needs moto').ThreadedMotoServer(
        '127.0.0.1', port=0, verbose=False)
    server.start()
    try:
        host, port = server.get_host_and_port()
        for name, value in (('ENDPOINT_URL', f'http://{host}:{port}'), ('ACCESS_KEY_ID', 'test'),
                            ('SECRET_ACCESS_KEY', 'test'), ('DEFAULT_REGION', 'us-east-1')):
            monkeypatch.setenv(f'AWS_{name}', value)
        import s3fs
        system = s3fs.S3FileSystem(skip_instance_cache=True)
        system.mkdir('recordings')
        for name in FILES:
            system.pipe_file(f'recordings/{name}', (folder / name).read_bytes())
        found = bags_of(['s3://recordings'])
        assert found == [f's3://recordings/{bag}' for bag in BAGS]
        for bag, name in zip(found, BAGS):
            with local_bag(bag, never) as copy:
                assert content(copy) == content(folder / name)
        before = fingerprint(found[2])
        system.pipe_file('recordings/many/x.mcap', b'another')
        assert fingerprint(found[2]) != before
        with pytest.raises(BagError, match='no such|not exist|cannot be read'):
            bags_of(['s3://nonsuch'])
    finally:
        server.stop()
