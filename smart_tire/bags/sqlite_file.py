"""Reading of one sqlite3 file of rosbag2, of any version of its schema."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import closing, ExitStack
from pathlib import Path
import shutil
import sqlite3
import tempfile
from urllib.parse import quote

import zstandard

from smart_tire.bags.storage import Channel, Message, note
from smart_tire.errors import BagError

ZSTD = b'\x28\xb5\x2f\xfd'                  # begins what is packed, and no message
PAGE_SIZE, CHANGES, VALID_FOR = 16, 24, 92  # where they stand in the file's header


class SqliteFile:
    """An sqlite3 file, whole or not."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.losses: list[str] = []
        self._stack = ExitStack()
        try:
            self._connection = self._stack.enter_context(closing(self._open()))
            self._channels = self._read_channels()
        except (sqlite3.DatabaseError, OSError) as error:
            self.close()
            raise BagError(f'{path}: is no sqlite3 bag ({error})') from error

    def close(self) -> None:
        """Give the file back."""
        self._stack.close()

    def span(self) -> tuple[int, int] | None:
        """Return when the first and the last message were received [ns]; None without any."""
        try:
            start, end = self._connection.execute(
                'SELECT min(timestamp), max(timestamp) FROM messages').fetchone()
        except sqlite3.DatabaseError:
            times = [ns for ns, _, _ in self.messages()]
            start, end = min(times, default=None), max(times, default=None)
        return None if start is None else (start, end)

    def counts(self) -> dict[Channel, int]:
        """Return the number of messages of each channel."""
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
        """Yield the messages of ``topics`` (None: all) in the order of their reception."""
        wanted = {number: channel for number, channel in self._channels.items()
                  if topics is None or channel.topic in topics}
        last = -1
        try:
            for number, ns, data in self._connection.execute(
                    'SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id'):
                if (channel := wanted.get(number)) is not None:
                    last = ns
                    yield ns, channel, _plain(data)
        except sqlite3.DatabaseError as error:
            note(self.losses, f'{self.path.name}: is damaged ({error})')
            yield from self._rest(wanted, last)

    def _open(self) -> sqlite3.Connection:
        try:
            return _connected(self.path)
        except sqlite3.DatabaseError as error:
            note(self.losses, f'{self.path.name}: is damaged ({error})')
        folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix='smart_tire_'))
        copy = Path(folder) / self.path.name
        _mend(self.path, copy)
        return _connected(copy)

    def _rest(self, wanted: dict[int, Channel], last: int) -> Iterator[Message]:
        """Yield what is newer than ``last`` and can be had without the index of times."""
        found: list[Message] = []
        try:
            for number, ns, data in self._connection.execute(
                    'SELECT topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id'):
                if isinstance(data, bytes) and number in wanted and ns > last:
                    found.append((ns, wanted[number], _plain(data)))
        except sqlite3.DatabaseError:
            pass  # noted by the caller; what was found up to here counts
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


def _plain(data: bytes) -> bytes:
    """Return ``data`` unpacked if it is packed, as rosbag2's message compression leaves it."""
    return zstandard.decompress(data) if data.startswith(ZSTD) else data


def _connected(path: Path) -> sqlite3.Connection:
    """
    Return a connection that changes nothing.

    Without right to write beside the file, sqlite opens one with a write-ahead log only as
    immutable, which leaves the log unread; so that is the second choice.
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


def _mend(path: Path, copy: Path) -> None:
    """
    Copy a file that was cut off so that sqlite opens the copy.

    Sqlite refuses a file that is shorter than its header says, unless the header says that
    its size is out of date (file format, 1.3.8: "version-valid-for" is not the change counter).
    """
    shutil.copyfile(path, copy)
    with copy.open('r+b') as file:
        file.seek(PAGE_SIZE)
        page = int.from_bytes(file.read(2), 'big')
        page = 65536 if page == 1 else max(page, 512)
        file.truncate(path.stat().st_size // page * page)  # half a page would be read as zeros
        file.seek(CHANGES)
        changes = int.from_bytes(file.read(4), 'big')
        file.seek(VALID_FOR)
        file.write(((changes + 1) & 0xFFFFFFFF).to_bytes(4, 'big'))
