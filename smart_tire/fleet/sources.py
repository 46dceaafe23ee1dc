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
The bags that arguments name: files, folders searched for bags, patterns, and URLs.

URLs are read by fsspec and its extras; a bag behind one is copied before it is read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
import errno
from glob import glob, has_magic
import os
from pathlib import Path, PurePosixPath
import re
import tempfile
from typing import Any
from urllib.parse import unquote, urlsplit

from smart_tire.errors import BagError, ParameterError, SmartTireError
from smart_tire.paths import BAG_METADATA, BAG_SUFFIXES, is_bag, no_bag, SUMMARY

Source = Path | str  # a bag on this machine, or the URL of one
Wait = Callable[[float], object]  # waits for some seconds

TRIES = 3               # of each file of a URL, assumed: servers restart, links drop
FIRST_PAUSE = 1.0       # s, before the second try; four times as long before the next one
SOCKET_TIMEOUT = 60.0   # s without a byte, assumed; a large file may take hours
HIDDEN = re.compile(r'\.[^.]')
FULL = errno.ENOSPC, errno.EDQUOT, errno.EFBIG  # the disk of the copies
RESULTS = 'estimates', 'smoothed'  # bags that "smart_tire analyze" has written
STATE_OF_FILE = 'ETag', 'mtime', 'Last-Modified', 'LastModified', 'Content-MD5'
FLEET_EXTRA = 'pip install smart_tire[fleet]'


def bags_of(arguments: Iterable[Source]) -> list[Source]:
    """
    Return the bags that ``arguments`` name, in order; raise BagError for one without any.

    An argument is a bag, a folder that is searched for bags at any depth, a pattern of such
    paths, or a URL. Estimates that "smart_tire analyze" has written are not found by a search.
    """
    return [bag for one in arguments for bag in _bags_of(one)]


def _bags_of(argument: Source) -> list[Source]:
    if is_url(argument):
        url = str(argument).rstrip('/')
        _file_system(url)  # a library that is missing concerns all bags
        if url.endswith(BAG_SUFFIXES):
            return [url]
        if not (found := bags_in(_remote_files(url), path_of(url).name)):
            raise BagError(f'{argument}: no .mcap or .db3 file')
        return [f'{url}/{path}' if path.parts else url for path in found]
    path = path_of(argument)
    if not path.exists() and has_magic(str(path)):
        if not (matches := sorted(glob(str(path), recursive=True))):
            raise BagError(f'{path}: no file or directory has such a name')
        return bags_of(map(Path, matches))
    if not path.exists():
        raise BagError(f'{path}: no such file or directory')
    if not path.is_dir() or (path / BAG_METADATA).exists():
        return [path]
    files = [Path(folder, name).relative_to(path) for folder, _, names in os.walk(path)
             for name in names]
    below = bags_in(map(PurePosixPath, files), path.resolve().name)
    if not below:
        raise BagError(no_bag(path))
    if len(below) == 1 and len(below[0].parts) < 2 and is_bag(path):  # its only file
        return [path]
    return [path / bag for bag in below]


def is_url(argument: Source) -> bool:
    """Return whether ``argument`` has to be copied; ``file://`` has not."""
    return isinstance(argument, str) and '://' in argument and not argument.startswith('file://')


def path_of(source: Source) -> Path:
    """Return the path of a bag, of a URL one that names it: ``/HOST/PATH``."""
    if isinstance(source, Path) or '://' not in source:
        return Path(source)
    url = urlsplit(source)
    return Path('/', url.netloc, unquote(url.path).lstrip('/'))


def bags_in(files: Iterable[PurePosixPath], root: str = '') -> list[PurePosixPath]:
    """
    Return the bags among ``files``, paths in the folder ``root``: folders and single files.

    A folder is one bag if it has metadata.yaml, or if all its bag files are named after it, as
    those of an interrupted recording; else each of them is a bag.
    """
    folders: dict[PurePosixPath, list[str]] = {}
    for file in files:
        folders.setdefault(file.parent, []).append(file.name)
    found: list[PurePosixPath] = []
    for folder, names in folders.items():
        bags = sorted(name for name in names if name.endswith(BAG_SUFFIXES))
        written = folder.name in RESULTS and SUMMARY in folders.get(folder.parent, ())
        described, hidden = BAG_METADATA in names, any(map(HIDDEN.match, folder.parts))
        if written or hidden or not (bags or described):
            continue
        name = folder.name or root
        own = re.compile(rf'{re.escape(name)}_\d+\.')
        if described or name and all(map(own.match, bags)):
            found.append(folder)
        else:
            found += [folder / name for name in bags]
    return sorted(found)


