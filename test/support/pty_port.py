"""A device behind a pseudo-terminal that can be plugged in and out under one name."""

from __future__ import annotations

from contextlib import suppress
import os
from pathlib import Path
import select
import tty


class PtyPort:
    """
    The device's end of a serial port; ``path`` is the host's end while it is plugged in.

    The host's end stays open here, as a driver keeps a port there that nobody uses.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._ends: tuple[int, int] | None = None

    def plug_in(self) -> PtyPort:
        """Let the port appear."""
        device, host = os.openpty()
        tty.setraw(device)
        os.set_blocking(device, False)
        self._ends = device, host
        self.path.symlink_to(os.ttyname(host))
        return self

    def unplug(self) -> None:
        """Let the port vanish from under whoever has it open; again, if it did before."""
        if self._ends is not None:
            self.path.unlink()
            for end in self._ends:
                os.close(end)
            self._ends = None

    def write(self, data: bytes) -> None:
        """Send bytes to the host; what does not fit into a full buffer is lost."""
        assert self._ends is not None
        with suppress(BlockingIOError):
            os.write(self._ends[0], data)

    def read(self, timeout: float) -> bytes:
        """Return what the host has sent, empty if there is nothing within ``timeout`` seconds."""
        assert self._ends is not None
        ready, _, _ = select.select(self._ends[:1], [], [], timeout)
        return os.read(self._ends[0], 4096) if ready else b''
