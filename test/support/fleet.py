# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags of several robots, a web server, and a cluster of processes."""

from __future__ import annotations

from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
import os
from pathlib import Path
import socket
import threading
import time

from smart_tire.parameters import build, SimulatorParams
from smart_tire.simulation.offline import simulate
from support.command import Python
from support.foreign import Foreign

DRIVE_S = 4.0
PARAMETERS = '/**: {ros__parameters: {wheel_radius: 0.087, film: {wheels: [front_left]}}}\n'


def square(item):
    """Return the square; a function that workers find by its name."""
    return item * item


def fail_or_die(item):
    """Return ``item``, or do what it says."""
    if item == 'fail':
        raise ZeroDivisionError('as requested')
    if item == 'die':
        os._exit(1)
    return item


def wait_for_file(path):
    """Write a file next to ``path``, and return as soon as ``path`` exists."""
    Path(f'{path}.began').touch()
    while not Path(path).exists():
        time.sleep(0.01)
    return path


def write_fleet(folder, robots=('alpha', 'beta'), drives=2):
    """Write the bags of short drives into a folder per robot; return a parameter file."""
    for robot in robots:
        (folder / robot).mkdir(parents=True)
        for drive in range(drives):
            events = list(simulate(build(SimulatorParams, {
                'film.wheels': ['front_left'], 'seed': 2 + drive}),
                [(0.3, 100.0, 60.0 + 10.0 * drive)], DRIVE_S))
            Foreign({topic: f'{robot}/{topic}' for _, topic, _ in events}).write(
                folder / robot / f'drive_{drive}', events)
    params = folder.parent / 'params.yaml'
    params.write_text(PARAMETERS)
    return params


class Server:
    """A web server of a folder, of which ``cuts`` answers end halfway."""

    def __init__(self, folder):
        self.cuts, self.requests = 0, []
        server = self

        class Handler(SimpleHTTPRequestHandler):

            def copyfile(self, source, outputfile):
                data = source.read()
                if self.path.endswith('.mcap') and server.cuts > 0:
                    server.cuts -= 1
                    data = data[:len(data) // 2]
                    self.close_connection = True
                outputfile.write(data)

            def do_GET(self):
                server.requests.append(self.path)
                super().do_GET()

            def log_message(self, *_):
                pass

        self._server = ThreadingHTTPServer(('127.0.0.1', 0), partial(
            Handler, directory=str(folder)))
        self.url = f'http://127.0.0.1:{self._server.server_port}'
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self):
        """Stop it."""
        self._server.shutdown()
        self._server.server_close()


class Cluster:
    """Scheduler and workers of dask.distributed as processes; a context manager."""

    def __init__(self, workers=2):
        with socket.socket() as free:
            free.bind(('127.0.0.1', 0))
            self.port = free.getsockname()[1]
        self.address = f'tcp://127.0.0.1:{self.port}'
        self._count, self.scheduler, self.workers = workers, None, []

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        for process in [*self.workers, self.scheduler]:
            process.__exit__()

    def start(self):
        """Start the scheduler, then the workers, which wait for it."""
        self.scheduler = Python('-m', 'distributed.cli.dask_scheduler', '--port', self.port,
                                '--host', '127.0.0.1', '--no-dashboard')
        for _ in range(self._count):
            self.add_worker()
        for worker in self.workers[-self._count:]:
            worker.wait_for('Registered to')

    def add_worker(self):
        """Start one more worker, without a nanny: killing it kills its task."""
        self.workers.append(Python(
            '-m', 'distributed.cli.dask_worker', self.address, '--nthreads', 1, '--no-nanny',
            '--no-dashboard', '--host', '127.0.0.1'))


@contextmanager
def serving(folder):
    """Yield a web server of ``folder``."""
    server = Server(folder)
    try:
        yield server
    finally:
        server.close()