def fingerprint(source: Source) -> list[list[Any]]:
    """Return name, size and state of each file of a bag, which change with its content."""
    if is_url(source):
        return [[str(path), info.get('size'), *(str(info.get(key)) for key in STATE_OF_FILE)]
                for path, info in sorted(_described(str(source)).items())]
    path = path_of(source)
    try:
        return [[file.name, file.stat().st_size, file.stat().st_mtime_ns]
                for file in (sorted(path.iterdir()) if path.is_dir() else [path])]
    except OSError as error:
        raise BagError(f'{path}: cannot be read ({error.strerror})') from error


@contextmanager
def local_bag(source: Source, wait: Wait) -> Iterator[Path]:
    """
    Yield the path of a bag, of a complete copy if it is behind a URL, which is deleted then.

    Raises BagError if the bag cannot be copied in three tries, between which it waits. Errors in
    the copy name the URL.
    """
    if not is_url(source):
        yield path_of(source)
        return
    url = str(source)
    system, _ = _file_system(url)
    with tempfile.TemporaryDirectory(prefix='smart_tire_') as folder:
        target = Path(folder, *path_of(url).parts[-2:])  # with the folder: a bag may be "bag"
        for name, info in _described(url).items():
            copy = target / unquote(str(name))
            copy.parent.mkdir(parents=True, exist_ok=True)
            _copy(lambda: system.get_file(info['name'], str(copy)),  # noqa: B023 - called here
                  '/'.join([url, *name.parts]), copy, info.get('size'), wait)
        try:
            yield target
        except SmartTireError as error:
            raise type(error)(str(error).replace(str(target), url)) from error


def _copy(get: Callable[[], object], url: str, copy: Path, size: int | None, wait: Wait) -> None:
    """Call ``get`` until ``copy`` has ``size`` bytes; raise BagError after some tries."""
    for attempt in range(TRIES):
        try:
            get()
            if size is None or (there := copy.stat().st_size) == size:
                return
            reason = f'{there} of {size} bytes'
        except _transport_errors() as error:
            if isinstance(error, OSError) and error.errno in FULL:
                raise BagError(
                    f'{url}: its copy cannot be written ({error.strerror})') from error
            reason = str(error) or type(error).__name__
        if attempt + 1 < TRIES:
            wait(FIRST_PAUSE * 4.0 ** attempt)
    raise BagError(f'{url}: not copied in {TRIES} tries ({reason})')


def _remote_files(url: str) -> Mapping[PurePosixPath, dict[str, Any]]:
    """Return relative path -> description of the files of a URL; of a file itself, '.'."""
    system, root = _file_system(url)
    with _server_errors(url):
        single = root.endswith(BAG_SUFFIXES)
        found = {} if single else system.find(root, detail=True)
        found = found or {root: system.info(root)}
    return {PurePosixPath(name.removeprefix(root.rstrip('/')).lstrip('/')): {**info, 'name': name}
            for name, info in found.items() if info.get('type') != 'directory'}


def _described(url: str) -> Mapping[PurePosixPath, dict[str, Any]]:
    """Return what ``_remote_files`` does, with the sizes that a list of files lacks."""
    system, _ = _file_system(url)
    with _server_errors(url):
        return {path: info if info.get('size') is not None else {
            **info, **system.info(info['name']), 'name': info['name']}
            for path, info in _remote_files(url).items()}


@contextmanager
def _server_errors(url: str) -> Iterator[None]:
    """Raise BagError for what a server or the link to it does."""
    try:
        yield
    except _transport_errors() as error:
        if isinstance(error, BagError):
            raise
        cause = error.__cause__ or error  # of "not found" it may be the link
        if isinstance(cause, FileNotFoundError):
            raise BagError(f'{url}: no such file or directory') from error
        raise BagError(f'{url}: cannot be read ({str(cause) or type(cause).__name__})') from error


def _file_system(url: str) -> tuple[Any, str]:
    """Return the file system of fsspec for ``url``, and the path in it."""
    try:
        import fsspec
    except ModuleNotFoundError as error:
        raise ParameterError(f'{url}: URLs need fsspec ({FLEET_EXTRA})') from error
    options: dict[str, Any] = {}
    try:
        if url.startswith('http'):
            from aiohttp import ClientTimeout
            options['client_kwargs'] = {
                'timeout': ClientTimeout(total=None, sock_connect=SOCKET_TIMEOUT,
                                         sock_read=SOCKET_TIMEOUT)}
        system, path = fsspec.core.url_to_fs(url, use_listings_cache=False, **options)
    except ImportError as error:
        raise ParameterError(f'{url}: {error} ({FLEET_EXTRA})') from error
    except ValueError as error:
        raise ParameterError(f'{url}: {error}') from error
    return system, path


def _transport_errors() -> tuple[type[Exception], ...]:
    """Return what file systems raise if a server or the link to it fails."""
    found: list[type[Exception]] = [OSError, TimeoutError]
    try:
        from aiohttp import ClientError
        found.append(ClientError)
        from botocore.exceptions import BotoCoreError
        found.append(BotoCoreError)
    except ModuleNotFoundError:
        pass  # then nothing raises it
    return tuple(found)
