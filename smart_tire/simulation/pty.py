"""Pseudo-terminals under fixed names, which drivers open as they open ``/dev/ttyUSB0``."""

from __future__ import annotations

import os
import select
import termios
import time
import tty

from smart_tire.errors import LinkError

CHUNK = 4096  # bytes per read


class PtyPort:
    """
    The device's end of a serial line; ``link`` is a symbolic link to the host's end.

    Nothing here ever blocks. Output is lost while nobody has the line open, and while a host
    that does not read has filled the kernel's buffer, as with a real port.
    """

    def __init__(self, link: str) -> None:
        self.link = link
        self.lost_bytes = 0
        try:
            self._fd, host = os.openpty()
        except OSError as error:
            raise LinkError(f'{link}: no pseudo-terminal to be had: {error}') from error
        self._name = os.ttyname(host)
        tty.setraw(host)
        os.close(host)  # from now on poll tells whether a host has it open
        os.set_blocking(self._fd, False)
        self._poll = select.poll()
        self._poll.register(self._fd, 0)
        self._connected = False
        try:
            self._make_link()
        except OSError as error:
            os.close(self._fd)
            raise LinkError(f'{link}: {error}') from error

    def __enter__(self) -> PtyPort:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def connected(self) -> bool:
        """Return whether a host had the line open when it was last written to or waited for."""
        return self._connected

    def write(self, data: bytes) -> None:
        """Send ``data`` as far as there is somebody to take it."""
        if self._hung_up():
            self.lost_bytes += len(data)
            return
        try:
            self.lost_bytes += len(data) - os.write(self._fd, data)
        except BlockingIOError:
            self.lost_bytes += len(data)

    def read(self) -> bytes:
        """Return what has arrived, which may be nothing."""
        try:
            return os.read(self._fd, CHUNK)
        except BlockingIOError:
            return b''
        except OSError:  # EIO: nobody has it open
            return b''

    def wait(self, seconds: float) -> None:
        """Return as soon as there is input, but after ``seconds`` at the latest."""
        if self._hung_up():  # select would return at once, again and again
            time.sleep(seconds)
        else:
            select.select([self._fd], [], [], seconds)

    def close(self) -> None:
        """Unplug: a host that has it open sees the line hung up, and the link goes."""
        os.close(self._fd)
        if os.path.islink(self.link) and os.readlink(self.link) == self._name:
            os.unlink(self.link)

    def _hung_up(self) -> bool:
        """Return whether no host has the line open; what the last one left unread is dropped."""
        connected = not self._poll.poll(0)
        if self._connected and not connected:
            host = os.open(self._name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            termios.tcflush(host, termios.TCIFLUSH)
            os.close(host)
        self._connected = connected
        return not connected

    def _make_link(self) -> None:
        """Put the link in place of an old one, in one step; nothing but a link is replaced."""
        os.makedirs(os.path.dirname(os.path.abspath(self.link)), exist_ok=True)
        if os.path.lexists(self.link) and not os.path.islink(self.link):
            raise FileExistsError('is there and is no link')
        new = f'{self.link}.{os.getpid()}'
        os.symlink(self._name, new)
        os.replace(new, self.link)
