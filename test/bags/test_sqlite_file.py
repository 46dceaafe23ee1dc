# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Reading of sqlite3 files: several schema versions, intact, truncated, and after a crash."""

from __future__ import annotations

from contextlib import closing
from itertools import product
import shutil
import sqlite3

import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from smart_tire.bags import Bag
from smart_tire.bags.cdr import empty, Encoder
from smart_tire.bags.sqlite_file import SqliteFile
from smart_tire.errors import BagError
from smart_tire.messages import TOPICS
from support.recordings import stream, write_with_rosbags
import zstandard

# Schema of rosbag2 in Foxy, before QoS profiles and definitions were added.
FOXY = """
    CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
                        serialization_format TEXT NOT NULL);
    CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
                          timestamp INTEGER NOT NULL, data BLOB NOT NULL);
    CREATE INDEX timestamp_idx ON messages (timestamp ASC);
    INSERT INTO topics VALUES (1, '/odom', 'nav_msgs/msg/Odometry', 'cdr');
    """


def written(path, script, *messages):
    """Execute a script on a file and insert messages; return its path."""
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.executescript(script)
        for message in messages:
            connection.execute('INSERT INTO messages VALUES (?, ?, ?, ?)', message)
    return path


@pytest.mark.parametrize(('version', 'plugin', 'mode'), [
    *product((8, 9), [StoragePlugin.SQLITE3],
             (CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE)),
    *product([9], [StoragePlugin.MCAP],
             (CompressionMode.NONE, CompressionMode.FILE, CompressionMode.STORAGE))])
def test_bags_are_read_with_any_compression(tmp_path, version, plugin, mode):
    events = stream(0.5)
    with Bag(write_with_rosbags(tmp_path / 'bag', events, version, plugin, mode)) as bag:
        assert list(bag.samples(TOPICS)) == events
        assert bag.topics['/imu/data'].messages == 50
        assert bag.span_ns == (events[0][0], events[-1][0])
        assert not bag.warnings


