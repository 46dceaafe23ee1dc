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

Damage costs the chunk that has it: the index leads to the next chunk; without an index, the next
record is found by its opcode, its length and the record after it.

The record layout follows version 0 of the MCAP specification. Chunks and messages are parsed
here: the libraries do not read truncated chunks, and for an intact file they take longer (rosbags
2.6 times, mcap 4 to 8 times). All other records are parsed by the mcap library.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Collection, Iterator
from io import BytesIO
from itertools import pairwise
from operator import attrgetter, itemgetter
from pathlib import Path
import re
import struct
from typing import NamedTuple
from zlib import crc32

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel as ChannelRecord
from mcap.records import ChunkIndex, McapRecord, Metadata, MetadataIndex, Schema, Statistics
from mcap.stream_reader import StreamReader
from smart_tire.bags.file_bytes import map_file, MAX_SIZE, unpacked
from smart_tire.bags.metadata import (
    add_warning, Channel, Losses, Message, Metadata as BagMetadata, metadata_in)
from smart_tire.errors import BagError
import zstandard

MAGIC = b'\x89MCAP0\r\n'
RECORD = struct.Struct('<BQ')            # opcode, length of the content
MESSAGE = struct.Struct('<BQHIQQ')       # opcode, length, channel, sequence, log and publish time
MESSAGE_HEAD = MESSAGE.size - RECORD.size
LOGGED = struct.Struct('<BQH4xQ8x')      # of these, what is used
CHUNK = struct.Struct('<QQQII')          # start, end, size, CRC, length of compression name
CHECKSUM_OFFSET = RECORD.size + 24       # of the CRC in a chunk record
LENGTH = struct.Struct('<Q')              # of compressed records
FOOTER = struct.Struct('<BQQQI8s')       # opcode, length, summary, summary offsets, CRC, magic
MAX_RUN_MESSAGES = 4096                  # unchunked messages that are read at a time
END_OPCODES = (Opcode.DATA_END, Opcode.FOOTER)
# Starts of records with messages: opcode, and a length below 1 TB.
CHUNK_START = re.compile(rb'\x06.{5}\0{3}', re.DOTALL)
MESSAGES_START = re.compile(rb'[\x05\x06].{5}\0{3}', re.DOTALL)
INDEX_ENTRY, INDEX_HEAD = 16, 15         # bytes of a message index: per message, and of the rest
NO_OPCODE = 0                            # of no record
MAX_TIME_NS = (1 << 63) - 1              # of a message, as in ROS; later ones are damage
MESSAGE_OPCODE = int(Opcode.MESSAGE)     # looking up a member of an enumeration takes longer
FIRST_PRIVATE_OPCODE = 0x80              # opcodes from here on are application-defined
MAX_NAME_LENGTH = 16                     # of a compression
METADATA_KEY = 'serialized_metadata'     # of the metadata record of rosbag2
NO_SCHEMA = Schema(id=0, data=b'', encoding='', name='')
DECODE_ERRORS = (McapError, struct.error, ValueError, EOFError, RuntimeError, zstandard.ZstdError)


class Chunk(NamedTuple):
    """Where the records of a chunk are, and what they must be."""

    compression: str
    start: int         # offset of the compressed records
    length: int        # bytes, compressed
    size: int          # bytes, decompressed
    checksum: int      # CRC-32 of the decompressed records; 0 if there is none
    messages: int = 0  # by the index; 0 if unknown


class Block(NamedTuple):
    """A chunk, or a run of consecutive unchunked messages."""

    start_ns: int
    end_ns: int
    offset: int                   # of its first record
    size: int                     # bytes, including the record header
    channels: frozenset[int]      # ids of the channels of its messages; empty if unknown
    chunk: Chunk | None = None


