"""What all deframers share: a bounded buffer, counters, and the rescan after a bad frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator


class Deframer(ABC):
    """
    Cut the intact frames out of a stream that arrives in pieces of any size.

    A deframer is fed, it never reads. Bytes that do not form a frame are dropped and counted.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.bad_frames = 0     # frames that started but turned out damaged or cut short
        self.skipped_bytes = 0  # bytes that belong to no intact frame

    def feed(self, chunk: bytes) -> Iterator[bytes]:
        """Take ``chunk`` and return an iterator over the bodies that are complete with it."""
        self._buffer += chunk
        return self._bodies()

    @abstractmethod
    def _bodies(self) -> Iterator[bytes]:
        """Yield the intact bodies in the buffer and drop what can not become one."""

    def _drop(self, size: int) -> None:
        self.skipped_bytes += size
        del self._buffer[:size]


NO_CLAIM, IMPOSSIBLE = 0, -1  # instead of a size


class HeaderDeframer(Deframer):
    """
    Deframer for frames whose header tells their size and whose start byte may occur as data.

    Every start byte is a claim. A claim that fails its check costs only its start byte, so the
    claims inside it are tried too; a claim that waits for more bytes does not hold up an intact
    frame behind it, however long it pretends to be.
    """

    START: bytes

    def __init__(self) -> None:
        super().__init__()
        self._waiting: list[int] = []  # starts of claims that need more bytes, ascending
        self._scanned = 0              # start bytes before this index are known
        self._blamed = 0               # damage before this index is counted

    @abstractmethod
    def _size(self, start: int) -> int | None:
        """
        Return the size of the claim at ``start``, None if it is too early to tell.

        ``NO_CLAIM`` says that no frame starts here, ``IMPOSSIBLE`` that one does whose header is
        complete and can not be true.
        """

    @abstractmethod
    def _body(self, frame: bytes) -> bytes | None:
        """Return the body of ``frame``, or None if its check fails."""

    def _bodies(self) -> Iterator[bytes]:
        while (found := self._first_intact()) is not None:
            start, end, body = found
            if self._waiting and self._waiting[0] < start:
                self._blame(self._waiting[0], start)  # it was cut short
            self._drop(start)
            del self._buffer[:end - start]
            self._shift(end)
            yield body
        keep = self._waiting[0] if self._waiting else len(self._buffer)
        self._drop(keep)
        self._shift(keep)

    def _first_intact(self) -> tuple[int, int, bytes] | None:
        """Judge all claims in order; return start, end and body of the first intact one."""
        open_claims, self._waiting = self._waiting, []
        while open_claims or (start := self._buffer.find(self.START, self._scanned)) >= 0:
            if open_claims:
                start = open_claims.pop(0)
            else:
                self._scanned = start + 1
            size = self._size(start)
            if size == NO_CLAIM:
                continue
            if size == IMPOSSIBLE:
                self._blame(start, start + 1)
                continue
            if size is None or start + size > len(self._buffer):
                self._waiting.append(start)
                continue
            body = self._body(bytes(self._buffer[start:start + size]))
            if body is not None:
                self._waiting += open_claims
                return start, start + size, body
            self._blame(start, start + size)
        return None

    def _blame(self, start: int, end: int) -> None:
        """
        Count one bad frame; what fails inside it is a part of the same damage.

        What fails behind a claim that still waits may be data of that one.
        """
        if start >= self._blamed and (not self._waiting or start <= self._waiting[0]):
            self.bad_frames += 1
            self._blamed = end

    def _shift(self, size: int) -> None:
        self._waiting = [start - size for start in self._waiting if start >= size]
        self._scanned = max(self._scanned - size, 0)
        self._blamed = max(self._blamed - size, 0)
