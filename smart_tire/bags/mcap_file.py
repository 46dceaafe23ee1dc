"""
Reading of one mcap file: fast where it has an index, and as far as it goes where it has none.

The layout of the records is that of the MCAP specification, version 0. Records that hold
messages are taken apart here, for they come a thousand times a second; the mcap library reads
the rest.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from io import BytesIO
import mmap
from operator import itemgetter
from pathlib import Path
import struct
from typing import NamedTuple
from zlib import crc32

import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel as ChannelRecord
from mcap.records import ChunkIndex, McapRecord, Schema, Statistics
from mcap.stream_reader import StreamReader
import zstandard

from smart_tire.bags.storage import Channel, Message, note
from smart_tire.errors import BagError

MAGIC = b'\x89MCAP0\r\n'
RECORD = struct.Struct('<BQ')            # opcode, length of what follows
MESSAGE = struct.Struct('<BQHIQQ')       # opcode, length, channel, sequence, log and publish time
MESSAGE_HEAD = MESSAGE.size - RECORD.size
CHUNK = struct.Struct('<QQQII')          # start, end, size and CRC of its records, name
FOOTER = struct.Struct('<BQQQI8s')       # opcode, length, summary, summary offsets, CRC, magic
RUN = 4096                               # messages outside of chunks that are read at a time
ENDS = (0, Opcode.DATA_END, Opcode.FOOTER)  # 0: a file system that lost power leaves zeros
FIRST_PRIVATE = 0x80                     # opcodes from here on are anybody's
NO_SCHEMA = Schema(id=0, data=b'', encoding='', name='')
BROKEN = (McapError, struct.error, ValueError, EOFError, RuntimeError, zstandard.ZstdError)


class Block(NamedTuple):
    """A chunk, or a run of messages outside of chunks."""

    start_ns: int
    end_ns: int
    offset: int                   # of its first record
    size: int                     # with that record's head
    channels: frozenset[int]      # that it has messages of; empty where nobody knows
    packed: bool                  # a chunk


class McapFile:
    """An mcap file, whole or not."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.losses: list[str] = []
        self._schemas: dict[int, Schema] = {}
        self._records: dict[int, ChannelRecord] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[Channel] | None = None
        self._data = _mapped(path)
        if self._data[:len(MAGIC)] != MAGIC:
            self._data.close()
            raise BagError(f'{path}: is no mcap file')
        self._blocks = self._index() or list(self._walk())
        self._blocks.sort(key=itemgetter(0))

    def close(self) -> None:
        """Give the file back."""
        self._data.close()

    def span(self) -> tuple[int, int] | None:
        """Return when the first and the last message were received [ns]; None without any."""
        if not self._blocks:
            return None
        return self._blocks[0].start_ns, max(block.end_ns for block in self._blocks)

    def counts(self) -> dict[Channel, int]:
        """Return the number of messages of each channel; reads all of a file without index."""
        if self._counts is None:
            self._counts = Counter(channel for _, channel, _ in self.messages())
        return {channel: self._counts[channel] for channel in self._channels.values()}

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Yield the messages of ``topics`` (None: all) in the order of their reception."""
        waiting: list[Message] = []
        when = itemgetter(0)
        for block in self._blocks:
            if block.channels and self._numbers(topics).isdisjoint(block.channels):
                continue
            ready = 0
            while ready < len(waiting) and waiting[ready][0] < block.start_ns:
                ready += 1
            yield from waiting[:ready]
            waiting = waiting[ready:] + self._read(block, topics)
            waiting.sort(key=when)  # stable, and next to nothing where they are in order already
        yield from waiting

    def _index(self) -> list[Block]:
        """Return the blocks that the summary lists; none where it is missing or incomplete."""
        data = self._data
        if len(data) < len(MAGIC) + FOOTER.size:
            return []
        opcode, _, start, _, checksum, magic = FOOTER.unpack_from(data, len(data) - FOOTER.size)
        if opcode != Opcode.FOOTER or magic != MAGIC or not 0 < start < len(data):
            return []
        try:
            if checksum and crc32(data[start:-len(MAGIC) - 4]) != checksum:
                raise ValueError('its checksum is another')
            summary = list(StreamReader(BytesIO(data[start:]), skip_magic=True).records)
            blocks = [self._indexed(entry) for entry in summary if isinstance(entry, ChunkIndex)]
        except BROKEN as error:
            note(self.losses, f'{self.path.name}: the index is damaged ({error})')
            return []
        return blocks if self._describe(summary, blocks) else []

    def _indexed(self, entry: ChunkIndex) -> Block:
        """Return the block for an entry of the index; raise ValueError if none is there."""
        opcode, length = RECORD.unpack_from(self._data, entry.chunk_start_offset)
        start_ns, end_ns, *_ = CHUNK.unpack_from(
            self._data, entry.chunk_start_offset + RECORD.size)
        if (opcode, RECORD.size + length, start_ns, end_ns) != (
                Opcode.CHUNK, entry.chunk_length, entry.message_start_time,
                entry.message_end_time):
            raise ValueError(f'no such chunk at byte {entry.chunk_start_offset}')
        return Block(start_ns, end_ns, entry.chunk_start_offset, entry.chunk_length,
                     frozenset(entry.message_index_offsets), packed=True)

    def _describe(self, summary: list[McapRecord], blocks: list[Block]) -> bool:
        """Take channels and counts from the summary; return whether it has all of them."""
        schemas = {entry.id for entry in summary if isinstance(entry, Schema)} | {0}
        channels = {entry.id: entry for entry in summary if isinstance(entry, ChannelRecord)}
        if not all(entry.schema_id in schemas for entry in channels.values()) or not all(
                block.channels <= channels.keys() for block in blocks):
            return False
        for entry in summary:
            if isinstance(entry, (Schema, ChannelRecord)):
                self._define(entry)
        for entry in summary:
            if isinstance(entry, Statistics) and blocks:
                counts = entry.channel_message_counts
                self._counts = Counter({channel: counts.get(number, 0)
                                        for number, channel in self._channels.items()})
                return entry.chunk_count == len(blocks)
        return True

    def _walk(self) -> Iterator[Block]:
        """Yield the blocks from the first record on, as far as whole records go."""
        data, offset, run = self._data, len(MAGIC), _Run()
        while offset + RECORD.size <= len(data):
            opcode, length = RECORD.unpack_from(data, offset)
            end = offset + RECORD.size + length
            if opcode in ENDS or Opcode.DATA_END < opcode < FIRST_PRIVATE:
                break
            if opcode == Opcode.CHUNK and offset + RECORD.size + CHUNK.size <= len(data):
                start_ns, end_ns, *_ = CHUNK.unpack_from(data, offset + RECORD.size)
                size = min(end, len(data)) - offset  # of a chunk that was cut, the rest may do
                yield Block(start_ns, end_ns, offset, size, frozenset(), packed=True)
            if end > len(data):
                break
            if opcode == Opcode.MESSAGE and length >= MESSAGE_HEAD:
                run.add(MESSAGE.unpack_from(data, offset)[4], offset, end)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._read(Block(0, 0, offset, end - offset, frozenset(), packed=False), None)
            if opcode != Opcode.MESSAGE or run.messages == RUN:
                yield from run.take()
            offset = end
        yield from run.take()
        if offset >= len(data) or data[offset] not in (Opcode.DATA_END, Opcode.FOOTER):
            note(self.losses, f'{self.path.name}: the recording was cut off: no index, and '
                              f'{len(data) - offset} bytes after the last whole record')

    def _read(self, block: Block, topics: Collection[str] | None) -> list[Message]:
        """Return the messages in ``block``; note what is lost."""
        found: list[Message] = []
        records = self._data[block.offset:block.offset + block.size]
        try:
            if block.packed:
                records = _unpacked(records)
            rest = len(records) - self._take_apart(records, topics, found)
            if rest:
                raise ValueError(f'the last {rest} of its {len(records)} bytes are no record')
        except BROKEN as error:
            note(self.losses, f'{self.path.name}: damaged at byte {block.offset}: {error}')
        return found

    def _take_apart(self, records: bytes, topics: Collection[str] | None,
                    found: list[Message]) -> int:
        """Add the messages among ``records`` to ``found``; return where whole records end."""
        wanted = self._wanted(topics)
        offset, size, unpack = 0, len(records), MESSAGE.unpack_from
        padded = records + bytes(MESSAGE_HEAD)  # so that a short last record can be unpacked too
        while offset + RECORD.size <= size:
            opcode, length, number, _, ns, _ = unpack(padded, offset)
            end = offset + RECORD.size + length
            if end > size:
                break
            if opcode == Opcode.MESSAGE:
                if (channel := wanted.get(number)) is not None:
                    found.append((ns, channel, records[offset + MESSAGE.size:end]))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                stream = ReadDataStream(BytesIO(records[offset + RECORD.size:end]))
                reader = Schema if opcode == Opcode.SCHEMA else ChannelRecord
                self._define(reader.read(stream))
                wanted = self._wanted(topics)
            offset = end
        return offset

    def _wanted(self, topics: Collection[str] | None) -> dict[int, Channel]:
        return {number: channel for number, channel in self._channels.items()
                if topics is None or channel.topic in topics}

    def _numbers(self, topics: Collection[str] | None) -> set[int]:
        return set(self._wanted(topics))

    def _define(self, record: Schema | ChannelRecord) -> None:
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif self._records.get(record.id) != record:  # many writers repeat it in every chunk
            self._records[record.id] = record
            schema = self._schemas.get(record.schema_id, NO_SCHEMA)
            if any(channel.topic == record.topic and channel.type != schema.name
                   for channel in self._channels.values()):
                note(self.losses, f'{self.path.name}: {record.topic} has a second type, '
                                  f'{schema.name}, which is left out')
                return
            self._channels[record.id] = Channel(
                record.topic, schema.name, record.message_encoding, schema.data.decode(),
                schema.encoding, record.metadata.get('offered_qos_profiles', ''),
                record.metadata.get('topic_type_hash', ''))


class _Run:
    """Messages outside of chunks that follow each other."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._start = self._end = 0

    @property
    def messages(self) -> int:
        return len(self._times)

    def add(self, ns: int, start: int, end: int) -> None:
        if not self._times:
            self._start = start
        self._times.append(ns)
        self._end = end

    def take(self) -> Iterator[Block]:
        if self._times:
            yield Block(min(self._times), max(self._times), self._start, self._end - self._start,
                        frozenset(), packed=False)
        self._times = []


def _mapped(path: Path) -> mmap.mmap:
    try:
        with path.open('rb') as file:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except ValueError as error:  # an empty file can not be mapped
        raise BagError(f'{path}: is empty') from error
    except OSError as error:
        raise BagError(f'{path}: cannot be read ({error.strerror})') from error


def _unpacked(chunk: bytes) -> bytes:
    """Return the records in a chunk; of one that was cut off, those that can be had."""
    _, _, size, checksum, name_length = CHUNK.unpack_from(chunk, RECORD.size)
    start = RECORD.size + CHUNK.size + name_length
    compression = chunk[start - name_length:start].decode()
    length = int.from_bytes(chunk[start:start + 8], 'little')
    packed = chunk[start + 8:start + 8 + length]
    if compression == 'zstd':
        records = zstandard.ZstdDecompressor().decompressobj().decompress(packed)
    elif compression == 'lz4':
        records = lz4.frame.LZ4FrameDecompressor().decompress(packed)
    elif not compression:
        records = packed
    else:
        raise ValueError(f'compressed by {compression}, expected zstd or lz4')
    if len(packed) == length and (len(records) != size or (
            checksum and crc32(records) != checksum)):
        raise ValueError('its checksum is another')
    return records
