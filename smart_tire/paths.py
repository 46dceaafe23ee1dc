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
Checks of the paths given to a program, before anything slow is imported; ports; writing of texts.

A bag may be given by a folder that contains it, such as ``demo_output``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import errno
import fcntl
from io import StringIO
import os
from pathlib import Path
import stat
from typing import Any, BinaryIO

from smart_tire.errors import BagError, ParameterError, SmartTireError

BAG_SUFFIXES = ('.mcap', '.db3', '.mcap.zstd', '.db3.zstd')
BAG_METADATA = 'metadata.yaml'
SUMMARY = 'summary.json'  # of an analysis, next to its bags
MAX_SUMMARY_SIZE = 10_000_000  # bytes, a hundred times that of a long recording
SIMULATED = 'simulated:'  # scheme of the ports of simulated devices
LOCK_SUFFIX = '.lock'     # of the file of the link of a simulated port
MAX_LOCK_BYTES = 256      # of its text: process and terminal


def port_url(port: str, namespace: str, device: str = '') -> str:
    """
    Return ``port``, with ``simulated:NAME`` as ``simulated:`` and the path of a link.

    ``simulated`` alone stands for ``simulated:`` and ``device``.

    Simulator and drivers of one user, ROS domain and ``namespace`` find the same link, and no
    others do. A port with this scheme is opened only if it is a pseudo-terminal.
    """
    if device and port == SIMULATED.rstrip(':'):
        port = SIMULATED + device
    name = port.removeprefix(SIMULATED)
    if name == port or '/' in name:
        return port
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    return f'{SIMULATED}{runtime_folder() / domain / namespace.strip("/") / name}'


def runtime_folder() -> Path:
    """
    Return the folder of this user's simulated ports.

    It is in ``XDG_RUNTIME_DIR``, if that is a folder of this user only, otherwise in ``/tmp``.
    """
    given = os.environ.get('XDG_RUNTIME_DIR', '')
    if os.path.isabs(given) and os.path.isdir(given):
        found = os.stat(given)
        if found.st_uid == os.getuid() and not found.st_mode & 0o077:
            return Path(given, 'smart_tire')
    return Path(f'/tmp/smart_tire-{os.getuid()}')


def make_runtime_folder() -> None:
    """Create ``runtime_folder``; raise OSError if another user has, or can write to it."""
    folder = runtime_folder()
    try:
        folder.mkdir(mode=0o700)
    except FileExistsError:
        found = folder.lstat()
        if (not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid()
                or found.st_mode & 0o022):
            raise PermissionError(
                f'{folder} is not a folder that only user {os.getuid()} can write to') from None
        folder.chmod(0o700)


def open_lock(link: str, flags: int) -> int:
    """
    Return a descriptor of the lock file of ``link``, of which the simulator holds the lock.

    Raises OSError if it is a link, or not a file of this user alone: others may write to folders
    such as ``/tmp``.
    """
    path = link + LOCK_SUFFIX
    lock = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o600)
    found = os.fstat(lock)
    if stat.S_ISREG(found.st_mode) and found.st_uid == os.getuid() and found.st_nlink == 1:
        return lock
    os.close(lock)
    raise PermissionError(f'{path} is not a file of user {os.getuid()} alone')


def owned_terminal(link: str) -> str:
    """
    Return the terminal of the running simulator that has created ``link``, '' without one.

    The simulator locks its lock file, which names its process and terminal. A link
    that was left behind may lead to a terminal that is another program's by now.
    """
    try:
        lock = open_lock(link, os.O_RDONLY)
    except OSError:
        return ''
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return os.read(lock, MAX_LOCK_BYTES).decode('ascii', 'replace').partition(' ')[2]
    finally:
        os.close(lock)
    return ''


def find_bag(path: Path) -> Path:
    """
    Return the bag that ``path`` names: itself, or the only bag one level below.

    Raises BagError if there is no bag, and if there are several.
    """
    if not path.exists():
        raise BagError(f'{path}: no such file or directory')
    if not path.is_dir() or is_bag(path):
        return path
    below = sorted(child for child in path.iterdir() if child.is_dir() and is_bag(child))
    if not below:
        raise BagError(no_bag(path))
    if len(below) > 1:
        raise BagError(f'{path} contains {len(below)} bags, expected one: '
                       + ', '.join(map(str, below)))
    return below[0]


