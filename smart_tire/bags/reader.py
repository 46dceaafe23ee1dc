"""
Bags of rosbag2: directories or single files, mcap or sqlite3, whole or broken.

The files are read here and not by rosbags, which wants each of them whole, and yields nothing
where metadata.yaml and the file tell the offered profiles in different words.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
import heapq
from operator import itemgetter
from pathlib import Path
import re
import tempfile
from types import TracebackType

import zstandard

from smart_tire.bags.cdr import Decoder
from smart_tire.bags.mcap_file import MAGIC as MCAP, McapFile
from smart_tire.bags.metadata import data_files
from smart_tire.bags.sqlite_file import SqliteFile
from smart_tire.bags.storage import Channel, Message, Storage
from smart_tire.errors import BagError, MessageError
from smart_tire.messages import find_topic, TOPICS
from smart_tire.samples import Sample

SUFFIXES = ('.mcap', '.db3', '.mcap.zstd', '.db3.zstd')
ZSTD = b'\x28\xb5\x2f\xfd'
SQLITE = b'SQLite format 3\x00'
UNZIP = 1 << 20  # bytes at a time


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag."""

    channel: Channel
    messages: int


class Bag:
    """
    A bag, open for reading.

    What could not be read stands in ``losses``, messages that break the contract are counted
    in ``rejected`` with the first reason in ``reasons``: neither ends the reading.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.rejected: Counter[str] = Counter()
        self.reasons: dict[str, str] = {}
        self._losses: list[str] = []
        self._unzipped = tempfile.TemporaryDirectory(prefix='smart_tire_')
        self._files: list[Storage] = []
        try:
            self._open_all()
        except BagError:
            self.close()
            raise

    def __enter__(self) -> Bag:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Give the files back."""
        for file in self._files:
            file.close()
        self._unzipped.cleanup()

    @property
    def losses(self) -> list[str]:
        """Return what was found missing or damaged up to now."""
        return self._losses + [loss for file in self._files for loss in file.losses]

    @cached_property
    def topics(self) -> dict[str, BagTopic]:
        """Return the topics by their names in the bag; reads all of a bag without index."""
        channels: dict[str, Channel] = {}
        counts: Counter[str] = Counter()
        for file in self._files:
            for channel, count in file.counts().items():
                channels.setdefault(channel.topic, channel)
                counts[channel.topic] += count
        return {topic: BagTopic(channel, counts[topic]) for topic, channel in channels.items()}

    @cached_property
    def span_ns(self) -> tuple[int, int]:
        """Return when the first and the last message were received [ns]; zeros without any."""
        spans = [span for file in self._files if (span := file.span()) is not None]
        if not spans:
            return 0, 0
        return min(start for start, _ in spans), max(end for _, end in spans)

    def match(self, wanted: Iterable[str]) -> dict[str, str]:
        """
        Return contract's name -> name in the bag, for those of ``wanted`` that are there.

        A name may carry a namespace. Where several do, all topics are taken from the one that
        has most of them, so that two robots are never mixed.
        """
        found: dict[str, list[str]] = {name: [] for name in wanted}
        for name in self.topics:
            topic = find_topic(name)
            if topic is not None and topic.name in found and not self._foreign(name):
                found[topic.name].append(name)
        spaces = Counter(_namespace(name, contract)
                         for contract, names in found.items() for name in names)
        return {contract: min(names, key=lambda name: (
                    -spaces[_namespace(name, contract)], len(name), name))
                for contract, names in found.items() if names}

    def misfits(self) -> list[str]:
        """Return the topics with a name of the contract but messages of another type."""
        return [f'{name} is {self.topics[name].channel.type}' for name in self.topics
                if find_topic(name) is not None and self._foreign(name)]

    def raw(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """Yield the messages of ``topics``, named as in the bag, in the order of reception."""
        streams = [file.messages(topics) for file in self._files]
        return streams[0] if len(streams) == 1 else heapq.merge(*streams, key=itemgetter(0))

    def samples(self, wanted: Iterable[str]) -> Iterator[tuple[int, str, Sample]]:
        """
        Yield when it was received [ns], the contract's topic, and the sample.

        In the order of reception, of those topics of ``wanted`` that are in the bag.
        """
        readers = {name: (contract, Decoder(TOPICS[contract].type), TOPICS[contract].decode)
                   for contract, name in self.match(wanted).items()}
        for receive_ns, channel, data in self.raw(readers):
            contract, read, decode = readers[channel.topic]
            try:
                sample = decode(read(data))
            except MessageError as error:
                self.rejected[contract] += 1
                self.reasons.setdefault(contract, str(error))
            else:
                yield receive_ns, contract, sample

    def _foreign(self, name: str) -> bool:
        topic, channel = find_topic(name), self.topics[name].channel
        return topic is None or channel.type != topic.type or channel.encoding != 'cdr'

    def _open_all(self) -> None:
        errors: list[BagError] = []
        for path in self._paths():
            try:
                self._files.append(self._open(path))
            except BagError as error:
                errors.append(error)
        if not self._files:
            raise errors[0]
        self._losses += map(str, errors)

    def _paths(self) -> list[Path]:
        if not self.path.exists():
            raise BagError(f'{self.path}: no such file or directory')
        if not self.path.is_dir():
            return [self.path]
        try:
            listed = data_files(self.path)
        except BagError as error:
            self._losses.append(str(error))
            listed = []
        else:
            if not listed:
                self._losses.append(f'{self.path}: metadata.yaml is missing')
        for path in listed:
            if not path.exists():
                self._losses.append(f'{path}: is missing')
        paths = [path for path in listed if path.exists()] or sorted(
            (path for path in self.path.iterdir() if path.name.endswith(SUFFIXES)),
            key=_natural)
        if not paths:
            raise BagError(f'{self.path}: is no bag (no .mcap or .db3 file in it)')
        return paths

    def _open(self, path: Path) -> Storage:
        plain = self._unzip(path) if _head(path).startswith(ZSTD) else path
        head = _head(plain)
        if head.startswith(MCAP):
            return McapFile(plain)
        if head == SQLITE:
            return SqliteFile(plain)
        raise BagError(f'{path}: is no bag (neither mcap nor sqlite3)')

    def _unzip(self, path: Path) -> Path:
        plain = Path(self._unzipped.name) / path.stem
        with path.open('rb') as packed, plain.open('wb') as file:
            unzipper = zstandard.ZstdDecompressor().decompressobj()
            try:
                while part := packed.read(UNZIP):
                    file.write(unzipper.decompress(part))
            except zstandard.ZstdError as error:
                self._losses.append(f'{path.name}: is damaged ({error})')
        return plain


def _head(path: Path) -> bytes:
    try:
        with path.open('rb') as file:
            return file.read(len(SQLITE))
    except OSError as error:
        raise BagError(f'{path}: cannot be read ({error.strerror})') from error


def _namespace(name: str, contract: str) -> str:
    return name.strip('/')[:-len(contract)].strip('/')


def _natural(path: Path) -> list[str | int]:
    return [int(part) if part.isdigit() else part for part in re.split(r'(\d+)', path.name)]
