# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Files that are no regular ones: reading them would block, never end, or fail."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
import os
from pathlib import Path
import pty
import socket

KINDS = ('FIFO', 'link to a FIFO', 'socket', 'terminal', 'zeros')


@contextmanager
def special_file(kind: str, folder: Path) -> Iterator[Path]:
    """Yield the path of a file of one of ``KINDS``, in ``folder`` if it is no device."""
    path = folder / 'special'
    if kind == 'zeros':
        yield Path('/dev/zero')
    elif kind == 'terminal':
        controller, terminal = pty.openpty()
        yield Path(os.ttyname(terminal))
        os.close(terminal)
        os.close(controller)
    elif kind == 'socket':
        with closing(socket.socket(socket.AF_UNIX)) as end:
            end.bind(str(path))
            yield path
    else:
        os.mkfifo(path)
        if kind == 'FIFO':
            yield path
        else:
            (folder / 'link').symlink_to(path)
            yield folder / 'link'
