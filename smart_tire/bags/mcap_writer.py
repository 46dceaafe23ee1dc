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
Writer of one MCAP file, with the bytes that the writer of the mcap library writes.

Messages and their index, of which there are many, are packed here; all other records are written
by the mcap library, which needs 3 times the CPU time for a message.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
import os
import struct
from typing import cast, IO
from zlib import crc32

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel as ChannelRecord
from mcap.records import (
    Chunk as ChunkRecord, ChunkIndex, DataEnd, Header, McapRecord, Metadata, MetadataIndex, Schema,
    Statistics, SummaryOffset)
from smart_tire.bags.mcap_file import MAGIC, MESSAGE, MESSAGE_HEAD, RECORD
import zstandard

CHUNK_SIZE = 1 << 20               # bytes of records that end a chunk
INDEX = struct.Struct('<BQHI')     # opcode, length, channel, bytes of times and offsets
FOOTER = struct.Struct('<BQQQ')    # opcode, length, summary, summary offsets


class McapWriter:
    """
    Writes compressed chunks of messages, with an index, to a stream.

    ``profile`` and ``library`` are those of the header. All methods raise OSError.
    """

    def __init__(self, stream: IO[bytes], profile: str, library: str) -> None:
        self._stream = stream
        self._schemas: list[Schema] = []
        self._channels: list[ChannelRecord] = []
        self._metadata: list[MetadataIndex] = []
        self._chunks: list[ChunkIndex] = []
        self._counts: Counter[int] = Counter()  # messages by channel
        self._records = bytearray()             # of the present chunk
        self._index: dict[int, list[int]] = {}  # channel -> times and offsets of its messages
        stream.write(MAGIC + _packed([Header(profile, library)]))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a message type; return its number."""
        self._schemas.append(Schema(
            id=len(self._schemas) + 1, name=name, encoding=encoding, data=data))
        self._add_record(self._schemas[-1])
        return len(self._schemas)

    def add_channel(self, topic: str, encoding: str, schema: int,
                    metadata: Mapping[str, str]) -> int:
        """Add a topic with the type ``schema``; return the number of its channel."""
        self._channels.append(ChannelRecord(
            id=len(self._channels) + 1, schema_id=schema, topic=topic, message_encoding=encoding,
            metadata=dict(metadata)))
        self._add_record(self._channels[-1])
        return len(self._channels)

    def add_message(self, channel: int, time_ns: int, data: bytes) -> None:
        """Add a message received at ``time_ns``; a full chunk is written."""
        records = self._records
        index = self._index.get(channel)
        if index is None:
            index = self._index[channel] = []
        index += time_ns, len(records)
        records += MESSAGE.pack(
            Opcode.MESSAGE, MESSAGE_HEAD + len(data), channel, 0, time_ns, time_ns)
        records += data
        if len(records) > CHUNK_SIZE:
            self._end_chunk()

    def add_metadata(self, name: str, metadata: Mapping[str, str]) -> None:
        """Write a metadata record."""
        offset, data = self._position, _packed([Metadata(name, dict(metadata))])
        self._metadata.append(MetadataIndex(offset, len(data), name))
        self._stream.write(data)

    def flush(self) -> None:
        """End the chunk and hand over all written data to the operating system."""
        self._end_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Write the summary; the stream stays open."""
        self._end_chunk()
        self._stream.write(_packed([DataEnd(0)]))
        start = self._position
        statistics = Statistics(
            message_count=self._counts.total(), schema_count=len(self._schemas),
            channel_count=len(self._channels), attachment_count=0,
            metadata_count=len(self._metadata), chunk_count=len(self._chunks),
            message_start_time=min((one.message_start_time for one in self._chunks), default=0),
            message_end_time=max((one.message_end_time for one in self._chunks), default=0),
            channel_message_counts=self._counts)
        groups: tuple[tuple[Opcode, Iterable[McapRecord]], ...] = (
            (Opcode.SCHEMA, self._schemas), (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]), (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, ()), (Opcode.METADATA_INDEX, self._metadata))
        summary, offsets = b'', []
        for opcode, records in groups:
            data = _packed(records)
            offsets.append(SummaryOffset(opcode, start + len(summary), len(data)))
            summary += data
        footer = FOOTER.pack(Opcode.FOOTER, FOOTER.size - RECORD.size + 4, start,
                             start + len(summary))
        summary += _packed(offsets) + footer
        self._stream.write(summary + struct.pack('<I', crc32(summary)) + MAGIC)

    @property
    def _position(self) -> int:
        return self._stream.seek(0, os.SEEK_CUR)

    def _add_record(self, record: McapRecord) -> None:
        """Add the record of a schema or channel to the chunk."""
        self._records += _packed([record])
        if len(self._records) > CHUNK_SIZE:
            self._end_chunk()

    def _end_chunk(self) -> None:
        """Write the chunk and the index of its messages, if it has any."""
        if not self._index:
            return
        offset, records = self._position, self._records
        start = min(min(index[::2]) for index in self._index.values())
        end = max(max(index[::2]) for index in self._index.values())
        compressed = zstandard.compress(records)
        chunk = _packed([ChunkRecord(
            message_start_time=start, message_end_time=end, uncompressed_size=len(records),
            uncompressed_crc=crc32(records), compression='zstd', data=compressed)])
        places, tables = {}, b''
        for channel, index in self._index.items():
            places[channel] = offset + len(chunk) + len(tables)
            size = 8 * len(index)
            tables += INDEX.pack(Opcode.MESSAGE_INDEX, INDEX.size - RECORD.size + size, channel,
                                 size) + struct.pack(f'<{len(index)}Q', *index)
        self._stream.write(chunk + tables)
        self._chunks.append(ChunkIndex(
            message_start_time=start, message_end_time=end, chunk_start_offset=offset,
            chunk_length=len(chunk), message_index_offsets=places,
            message_index_length=len(tables), compression='zstd',
            compressed_size=len(compressed), uncompressed_size=len(records)))
        self._counts.update({channel: len(index) // 2 for channel, index in self._index.items()})
        self._records, self._index = bytearray(), {}


def _packed(records: Iterable[McapRecord]) -> bytes:
    """Return records as bytes."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return cast(bytes, builder.end())  # type: ignore[no-untyped-call]