class McapFile:
    """An MCAP file, intact or damaged."""

    def __init__(self, path: Path, losses: Losses | None = None) -> None:
        self.path = path
        self.warnings: list[str] = []
        self.losses = Losses() if losses is None else losses
        self._schemas: dict[int, Schema] = {}
        self._records: dict[int, ChannelRecord] = {}
        self._channels: dict[int, Channel] = {}
        self._types: dict[str, str] = {}  # by topic
        self._counts: Counter[Channel] | None = None
        self._listed = 0  # messages, by the statistics
        self._metadata_offsets: list[int] = []
        self._data = map_file(path)
        self._blocks = self._read_index() or list(self._scan())
        if not self._blocks and self._data[:len(MAGIC)] != MAGIC:
            self._data.close()
            raise BagError(f'{path}: not an MCAP file')
        self._blocks.sort(key=itemgetter(0))

    def close(self) -> None:
        """Close the file."""
        self._data.close()

    def span(self) -> tuple[int, int] | None:
        """Return the receive times of the first and last message [ns]; None without messages."""
        if not self._blocks:
            return None
        return self._blocks[0].start_ns, max(block.end_ns for block in self._blocks)

    def metadata(self) -> list[BagMetadata]:
        """Return the metadata records of rosbag2."""
        found, left = [], len(self._data)  # bytes: an index may list a record many times
        for offset in self._metadata_offsets:
            try:
                length = RECORD.unpack_from(self._data, offset)[1]
                start = offset + RECORD.size
                left -= length
                if left < 0:
                    raise ValueError('metadata overlap')
                record = Metadata.read(ReadDataStream(BytesIO(self._data[start:start + length])))
            except DECODE_ERRORS as error:
                add_warning(self.warnings, f'{self.path.name}: damaged at byte {offset}: {error}')
            else:
                found.append(metadata_in(record.metadata.get(METADATA_KEY, '')))
        return found

    def counts(self) -> dict[Channel, int]:
        """Return the message count of each channel; without index this reads the whole file."""
        if self._counts is None:
            self._counts = Counter(channel for _, channel, _ in self.messages())
            if (found := self._counts.total()) < self._listed:
                self.losses.add(f'{self.path.name}: {found} of {self._listed} messages in its '
                                'statistics', self._listed - found)
        return {channel: self._counts[channel] for channel in self._channels.values()}

    def messages(self, topics: Collection[str] | None = None, *, as_written: bool = False
                 ) -> Iterator[Message]:
        """
        Yield the messages of ``topics`` (None: all) in order of receive time.

        ``as_written``: in the order of the file.
        """
        waiting: list[Message] = []
        log_time = itemgetter(0)
        wanted = {number: channel for number, channel in self._channels.items()
                  if topics is None or channel.topic in topics}
        blocks = sorted(self._blocks, key=_place) if as_written else self._blocks
        for block in blocks:
            if block.channels and wanted.keys().isdisjoint(block.channels):
                continue
            if as_written:
                yield from self._read(block, topics, wanted)
                continue
            ready = bisect_left(waiting, block.start_ns, key=log_time)
            yield from waiting[:ready]
            waiting = waiting[ready:] + self._read(block, topics, wanted)
            waiting.sort(key=log_time)  # stable, and fast if already in order
        yield from waiting

    def _read_index(self) -> list[Block] | None:
        """Return the blocks that the summary lists; None if it is missing or incomplete."""
        data = self._data
        if len(data) < len(MAGIC) + FOOTER.size:
            return None
        opcode, _, start, _, checksum, magic = FOOTER.unpack_from(data, len(data) - FOOTER.size)
        if opcode != Opcode.FOOTER or magic != MAGIC or not 0 < start < len(data):
            return None
        try:
            if checksum and crc32(data[start:-len(MAGIC) - 4]) != checksum:
                raise ValueError('checksum mismatch')
            summary = list(StreamReader(
                BytesIO(data[start:]), skip_magic=True, emit_chunks=True).records)
            blocks = [self._indexed_block(entry) for entry in summary
                      if isinstance(entry, ChunkIndex)]
            if any(block.offset + block.size > after.offset for block, after in pairwise(
                    sorted(blocks, key=attrgetter('offset')))):
                raise ValueError('chunks overlap')
            fitting = sum(map(self._has_header, blocks))
            if not checksum and fitting < len(blocks) or 2 * fitting < len(blocks):
                raise ValueError('chunks are not where it says')
            return blocks if self._read_summary(summary, blocks) else None
        except DECODE_ERRORS as error:
            add_warning(self.warnings, f'{self.path.name}: index is damaged ({error})')
            self._counts = None
            return None

    def _indexed_block(self, entry: ChunkIndex) -> Block:
        """Return the block of an index entry, whatever the header of the chunk is."""
        offset, end = entry.chunk_start_offset, entry.chunk_start_offset + entry.chunk_length
        checksum, = struct.unpack_from('<I', self._data, offset + CHECKSUM_OFFSET)
        channels = frozenset(entry.message_index_offsets)
        messages = max(0, entry.message_index_length - INDEX_HEAD * len(channels)) // INDEX_ENTRY
        return Block(
            entry.message_start_time, entry.message_end_time, offset, entry.chunk_length, channels,
            Chunk(entry.compression, end - entry.compressed_size, entry.compressed_size,
                  entry.uncompressed_size, checksum, messages))

    def _has_header(self, block: Block) -> bool:
        """Return whether the file has the header of the chunk that ``block`` is by the index."""
        opcode, length = RECORD.unpack_from(self._data, block.offset)
        start_ns, end_ns, *_ = CHUNK.unpack_from(self._data, block.offset + RECORD.size)
        return bool((opcode, RECORD.size + length, start_ns, end_ns) == (
            Opcode.CHUNK, block.size, block.start_ns, block.end_ns))

    def _read_summary(self, summary: list[McapRecord], blocks: list[Block]) -> bool:
        """Read channels and counts from the summary; return whether it is complete."""
        for entry in summary:
            if isinstance(entry, Schema) or isinstance(entry, ChannelRecord) and (
                    not entry.schema_id or entry.schema_id in self._schemas):
                self._register(entry)
        channels = {entry.id for entry in summary if isinstance(entry, ChannelRecord)}.union(
            *(block.channels for block in blocks))
        if not channels <= self._records.keys():
            return False
        self._metadata_offsets = [entry.offset for entry in summary
                                  if isinstance(entry, MetadataIndex)]
        for entry in summary:
            if isinstance(entry, Statistics):
                self._listed = entry.message_count
            if isinstance(entry, Statistics) and blocks:
                counts = entry.channel_message_counts
                if entry.chunk_count != len(blocks):
                    return False
                self._counts = Counter({channel: counts.get(number, 0)
                                        for number, channel in self._channels.items()})
        return True

    def _scan(self) -> Iterator[Block]:
        """Yield the blocks in file order."""
        run = _MessageRun()
        self._metadata_offsets = []
        for offset, end in self._record_extents():
            opcode, chunk = self._data[offset], self._chunk_at(offset, end)
            if not run.continues(offset):
                yield from run.take()
            if chunk is not None:
                yield chunk
            elif opcode == Opcode.MESSAGE:
                run.extend(LOGGED.unpack_from(self._data, offset)[3], offset, end)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._read(Block(0, 0, offset, end - offset, frozenset()), (), {})
            elif opcode == Opcode.METADATA:
                self._metadata_offsets.append(offset)
            if opcode != Opcode.MESSAGE or run.messages == MAX_RUN_MESSAGES:
                yield from run.take()
        yield from run.take()

    def _record_extents(self) -> Iterator[tuple[int, int]]:
        """Yield start and end of the records, also of damaged chunks; skip other damage."""
        data, offset = self._data, len(MAGIC)
        # In a damaged chunk no message is searched for: messages have no checksum of their own.
        chunked = self._next_messages(CHUNK_START, offset) is not None
        pattern = CHUNK_START if chunked else MESSAGES_START
        while offset + RECORD.size <= len(data):
            opcode, length = RECORD.unpack_from(data, offset)
            end = offset + RECORD.size + length
            chunk = self._chunk_at(offset, end)
            intact = self._is_record(offset) and (opcode not in END_OPCODES or chunk is not None)
            if not (intact and (end == len(data) or self._is_record(end))):
                found = self._next_messages(pattern, offset + 1)
                if not intact or found is not None and found < end:
                    if chunk is not None:
                        yield offset, end  # its content shows whether it is damaged
                    elif found is not None:
                        self.losses.add(f'{self.path.name}: {found - offset} bytes at byte '
                                        f'{offset} are damaged')
                    if found is None:
                        break
                    offset = found
                    continue
            yield offset, end
            offset = end
        if offset >= len(data) or data[offset] not in END_OPCODES:
            self.losses.add(f'{self.path.name}: file is truncated: no index, '
                            f'{len(data) - offset} bytes after the last complete record')

    def _is_record(self, offset: int) -> bool:
        """Return whether a complete record may begin at ``offset``."""
        if offset + RECORD.size > len(self._data):
            return False
        opcode, length = RECORD.unpack_from(self._data, offset)
        end = offset + RECORD.size + length
        if opcode == Opcode.CHUNK:
            block = self._chunk_at(offset, end)
            return block is not None and block.offset + block.size == end
        return end <= len(self._data) and (
            length >= MESSAGE_HEAD if opcode == Opcode.MESSAGE
            else NO_OPCODE < opcode <= Opcode.DATA_END or opcode >= FIRST_PRIVATE_OPCODE)

    def _next_messages(self, pattern: re.Pattern[bytes], offset: int) -> int | None:
        """Return where the next record like ``pattern`` begins that a record follows."""
        for match in pattern.finditer(self._data, offset):
            start = match.start()
            opcode, length, number, *_ = MESSAGE.unpack(
                self._data[start:start + MESSAGE.size].ljust(MESSAGE.size, b'\0'))
            end = start + RECORD.size + length
            if (opcode == Opcode.CHUNK or number in self._records) and self._is_record(start) and (
                    end == len(self._data) or self._is_record(end)):
                return start
        return None

    def _chunk_at(self, offset: int, record_end: int) -> Block | None:
        """
        Return the chunk whose record begins at ``offset``; None if its header is not valid.

        It may have a wrong opcode, if it ends where the record does.
        """
        data, head = self._data, offset + RECORD.size + CHUNK.size
        if head > len(data) or data[offset] == Opcode.MESSAGE:
            return None
        start_ns, end_ns, size, checksum, name_length = CHUNK.unpack_from(
            data, offset + RECORD.size)
        start = head + name_length + LENGTH.size
        if name_length > MAX_NAME_LENGTH or start > len(data):
            return None
        name, (length,) = data[head:head + name_length], LENGTH.unpack_from(
            data, start - LENGTH.size)
        if not length or not name.isalnum() and (name or size != length) or (
                data[offset] != Opcode.CHUNK and start + length != record_end):
            return None
        return Block(start_ns, end_ns, offset, min(start + length, len(data)) - offset,
                     frozenset(), Chunk(name.decode('latin-1'), start, length, size, checksum))

    def _read(self, block: Block, topics: Collection[str] | None,
              wanted: dict[int, Channel]) -> list[Message]:
        """
        Return the messages in ``block``; add a loss if some cannot be read.

        ``wanted`` are the channels of ``topics``, to which those in ``block`` are added.
        """
        found: list[Message] = []
        try:
            records = (self._data[block.offset:block.offset + block.size] if block.chunk is None
                       else self._chunk_records(block.chunk))
            self._parse_records(records, topics, wanted, found)
        except DECODE_ERRORS as error:
            self.losses.add(f'{self.path.name}: damaged at byte {block.offset}: {error}',
                            block.chunk.messages if block.chunk and not found else 0)
        possible = [one for one in found if one[0] <= MAX_TIME_NS]
        if len(possible) < len(found):
            lost = len(found) - len(possible)
            self.losses.add(f'{self.path.name}: damaged at byte {block.offset}: {lost} messages '
                            f'with times above {MAX_TIME_NS} ns', lost)
        return possible

    def _chunk_records(self, chunk: Chunk) -> bytes:
        """Return the records of a chunk; of a truncated one, those that can be decompressed."""
        packed = self._data[chunk.start:chunk.start + min(chunk.length, MAX_SIZE)]
        records = unpacked(packed, chunk.compression, chunk.size)
        if (len(packed) == chunk.length or len(records) == chunk.size) and (
                len(records) != chunk.size
                or chunk.checksum and crc32(records) != chunk.checksum):
            raise ValueError('checksum mismatch')
        return records

    def _parse_records(self, records: bytes, topics: Collection[str] | None,
                       wanted: dict[int, Channel], found: list[Message]) -> None:
        """Append the messages in ``records`` to ``found``; raise ValueError if some are left."""
        offset, unknown, size, unpack = 0, 0, len(records), LOGGED.unpack_from
        head, message_head = RECORD.size, MESSAGE.size
        padded = records + bytes(MESSAGE_HEAD)  # allows unpacking a short last record
        while offset + head <= size:
            opcode, length, number, ns = unpack(padded, offset)
            end = offset + head + length
            if end > size:
                break
            if opcode == MESSAGE_OPCODE:
                if (channel := wanted.get(number)) is not None:
                    found.append((ns, channel, records[offset + message_head:end]))
                elif number not in self._records:
                    unknown += 1
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                stream = ReadDataStream(BytesIO(records[offset + head:end]))
                record = (Schema if opcode == Opcode.SCHEMA else ChannelRecord).read(stream)
                self._register(record)
                self._want(record, topics, wanted)
            elif opcode == NO_OPCODE:  # zeros would be millions of records
                break
            offset = end
        if unknown:
            raise ValueError(f'{unknown} messages of unknown topics')
        if offset < size:
            raise ValueError(f'last {size - offset} of {size} bytes are not a complete record')

    def _want(self, record: Schema | ChannelRecord, topics: Collection[str] | None,
              wanted: dict[int, Channel]) -> None:
        """Add the channel of ``record``, if it is one, to ``wanted`` if it is of ``topics``."""
        if isinstance(record, Schema):
            return
        wanted.pop(record.id, None)
        channel = self._channels.get(record.id)
        if channel is not None and (topics is None or channel.topic in topics):
            wanted[record.id] = channel

    def _register(self, record: Schema | ChannelRecord) -> None:
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif self._records.get(record.id) != record:  # some writers repeat channels in every chunk
            self._records[record.id] = record
            schema = self._schemas.get(record.schema_id, NO_SCHEMA)
            if self._types.setdefault(record.topic, schema.name) != schema.name:
                add_warning(self.warnings, f'{self.path.name}: {record.topic} has a second type, '
                            f'{schema.name}, which is skipped')
                return
            stored = record.metadata
            self._channels[record.id] = Channel(
                record.topic, schema.name, record.message_encoding,
                schema.data.decode(errors='replace'), schema.encoding,
                stored.get('offered_qos_profiles', ''), stored.get('topic_type_hash', ''))


class _MessageRun:
    """Consecutive unchunked messages."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._start = self._end = 0

    @property
    def messages(self) -> int:
        return len(self._times)

    def continues(self, start: int) -> bool:
        return not self._times or self._end == start

    def extend(self, ns: int, start: int, end: int) -> None:
        if not self._times:
            self._start = start
        self._times.append(ns)
        self._end = end

    def take(self) -> Iterator[Block]:
        if self._times:
            yield Block(min(self._times), max(self._times), self._start, self._end - self._start,
                        frozenset())
        self._times = []


def _place(block: Block) -> int:
    """Return where in the file ``block`` begins [bytes]."""
    return block.offset if block.chunk is None else block.chunk.start
