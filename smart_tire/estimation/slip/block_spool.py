"""Blocks of bytes that outgrow the memory: kept in order, read and replaced anywhere."""

from __future__ import annotations

from collections.abc import Sequence
import pickle
import tempfile
from typing import Any, IO

from smart_tire.errors import EstimatorError

IN_MEMORY = 1 << 26  # bytes; the blocks of a few minutes never see a disk


class Spool:
    """A temporary file, in memory while it is small; EstimatorError where it has no room."""

    def __init__(self) -> None:
        self._file = _new_file()
        self._end = 0

    def close(self) -> None:
        """Give the file back; what was in it is gone."""
        self._file.close()

    def append(self, data: bytes, room: int = 0) -> int:
        """Append ``data``, with ``room`` [bytes] for it to grow to; return its place."""
        place = self._end
        self.replace(place, data)
        self._end += max(len(data), room)
        return place

    def append_items(self, items: Sequence[Any]) -> int:
        """Append any picklable items and return their place."""
        return self.append(pickle.dumps(items, pickle.HIGHEST_PROTOCOL))

    def replace(self, place: int, data: bytes) -> None:
        """Write ``data`` over what begins at ``place``, within its room."""
        try:
            self._file.seek(place)
            self._file.write(data)
        except OSError as error:
            raise EstimatorError(f'no room in {tempfile.gettempdir()} for {place + len(data)} '
                                 f'bytes ({error.strerror}); TMPDIR may name a larger folder'
                                 ) from error

    def read(self, place: int, size: int) -> bytes:
        """Return ``size`` bytes from ``place``."""
        self._file.seek(place)
        return self._file.read(size)

    def items(self, place: int) -> Any:
        """Return the items at ``place``, which only this object has written."""
        self._file.seek(place)
        return pickle.load(self._file)


def _new_file() -> IO[bytes]:
    return tempfile.SpooledTemporaryFile(max_size=IN_MEMORY, prefix='smart_tire_')
