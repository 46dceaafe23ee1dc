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
Mapping of files, and bounded decompression of chunks, messages and files.

The size when decompressed is a claim of the file: 131 kB may become 4 GB.
"""

from __future__ import annotations

from collections.abc import Iterator
import mmap
from pathlib import Path
import shutil
import threading

import lz4.frame  # type: ignore[import-untyped]
from smart_tire.errors import BagError
from smart_tire.paths import open_file
import zstandard

ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'  # start of a compressed file or message, but of no CDR message
MAX_SIZE = 1 << 28       # bytes of a chunk or message in memory, assumed: more than any image has
MAX_FILE_SIZE = 1 << 30  # bytes of a file that is compressed by more than MAX_RATIO
MAX_RATIO = 1000         # assumed: recordings have 2 to 100, zeros 30,000
BLOCK_SIZE = 1 << 20     # bytes that are decompressed at a time


def map_file(path: Path) -> mmap.mmap:
    """Return the content of a file; raise BagError if it is empty or cannot be read."""
    try:
        with open_file(path) as file:
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except ValueError as error:  # an empty file cannot be mapped
        raise BagError(f'{path}: file is empty') from error
    except OSError as error:
        raise BagError(f'{path}: cannot be read ({error.strerror})') from error


class _Zstd(threading.local):
    """Decompressor of a thread: making one takes longer than a small chunk."""

    def __init__(self) -> None:
        self.decompressor = zstandard.ZstdDecompressor()


_zstd = _Zstd()


def unpacked(data: bytes, compression: str = 'zstd', size: int | None = None) -> bytes:
    """
    Return ``data`` decompressed; of truncated data, what can be decompressed.

    ``size`` [bytes] is that of the result, by default that in ``data``, if any. Raises ValueError
    if it is above ``MAX_SIZE``, or smaller than the result; ZstdError or RuntimeError if ``data``
    are damaged.
    """
    if size is None:
        size = zstandard.frame_content_size(data)
    limit = MAX_SIZE if size < 0 else size
    if limit > MAX_SIZE:
        raise ValueError(_too_large(limit, MAX_SIZE))
    if compression == 'zstd':
        return b''.join(_parts(_zstd.decompressor.stream_reader(data), limit))
    if compression == 'lz4':
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=limit))
    if compression:
        raise ValueError(f'compression is {compression}, expected zstd or lz4')
    return data


def max_unpacked(size: int) -> int:
    """Return how many bytes ``size`` compressed bytes of a recording may have at most."""
    return max(MAX_FILE_SIZE, MAX_RATIO * size)


def unpack_file(path: Path, plain: Path) -> str:
    """
    Decompress the file ``path`` to ``plain``; return what is wrong, '' if nothing is.

    Raises BagError if the file is too large when decompressed, or cannot be written.
    """
    try:
        limit = min(max_unpacked(path.stat().st_size), shutil.disk_usage(plain.parent).free)
        with open_file(path) as file, plain.open('wb') as out:
            size = zstandard.get_frame_parameters(file.read(BLOCK_SIZE)).content_size
            if limit < size < zstandard.CONTENTSIZE_UNKNOWN:
                raise BagError(f'{path}: {_too_large(size, limit)}')
            file.seek(0)
            for part in _parts(zstandard.ZstdDecompressor().stream_reader(file), limit):
                out.write(part)
    except zstandard.ZstdError as error:
        return f'compressed file is damaged ({error})'
    except ValueError as error:
        raise BagError(f'{path}: {error}') from error
    except BagError:  # an OSError, too
        raise
    except OSError as error:
        raise BagError(f'{path}: cannot be decompressed ({error.strerror})') from error
    return '' if size in (out_size := plain.stat().st_size, zstandard.CONTENTSIZE_UNKNOWN) else (
        f'compressed file is truncated ({out_size} of {size} bytes)')


def _parts(reader: zstandard.ZstdDecompressionReader, limit: int) -> Iterator[bytes]:
    """Yield what ``reader`` decompresses; raise ValueError beyond ``limit`` bytes."""
    total = 0
    while part := reader.read(BLOCK_SIZE):
        total += len(part)
        if total > limit:
            raise ValueError(_too_large(total, limit))
        yield part


def _too_large(size: int, limit: int) -> str:
    return f'{size / 1e6:.0f} MB when decompressed, at most {limit / 1e6:.0f} MB are read'
