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
Reader of one MCAP file: by its index, or record by record if the index is missing or damaged.

The record layout follows version 0 of the MCAP specification. Chunks and messages are parsed
here: the libraries do not read truncated chunks, and for an intact file they take longer (rosbags
2.6 times, mcap 4 to 8 times). All other records are parsed by the mcap library.
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
from mcap.records import ChunkIndex, McapRecord, Metadata, MetadataIndex, Schema, Statistics
from mcap.stream_reader import StreamReader
from smart_tire.bags.metadata import add_warning, Channel, custom_data_in, Message
from smart_tire.errors import BagError
import zstandard

MAGIC = b'\x89MCAP0\r\n'
RECORD = struct.Struct('<BQ')            # opcode, length of the content
MESSAGE = struct.Struct('<BQHIQQ')       # opcode, length, channel, sequence, log and publish time
MESSAGE_HEAD = MESSAGE.size - RECORD.size
CHUNK = struct.Struct('<QQQII')          # start, end, size, CRC, length of compression name
FOOTER = struct.Struct('<BQQQI8s')       # opcode, length, summary, summary offsets, CRC, magic
MAX_RUN_MESSAGES = 4096                  # unchunked messages that are read at a time
END_OPCODES = (0, Opcode.DATA_END, Opcode.FOOTER)  # 0: zeros that a power failure leaves
FIRST_PRIVATE_OPCODE = 0x80              # opcodes from here on are application-defined
METADATA_KEY = 'serialized_metadata'     # of the metadata record of rosbag2
NO_SCHEMA = Schema(id=0, data=b'', encoding='', name='')
DECODE_ERRORS = (McapError, struct.error, ValueError, EOFError, RuntimeError, zstandard.ZstdError)


class Block(NamedTuple):
    """A chunk, or a run of consecutive unchunked messages."""

    start_ns: int
    end_ns: int
    offset: int                   # of its first record
    size: int                     # bytes, including the record header
    channels: frozenset[int]      # ids of the channels of its messages; empty if unknown
    is_chunk: bool


