# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The viewer process: reached from this machine only, quick enough for live data."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
import socket
import time

import numpy as np
import pytest

from smart_tire.cli.view import FLUSH_PERIOD, LiveFeed
from smart_tire.messages import TOPICS
from smart_tire.parameters import build, RobotParams
from smart_tire.samples import Icr, ImuSample, TireSample
from smart_tire.view.layout import ViewLayout
from smart_tire.view.scene import Scene
from smart_tire.view.viewer import Address, free_port, open_stream, START_TIMEOUT, Viewer
from smart_tire.view.writer import ViewError
from support.rolling import films, in_order, slips, steady, WHEEL, wheels
from support.waiting import PATIENCE

pytestmark = pytest.mark.processes

LOAD = 0.8  # s of samples


def patiently(seconds: float) -> None:
    """Wait for a viewer that starts on a busy machine."""
    time.sleep(PATIENCE / START_TIMEOUT * seconds)


def listening(pid: int) -> set[tuple[str, int]]:
    """Return address and port of the TCP sockets on which a process listens."""
    inodes = set()
    for link in Path(f'/proc/{pid}/fd').iterdir():
        with suppress(FileNotFoundError):  # closed meanwhile
            inodes.add(link.readlink().name)
    found = set()
    for name, family in (('tcp', socket.AF_INET), ('tcp6', socket.AF_INET6)):
        for line in Path(f'/proc/{pid}/net/{name}').read_text().splitlines()[1:]:
            _, local, _, state, *rest = line.split()
            if state == '0A' and f'socket:[{rest[5]}]' in inodes:
                address, port = local.split(':')
                raw = b''.join(bytes.fromhex(address[i:i + 8])[::-1]
                               for i in range(0, len(address), 8))
                found.add((socket.inet_ntop(family, raw), int(port, 16)))
    return found


@pytest.fixture(scope='module')
def viewer():
    with Viewer(web=True, wait=patiently) as running:
        yield running


def test_page_and_stream_are_served_on_the_loopback_address_only(viewer):
    address = viewer.address
    assert listening(viewer._process.pid) == {
        ('127.0.0.1', address.grpc), ('127.0.0.1', address.web)}
    assert address.page == (f'http://127.0.0.1:{address.web}/?url='
                            f'rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{address.grpc}%2Fproxy')


def test_live_data_at_full_load_leave_the_process_in_time(viewer):
    """Two instrumented wheels, IMU and slips, with the times at which a robot sends them."""
    params = build(RobotParams, {'film.wheels': [WHEEL, 'front_left']})
    layout = ViewLayout(params.film.wheels, live=True)
    stream = open_stream('load', layout.blueprint(), address=viewer.address.stream)
    names = {topic.sample: topic.name for topic in reversed(TOPICS.values())}
    course = steady(120.0)
    estimated = slips(course, LOAD)
    imu = [ImuSample(one.stamp_ns, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0)) for one in estimated]
    samples = in_order(films(course, LOAD), wheels(course, LOAD), estimated, imu)
    now = next_flush = 1e-9 * samples[0].stamp_ns
    feed = LiveFeed(Scene(stream, params), lambda: now)
    for sample in samples:
        now = 1e-9 * sample.stamp_ns
        if now >= next_flush:
            feed.flush()
            next_flush = now + FLUSH_PERIOD
        feed.on_sample(names[type(sample)], sample)
        if isinstance(sample, TireSample):
            feed.on_sample('tire_samples', replace(sample, wheel='front_left'))
    feed.flush()
    stream.disconnect()
    assert feed.samples > 1000 * LOAD
    assert len(feed.delays) > 5
    assert 0.5 * FLUSH_PERIOD < np.max(feed.delays) < FLUSH_PERIOD + 0.01
    assert 'at most 0.1' in feed.report()


def test_a_stopped_viewer_is_noticed_and_frees_its_ports():
    viewer = Viewer(web=True, wait=patiently)
    assert viewer.running
    stream = open_stream('a', ViewLayout((), live=True).blueprint(), address=viewer.address.stream)
    scene = Scene(stream, RobotParams())
    scene.flush()
    viewer.stop()
    assert not viewer.running
    scene.add_sample('icr', Icr(1, 2.0, 3.0))
    with pytest.raises(ViewError, match='has ended'):
        scene.flush()
    assert free_port(viewer.address.grpc) == viewer.address.grpc


def test_a_viewer_that_does_not_start_is_reported_with_its_reason(monkeypatch):
    monkeypatch.setenv('DISPLAY', ':nonexistent')
    monkeypatch.delenv('WAYLAND_DISPLAY', raising=False)
    monkeypatch.setattr('smart_tire.view.viewer._program', lambda: '/bin/false')
    with pytest.raises(ViewError, match='does not start: exit status 1'):
        Viewer(web=False, wait=patiently)


def test_a_port_in_use_is_replaced_by_a_free_one():
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        other = free_port(port)
    assert other != port
    assert Address(other, None).stream == f'rerun+http://127.0.0.1:{other}/proxy'


def test_a_file_that_cannot_be_written_is_an_error(tmp_path):
    with pytest.raises(ViewError, match='cannot be written'):
        open_stream('a', ViewLayout((), live=False).blueprint(), file=tmp_path / 'no' / 'a.rrd')
