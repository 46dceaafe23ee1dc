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

rosbags takes 1.3 times as long and reads intact files only.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import closing, ExitStack
from pathlib import Path
import shutil
import sqlite3
import tempfile
from urllib.parse import quote

from smart_tire.bags.metadata import add_warning, Channel, custom_data_in, Message
from smart_tire.errors import BagError
import zstandard

ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'  # start of a compressed file or message, but of no CDR message
# Bytes from the start of the file.
PAGE_SIZE_OFFSET, CHANGE_COUNTER_OFFSET, VERSION_VALID_FOR_OFFSET = 16, 24, 92


class SqliteFile:
    """An sqlite3 file, intact or damaged."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.warnings: list[str] = []
        self._stack = ExitStack()
        try:
            self._connection = self._stack.enter_context(closing(self._open()))
            self._channels = self._read_channels()
        except (sqlite3.DatabaseError, OSError) as error:
            self.close()
            raise BagError(f'{path}: not an sqlite3 bag ({error})') from error

    def close(self) -> None:
        """Close the file."""
        self._stack.close()

    def custom_data(self) -> dict[str, str]:
        """Return the custom data in the file; schemas before version 4 have none."""
        try:
            texts = self._connection.execute('SELECT metadata FROM metadata ORDER BY id')
            return {key: value for text, in texts for key, value in custom_data_in(text).items()}
        except sqlite3.DatabaseError:
            return {}

    def span(self) -> tuple[int, int] | None:
        """Return the receive times of the first and last message [ns]; None without messages."""
        try:
            start, end = self._connection.execute(
                'SELECT min(timestamp), max(timestamp) FROM messages').fetchone()
        except sqlite3.DatabaseError:
            times = [ns for ns, _, _ in self.messages()]
            start, end = min(times, default=None), max(times, default=None)
        return None if start is None else (start, end)

    def counts(self) -> dict[Channel, int]:
        """Return the message count of each channel."""
        counts = dict.fromkeys(self._channels.values(), 0)
        try:
            for number, count in self._connection.execute(
                    'SELECT topic_id, count(*) FROM messages GROUP BY topic_id'):
                counts[self._channels[number]] = count
        except sqlite3.DatabaseError:
            counts = dict.fromkeys(counts, 0)
            for _, channel, _ in self.messages():
                counts[channel] += 1
        return counts

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Yield the messages of ``topics`` (None: all) in order of receive time."""
        wanted = {number: channel for number, channel in self._channels.items()
                  if topics is None or channel.topic in topics}
        last = -1
        try:
            for number, ns, data in self._connection.execute(
                    'SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id'):
                if (channel := wanted.get(number)) is not None:
                    last = ns
                    yield ns, channel, _decompressed(data)
        except sqlite3.DatabaseError as error:
            add_warning(self.warnings, f'{self.path.name}: file is damaged ({error})')
            yield from self._read_unindexed(wanted, last)

    def _open(self) -> sqlite3.Connection:
        try:
            return _connect(self.path)
        except sqlite3.DatabaseError as error:
            add_warning(self.warnings, f'{self.path.name}: file is damaged ({error})')
        folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix='smart_tire_'))
        copy = Path(folder) / self.path.name
        _copy_repaired(self.path, copy)
        return _connect(copy)

    def _read_unindexed(self, wanted: dict[int, Channel], last: int) -> Iterator[Message]:
        """Yield messages after ``last`` [ns] that can be read without the timestamp index."""
        found: list[Message] = []
        try:
            for number, ns, data in self._connection.execute(
                    'SELECT topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id'):
                if isinstance(data, bytes) and number in wanted and ns > last:
                    found.append((ns, wanted[number], _decompressed(data)))
        except sqlite3.DatabaseError:
            pass  # the caller has added a warning; keep what was read
        yield from sorted(found, key=lambda message: message[0])

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


def _decompressed(data: bytes) -> bytes:
    """Return ``data``, decompressed if rosbag2 has compressed the message."""
    return zstandard.decompress(data) if data.startswith(ZSTD_MAGIC) else data


def _connect(path: Path) -> sqlite3.Connection:
    """
    Return a read-only connection.

    In a read-only folder, sqlite opens a file with a write-ahead log only as immutable. The log
    is ignored then, hence this mode is the second choice.
    """
    for mode in ('mode=ro', 'immutable=1'):
        connection = sqlite3.connect(f'file:{quote(str(path))}?{mode}', uri=True)
        try:
            connection.execute('SELECT count(*) FROM sqlite_master')
        except sqlite3.OperationalError:
            connection.close()
        except sqlite3.DatabaseError:
            connection.close()
            raise
        else:
            return connection
    raise sqlite3.OperationalError('cannot be opened')


def _copy_repaired(path: Path, copy: Path) -> None:
    """
    Copy a truncated file so that sqlite opens the copy.

    Sqlite refuses a file that is shorter than the size in its header, unless the header marks
    that size as invalid (file format 1.3.8: "version-valid-for" differs from the change counter).
    """
    shutil.copyfile(path, copy)
    with copy.open('r+b') as file:
        file.seek(PAGE_SIZE_OFFSET)
        page = int.from_bytes(file.read(2), 'big')
        page = 65536 if page == 1 else max(page, 512)
        file.truncate(path.stat().st_size // page * page)  # a partial page would be read as zeros
        file.seek(CHANGE_COUNTER_OFFSET)
        changes = int.from_bytes(file.read(4), 'big')
        file.seek(VERSION_VALID_FOR_OFFSET)
        file.write(((changes + 1) & 0xFFFFFFFF).to_bytes(4, 'big'))
