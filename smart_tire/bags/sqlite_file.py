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
Reader of one sqlite3 file of rosbag2, of any schema version.

Sqlite checks the file first (0.3 s for 500,000 messages). Of a damaged one the rows in all intact
pages are read, whatever leads to them. rosbags takes 1.3 times as long and reads intact files
only.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing, ExitStack
from dataclasses import replace
from pathlib import Path
import re
import shutil
import sqlite3
import tempfile
from typing import Any
from urllib.parse import quote

from smart_tire.bags.file_bytes import map_file, unpacked, ZSTD_MAGIC
from smart_tire.bags.metadata import Channel, Losses, Message, Metadata, metadata_in
from smart_tire.bags.sqlite_pages import Cell, Pages
from smart_tire.errors import BagError
import zstandard

# What is read by SQL. A view or a generated column may be endless, and sqlite evaluates conditions
# and the expressions of indices while it checks a file.
COLUMN = r'\s*"?\w+"?(?:\s+(?:ASC|DESC))?\s*'
WAL_MODE_AT = 18  # byte of the file, 2 in write-ahead mode (sqlite file format, 1.3)
PLAIN_SCHEMA = re.compile(
    r'CREATE\s+(?:TABLE\s[^()]*\((?:(?!\b(?:CHECK|AS)\b)(?:[^()]|\([\w\s,]*\)))*\)[^()]*'
    rf'|(?:UNIQUE\s+)?INDEX\s[^()]*\({COLUMN}(?:,{COLUMN})*\)\s*)', re.IGNORECASE)
VALID = """topic_id IN (SELECT id FROM topics) AND typeof(timestamp) = 'integer'
           AND typeof(data) = 'blob'"""  # of a message


class SqliteFile:
    """An sqlite3 file, intact or damaged."""

    def __init__(self, path: Path, losses: Losses | None = None) -> None:
        self.path = path
        self.warnings: list[str] = []
        self.losses = Losses() if losses is None else losses
        self._stack = ExitStack()
        try:
            try:
                self._tables: _Database | _DamagedDatabase = _Database(path, self._stack)
            except sqlite3.DatabaseError as error:
                self._tables = _DamagedDatabase(path, self._stack, error)
        except BagError:
            self.close()
            raise
        if self._tables.damage:
            self.losses.add(f'{path.name}: {self._tables.damage}', self._tables.lost)
        self._channels = self._tables.channels

    def close(self) -> None:
        """Close the file."""
        self._stack.close()

    @property
    def lacks_log(self) -> bool:
        """Return whether the file may have had a write-ahead log, and there is none."""
        with self.path.open('rb') as file:
            head = file.read(WAL_MODE_AT + 1)
        log = _log(self.path)  # an empty one is made by reading
        return head[WAL_MODE_AT:] == b'\x02' and not (log.exists() and log.stat().st_size)

    def metadata(self) -> list[Metadata]:
        """Return the metadata in the file; schemas before version 4 have none."""
        return [metadata_in(text) for text in self._tables.metadata()]

    def span(self) -> tuple[int, int] | None:
        """Return the receive times of the first and last message [ns]; None without messages."""
        start, end = self._tables.span()
        return None if start is None or end is None else (start, end)

    def counts(self) -> dict[Channel, int]:
        """Return the message count of each channel."""
        counts = self._tables.counts()
        return {channel: counts.get(number, 0) for number, channel in self._channels.items()}

    def messages(self, topics: Collection[str] | None = None, *, as_written: bool = False
                 ) -> Iterator[Message]:
        """
        Yield the messages of ``topics`` (None: all) in order of receive time.

        ``as_written``: in the order of the file, if it is intact.
        """
        wanted = {number: channel for number, channel in self._channels.items()
                  if topics is None or channel.topic in topics}
        for number, ns, data in self._tables.messages(as_written=as_written):
            if (channel := wanted.get(number)) is None:
                continue
            try:
                yield ns, channel, unpacked(data) if data.startswith(ZSTD_MAGIC) else data
            except (ValueError, zstandard.ZstdError) as error:
                self.losses.add(f'{self.path.name}: message of {channel.topic} received at {ns} '
                                f'ns: {error}', 1)


