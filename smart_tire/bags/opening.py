# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Opens the files of a bag: directories or single files, compressed or not."""

from __future__ import annotations

from itertools import pairwise
from operator import itemgetter
import os
from pathlib import Path
import re
import tempfile

from smart_tire.bags.file_bytes import unpack_file, ZSTD_MAGIC
from smart_tire.bags.mcap_file import MAGIC as MCAP_MAGIC, McapFile
from smart_tire.bags.metadata import Losses, Metadata, read_metadata
from smart_tire.bags.sqlite_file import SqliteFile
from smart_tire.errors import BagError
from smart_tire.paths import BAG_METADATA, BAG_SUFFIXES, no_bag, of_ros1, open_file
from smart_tire.samples import NS_PER_S

SQLITE_MAGIC = b'SQLite format 3\x00'
ROS1_MAGIC = b'#ROSBAG V2.0'
MAX_SPLIT_NS = 2 * NS_PER_S  # between the files of one recording, and of their overlap


class OpenFiles:
    """
    The files of the bag at ``path``, open for reading.

    What cannot be read is added to ``losses``, a missing metadata.yaml to ``warnings``. Raises
    BagError if no file can be read.
    """

    def __init__(self, path: Path, warnings: list[str], losses: Losses) -> None:
        self.files: list[McapFile | SqliteFile] = []
        self.metadata = Metadata()  # content of metadata.yaml
        self.size = 0               # bytes of the files
        self._path, self._warnings, self._losses = path, warnings, losses
        self._absent: list[Path] = []  # listed in metadata.yaml
        self._decompressed = tempfile.TemporaryDirectory(prefix='smart_tire_')
        try:
            self._open_all()
        except BagError:
            self.close()
            raise

    def close(self) -> None:
        """Close all files."""
        for file in self.files:
            file.close()
        self._decompressed.cleanup()

    def _open_all(self) -> None:
        errors: list[BagError] = []
        for path in self._paths():
            try:
                self.files.append(self._open(path))
                self.size += path.stat().st_size
            except BagError as error:
                errors.append(error)
        if not self.files:
            raise errors[0]
        for unreadable in errors:
            self._losses.add(str(unreadable))
        self._check_renamed()
        if self._path.is_dir() and not self.metadata.files:
            self._check_one_recording()
            for file in self.files:
                if isinstance(file, SqliteFile) and file.lacks_log and not file.metadata():
                    self._losses.add(f'{file.path.name}: the recording was interrupted, and its '
                                     'write-ahead log (-wal) is missing')

    def _check_renamed(self) -> None:
        """Note the files that are missing as losses, unless others have all messages."""
        listed = self.metadata.messages
        renamed = bool(self._absent and listed) and listed <= sum(
            sum(file.counts().values()) for file in self.files)
        for path in self._absent:
            if renamed:
                self._warnings.append(f'{path}: renamed since it was recorded, no message is '
                                      'missing')
            else:
                self._losses.add(f'{path}: file is missing')

    def _check_one_recording(self) -> None:
        """Raise BagError if files without metadata.yaml do not continue each other."""
        spans = sorted(((span, file) for file in self.files if (span := file.span())),
                       key=itemgetter(0))
        for ((_, end), file), ((start, _), other) in pairwise(spans):
            topics, same = ({channel.topic for channel in one.counts()} for one in (file, other))
            if start - end > MAX_SPLIT_NS or end - start > MAX_SPLIT_NS and topics & same:
                raise BagError(
                    f'{self._path}: {len(self.files)} files, which are not of one recording: '
                    f'{other.path.name} begins {abs(start - end) / NS_PER_S:.4g} s '
                    f'{"after" if start > end else "before"} the end of {file.path.name}; give '
                    'one of the files')

    def _paths(self) -> list[Path]:
        if not self._path.exists():
            raise BagError(f'{self._path}: no such file or directory')
        if not self._path.is_dir():
            return [self._path]
        try:
            metadata = read_metadata(self._path)
        except BagError as error:
            self._warnings.append(str(error))
        else:
            if metadata is None:
                self._warnings.append(f'{self._path}: metadata.yaml is missing')
            else:
                self.metadata = metadata
        listed = [self._path / name for name in self.metadata.files]
        found = [path for path in listed if os.path.exists(path)]  # not with 300 characters
        self._absent = sorted({*listed} - {*found})
        paths = found or sorted(
            (path for path in self._path.iterdir() if path.name.endswith(BAG_SUFFIXES)),
            key=_natural_sort_key)
        if not paths:
            raise BagError(no_bag(self._path))
        return paths

    def _open(self, path: Path) -> McapFile | SqliteFile:
        plain = self._decompress(path) if _first_bytes(path).startswith(ZSTD_MAGIC) else path
        head = _first_bytes(plain)  # the first bytes may be damaged, too
        try:
            if head.startswith(MCAP_MAGIC) or head != SQLITE_MAGIC and plain.suffix == '.mcap':
                return McapFile(plain, self._losses)
            if head == SQLITE_MAGIC or plain.suffix == '.db3':
                return SqliteFile(plain, self._losses)
        except BagError as error:
            raise BagError(str(error).replace(str(plain), str(path))) from error
        if head.startswith(ROS1_MAGIC):
            raise BagError(of_ros1(path))
        if plain.suffix == '.csv':
            raise BagError(f'{path}: a table, expected a bag; write its rows as samples with '
                           'smart_tire.bags.BagWriter.write_sample')
        if plain.name == BAG_METADATA:
            raise BagError(f'{path}: describes a bag: give its folder {path.parent}')
        raise BagError(f'{path}: not a bag file (neither MCAP nor sqlite3)')

    def _decompress(self, path: Path) -> Path:
        plain = Path(self._decompressed.name) / path.stem
        if problem := unpack_file(path, plain):
            if not plain.stat().st_size:
                raise BagError(f'{path}: {problem}')
            self._losses.add(f'{path.name}: {problem}')
        return plain


def _first_bytes(path: Path) -> bytes:
    try:
        with open_file(path) as file:
            return file.read(len(SQLITE_MAGIC))
    except OSError as error:
        raise BagError(f'{path}: cannot be read ({error.strerror})') from error


def _natural_sort_key(path: Path) -> list[str | int]:
    return [int(part) if part.isdigit() else part for part in re.split(r'(\d+)', path.name)]