def test_the_start_of_a_truncated_compressed_file_is_read(tmp_path):
    events = stream(8.0)
    path = write_with_rosbags(tmp_path / 'bag', events, mode=CompressionMode.FILE)
    file, = path.glob('*.zstd')
    file.write_bytes(file.read_bytes()[:file.stat().st_size * 2 // 3])
    with Bag(path) as bag:
        read = list(bag.samples(TOPICS))
        assert bag.losses.lines()
    assert 100 < len(read) < len(events)


def test_a_file_without_profiles_and_definitions_is_read(tmp_path):
    event = next(event for event in stream(0.2) if event[1] == 'odom')
    topic = TOPICS['odom']
    path = tmp_path / 'foxy.db3'
    data = Encoder(topic.type)(topic.to_msg(empty(topic.type), event[2]))
    written(path, FOXY, (1, 1, event[0], data))
    with Bag(path) as bag:
        assert list(bag.samples(['odom'])) == [event]


def test_a_name_that_is_no_utf_8_is_no_damage(tmp_path):
    path = written(tmp_path / 'foxy.db3', FOXY + """
        INSERT INTO topics VALUES (2, CAST(x'2fff62' AS TEXT), 'a_msgs/msg/A', 'cdr');""",
                   (1, 2, 7, b'data'))
    with closing(SqliteFile(path)) as file:
        assert [(ns, channel.topic, data) for ns, channel, data in file.messages()] == [
            (7, '/\ufffdb', b'data')]
        assert not file.losses.reasons and not file.warnings


def test_messages_in_the_write_ahead_log_of_a_killed_recorder_are_read(tmp_path):
    events = stream(0.5)
    file, = write_with_rosbags(tmp_path / 'bag', events[:-100]).glob('*.db3')
    with Bag(write_with_rosbags(tmp_path / 'rest', events[-100:])) as rest:
        late = list(rest.raw())
    connection = sqlite3.connect(file)
    connection.execute('PRAGMA journal_mode=WAL')
    numbers = dict(connection.execute('SELECT name, id FROM topics'))
    connection.executemany('INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)',
                           [(numbers[channel.topic], ns, data) for ns, channel, data in late])
    connection.commit()
    killed = tmp_path / 'killed'
    shutil.copytree(tmp_path / 'bag', killed)  # with the log: the connection is still open
    connection.close()
    with Bag(killed) as bag:
        assert list(bag.samples(TOPICS)) == events


@pytest.mark.parametrize('data', [b'SQLite format 3\x00' + b'\xaa' * 2000,
                                  b'SQLite format 3\x00'])
def test_a_file_that_is_not_sqlite3_is_rejected(tmp_path, data):
    path = tmp_path / 'a.db3'
    path.write_bytes(data)
    with pytest.raises(BagError, match=r'a\.db3: '):
        Bag(path)


def test_a_database_without_bag_tables_is_rejected(tmp_path):
    path = written(tmp_path / 'a.db3', 'CREATE TABLE recipes(id INTEGER)')
    with pytest.raises(BagError, match='not an sqlite3 bag'):
        Bag(path)


JAZZY = """
    CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
                        serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,
                        type_description_hash TEXT NOT NULL);
    CREATE TABLE message_definitions(
        id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL, encoding TEXT NOT NULL,
        encoded_message_definition TEXT NOT NULL, type_description_hash TEXT NOT NULL);
    CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL,
                          metadata TEXT NOT NULL);
    CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
                          timestamp INTEGER NOT NULL, data BLOB NOT NULL);
    CREATE INDEX timestamp_idx ON messages (timestamp ASC);
    INSERT INTO topics VALUES (3, '/a', 'a_msgs/msg/A', 'cdr', '- depth: 7', 'RIHS01_a');
    INSERT INTO topics VALUES (5, '/b', 'b_msgs/msg/B', 'json', '', '');
    INSERT INTO message_definitions VALUES (1, 'a_msgs/msg/A', 'ros2msg', 'int32 a', 'RIHS01_a');
    INSERT INTO metadata VALUES (1, 9, 'ros_distro: jazzy');
    """
TIMES = [0, 40, 20, 20, 30, 10]  # ns, of the messages


def jazzy(path):
    """Write the file of a recorder of Jazzy; return its path."""
    return written(path, JAZZY, *((number, (3, 5)[number % 2], ns, b'message %d' % number)
                                  for number, ns in enumerate(TIMES, 1)))


def contents(path):
    """Return messages, channels, metadata, span and losses of a file."""
    with closing(SqliteFile(path)) as file:
        counts = [(one.topic, one.type, one.encoding, one.definition, one.definition_encoding,
                   one.qos, one.type_hash, count) for one, count in file.counts().items()]
        return ([(ns, channel.topic, data) for ns, channel, data in file.messages()], counts,
                [one.ros_distro for one in file.metadata()], file.span(), file.losses)


def test_the_latest_valid_custom_data_count(tmp_path):
    path = jazzy(tmp_path / 'a.db3')
    written(path, ''.join(f"INSERT INTO metadata VALUES ({number}, 9, '{text}');" for number, text
                          in enumerate(('custom_data: ~', 'custom_data: {params: a}', '{'), 2)))
    with Bag(path) as bag:
        assert bag.custom_data == {'params': 'a'}


def test_the_rows_of_a_damaged_file_are_those_of_the_intact_one(tmp_path):
    path = jazzy(tmp_path / 'a.db3')
    messages, counts, metadata, span, losses = contents(path)
    assert [(ns, data) for ns, _, data in messages] == [
        (0, b'message 1'), (10, b'message 6'), (20, b'message 3'), (20, b'message 4'),
        (30, b'message 5'), (40, b'message 2')]
    assert counts == [('/a', 'a_msgs/msg/A', 'cdr', 'int32 a', 'ros2msg', '- depth: 7', 'RIHS01_a',
                       3), ('/b', 'b_msgs/msg/B', 'json', '', '', '', '', 3)]
    assert (metadata, span, losses.reasons) == (['jazzy'], (0, 40), [])
    path.write_bytes(path.read_bytes() + b'x')  # an incomplete page
    assert contents(path)[:4] == (messages, counts, metadata, span)
    line, = contents(path)[4].lines()
    assert line == 'messages are missing: a.db3: file is damaged (last page is incomplete)'


@pytest.mark.parametrize(('statement', 'lost'), [
    ('UPDATE messages SET topic_id = 4 WHERE id > 3', 3),
    ("UPDATE messages SET data = 'text' WHERE id < 3", 2)])
@pytest.mark.parametrize('damaged', [True, False])
def test_invalid_rows_are_left_out_and_counted(tmp_path, statement, lost, damaged):
    path = jazzy(tmp_path / 'a.db3')
    complete = contents(path)[0]
    written(path, statement)
    if damaged:
        path.write_bytes(path.read_bytes() + b'x')
    messages, counts, _, span, losses = contents(path)
    assert len(messages) == len(TIMES) - lost == sum(count[-1] for count in counts)
    assert set(messages) < set(complete)
    assert span == (messages[0][0], messages[-1][0])
    assert losses.messages == lost
    assert damaged or losses.reasons == [f'a.db3: {lost} invalid rows']


def test_a_page_without_kind_costs_its_rows_only(tmp_path):
    path = jazzy(tmp_path / 'a.db3')
    written(path, '', *((number, 3, 100 + number, bytes(100)) for number in range(10, 500)))
    complete, data = contents(path)[0], bytearray(path.read_bytes())
    last = max(at for at in range(0, len(data), 4096) if data[at] == 0x0D)
    rows = int.from_bytes(data[last + 3:last + 5], 'big')
    data[last] = 0
    path.write_bytes(data)
    messages, _, _, _, losses = contents(path)
    assert messages == complete[:-rows]
    assert losses.messages == rows  # by the index


def test_an_empty_table_has_no_span(tmp_path):
    path = written(tmp_path / 'a.db3', JAZZY)
    assert contents(path)[3] is None
    path.write_bytes(path.read_bytes() + b'x')
    assert contents(path)[3] is None
    assert contents(path)[0] == []


def test_a_damaged_compressed_message_is_one_loss(tmp_path):
    path = jazzy(tmp_path / 'a.db3')
    written(path, 'DELETE FROM messages WHERE id IN (2, 3)',
            (2, 3, 40, b'\x28\xb5\x2f\xfd' + b'\xff' * 9),
            (3, 5, 20, zstandard.compress(b'packed')))
    messages, _, _, _, losses = contents(path)
    assert [data for _, _, data in messages] == [
        b'message 1', b'message 6', b'packed', b'message 4', b'message 5']
    assert losses.messages == 1
    assert losses.reasons[0].startswith('a.db3: message of /a received at 40 ns: ')


def test_text_that_is_not_utf8_is_replaced(tmp_path):
    path = jazzy(tmp_path / 'a.db3')
    data = path.read_bytes()
    path.write_bytes(data.replace(b'- depth: 7', b'- depth\xff 7'))
    assert contents(path)[1][0][5] == '- depth\ufffd 7'
    path.write_bytes(path.read_bytes() + b'x')
    assert contents(path)[1][0][5] == '- depth\ufffd 7'


def test_a_name_with_special_characters_is_opened(tmp_path):
    path = jazzy(tmp_path / 'a?b#c%20 d.db3')
    assert len(contents(path)[0]) == len(TIMES)
    assert contents(path)[4].reasons == []


ENDLESS = 'WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT '
MESSAGES = 'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp INTEGER, data'
INDEX = 'CREATE INDEX a ON messages '
SCHEMAS = {  # table that is replaced, and how
    'endless messages': ('messages', 'CREATE VIEW messages AS ' + ENDLESS +
                         'x AS id, 3 AS topic_id, x AS timestamp, zeroblob(9) AS data FROM n'),
    'endless topics': ('topics', 'CREATE VIEW topics AS ' + ENDLESS +
                       "x AS id, '/a' AS name, 'a' AS type, 'cdr' AS serialization_format FROM n"),
    'endless metadata': ('metadata', 'CREATE VIEW metadata AS ' + ENDLESS +
                         "x AS id, 'a: b' AS metadata FROM n"),
    'endless definitions': ('message_definitions', 'CREATE VIEW message_definitions AS ' + ENDLESS
                            + "'a' AS topic_type, 'b' AS encoding, 'c' AS "
                            'encoded_message_definition FROM n'),
    'generated column': ('messages', MESSAGES + ' GENERATED ALWAYS AS (zeroblob(900000000)))'),
    'stored column': ('messages', MESSAGES + ' AS (zeroblob(900000000)) STORED)'),
    'virtual table': ('messages', 'CREATE VIRTUAL TABLE messages USING fts5(timestamp, data)'),
    'check': ('messages', MESSAGES + ', CHECK (length(hex(zeroblob(4))) > 0))'),
    'check without brackets': ('messages', MESSAGES + ' check(data LIKE data))'),
    'index': ('', INDEX + '(length(hex(zeroblob(4))))'),
    'index without brackets': ('', INDEX + '(data LIKE data)'),
    'partial index': ('', INDEX + '(timestamp) WHERE data LIKE data'),
    'trigger': ('', f'CREATE TRIGGER a AFTER INSERT ON messages BEGIN {ENDLESS} x FROM n; END'),
    'comment': ('', f'CREATE /* TABLE a(b) */ VIEW a AS {ENDLESS} x FROM n')}


@pytest.mark.parametrize('name', SCHEMAS)
def test_of_any_schema_but_plain_tables_only_the_rows_are_read(tmp_path, name, monkeypatch):
    path = jazzy(tmp_path / 'a.db3')
    expected, statements, connect = contents(path), [], sqlite3.connect
    table, statement = SCHEMAS[name]
    written(path, (f'DROP TABLE {table};' if table else '') + statement)

    def traced(*args, **options):
        connection = connect(*args, **options)
        connection.set_trace_callback(statements.append)
        return connection

    monkeypatch.setattr(sqlite3, 'connect', traced)
    if table == 'topics':
        with pytest.raises(BagError, match=r'not an sqlite3 bag \(the schema has more than plain'):
            contents(path)
    else:
        messages, counts, metadata, _, losses = contents(path)
        assert messages == ([] if table == 'messages' else [
            one for one in expected[0] if one in messages or not name.startswith('index')])
        # The entries of an unknown index contradict the times of some rows.
        assert [count[0] for count in counts] == ['/a', '/b']
        assert metadata == ([] if table == 'metadata' else ['jazzy'])
        assert 'the schema has more than plain tables' in losses.reasons[0]
    assert statements[0] == 'PRAGMA trusted_schema = OFF'
    assert all('FROM sqlite_master' in one for one in statements[1:])


@pytest.mark.parametrize('statement', [
    'CREATE TABLE other(a VARCHAR(255) DEFAULT 3, b, FOREIGN KEY (b) REFERENCES topics(id))',
    'CREATE TABLE other(a, b, PRIMARY KEY (a, b)) WITHOUT ROWID', 'CREATE TABLE "o t"("a" UNIQUE)',
    'create unique index other on messages("timestamp" ASC, id desc)'])
def test_plain_tables_and_indices_have_any_columns(tmp_path, statement):
    path = jazzy(tmp_path / 'a.db3')
    expected = contents(path)[:4]
    written(path, statement)
    assert contents(path)[:4] == expected
    assert contents(path)[4].reasons == []


@pytest.mark.parametrize('sql', ['sql', 'CAST(sql AS BLOB)', '5'])
def test_a_view_that_claims_to_be_a_table_is_none(tmp_path, sql):
    path = jazzy(tmp_path / 'a.db3')
    expected = contents(path)[:4]
    written(path, 'PRAGMA writable_schema = ON; CREATE VIEW a AS SELECT 1; UPDATE sqlite_master '
                  f"SET type = 'table', rootpage = 2, sql = {sql} WHERE name = 'a'")
    assert contents(path)[:4] == expected
    assert 'file is damaged' in contents(path)[4].reasons[0]


@pytest.fixture
def logged(tmp_path):
    """Return a bag of an interrupted recording, whose rows are in the write-ahead log."""
    live, folder = tmp_path / 'live.db3', tmp_path / 'bag'
    folder.mkdir()
    db = sqlite3.connect(live, isolation_level=None)
    db.executescript("""PRAGMA journal_mode=WAL; PRAGMA wal_autocheckpoint=0;
        CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
            serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
        CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
            timestamp INTEGER NOT NULL, data BLOB NOT NULL);
        INSERT INTO topics VALUES (1, '/imu/data', 'sensor_msgs/msg/Imu', 'cdr', '');
        PRAGMA wal_checkpoint(TRUNCATE);""")
    for k in range(50):
        db.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)', (k, b'x'))
    for suffix in ('', '-wal'):
        shutil.copy(f'{live}{suffix}', folder / f'bag_0.db3{suffix}')
    db.close()
    return folder


def counted(folder):
    """Return the number of messages of a bag, and what is missing."""
    with Bag(folder) as bag:
        return sum(topic.messages for topic in bag.topics.values()), bag.losses.lines()


def test_the_write_ahead_log_is_read(logged):
    assert counted(logged) == (50, [])


def test_the_write_ahead_log_is_read_where_sqlite_can_make_no_index_of_it(logged):
    (logged / 'bag_0.db3-shm').mkdir()  # as in a read-only folder
    before = sorted(path.name for path in logged.iterdir())
    assert counted(logged) == (50, [])
    assert sorted(path.name for path in logged.iterdir()) == before


def test_a_write_ahead_log_that_is_gone_is_a_loss(logged):
    (logged / 'bag_0.db3-wal').unlink()
    for _ in range(2):  # reading makes an empty one
        count, (loss,) = counted(logged)
        assert count == 0 and 'write-ahead log (-wal) is missing' in loss
