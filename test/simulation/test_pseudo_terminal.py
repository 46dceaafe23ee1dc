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
from smart_tire import paths
from smart_tire.errors import LinkError
from smart_tire.paths import LOCK_SUFFIX, owned_terminal, port_url
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


@pytest.mark.parametrize('make', [
    os.symlink, os.link,
    lambda target, lock: os.mkfifo(lock)], ids=['symbolic link', 'hard link', 'FIFO'])
def test_a_lock_that_leads_to_another_file_is_refused_and_changes_nothing(link, make, tmp_path):
    (precious := tmp_path / 'precious').write_text('content')
    os.makedirs(os.path.dirname(link))
    make(precious, link + LOCK_SUFFIX)
    descriptors = len(os.listdir('/proc/self/fd'))
    with pytest.raises(LinkError, match='tire_radio'):
        PtyPort(link)
    assert owned_terminal(link) == ''
    assert precious.read_text() == 'content'
    assert len(os.listdir('/proc/self/fd')) == descriptors


def test_the_lock_and_the_folder_of_another_user_are_refused(link, tmp_path, monkeypatch):
    with PtyPort(link):
        assert owned_terminal(link).startswith('/dev/pts/')
        user = os.getuid()
        monkeypatch.setattr(os, 'getuid', lambda: user + 1)
        assert owned_terminal(link) == ''
    with pytest.raises(LinkError, match=rf'lock is not a file of user {user + 1} alone'):
        PtyPort(link)


@pytest.fixture
def runtime(tmp_path, monkeypatch):
    """Return a private folder that is XDG_RUNTIME_DIR."""
    (folder := tmp_path / 'runtime').mkdir(mode=0o700)
    monkeypatch.setenv('XDG_RUNTIME_DIR', str(folder))
    return folder


def simulated(name='imu'):
    return port_url(f'simulated:{name}', '/r1').removeprefix('simulated:')


def test_simulated_ports_are_in_a_folder_of_this_user_only(runtime):
    (runtime / 'smart_tire').mkdir(mode=0o755)  # as older versions have made it
    with PtyPort(simulated()):
        assert os.stat(runtime / 'smart_tire').st_mode & 0o777 == 0o700
        assert owned_terminal(simulated()).startswith('/dev/pts/')
        assert simulated().startswith(str(runtime / 'smart_tire'))


@pytest.mark.parametrize('mode', [0o777, 0o720, 0o702])
def test_a_folder_that_others_can_write_to_is_refused(runtime, mode):
    (folder := runtime / 'smart_tire').mkdir()
    folder.chmod(mode)
    with pytest.raises(LinkError, match=r'smart_tire is not a folder that only user'):
        PtyPort(simulated())
    assert not list(folder.iterdir())


def test_a_link_instead_of_the_folder_and_a_folder_of_another_user_are_refused(
        runtime, tmp_path, monkeypatch):
    (other := tmp_path / 'other').mkdir(mode=0o700)
    (runtime / 'smart_tire').symlink_to(other)
    with pytest.raises(LinkError, match='is not a folder that only user'):
        PtyPort(simulated())
    (runtime / 'smart_tire').unlink()
    with PtyPort(simulated()):
        pass
    link, user = simulated(), os.getuid()
    folder = os.path.dirname(os.path.dirname(os.path.dirname(link)))
    monkeypatch.setattr(paths, 'runtime_folder', lambda: paths.Path(folder))
    monkeypatch.setattr(os, 'getuid', lambda: user + 1)
    with pytest.raises(PermissionError, match=f'only user {user + 1} can write to'):
        paths.make_runtime_folder()


@pytest.mark.parametrize('mode, used', [(0o700, True), (0o750, False), (0o777, False)])
def test_a_runtime_folder_of_others_is_not_used(runtime, mode, used):
    runtime.chmod(mode)
    assert (str(runtime) in simulated()) == used
    assert used or f'/tmp/smart_tire-{os.getuid()}/' in simulated()


@pytest.mark.parametrize('value', ['', 'relative', '/nowhere/at/all'])
def test_a_runtime_folder_that_does_not_exist_is_not_used(monkeypatch, value):
    monkeypatch.setenv('XDG_RUNTIME_DIR', value)
    assert simulated().startswith(f'/tmp/smart_tire-{os.getuid()}/')