class McapFile:
    """An MCAP file, intact or damaged."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.warnings: list[str] = []
        self._schemas: dict[int, Schema] = {}
        self._records: dict[int, ChannelRecord] = {}
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[Channel] | None = None
        self._metadata_offsets: list[int] = []
        self._data = _map_file(path)
        if self._data[:len(MAGIC)] != MAGIC:
            self._data.close()
            raise BagError(f'{path}: not an MCAP file')
        self._blocks = self._read_index() or list(self._scan())
        self._blocks.sort(key=itemgetter(0))

    def close(self) -> None:
        """Close the file."""
        self._data.close()

    def span(self) -> tuple[int, int] | None:
        """Return the receive times of the first and last message [ns]; None without messages."""
        if not self._blocks:
            return None
        return self._blocks[0].start_ns, max(block.end_ns for block in self._blocks)

    def custom_data(self) -> dict[str, str]:
        """Return the custom data in the metadata records of rosbag2, later ones win."""
        found: dict[str, str] = {}
        for offset in self._metadata_offsets:
            try:
                length = RECORD.unpack_from(self._data, offset)[1]
                start = offset + RECORD.size
                record = Metadata.read(ReadDataStream(BytesIO(self._data[start:start + length])))
            except DECODE_ERRORS as error:
                add_warning(self.warnings, f'{self.path.name}: damaged at byte {offset}: {error}')
            else:
                found.update(custom_data_in(record.metadata.get(METADATA_KEY, '')))
        return found

    def counts(self) -> dict[Channel, int]:
        """Return the message count of each channel; without index this reads the whole file."""
        if self._counts is None:
            self._counts = Counter(channel for _, channel, _ in self.messages())
        return {channel: self._counts[channel] for channel in self._channels.values()}

    def messages(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Yield the messages of ``topics`` (None: all) in order of receive time."""
        waiting: list[Message] = []
        log_time = itemgetter(0)
        for block in self._blocks:
            if block.channels and self._channel_ids(topics).isdisjoint(block.channels):
                continue
            ready = 0
            while ready < len(waiting) and waiting[ready][0] < block.start_ns:
                ready += 1
            yield from waiting[:ready]
            waiting = waiting[ready:] + self._read(block, topics)
            waiting.sort(key=log_time)  # stable, and fast if already in order
        yield from waiting

    def _read_index(self) -> list[Block]:
        """Return the blocks that the summary lists; none if it is missing or incomplete."""
        data = self._data
        if len(data) < len(MAGIC) + FOOTER.size:
            return []
        opcode, _, start, _, checksum, magic = FOOTER.unpack_from(data, len(data) - FOOTER.size)
        if opcode != Opcode.FOOTER or magic != MAGIC or not 0 < start < len(data):
            return []
        try:
            if checksum and crc32(data[start:-len(MAGIC) - 4]) != checksum:
                raise ValueError('checksum mismatch')
            summary = list(StreamReader(BytesIO(data[start:]), skip_magic=True).records)
            blocks = [self._indexed_block(entry) for entry in summary
                      if isinstance(entry, ChunkIndex)]
        except DECODE_ERRORS as error:
            add_warning(self.warnings, f'{self.path.name}: index is damaged ({error})')
            return []
        return blocks if self._read_summary(summary, blocks) else []

    def _indexed_block(self, entry: ChunkIndex) -> Block:
        """Return the block of an index entry; raise ValueError if the file has no such chunk."""
        opcode, length = RECORD.unpack_from(self._data, entry.chunk_start_offset)
        start_ns, end_ns, *_ = CHUNK.unpack_from(
            self._data, entry.chunk_start_offset + RECORD.size)
        if (opcode, RECORD.size + length, start_ns, end_ns) != (
                Opcode.CHUNK, entry.chunk_length, entry.message_start_time,
                entry.message_end_time):
            raise ValueError(f'no such chunk at byte {entry.chunk_start_offset}')
        return Block(start_ns, end_ns, entry.chunk_start_offset, entry.chunk_length,
                     frozenset(entry.message_index_offsets), is_chunk=True)

    def _read_summary(self, summary: list[McapRecord], blocks: list[Block]) -> bool:
        """Read channels and counts from the summary; return whether it is complete."""
        schemas = {entry.id for entry in summary if isinstance(entry, Schema)} | {0}
        channels = {entry.id: entry for entry in summary if isinstance(entry, ChannelRecord)}
        if not all(entry.schema_id in schemas for entry in channels.values()) or not all(
                block.channels <= channels.keys() for block in blocks):
            return False
        self._metadata_offsets = [entry.offset for entry in summary
                                  if isinstance(entry, MetadataIndex)]
        for entry in summary:
            if isinstance(entry, (Schema, ChannelRecord)):
                self._register(entry)
        for entry in summary:
            if isinstance(entry, Statistics) and blocks:
                counts = entry.channel_message_counts
                self._counts = Counter({channel: counts.get(number, 0)
                                        for number, channel in self._channels.items()})
                return entry.chunk_count == len(blocks)
        return True

    def _scan(self) -> Iterator[Block]:
        """Yield the blocks in file order, up to the last complete record."""
        data, offset, run = self._data, len(MAGIC), _MessageRun()
        while offset + RECORD.size <= len(data):
            opcode, length = RECORD.unpack_from(data, offset)
            end = offset + RECORD.size + length
            if opcode in END_OPCODES or Opcode.DATA_END < opcode < FIRST_PRIVATE_OPCODE:
                break
            if opcode == Opcode.CHUNK and offset + RECORD.size + CHUNK.size <= len(data):
                start_ns, end_ns, *_ = CHUNK.unpack_from(data, offset + RECORD.size)
                size = min(end, len(data)) - offset  # a truncated chunk may be readable in part
                yield Block(start_ns, end_ns, offset, size, frozenset(), is_chunk=True)
            if end > len(data):
                break
            if opcode == Opcode.MESSAGE and length >= MESSAGE_HEAD:
                run.extend(MESSAGE.unpack_from(data, offset)[4], offset, end)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._read(Block(0, 0, offset, end - offset, frozenset(), is_chunk=False), None)
            elif opcode == Opcode.METADATA:
                self._metadata_offsets.append(offset)
            if opcode != Opcode.MESSAGE or run.messages == MAX_RUN_MESSAGES:
                yield from run.take()
            offset = end
        yield from run.take()
        if offset >= len(data) or data[offset] not in (Opcode.DATA_END, Opcode.FOOTER):
            add_warning(self.warnings, f'{self.path.name}: file is truncated: no index, '
                        f'{len(data) - offset} bytes after the last complete record')

    def _read(self, block: Block, topics: Collection[str] | None) -> list[Message]:
        """Return the messages in ``block``; add a warning if some cannot be read."""
        found: list[Message] = []
        records = self._data[block.offset:block.offset + block.size]
        try:
            if block.is_chunk:
                records = _chunk_records(records)
            rest = len(records) - self._parse_records(records, topics, found)
            if rest:
                raise ValueError(f'last {rest} of {len(records)} bytes are not a complete record')
        except DECODE_ERRORS as error:
            add_warning(self.warnings,
                        f'{self.path.name}: damaged at byte {block.offset}: {error}')
        return found

    def _parse_records(self, records: bytes, topics: Collection[str] | None,
                       found: list[Message]) -> int:
        """Append the messages in ``records`` to ``found``; return the end of the last record."""
        wanted = self._wanted(topics)
        offset, size, unpack = 0, len(records), MESSAGE.unpack_from
        padded = records + bytes(MESSAGE_HEAD)  # allows unpacking a short last record
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
                self._register(reader.read(stream))
                wanted = self._wanted(topics)
            offset = end
        return offset

    def _wanted(self, topics: Collection[str] | None) -> dict[int, Channel]:
        return {number: channel for number, channel in self._channels.items()
                if topics is None or channel.topic in topics}

    def _channel_ids(self, topics: Collection[str] | None) -> set[int]:
        return set(self._wanted(topics))

    def _register(self, record: Schema | ChannelRecord) -> None:
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif self._records.get(record.id) != record:  # some writers repeat channels in every chunk
            self._records[record.id] = record
            schema = self._schemas.get(record.schema_id, NO_SCHEMA)
            if any(channel.topic == record.topic and channel.type != schema.name
                   for channel in self._channels.values()):
                add_warning(self.warnings, f'{self.path.name}: {record.topic} has a second type, '
                            f'{schema.name}, which is skipped')
                return
            self._channels[record.id] = Channel(
                record.topic, schema.name, record.message_encoding, schema.data.decode(),
                schema.encoding, record.metadata.get('offered_qos_profiles', ''),
                record.metadata.get('topic_type_hash', ''))