def is_analysis(folder: Path) -> bool:
    """Return whether ``folder`` is the output folder of ``smart_tire analyze``."""
    return (folder / SUMMARY).is_file() and (folder / 'estimates').is_dir()


def analyzed_bag(folder: Path) -> tuple[Path, dict[str, str]] | None:
    """
    Return the bag that the summary in ``folder`` names, and its topics that were remapped.

    None if summary or bag are missing; raises BagError if this is not a summary.
    """
    import json  # nodes start without
    summary = folder / SUMMARY
    try:
        tree = json.loads(read_file(summary, MAX_SUMMARY_SIZE))
        bag, remap = Path(tree['bag']), dict(tree.get('remap', {}))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise BagError(f'{summary}: not the summary of an analysis ({error})') from error
    return (bag, remap) if os.path.exists(bag) else None  # also for names of 300 characters


def no_bag(folder: Path) -> str:
    """Return why ``folder`` is no bag; one with a ROS 1 bag has a way on."""
    old = sorted(folder.glob('*.bag'))
    return of_ros1(old[0]) if old else (
        f'{folder}: not a rosbag2 directory (contains no .mcap or .db3 file)')


def of_ros1(path: Path) -> str:
    """Return that a file is a ROS 1 bag, and how it is converted."""
    return (f'{path}: a ROS 1 bag; convert it: rosbags-convert --src {path} '
            f'--dst {path.with_suffix("")} --dst-storage mcap')


def bag_name(path: Path) -> str:
    """Return the name of a bag: that of its folder, or of its file without suffix."""
    bag = path.resolve()
    return bag.name if bag.is_dir() else bag.stem


def is_bag(folder: Path) -> bool:
    """Return whether ``folder`` has the files of a bag; a bag may lack its metadata."""
    return (folder / BAG_METADATA).is_file() or any(
        child.name.endswith(BAG_SUFFIXES) and child.is_file() for child in folder.iterdir())


def open_file(path: str | Path) -> BinaryIO:
    """
    Open a regular file for reading; raise OSError if it cannot be read, and for anything else.

    A FIFO would wait for a writer, a terminal or /dev/zero never end, and opening a serial port
    resets the device behind it.
    """
    _check_regular(os.stat(path))
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        _check_regular(os.fstat(descriptor))  # it may have been replaced
    except OSError:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, 'rb')


def _check_regular(found: os.stat_result) -> None:
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, 'not a regular file')


def read_file(path: str | Path, max_size: int) -> bytes:
    """Return the content of a regular file; raise OSError if that is above ``max_size`` bytes."""
    with open_file(path) as file:
        data = file.read(max_size + 1)
    if len(data) > max_size:
        raise OSError(errno.EFBIG, f'more than {max_size} bytes')
    return data


@contextmanager
def explained(path: Path, what: str, kind: type[SmartTireError] = ParameterError
              ) -> Iterator[None]:
    """Raise an error of ``kind`` for an OSError: ``path`` cannot be ``what``, such as read."""
    try:
        yield
    except OSError as error:
        raise kind(f'{path}: cannot be {what} ({error.strerror})') from error


def check_file(path: Path) -> None:
    """Raise ParameterError unless ``path`` is a regular file that can be read."""
    with explained(path, 'read'):
        open_file(path).close()


@contextmanager
def csv_rows(path: Path, max_size: int, kind: str) -> Iterator[Any]:
    """Yield the reader of a CSV file; raise ParameterError if it is no file of this ``kind``."""
    import csv  # nodes start without
    try:
        with explained(path, 'read'):
            # decoded as a whole: the error has the position in the file
            yield csv.reader(StringIO(read_file(path, max_size).decode('utf-8-sig'), newline=''),
                             skipinitialspace=True)
    except (UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(f'{path}: not a {kind} ({error})') from error


def is_number(text: str) -> bool:
    """Return whether ``text`` is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def check_writable(path: Path) -> None:
    """Raise ParameterError if ``path``, or a file in it if it is a folder, cannot be written."""
    folder = path.absolute() if path.is_dir() else path.absolute().parent
    while not os.path.lexists(folder):
        folder = folder.parent
    if not folder.is_dir():
        raise ParameterError(f'{path}: cannot be written ({folder} is not a folder)')
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ParameterError(f'{path}: cannot be written (no permission to write to {folder})')


def write_text(path: Path, text: str) -> None:
    """Write a file and create its folder; raise ParameterError if that is not possible."""
    with explained(path, 'written'):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding='utf-8')
