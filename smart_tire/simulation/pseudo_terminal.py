# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pseudo-terminals with fixed names, opened by drivers like ``/dev/ttyUSB0``."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
import select
import termios
import time
import tty

from smart_tire.errors import LinkError
from smart_tire.paths import make_runtime_folder, MAX_LOCK_BYTES, open_lock, runtime_folder

MAX_READ_BYTES = 4096  # bytes per read
LOCK_ATTEMPTS, LOCK_DELAY = 5, 0.02  # -, s; a driver needs microseconds


class PtyPort:
    """
    Device side of a serial line; ``link`` is a symbolic link to the host side.

    No method except ``wait`` blocks. As with a real port, output is lost while no host has the
    port open, and while the kernel buffer is full because the host does not read.
    """

    def __init__(self, link: str) -> None:
        self.link = link
        self.lost_bytes = 0
        try:
            self._fd, host = os.openpty()
        except OSError as error:
            raise LinkError(f'{link}: no pseudo-terminal available: {error}') from error
        self._name = os.ttyname(host)
        tty.setraw(host)
        os.close(host)  # from now on poll reports whether a host has it open
        os.set_blocking(self._fd, False)
        self._poll = select.poll()
        self._poll.register(self._fd, 0)
        self._connected = False
        try:
            self._lock = self._make_link()
        except OSError as error:
            os.close(self._fd)
            raise LinkError(f'{link}: {error}') from error

    def __enter__(self) -> PtyPort:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def connected(self) -> bool:
        """Return whether a host had the port open at the latest write or wait."""
        return self._connected

    def write(self, data: bytes) -> None:
        """Send ``data``; bytes that the host cannot receive are lost."""
        if self._hung_up():
            self.lost_bytes += len(data)
            return
        try:
            self.lost_bytes += len(data) - os.write(self._fd, data)
        except BlockingIOError:
            self.lost_bytes += len(data)

    def read(self) -> bytes:
        """Return the received bytes, possibly none."""
        try:
            return os.read(self._fd, MAX_READ_BYTES)
        except BlockingIOError:
            return b''
        except OSError:  # EIO: no host has it open
            return b''

    @property
    def unread(self) -> bool:
        """Return whether the host has not read all bytes yet."""
        if not self._connected:
            return False
        host = os.open(self._name, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            return fcntl.ioctl(host, termios.FIONREAD, bytes(4)) != bytes(4)
        finally:
            os.close(host)

    def wait(self, seconds: float) -> None:
        """Wait for input, at most ``seconds``."""
        if self._hung_up():  # select would return immediately every time
            time.sleep(seconds)
        else:
            select.select([self._fd], [], [], seconds)

    def close(self) -> None:
        """Close the port: a host that has it open sees a hang-up; the link is removed."""
        os.close(self._fd)
        if os.path.islink(self.link) and os.readlink(self.link) == self._name:
            os.unlink(self.link)
        os.close(self._lock)

    def _hung_up(self) -> bool:
        """Return whether no host has the port open; discard bytes left unread by the last one."""
        connected = not self._poll.poll(0)
        if self._connected and not connected:
            host = os.open(self._name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            termios.tcflush(host, termios.TCIFLUSH)
            os.close(host)
        self._connected = connected
        return not connected

    def _make_link(self) -> int:
        """
        Create the link atomically and return its lock (a descriptor), which ends with the process.

        An old link is replaced, but never another kind of file, nor the link of another port.
        """
        if runtime_folder() in Path(self.link).parents:
            make_runtime_folder()
        os.makedirs(os.path.dirname(os.path.abspath(self.link)), exist_ok=True)
        if os.path.lexists(self.link) and not os.path.islink(self.link):
            raise FileExistsError('exists and is not a link')
        lock = open_lock(self.link, os.O_RDWR | os.O_CREAT)
        for _ in range(LOCK_ATTEMPTS):  # a driver holds it while it looks for a simulator
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                time.sleep(LOCK_DELAY)
        else:
            owner = os.read(lock, MAX_LOCK_BYTES).decode('ascii', 'replace').partition(' ')[0]
            os.close(lock)
            raise FileExistsError(f'another simulator uses it (process {owner})')
        os.ftruncate(lock, 0)
        new = f'{self.link}.{os.getpid()}'
        os.symlink(self._name, new)
        os.replace(new, self.link)
        os.write(lock, f'{os.getpid()} {self._name}'.encode())
        return lock