class _MessageRun:
    """Consecutive unchunked messages."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._start = self._end = 0

    @property
    def messages(self) -> int:
        return len(self._times)

    def extend(self, ns: int, start: int, end: int) -> None:
        if not self._times:
            self._start = start
        self._times.append(ns)
        self._end = end

    def take(self) -> Iterator[Block]:
        if self._times:
            yield Block(min(self._times), max(self._times), self._start, self._end - self._start,
                        frozenset(), is_chunk=False)
        self._times = []


def _map_file(path: Path) -> mmap.mmap:
    try:
        with path.open('rb') as file:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except ValueError as error:  # an empty file cannot be mapped
        raise BagError(f'{path}: file is empty') from error
    except OSError as error:
        raise BagError(f'{path}: cannot be read ({error.strerror})') from error


def _chunk_records(chunk: bytes) -> bytes:
    """Return the records of a chunk; of a truncated one, those that can be decompressed."""
    _, _, size, checksum, name_length = CHUNK.unpack_from(chunk, RECORD.size)
    start = RECORD.size + CHUNK.size + name_length
    compression = chunk[start - name_length:start].decode()
    length = int.from_bytes(chunk[start:start + 8], 'little')
    compressed = chunk[start + 8:start + 8 + length]
    if compression == 'zstd':
        records = zstandard.ZstdDecompressor().decompressobj().decompress(compressed)
    elif compression == 'lz4':
        records = lz4.frame.LZ4FrameDecompressor().decompress(compressed)
    elif not compression:
        records = compressed
    else:
        raise ValueError(f'compression is {compression}, expected zstd or lz4')
    if len(compressed) == length and (len(records) != size or (
            checksum and crc32(records) != checksum)):
        raise ValueError('checksum mismatch')
    return records
