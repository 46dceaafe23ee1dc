# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
The rows in the pages of a damaged sqlite3 file, without the tree that leads to them.

A page of a table or of an index names its kind and the places of its cells (sqlite file format,
1.6): every intact page is read for itself. A page of overflow begins with the number of a page,
which is none of the kinds below in a file of less than 33 million pages.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import mmap
import struct
from typing import Any

TABLE_LEAF, INDEX_LEAF, INDEX_INTERIOR = 0x0D, 0x0A, 0x02  # kinds of pages
FILE_HEAD = 100          # bytes before the first page's own head
PAGE_SIZE_OFFSET, DEFAULT_PAGE_SIZE = 16, 4096
SIZES = (0, 1, 2, 3, 4, 6, 8, 8, 0, 0)  # bytes of serial types: NULL, integers, REAL, ZERO, ONE
REAL, ZERO, ONE, FIRST_BLOB = 7, 8, 9, 12  # serial types; odd ones from 13 on are texts
# Bytes of the content of a cell that its page has, from the usable size U of a page (1.6): at most
# U - 35 of a row and 64/255 (U - 12) - 23 of an entry of an index, else at least
# 32/255 (U - 12) - 23.
ROW_RESERVE, PAGE_RESERVE, CELL_RESERVE = 35, 12, 23  # bytes
MAX_SHARE, MIN_SHARE, SHARE_UNIT = 64, 32, 255        # over SHARE_UNIT
DECODE_ERRORS = (IndexError, struct.error, ValueError)
PAGE_NUMBER = struct.Struct('>I')

MAX_COPIES = 2  # of a byte, assumed: a page of overflow may belong to a row and to a deleted one

Cell = tuple[int, int]   # number of its page, offset in the file


class Pages:
    """The pages of a file; ``damaged`` counts the cells that could not be read."""

    def __init__(self, data: mmap.mmap) -> None:
        self._data, self.damaged, self._read = data, 0, 0
        size, = struct.unpack_from('>H', data[:FILE_HEAD].ljust(FILE_HEAD, b'\0'),
                                   PAGE_SIZE_OFFSET)
        size = 65536 if size == 1 else size
        valid = size >= 512 and not size & (size - 1)
        self._size = size if valid else DEFAULT_PAGE_SIZE

    def rows(self) -> Iterator[tuple[Cell, int, Sequence[Any]]]:
        """Yield place, row number and columns of all rows of tables, in order of the pages."""
        for cell in self._disjoint(self._cells((TABLE_LEAF,))):
            try:
                row, columns = self.row(cell)
            except DECODE_ERRORS:
                self.damaged += 1
            else:
                yield cell, row, columns

    def row(self, cell: Cell) -> tuple[int, Sequence[Any]]:
        """Return row number and columns of a row."""
        number, start = cell
        length, start = _varint(self._data, start)
        row, start = _varint(self._data, start)
        return row, _columns(self._payload(number, start, length, self._size - ROW_RESERVE))

    def index_entries(self) -> Iterator[Sequence[Any]]:
        """Yield the columns of all entries of indices."""
        most = self._share_of_page(MAX_SHARE)
        for number, start in self._disjoint(self._cells((INDEX_LEAF, INDEX_INTERIOR))):
            try:
                length, start = _varint(self._data, start)
                yield _columns(self._payload(number, start, length, most))
            except DECODE_ERRORS:
                continue  # serves as a check of the rows only

    def _disjoint(self, cells: Iterator[Cell]) -> Iterator[Cell]:
        """Yield ``cells`` until more was read than the file has: they share pages."""
        most = self._read + MAX_COPIES * len(self._data)
        for cell in cells:
            if self._read > most:
                self.damaged += 1
                return
            yield cell

    def _cells(self, kinds: Sequence[int]) -> Iterator[Cell]:
        """Yield the number of the page and the offset of each cell in pages of ``kinds``."""
        for number in range(len(self._data) // self._size):
            page = number * self._size
            head = page + (FILE_HEAD if number == 0 else 0)
            kind = self._data[head]
            if kind not in kinds:
                continue
            count, = struct.unpack_from('>H', self._data, head + 3)
            inner = PAGE_NUMBER.size if kind == INDEX_INTERIOR else 0  # of the page below
            first = head + 8 + inner
            count = min(count, (page + self._size - first) // 2)
            for pointer in struct.unpack_from(f'>{count}H', self._data, first):
                yield number, page + pointer + inner

    def _share_of_page(self, share: int) -> int:
        """Return the bytes of a cell at a ``share`` of its page."""
        return (self._size - PAGE_RESERVE) * share // SHARE_UNIT - CELL_RESERVE

    def _payload(self, number: int, start: int, length: int, most: int) -> bytes:
        """Return the content of a cell, of which at most ``most`` bytes are in its page."""
        least = self._share_of_page(MIN_SHARE)
        local = least + (length - least) % (self._size - 4)
        local = length if length <= most else local if local <= most else least
        end = start + local
        if end > (number + 1) * self._size or length > len(self._data):
            raise ValueError('cell is longer than its page')
        parts, left = [self._data[start:end]], length - local
        while left:
            page, = PAGE_NUMBER.unpack_from(self._data, end)
            start = (page - 1) * self._size + PAGE_NUMBER.size
            end = start - PAGE_NUMBER.size
            if end < 0 or end + self._size > len(self._data):
                raise ValueError('page of overflow is missing')
            parts.append(self._data[start:end + min(self._size, PAGE_NUMBER.size + left)])
            left -= len(parts[-1])
        self._read += length
        return b''.join(parts)


def _columns(payload: bytes) -> list[Any]:
    size, offset = _varint(payload, 0)
    start, found = size, []
    while offset < size:
        kind, offset = _varint(payload, offset)
        length = (kind - FIRST_BLOB) // 2 if kind >= FIRST_BLOB else SIZES[kind]
        value = payload[start:start + length]
        if len(value) != length:
            raise ValueError('column is longer than its row')
        start += length
        found.append(_value(kind, value))
    return found


def _value(kind: int, value: bytes) -> Any:
    """Return the value of a serial type."""
    if kind >= FIRST_BLOB:
        return value.decode(errors='replace') if kind % 2 else value
    if kind in (ZERO, ONE):
        return kind - ZERO
    if kind == REAL:
        return struct.unpack('>d', value)[0]
    return int.from_bytes(value, 'big', signed=True) if kind else None


def _varint(data: bytes | mmap.mmap, offset: int) -> tuple[int, int]:
    """Return an integer of 1 to 9 bytes, the first bytes with 7 bits each, and its end."""
    number = 0
    for end in range(offset, offset + 8):
        number = number << 7 | data[end] & 0x7F
        if data[end] < 0x80:
            return number, end + 1
    return number << 8 | data[offset + 8], offset + 9
