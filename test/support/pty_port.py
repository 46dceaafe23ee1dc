# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A serial device on a pseudo-terminal that can be plugged in and unplugged."""

from __future__ import annotations

from contextlib import suppress
import os
from pathlib import Path
import select
import tty


class PtyPort:
    """
    Device side of a serial port; ``path`` is the host side while it is plugged in.

    The host side stays open here: a port exists even if no process uses it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._ends: tuple[int, int] | None = None

    def plug_in(self) -> PtyPort:
        """Create the port."""
        device, host = os.openpty()
        tty.setraw(device)
        os.set_blocking(device, False)
        self._ends = device, host
        self.path.symlink_to(os.ttyname(host))
        return self

    def unplug(self) -> None:
        """Remove the port even if a host has it open; no effect if it is unplugged."""
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
        """Return bytes sent by the host, empty after ``timeout`` seconds without any."""
        assert self._ends is not None
        ready, _, _ = select.select(self._ends[:1], [], [], timeout)
        return os.read(self._ends[0], 4096) if ready else b''
