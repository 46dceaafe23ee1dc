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
from heapq import heappop, heappush


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
        self.damage = ''        # why frames are bad, if that is known

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
        # Positions in the stream:
        self._base = 0     # of the buffer
        self._scanned = 0  # start bytes before it have been examined
        self._counted = 0  # bad frames before it have been counted
        self._incomplete: set[int] = set()      # starts of candidates with missing bytes
        self._starts: list[int] = []            # heap of the same, and some others
        self._ends: list[tuple[int, int]] = []  # heap of their ends and starts, and some others
        self._complete: list[int] = []          # heap of candidates that are to be examined

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
            if (first := self._first_incomplete()) is not None and first < start:
                self._count_bad_frame(first, start)  # it was truncated
            self._discard(start - self._base)
            del self._buffer[:end - start]
            self._base, self._scanned = end, max(self._scanned, end)
            while (first := self._first_incomplete()) is not None and first < end:
                self._incomplete.remove(first)
            yield body
        kept = self._first_incomplete()
        begin = self._scanned if kept is None else kept
        self._discard(begin - self._base)
        self._base = begin

    def _first_intact(self) -> tuple[int, int, bytes] | None:
        """Examine candidates in order; return start, end and body of the first intact one."""
        limit = self._base + len(self._buffer)
        while self._ends and self._ends[0][0] <= limit:
            _, known = heappop(self._ends)
            if known in self._incomplete:
                self._incomplete.remove(known)
                heappush(self._complete, known)
        while (start := self._next_candidate()) is not None:
            index = start - self._base
            size = self._size(index)
            end = limit + 1 if size is None else start + size  # one more byte of the header
            if size == NOT_A_FRAME:
                continue
            if size == INVALID_HEADER:
                self._count_bad_frame(start, start + 1)
            elif end > limit:
                self._incomplete.add(start)
                heappush(self._starts, start)
                heappush(self._ends, (end, start))
            elif (body := self._body(bytes(self._buffer[index:end - self._base]))) is not None:
                return start, end, body
            else:
                self._count_bad_frame(start, end)
        return None

    def _next_candidate(self) -> int | None:
        """Return the first complete candidate, else the next start byte; None if there is none."""
        while self._complete:
            if (start := heappop(self._complete)) >= self._base:  # else inside an intact frame
                return start
        index = self._buffer.find(self.START, self._scanned - self._base)
        if index < 0:
            self._scanned = self._base + len(self._buffer)
            return None
        self._scanned = self._base + index + 1
        return self._scanned - 1

    def _first_incomplete(self) -> int | None:
        while self._starts and self._starts[0] not in self._incomplete:
            heappop(self._starts)
        return self._starts[0] if self._starts else None

    def _count_bad_frame(self, start: int, end: int) -> None:
        """
        Count one bad frame; failures inside a counted frame belong to the same corruption.

        Failures behind an incomplete candidate are not counted: they may be its data.
        """
        first = self._first_incomplete()
        if start >= self._counted and (first is None or start <= first):
            self.bad_frames += 1
            self._counted = end
