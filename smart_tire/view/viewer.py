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
The viewer as a process of its own, and the stream of a recording to it.

rerun's own functions would serve every network interface; the viewer started here is reached from
this machine only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
import os
from pathlib import Path
import socket
import subprocess
import tempfile
from urllib.parse import quote

import rerun as rr
import rerun.blueprint as rrb

from smart_tire.paths import explained
from smart_tire.view.writer import ViewError

APPLICATION = 'smart_tire'
LOOPBACK = '127.0.0.1'
GRPC_PORT, WEB_PORT = 9876, 9090  # the usual ones of rerun, if they are free
START_TIMEOUT, STOP_TIMEOUT, POLL_PERIOD = 20.0, 5.0, 0.05  # s
# ``Scene.flush`` sends the data, rerun itself rarely: viewers read few large parts much faster
# than many small ones.
FLUSH_TICK, FLUSH_BYTES, FLUSH_ROWS = 10.0, 1 << 23, 1 << 20  # s, bytes, rows
MEMORY_LIMIT = '2GB'    # of the server, which then drops the oldest data


@dataclass(frozen=True)
class Address:
    """Ports of a viewer on this machine; ``page`` requires that of a web viewer."""

    grpc: int
    web: int | None  # None for the native viewer

    @property
    def stream(self) -> str:
        """Return the address for the stream of a recording."""
        return f'rerun+http://{LOOPBACK}:{self.grpc}/proxy'

    @property
    def page(self) -> str:
        """Return the address for a browser."""
        return f'http://{LOOPBACK}:{self.web}/?url={quote(self.stream, safe="")}'


class Viewer:
    """A viewer process; as a context manager it is stopped at the end."""

    def __init__(self, *, web: bool, wait: Callable[[float], None],
                 prepare: Callable[[], None] | None = None) -> None:
        """
        Start a viewer, with ``web`` one for browsers; raise ViewError if it does not start.

        ``wait`` waits for a time [s]; ``prepare`` is called in the new process.
        """
        grpc = free_port(GRPC_PORT)
        self.address = Address(grpc, free_port(WEB_PORT, grpc) if web else None)
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 (as long as the viewer)
        options = (['--serve-web', '--web-viewer-port', str(self.address.web)] if web
                   else ['--expect-data-soon', '--hide-welcome-screen'])
        # A session of its own: Ctrl-C ends the program that streams, not a viewer with its data.
        self._process = subprocess.Popen(
            [_program(), '--bind', LOOPBACK,
             '--port', str(grpc), '--server-memory-limit', MEMORY_LIMIT, *options],
            env={**os.environ, 'RERUN_APP_ONLY': 'true'}, stdin=subprocess.DEVNULL,
            stdout=self._log, stderr=self._log, start_new_session=True, preexec_fn=prepare)
        for _ in range(round(START_TIMEOUT / POLL_PERIOD)):
            if all(map(_accepts, filter(None, (grpc, self.address.web)))):
                return
            if not self.running:
                break
            wait(POLL_PERIOD)
        self.stop()
        raise ViewError(f'the viewer does not start: {self._reason()}')

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def running(self) -> bool:
        """Return whether the viewer still runs: a user may close it."""
        return self._process.poll() is None

    def stop(self) -> None:
        """End the viewer."""
        self._process.terminate()
        try:
            self._process.wait(STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _reason(self) -> str:
        self._log.seek(0)
        lines = self._log.read().decode(errors='replace').strip().splitlines()
        return lines[-1] if lines else f'exit status {self._process.returncode}'


def open_stream(name: str, blueprint: rrb.Blueprint, *, address: str | None = None,
                file: Path | None = None) -> rr.RecordingStream:
    """
    Return the stream of a recording to the viewer at ``address``, to a ``file``, or to both.

    Raises ViewError if the file cannot be written.
    """
    stream = rr.RecordingStream(APPLICATION, batcher_config=rr.ChunkBatcherConfig(
        flush_tick=FLUSH_TICK, flush_num_bytes=FLUSH_BYTES, flush_num_rows=FLUSH_ROWS))
    sinks: list[rr.GrpcSink | rr.FileSink] = []
    if address is not None:
        sinks.append(rr.GrpcSink(address))
    if file is not None:
        with explained(file, 'written', ViewError):
            file.open('wb').close()
        sinks.append(rr.FileSink(file))
    stream.set_sinks(*sinks, default_blueprint=blueprint)
    stream.send_recording_name(name)
    return stream


def free_port(wanted: int, *taken: int) -> int:
    """Return the TCP port ``wanted``, or another one if it is in use or one of ``taken``."""
    for port in (wanted, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((LOOPBACK, port))
            except OSError:
                continue
            found = int(probe.getsockname()[1])
            if found not in taken:
                return found
    raise ViewError('no free TCP port')


def _program() -> str:
    """Return the path of the viewer that comes with rerun."""
    spec = find_spec('rerun_cli')
    if spec is None or spec.origin is None:
        raise ViewError('rerun is installed without its viewer: pip install rerun-sdk')
    return str(Path(spec.origin).with_name('rerun'))


def _accepts(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((LOOPBACK, port)) == 0
