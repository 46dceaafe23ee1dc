# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Pseudo-terminals as serial ports, opened with pyserial as by the drivers."""

import os
import select
import time

import pytest
import serial
from smart_tire.errors import LinkError
from smart_tire.simulation.pseudo_terminal import PtyPort

ALL_BYTES = bytes(range(256))
PATIENCE = 10.0  # s, only a failing test waits so long


@pytest.fixture
def link(tmp_path):
    return str(tmp_path / 'ports' / 'tire_radio')


@pytest.fixture
def port(link):
    with PtyPort(link) as port:
        yield port


def open_host(link):
    return serial.serial_for_url(link, baudrate=115200, timeout=PATIENCE)


def receive(port, size):
    """Return ``size`` bytes received on the device side."""
    data, chunk = b'', b'?'
    while len(data) < size and chunk:
        port.wait(PATIENCE)
        chunk = port.read()
        data += chunk
    return data


def test_every_byte_is_transferred_unchanged_in_both_directions(port, link):
    with open_host(link) as host:
        port.write(ALL_BYTES)
        assert host.read(256) == ALL_BYTES
        host.write(ALL_BYTES)
        assert receive(port, 256) == ALL_BYTES
        assert port.read() == b''  # no echo
    assert port.lost_bytes == 0


def test_output_is_lost_while_no_host_has_the_port_open(port, link):
    port.write(b'old')
    assert port.lost_bytes == 3
    with open_host(link) as host:
        port.write(b'new')
        assert host.read(3) == b'new'
    assert port.lost_bytes == 3


def test_waiting_without_a_host_sleeps(port, link, monkeypatch):
    slept = []
    monkeypatch.setattr(time, 'sleep', slept.append)
    open_host(link).close()
    port.wait(0.05)
    assert slept == [0.05]


def test_output_beyond_the_buffer_of_a_host_that_does_not_read_is_lost(port, link):
    with open_host(link) as host:
        for _ in range(2000):
            port.write(b'x' * 100)
        assert port.lost_bytes > 0
        kept = 200_000 - port.lost_bytes
        assert host.read(kept) == b'x' * kept
        port.write(b'after')
        assert host.read(5) == b'after'


def test_bytes_left_unread_by_one_host_do_not_reach_the_next(port, link):
    with open_host(link) as host:
        port.write(b'stale' * 100)
        assert host.read(5) == b'stale'
    port.write(b'lost')
    descriptor = os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)  # flushes nothing itself
    try:
        port.write(b'fresh')
        assert select.select([descriptor], [], [], PATIENCE)[0]
        assert os.read(descriptor, 1000) == b'fresh'
    finally:
        os.close(descriptor)


def test_closing_hangs_up_and_a_new_port_can_use_the_same_name(link):
    first = PtyPort(link)
    host = open_host(link)
    first.close()
    assert not os.path.lexists(link)
    with pytest.raises(serial.SerialException):
        host.read(1)
    host.close()
    with PtyPort(link) as second, open_host(link) as host:
        second.write(b'again')
        assert host.read(5) == b'again'


def test_a_stale_link_is_replaced(link):
    os.makedirs(os.path.dirname(link))
    os.symlink('/dev/pts/nothing', link)
    with PtyPort(link) as port, open_host(link) as host:
        port.write(b'hello')
        assert host.read(5) == b'hello'


def test_the_link_of_another_port_is_not_replaced_while_its_process_has_it(link):
    with PtyPort(link):
        target, descriptors = os.readlink(link), len(os.listdir('/proc/self/fd'))
        with pytest.raises(LinkError, match=rf'simulator uses it \(process {os.getpid()}\)'):
            PtyPort(link)
        assert os.readlink(link) == target
        assert len(os.listdir('/proc/self/fd')) == descriptors
    with PtyPort(link):
        assert os.path.islink(link)
    assert not os.path.lexists(link)


def test_a_file_is_never_replaced(link):
    os.makedirs(os.path.dirname(link))
    with open(link, 'w', encoding='ascii') as file:
        file.write('precious')
    descriptors = len(os.listdir('/proc/self/fd'))
    with pytest.raises(LinkError, match='tire_radio: exists and is not a link'):
        PtyPort(link)
    assert len(os.listdir('/proc/self/fd')) == descriptors
    with open(link, encoding='ascii') as file:
        assert file.read() == 'precious'
