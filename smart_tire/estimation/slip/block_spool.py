# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Byte-block store that spills to a temporary file; blocks can be rewritten in place."""

from __future__ import annotations

from collections.abc import Sequence
import pickle
import tempfile
from typing import Any, IO

from smart_tire.errors import EstimatorError

MAX_MEMORY = 1 << 26  # bytes before the file goes to disk; a few minutes of states fit


class Spool:
    """A temporary file, in memory while it is small; EstimatorError if the disk is full."""

    def __init__(self) -> None:
        self._file = _new_file()
        self._end = 0

    def close(self) -> None:
        """Delete the file and its content."""
        self._file.close()

    def append(self, data: bytes, reserve: int = 0) -> int:
        """Append ``data``, reserving at least ``reserve`` [bytes]; return its offset."""
        offset = self._end
        self.replace(offset, data)
        self._end += max(len(data), reserve)
        return offset

    def append_items(self, items: Sequence[Any]) -> int:
        """Append any picklable items; return their offset."""
        return self.append(pickle.dumps(items, pickle.HIGHEST_PROTOCOL))

    def replace(self, offset: int, data: bytes) -> None:
        """Overwrite the block at ``offset`` with ``data``, which must fit what was reserved."""
        try:
            self._file.seek(offset)
            self._file.write(data)
        except OSError as error:
            raise EstimatorError(
                f'cannot write {offset + len(data)} bytes to {tempfile.gettempdir()} '
                f'({error.strerror}); set TMPDIR to a larger directory') from error

    def read(self, offset: int, size: int) -> bytes:
        """Return ``size`` bytes from ``offset``."""
        self._file.seek(offset)
        return self._file.read(size)

    def items(self, offset: int) -> Any:
        """Return the items at ``offset``, as written by ``append_items``."""
        self._file.seek(offset)
        return pickle.load(self._file)


def _new_file() -> IO[bytes]:
    return tempfile.SpooledTemporaryFile(max_size=MAX_MEMORY, prefix='smart_tire_')
