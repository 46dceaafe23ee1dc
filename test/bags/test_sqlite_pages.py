# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pages of sqlite3 files: what sqlite reads from an intact file, whatever the sizes."""

from __future__ import annotations

from contextlib import closing
import sqlite3
import struct

import pytest
from smart_tire.bags.file_bytes import map_file
from smart_tire.bags.sqlite_pages import _varint, Pages

# The limits of all serial types, and texts and blobs around the sizes at which overflow begins.
INTEGERS = [sign * (1 << bits) + more for bits in (0, 7, 15, 23, 31, 47, 62)
            for sign in (-1, 1) for more in (-1, 0, 1)]
VALUES = [None, 0, 1, 2, -1, 0.5, -1e300, '', 'a', b'', b'x', '\u00e4', *INTEGERS]
ROWS = [1, 2, 127, 128, 129, 16_383, 16_384, 1 << 31, (1 << 56) - 1, 1 << 56, (1 << 63) - 1, -7]
PAGE_SIZES = [512, 1024, 4096, 65536]


def write(path, page_size, rows, index=True):
    """Write a table of (number, value, value); return its path."""
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(f"""
            PRAGMA page_size = {page_size};
            CREATE TABLE some(id INTEGER PRIMARY KEY, a, b);
            {'CREATE INDEX places ON some (a);' if index else ''}""")
        connection.executemany('INSERT INTO some VALUES (?, ?, ?)', rows)
        connection.commit()
    return path


def read(path):
    """Return rows, entries of indices and number of damaged cells."""
    with closing(map_file(path)) as data:
        pages = Pages(data)
        rows = sorted((number, *columns[1:]) for _, number, columns in pages.rows()
                      if columns[0] is None)  # the others are in the table of tables
        return rows, [tuple(entry) for entry in pages.index_entries()], pages.damaged


@pytest.mark.parametrize('page_size', PAGE_SIZES)
def test_all_kinds_of_values_are_read(tmp_path, page_size):
    rows = sorted((number + 1000, value, VALUES[-number]) for number, value in enumerate(VALUES))
    found, entries, damaged = read(write(tmp_path / 'a.db3', page_size, rows))
    assert repr(found) == repr(rows)
    assert sorted(map(repr, entries)) == sorted(
        repr((value, number)) for number, value, _ in rows)
    assert damaged == 0


@pytest.mark.parametrize('page_size', PAGE_SIZES)
def test_row_numbers_of_all_lengths_are_read(tmp_path, page_size):
    rows = sorted((number, number, 'text') for number in ROWS)
    found, entries, damaged = read(write(tmp_path / 'a.db3', page_size, rows))
    assert sorted((number - (number >> 63 << 64), *rest) for number, *rest in found) == rows
    assert sorted(entries) == [(number, number) for number, _, _ in rows]
    assert damaged == 0