class _Database:
    """The tables of an intact file; sqlite3.DatabaseError if it is damaged."""

    def __init__(self, path: Path, stack: ExitStack) -> None:
        self._connection = stack.enter_context(closing(_connect(path, stack)))
        self._connection.text_factory = lambda text: text.decode(errors='replace')
        if not all(sql is None or isinstance(sql, str) and PLAIN_SCHEMA.fullmatch(sql)
                   for sql, in self._connection.execute('SELECT sql FROM sqlite_master')):
            raise sqlite3.DatabaseError('the schema has more than plain tables and indices')
        page_size, = self._connection.execute('PRAGMA page_size').fetchone()
        if path.stat().st_size % page_size:  # sqlite reads the missing bytes as zeros
            raise sqlite3.DatabaseError('last page is incomplete')
        result, = self._connection.execute('PRAGMA integrity_check(1)').fetchone()
        if result != 'ok':
            raise sqlite3.DatabaseError(result.splitlines()[-1])
        self.channels = self._read_channels()
        self.lost, = self._connection.execute(
            f'SELECT count(*) FROM messages WHERE ({VALID}) IS NOT TRUE').fetchone()
        self.damage = f'{self.lost} invalid rows' if self.lost else ''

    def metadata(self) -> list[str]:
        try:
            return [text for text, in self._connection.execute(
                "SELECT metadata FROM metadata WHERE typeof(metadata) = 'text' ORDER BY id")]
        except sqlite3.OperationalError:
            return []

    def span(self) -> tuple[int | None, int | None]:
        start, end = self._connection.execute(
            f'SELECT min(timestamp), max(timestamp) FROM messages WHERE {VALID}').fetchone()
        return start, end

    def counts(self) -> dict[int, int]:
        return dict(self._connection.execute(
            f'SELECT topic_id, count(*) FROM messages WHERE {VALID} GROUP BY topic_id'))

    def messages(self, *, as_written: bool) -> Iterator[tuple[int, int, bytes]]:
        order = 'id' if as_written else 'timestamp, id'
        return self._connection.execute(f"""SELECT topic_id, timestamp, data FROM messages
                                            WHERE {VALID} ORDER BY {order}""")

    def _read_channels(self) -> dict[int, Channel]:
        columns = {row[1] for row in self._connection.execute('PRAGMA table_info(topics)')}
        optional = [name if name in columns else "''"
                    for name in ('offered_qos_profiles', 'type_description_hash')]
        definitions = self._read_definitions()
        return {
            number: Channel(topic, kind, encoding, *definitions.get(kind, ('', '')),
                            qos=qos, type_hash=type_hash)
            for number, topic, kind, encoding, qos, type_hash in self._connection.execute(
                f'SELECT id, name, type, serialization_format, {", ".join(optional)} FROM topics')}

    def _read_definitions(self) -> dict[str, tuple[str, str]]:
        if not self._connection.execute('PRAGMA table_info(message_definitions)').fetchall():
            return {}
        return {kind: (text, encoding) for kind, text, encoding in self._connection.execute(
            'SELECT topic_type, encoded_message_definition, encoding FROM message_definitions')}


class _DamagedDatabase:
    """The rows in the intact pages of a file; BagError if no topics are among them."""

    def __init__(self, path: Path, stack: ExitStack, error: Exception) -> None:
        self._pages = Pages(stack.enter_context(closing(map_file(path))))
        self.damage = f'file is damaged ({error})'
        self.channels: dict[int, Channel] = {}
        self._metadata: list[str] = []
        self._cells: list[tuple[int, int, int, Cell]] = []  # time [ns], row, topic, place
        definitions: dict[str, tuple[str, str]] = {}
        for cell, row, columns in self._pages.rows():
            match columns:
                case [None, int(number), int(ns), bytes()]:
                    self._cells.append((ns, row, number, cell))
                case [None, str(topic), str(kind), str(encoding), *rest] if '/' in kind:
                    qos, type_hash, *_ = *filter(_is_text, rest), '', ''
                    self.channels[row] = Channel(topic, kind, encoding, '', '', qos, type_hash)
                case [None, str(kind), str(encoding), str(text), *_]:
                    definitions[kind] = text, encoding
                case [None, int(), str(text)]:
                    self._metadata.append(text)
        if not self.channels:
            raise BagError(f'{path}: not an sqlite3 bag ({error})') from error
        self.channels = {row: replace(one, definition=text, definition_encoding=encoding)
                         for row, one in self.channels.items()
                         for text, encoding in [definitions.get(one.type, ('', ''))]}
        self._keep_valid()

    def _keep_valid(self) -> None:
        """Leave out rows of unknown topics, and those with another time than in the index."""
        times = {entry[1]: entry[0] for entry in self._pages.index_entries()
                 if len(entry) == 2 and all(isinstance(one, int) for one in entry)}
        found, valid = len(self._cells), {
            row: (ns, row, number, cell) for ns, row, number, cell in self._cells
            if number in self.channels and times.get(row, ns) == ns}
        self._cells = sorted(valid.values())
        self.lost = max(len(times.keys() - valid.keys()),
                        self._pages.damaged + found - len(valid))

    def metadata(self) -> list[str]:
        return self._metadata

    def span(self) -> tuple[int | None, int | None]:
        return (self._cells[0][0], self._cells[-1][0]) if self._cells else (None, None)

    def counts(self) -> dict[int, int]:
        return Counter(number for _, _, number, _ in self._cells)

    def messages(self, *, as_written: bool) -> Iterator[tuple[int, int, bytes]]:
        for ns, _, number, cell in self._cells:
            yield number, ns, self._pages.row(cell)[1][3]


def _log(path: Path) -> Path:
    """Return the write-ahead log of a file."""
    return path.with_name(f'{path.name}-wal')


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _connect(path: Path, stack: ExitStack) -> sqlite3.Connection:
    """
    Return a read-only connection.

    In a read-only folder, sqlite opens a file with a write-ahead log only as immutable. The log
    would be ignored then, so that a copy of both is opened.
    """
    log = _log(path)
    modes = ['mode=ro', 'immutable=1']
    if log.is_file() and log.stat().st_size:
        modes.insert(1, '')
    for mode in modes:
        if not mode:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='smart_tire_')))
            try:
                for file in (log, path):
                    path = Path(shutil.copyfile(file, folder / file.name))
            except OSError as error:
                raise sqlite3.DatabaseError(f'{log.name} cannot be used: the folder is read-only, '
                                            f'and no copy can be made: {error}') from error
            mode = 'mode=ro'
        connection = sqlite3.connect(f'file:{quote(str(path))}?{mode}', uri=True)
        try:
            connection.execute('PRAGMA trusted_schema = OFF')
            connection.execute('SELECT count(*) FROM sqlite_master')
        except sqlite3.OperationalError:
            connection.close()
        except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
            connection.close()
            raise sqlite3.DatabaseError(str(error)) from error
        else:
            return connection
    raise sqlite3.OperationalError('cannot be opened')
