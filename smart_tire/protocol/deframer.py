# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Deframers: intact frames from a byte stream, with bounded buffers and counters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator


class Deframer(ABC):
    """
    Base of the deframers: extracts intact frames from a stream that arrives in chunks of any size.

    A deframer takes bytes; it does not read from a port. Bytes that belong to no intact frame are
    discarded and counted.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.bad_frames = 0     # frames that started but were corrupted or truncated
        self.skipped_bytes = 0  # bytes that belong to no intact frame

    def extract(self, chunk: bytes) -> Iterator[bytes]:
        """Append ``chunk`` and return an iterator over the bodies that it completes."""
        self._buffer += chunk
        return self._bodies()

    @abstractmethod
    def _bodies(self) -> Iterator[bytes]:
        """Yield the intact bodies in the buffer; discard bytes that cannot become one."""

    def _discard(self, size: int) -> None:
        self.skipped_bytes += size
        del self._buffer[:size]


NOT_A_FRAME, INVALID_HEADER = 0, -1  # returned by _size instead of a size


class HeaderDeframer(Deframer):
    """
    Deframer for protocols whose header gives the frame size and whose start byte occurs in data.

    Every start byte begins a candidate frame::

        +----------+  start byte   +-----------+  bytes missing   +------------+
        | scanning | ------------> | candidate | ---------------> | incomplete |
        +----------+               +-----------+ <--------------- +------------+
          ^      ^                   |       |      more bytes
          |      |     rejected      |       |
          |      +-------------------+       | checksum correct
          |           body yielded           |
          +----------------------------------+

    A candidate is rejected if no frame starts there, or, as a bad frame, if its header is invalid
    or its checksum wrong. Scanning resumes at the byte after its start byte, so frames inside it
    are found. Scanning also continues behind an incomplete candidate: a corrupt length does not
    delay the frames that follow it. An intact frame ends all candidates before and inside it. The
    buffer keeps only the bytes from the first incomplete candidate on.
    """

    START: bytes

    def __init__(self) -> None:
        super().__init__()
        self._incomplete: list[int] = []  # starts of candidates with missing bytes, ascending
        self._scanned = 0                 # start bytes before this index have been examined
        self._counted = 0                 # bad frames before this index have been counted

    @abstractmethod
    def _size(self, start: int) -> int | None:
        """
        Return the size of the candidate at ``start``, None if the header is incomplete.

        ``NOT_A_FRAME``: no frame starts here. ``INVALID_HEADER``: the header is complete but
        impossible, which counts as a bad frame.
        """

    @abstractmethod
    def _body(self, frame: bytes) -> bytes | None:
        """Return the body of ``frame``, None if its checksum is wrong."""

    def _bodies(self) -> Iterator[bytes]:
        while (found := self._first_intact()) is not None:
            start, end, body = found
            if self._incomplete and self._incomplete[0] < start:
                self._count_bad_frame(self._incomplete[0], start)  # it was truncated
            self._discard(start)
            del self._buffer[:end - start]
            self._shift(end)
            yield body
        keep = self._incomplete[0] if self._incomplete else len(self._buffer)
        self._discard(keep)
        self._shift(keep)

    def _first_intact(self) -> tuple[int, int, bytes] | None:
        """Examine candidates in order; return start, end and body of the first intact one."""
        pending, self._incomplete = self._incomplete, []
        while pending or (start := self._buffer.find(self.START, self._scanned)) >= 0:
            if pending:
                start = pending.pop(0)
            else:
                self._scanned = start + 1
            size = self._size(start)
            if size == NOT_A_FRAME:
                continue
            if size == INVALID_HEADER:
                self._count_bad_frame(start, start + 1)
                continue
            if size is None or start + size > len(self._buffer):
                self._incomplete.append(start)
                continue
            body = self._body(bytes(self._buffer[start:start + size]))
            if body is not None:
                return start, start + size, body
            self._count_bad_frame(start, start + size)
        return None

    def _count_bad_frame(self, start: int, end: int) -> None:
        """
        Count one bad frame; failures inside a counted frame belong to the same corruption.

        Failures behind an incomplete candidate are not counted: they may be its data.
        """
        if start >= self._counted and (not self._incomplete or start <= self._incomplete[0]):
            self.bad_frames += 1
            self._counted = end

    def _shift(self, size: int) -> None:
        """Move all indices after ``size`` bytes have been removed from the buffer's front."""
        self._incomplete = [start - size for start in self._incomplete if start >= size]
        self._scanned = max(self._scanned - size, 0)
        self._counted = max(self._counted - size, 0)
