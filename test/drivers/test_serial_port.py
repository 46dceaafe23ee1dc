# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Serial ports that are absent, busy, unplugged and plugged in again."""

from __future__ import annotations

import os
import threading

import pytest
from smart_tire.drivers import serial_port
from smart_tire.drivers.clock import Clock
from smart_tire.drivers.serial_port import open_port, read_loop, RETRY_DELAY, SerialPort
from smart_tire.errors import LinkError
from smart_tire.simulation.pseudo_terminal import PtyPort
from support.waiting import PATIENCE, wait_for


class VirtualClock(Clock):
    """A clock that what waits for it advances, with the lengths of the waits [s]."""

    def __init__(self):
        self.waits, self.time = [], 0

    def time_ns(self):
        return self.time

    def wait(self, event, seconds):
        self.waits.append(seconds)
        return event.wait(0.001)


@pytest.fixture
def link(port, monkeypatch):
    """Return a port whose chunks and reports are collected in ``received`` and ``reports``."""
    monkeypatch.setattr(serial_port, 'CLOSE_TIMEOUT', PATIENCE)
    received, reports, clock = bytearray(), [], VirtualClock()
    made = SerialPort(
        str(port.path), 115200,
        lambda opened, stopping: read_loop(
            opened, stopping, lambda chunk, _: received.extend(chunk)), reports.append, clock)
    made.received, made.reports, made.waits = received, reports, clock.waits
    yield made
    made.stop()


class SlowLine:
    """A port on which each read of as many bytes as wait takes a millisecond."""

    def __init__(self, clock, stopping, *chunks):
        self._clock, self._stopping, self._chunks = clock, stopping, list(chunks)

    @property
    def in_waiting(self):
        return len(self._chunks[0])

    def read(self, size):
        chunk = self._chunks.pop(0)
        assert size == max(1, len(chunk))  # without bytes it blocks until one arrives
        self._clock.time += 1_000_000
        if not self._chunks:
            self._stopping.set()
        return chunk


def test_a_chunk_has_the_time_after_its_last_byte():
    clock, stopping, delivered = VirtualClock(), threading.Event(), []
    line = SlowLine(clock, stopping, b'he', b'', b'llo')
    read_loop(line, stopping, lambda *chunk: delivered.append(chunk), clock)
    assert delivered == [(b'he', 1_000_000), (b'llo', 3_000_000)]


@pytest.mark.parametrize(('url', 'reason'), [
    ('/no/such/port', 'there is no such port'),
    ('bogus://port', "protocol 'bogus' not known"),
    ('/dev/null', 'it is not a serial port'),
    ('loop://?loggint=debug', 'debug'),
    ('hwgrep://[', 'unterminated character set'),
    ('hwgrep://0403&n=', 'int()'),
    ('hwgrep://0403&n', 'NoneType'),
    ('socket://host', ''),
    ('rfc2217://', ''),
    ('spy://', ''),
])
def test_a_port_that_cannot_be_opened_is_refused_with_the_reason(url, reason):
    with pytest.raises(LinkError) as caught:
        open_port(url, 9600)
    assert str(caught.value).startswith(f'cannot open {url} at 9600 baud: ')
    assert reason in str(caught.value)


def test_a_simulated_port_is_never_a_real_device(port, tmp_path):
    real = tmp_path / 'ttyUSB0'
    real.touch()
    for target in (real, tmp_path / 'absent'):
        other = tmp_path / f'link to {target.name}'
        other.symlink_to(target)
        with pytest.raises(LinkError, match='no simulator of this namespace and ROS domain runs'):
            open_port(f'simulated:{other}', 115200)
    with PtyPort(str(tmp_path / 'imu')) as simulated:
        open_port(f'simulated:{simulated.link}', 115200).close()


def test_a_link_left_by_a_simulator_leads_to_no_terminal_of_another_program(port, tmp_path):
    link = tmp_path / 'imu'
    with PtyPort(str(link)):
        pass
    port.plug_in()
    link.symlink_to(os.path.realpath(port.path))  # as after a kill: the number is used again
    with pytest.raises(LinkError, match='no simulator of this namespace and ROS domain runs'):
        open_port(f'simulated:{link}', 115200)
    with PtyPort(str(link)) as simulated, open_port(f'simulated:{link}', 115200) as host:
        host.write(b'x')
        simulated.wait(1.0)
        assert simulated.read() == b'x'


def test_a_plain_file_is_refused_with_a_reason_and_not_modified(tmp_path):
    path = tmp_path / 'notes.txt'
    path.write_text('hello')
    with pytest.raises(LinkError, match='notes.txt at 115200 baud: it is not a serial port'):
        open_port(str(path), 115200)
    assert path.read_text() == 'hello'


def test_a_port_that_is_in_use_is_refused(port):
    first = open_port(str(port.plug_in().path), 115200)
    with pytest.raises(LinkError, match='busy'):
        open_port(str(port.path), 115200)
    first.close()
    open_port(str(port.path), 115200).close()


def test_bytes_received_before_opening_are_not_delivered(port):
    port.plug_in().write(b'old')
    opened = open_port(str(port.path), 115200, timeout=0.0)
    assert opened.read(10) == b''
    opened.close()


def test_a_missing_port_is_opened_soon_after_it_appears_however_long_it_was_missing(port, link):
    link.start()
    wait_for(lambda: link.refused >= 40)
    assert 'no such port' in link.problem
    port.plug_in()
    wait_for(lambda: link.opened)
    port.write(b'data')
    wait_for(lambda: link.received == b'data')
    assert link.waits == [RETRY_DELAY] * link.refused and RETRY_DELAY <= 0.25
    assert link.problem == ''
    assert len(link.reports) == 2  # absent, open: one line each, for any number of attempts


def test_a_port_that_is_unplugged_is_opened_again(port, link):
    port.plug_in()
    link.start()
    for times in (1, 2, 3):
        wait_for(lambda times=times: link.opened == times)
        port.write(b'x')
        wait_for(lambda times=times: link.received == b'x' * times)
        port.unplug()
        wait_for(lambda: link.problem)
        port.plug_in()
    assert any(report.startswith('lost ') for report in link.reports)
    assert set(link.waits) == {RETRY_DELAY}


def test_a_port_stops_while_its_device_is_missing(port, link):
    link.start()
    wait_for(lambda: link.refused)
    link.stop()
    opened = link.opened
    port.plug_in()
    assert link.opened == opened
    open_port(str(port.path), 115200).close()  # it is not locked


def test_a_port_that_was_never_started_stops():
    SerialPort('/no/such/port', 9600, lambda port, stopping: None, lambda report: None).stop()
