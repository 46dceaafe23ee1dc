# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bounded decompression: sizes that a file claims, and those that it does not."""

from __future__ import annotations

import struct
import tracemalloc
from types import SimpleNamespace

import lz4.frame
from mcap.writer import CompressionType, Writer
import pytest
from smart_tire.bags import Bag, file_bytes
from smart_tire.bags.file_bytes import unpack_file, unpacked
from smart_tire.errors import BagError
import zstandard

MEGABYTE = bytes(1 << 20)


def bomb(megabytes, *, size_known=True):
    """Return some kB that are ``megabytes`` of zeros when decompressed."""
    packer = zstandard.ZstdCompressor(write_content_size=size_known).compressobj(
        size=megabytes * len(MEGABYTE) if size_known else -1)
    return b''.join([*(packer.compress(MEGABYTE) for _ in range(megabytes)), packer.flush()])


@pytest.fixture
def small(monkeypatch):
    """Set the limits to 4 MB, and to 8 MB for files."""
    monkeypatch.setattr(file_bytes, 'MAX_SIZE', 4 << 20)
    monkeypatch.setattr(file_bytes, 'MAX_FILE_SIZE', 8 << 20)


@pytest.mark.parametrize('size_known', [True, False])
def test_data_up_to_the_limit_are_decompressed(small, size_known):
    assert unpacked(bomb(4, size_known=size_known)) == 4 * MEGABYTE
    with pytest.raises(ValueError, match='MB when decompressed, at most 4 MB are read'):
        unpacked(bomb(5, size_known=size_known))


def test_a_bomb_takes_no_memory(small):
    packed = bomb(64, size_known=False)
    tracemalloc.start()
    for data, size in ((packed, None), (bomb(64), None), (packed, 3 << 20)):
        with pytest.raises(ValueError, match='when decompressed'):
            unpacked(data, 'zstd', size)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20 << 20


@pytest.mark.parametrize(('compression', 'packed'), [
    ('zstd', zstandard.compress(MEGABYTE)), ('lz4', lz4.frame.compress(MEGABYTE)),
    ('', MEGABYTE)])
def test_the_size_of_a_chunk_is_that_in_its_header(compression, packed):
    assert unpacked(packed, compression, len(MEGABYTE)) == MEGABYTE
    assert MEGABYTE.startswith(unpacked(packed[:-3], compression, len(MEGABYTE)))
    if compression == 'lz4':
        assert len(unpacked(packed, compression, 1000)) == 1000
    with pytest.raises(ValueError, match='at most 268 MB'):
        unpacked(packed, compression, (1 << 28) + 1)


def test_other_compressions_are_refused():
    with pytest.raises(ValueError, match='compression is br, expected zstd or lz4'):
        unpacked(b'abc', 'br', 3)


@pytest.mark.parametrize('size_known', [True, False])
def test_a_file_that_is_too_large_is_refused(small, tmp_path, size_known):
    path = tmp_path / 'a.mcap.zstd'
    path.write_bytes(bomb(64, size_known=size_known))
    assert 1000 * path.stat().st_size < 64 << 20
    with pytest.raises(BagError, match=r'a\.mcap\.zstd: .* MB when decompressed, at most 8 MB'):
        Bag(path)
    with pytest.raises(BagError, match='MB when decompressed'):
        unpack_file(path, tmp_path / 'plain')
    plain = tmp_path / 'plain'
    assert not size_known or not plain.exists() or not plain.stat().st_size
    path.write_bytes(bomb(8, size_known=size_known))
    assert unpack_file(path, plain) == ''
    assert plain.stat().st_size == 8 << 20


def test_a_file_larger_than_the_free_space_is_refused(monkeypatch, tmp_path):
    path = tmp_path / 'a.db3.zstd'
    path.write_bytes(bomb(2))
    monkeypatch.setattr(file_bytes.shutil, 'disk_usage', lambda _: type('', (), {'free': 1 << 20}))
    with pytest.raises(BagError, match='2 MB when decompressed, at most 1 MB'):
        unpack_file(path, tmp_path / 'plain')


def test_a_truncated_or_damaged_file_is_decompressed_up_to_there(tmp_path):
    path, plain = tmp_path / 'a.zstd', tmp_path / 'plain'
    content = b''.join(struct.pack('<I', number * number % 65521) for number in range(300_000))
    packed = zstandard.compress(content)
    path.write_bytes(packed[:len(packed) // 2])
    assert unpack_file(path, plain).startswith('compressed file is truncated (')
    assert 0 < plain.stat().st_size < len(content)
    assert content.startswith(plain.read_bytes())
    path.write_bytes(packed[:4] + b'\xff' * 20)
    assert unpack_file(path, plain).startswith('compressed file is damaged (')
    path.write_bytes(packed)
    assert unpack_file(path, plain) == ''
    assert plain.read_bytes() == content
    with pytest.raises(BagError, match='cannot be decompressed'):
        unpack_file(tmp_path / 'nowhere', plain)


def test_a_chunk_that_is_too_large_is_a_loss(tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as file:
        writer = Writer(file, compression=CompressionType.ZSTD, chunk_size=1000)
        writer.start('ros2')
        channel = writer.register_channel('/a', 'cdr', writer.register_schema('a', '', b''))
        for number in range(3):
            writer.add_message(channel, number, MEGABYTE if number == 1 else b'x', number)
            writer.flush()
        writer.finish()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(file_bytes, 'MAX_SIZE', 1 << 19)
        with Bag(path) as bag:
            assert [ns for ns, _, _ in bag.raw()] == [0, 2]
            line, = bag.losses.lines()
    assert line.startswith('1 messages or more are missing')
    assert line.endswith('1 MB when decompressed, at most 1 MB are read')


def claim(size):
    """Return the head of a file that claims to be this large when decompressed."""
    return zstandard.MAGIC_NUMBER.to_bytes(4, 'little') + b'\xe0' + size.to_bytes(8, 'little')


@pytest.mark.parametrize(('packed', 'most'), [(20, 1 << 30), (2_000_000, 2_000_000_000)])
def test_a_file_may_claim_a_gigabyte_or_a_thousand_times_its_size(
        monkeypatch, tmp_path, packed, most):
    free = SimpleNamespace(free=1 << 40)
    monkeypatch.setattr(file_bytes.shutil, 'disk_usage', lambda _: free)
    path, plain = tmp_path / 'a.zstd', tmp_path / 'plain'
    for size, refused in ((most, False), (most + 1, True)):
        path.write_bytes(claim(size).ljust(packed, b'\xff'))
        if refused:
            with pytest.raises(BagError, match=f'{size / 1e6:.0f} MB when decompressed'):
                unpack_file(path, plain)
        else:
            assert 'damaged' in unpack_file(path, plain)


def test_files_are_mapped_or_refused(tmp_path):
    path = tmp_path / 'a'
    path.write_bytes(b'content')
    with file_bytes.map_file(path) as data:
        assert data[:] == b'content'
    path.write_bytes(b'')
    for name, message in (('a', 'a: file is empty'), ('b', r'b: cannot be read \(No such file')):
        with pytest.raises(BagError, match=message):
            file_bytes.map_file(tmp_path / name)