@pytest.mark.parametrize('page_size', PAGE_SIZES)
def test_rows_of_all_sizes_are_read_with_their_overflow(tmp_path, page_size):
    sizes = {max(0, size + more) for parts in (1, 2, 3) for more in range(-40, 41, 1 + parts)
             for size in (parts * page_size // 8, parts * page_size, 64 * parts)}
    rows = [(number, bytes(i * number % 251 for i in range(size)), None)
            for number, size in enumerate(sorted(sizes), 1)]
    found, entries, damaged = read(write(tmp_path / 'a.db3', page_size, rows))
    assert found == rows
    assert sorted(number for _, number in entries) == [number for number, _, _ in rows]
    assert {number: value for value, number in entries} == {
        number: value for number, value, _ in rows}
    assert damaged == 0


def test_the_first_page_begins_behind_the_head_of_the_file(tmp_path):
    with closing(map_file(write(tmp_path / 'a.db3', 512, []))) as data:
        assert [(columns[0], columns[1]) for _, _, columns in Pages(data).rows()] == [
            ('table', 'some'), ('index', 'places')]


def test_a_row_is_read_again_by_its_place(tmp_path):
    rows = [(number, number, bytes([number]) * 900) for number in range(1, 100)]
    with closing(map_file(write(tmp_path / 'a.db3', 512, rows))) as data:
        pages = Pages(data)
        for cell, number, columns in pages.rows():
            assert pages.row(cell) == (number, columns)


@pytest.mark.parametrize('size', [0, 256, 513, 3000])
def test_an_impossible_page_size_is_the_default_one(tmp_path, size):
    path = write(tmp_path / 'a.db3', 4096, [(1, 2, 'text')])
    data = bytearray(path.read_bytes())
    data[16:18] = size.to_bytes(2, 'big')
    path.write_bytes(data)
    assert read(path)[0] == [(1, 2, 'text')]


def test_damaged_cells_are_counted_and_the_others_read(tmp_path):
    rows = [(number, 7, f'text {number:02}') for number in range(1, 41)]
    path = write(tmp_path / 'a.db3', 4096, rows, index=False)
    data = bytearray(path.read_bytes())
    # Length, row number, four bytes of serial types, then the columns. The first row is the last.
    data[data.index(b'text 01') - 7] = 0x7f  # a cell longer than its page
    data[data.index(b'text 05') - 2] = 0x7f  # a column longer than its row
    data[data.index(b'text 09') - 2] = 0x19  # a shorter one
    path.write_bytes(data)
    kept = [(*row[:2], 'text 0') if row[0] == 9 else row for row in rows if row[0] not in (1, 5)]
    assert read(path) == (kept, [], 2)


def test_a_lost_page_of_overflow_costs_its_row(tmp_path):
    rows = [(1, 0, b'a' * 100), (2, 0, b'b' * 2000), (3, 0, b'c' * 100)]
    path = write(tmp_path / 'a.db3', 512, rows, index=False)
    size = path.stat().st_size
    path.write_bytes(path.read_bytes()[:size - 512])
    assert read(path) == ([rows[0], rows[2]], [], 1)
    data = bytearray(path.read_bytes())
    head = data.index(b'c' * 100)
    data[head - 2] ^= 0x40
    path.write_bytes(data)
    assert read(path)[2] == 2


@pytest.mark.parametrize(('data', 'number', 'end'), [
    (b'\x00', 0, 1), (b'\x7f', 127, 1), (b'\x81\x00', 128, 2), (b'\xff\x7f', 16383, 2),
    (b'\xff' * 7 + b'\x7f', (1 << 56) - 1, 8), (b'\xff' * 9, (1 << 64) - 1, 9),
    (b'\x80' * 8 + b'\x01', 1, 9), (b'\x81' + b'\x80' * 7 + b'\x05', (1 << 57) + 5, 9)])
def test_integers_of_variable_length(data, number, end):
    assert _varint(b'ab' + data + b'\xff', 2) == (number, 2 + end)
    with pytest.raises(IndexError):
        _varint(data[:-1], 0)


def test_rows_that_share_their_pages_are_read_no_more_often_than_twice(tmp_path):
    size = 200_000
    path = write(tmp_path / 'a.db3', 4096, [(number, 7, bytes(size) if number == 1 else 'text')
                                            for number in range(1, 100)], index=False)
    data = bytearray(path.read_bytes())
    with closing(map_file(path)) as content:
        cells = {row: cell for cell, row, columns in Pages(content).rows() if len(columns) == 3}
    page, first = cells[1]
    head = page * 4096
    count, = struct.unpack_from('>H', data, head + 3)
    for number in range(count):  # all rows of this page are the first one
        struct.pack_into('>H', data, head + 8 + 2 * number, first - head)
    path.write_bytes(data)
    with closing(map_file(path)) as content:
        pages = Pages(content)
        long = [columns for _, _, columns in pages.rows()
                if len(columns) == 3 and columns[2] != 'text']
    assert count > 10
    assert 1 < len(long) <= 2 * len(data) // size + 1
    assert pages.damaged == 1
