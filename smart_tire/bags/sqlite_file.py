"""Reading of one sqlite3 file of rosbag2, of any version of its schema."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
import sqlite3
from urllib.parse import quote

from smart_tire.bags.storage import Channel, Message, note
from smart_tire.errors import BagError


class SqliteFile:
    """An sqlite3 file, whole or not."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.losses: list[str] = []
        self._connection = _connected(path)
        try:
            self._channels = self._read_channels()
        except sqlite3.DatabaseError as error:
            self.close()
            raise BagError(f'{path}: is no sqlite3 bag ({error})') from error

    def close(self) -> None:
        """Give the file back."""
        self._connection.close()

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
                    yield ns, channel, data
        except sqlite3.DatabaseError as error:
            note(self.losses, f'{self.path.name}: is damaged ({error})')
            yield from self._rest(wanted, last)

    def _rest(self, wanted: dict[int, Channel], last: int) -> Iterator[Message]:
        """Yield what is newer than ``last`` and can be had without the index of times."""
        found: list[Message] = []
        try:
            for number, ns, data in self._connection.execute(
                    'SELECT topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY id'):
                if ns > last and number in wanted:
                    found.append((ns, wanted[number], data))
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


def _connected(path: Path) -> sqlite3.Connection:
    """
    Return a connection that changes nothing.

    Without right to write beside the file, sqlite opens one with a write-ahead log only as
    immutable, which leaves the log unread; so that is the second choice.
    """
    if not path.is_file():
        raise BagError(f'{path}: cannot be read (no such file)')
    for mode in ('mode=ro', 'immutable=1'):
        connection = sqlite3.connect(f'file:{quote(str(path))}?{mode}', uri=True)
        try:
            connection.execute('SELECT count(*) FROM sqlite_master')
        except sqlite3.OperationalError:
            connection.close()
        except sqlite3.DatabaseError as error:
            connection.close()
            raise BagError(f'{path}: is no sqlite3 file ({error})') from error
        else:
            return connection
    raise BagError(f'{path}: cannot be read')
