# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Scan of ports: recognized devices, held and forbidden ports, and what is written to them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
import threading

import numpy as np
import pytest

from smart_tire.drivers import port_scan
from smart_tire.drivers.port_scan import identify, scan_port
from smart_tire.errors import FrameError
from smart_tire.protocol.roboclaw import decode_text_reply, encode_text_reply, READ_VERSION
from smart_tire.samples import ImuSample
from smart_tire.simulation.device_emulators import (
    ImuEmulator, RadioEmulator, RoboclawEmulator, SensorNodeEmulator)

STILL = ImuSample(0, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0))


def imu_bytes(protocol, count=20):
    """Return frames of an IMU."""
    device = ImuEmulator(protocol)
    return b''.join(device.frame(ImuSample(10_000_000 * k, STILL.acceleration, STILL.rate))
                    for k in range(count))


def radio_bytes(count=8):
    """Return batches of a sensor node."""
    radio = RadioEmulator({'front_left': SensorNodeEmulator(0x13A20040A1B2C3)},
                          np.random.default_rng(0))
    for k in range(count):
        radio.send('front_left', 16 * k, [(512, 512)] * 16, 40_000_000 * k)
    return radio.due(10**12)


@pytest.fixture(autouse=True)
def short_time(monkeypatch):
    """Listen shortly: the devices of these tests answer at once."""
    monkeypatch.setattr(port_scan, 'LISTEN_TIME', 0.04)


@contextmanager
def device(port, reply) -> Iterator[list[bytes]]:
    """Run a device that calls ``reply`` with what it received; yield what it received."""
    received: list[bytes] = []
    stopping = threading.Event()

    def work():
        while not stopping.is_set():
            chunk = port.read(0.005)
            received.append(chunk)
            port.write(reply(chunk))

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield received
    finally:
        stopping.set()
        thread.join()


@pytest.mark.parametrize('protocol', ['vectornav_binary', 'vectornav_ascii', 'xsens'])
def test_an_imu_is_recognized_by_its_frames(protocol):
    found, frames = identify(b'\x00\xfa' + imu_bytes(protocol)[3:])
    assert (found, len(frames)) == (protocol, 19)


def test_the_radio_is_recognized_and_one_frame_is_not_enough():
    for count in (2, 8):
        assert identify(radio_bytes(count)) == ('tire_radio', [0x13A20040A1B2C3] * count)
    assert identify(radio_bytes(1)) == identify(bytes(range(256)) * 8) == ('', [])


def test_the_sensor_nodes_of_a_radio_are_listed(port):
    with device(port.plug_in(), lambda chunk: radio_bytes()):
        found = scan_port(str(port.path), (115200,), ask=False)
    assert (found.addresses, found.protocol) == ((0x13A20040A1B2C3,), 'tire_radio')
    assert found.received > 0 and found.details.endswith(' frames')


def test_a_device_that_sends_is_recognized_and_never_written_to(port):
    frames = imu_bytes('xsens')
    with device(port.plug_in(), lambda chunk: frames) as received:
        found = scan_port(str(port.path), (57600, 115200), ask=True)
    assert (found.protocol, found.baud_rate, found.problem) == ('xsens', 57600, '')
    assert b''.join(received) == b''


def boards_on(port, addresses):
    """Return a device: motor boards with the given addresses."""
    boards = RoboclawEmulator(addresses)
    return device(port.plug_in(), lambda chunk: boards.replies(chunk, 0, (0,) * 4))


def test_motor_boards_are_asked_for_their_version_only(port):
    with boards_on(port, (128, 130)) as received:
        found = scan_port(str(port.path), (115200, 9600), ask=True)
    assert found.protocol == 'roboclaw' and found.baud_rate == 115200
    assert found.addresses == (128, 130)
    assert found.details == ('128 USB Roboclaw 2x15a v4.1.34, 130 USB Roboclaw 2x15a v4.1.34')
    assert b''.join(received) == bytes(
        byte for address in range(0x80, 0x88) for byte in (address, 21))


def test_a_silent_port_that_is_not_configured_for_boards_is_not_written_to(port):
    with boards_on(port, (128, 129)) as received:
        found = scan_port(str(port.path), (115200, 9600), ask=False)
    assert (found.protocol, found.problem, found.received) == ('', '', 0)
    assert b''.join(received) == b''


def test_bytes_without_frames_are_counted_and_not_answered(port):
    with device(port.plug_in(), lambda chunk: b'U' * 50) as received:
        found = scan_port(str(port.path), (115200,), ask=True)
    assert found.protocol == '' and found.received >= 50
    assert b''.join(received) == b''


def test_a_missing_and_a_forbidden_port_are_reported(port, tmp_path, monkeypatch):
    assert scan_port('/dev/missing', (9600,), True).problem == 'does not exist'
    monkeypatch.setattr(os, 'access', lambda path, mode: False)
    port.plug_in()
    group = port_scan.grp.getgrgid(os.stat(port.path).st_gid).gr_name
    assert scan_port(str(port.path), (9600,), True).problem == (
        f'no permission; its group is {group}')


def test_a_port_that_another_process_holds_is_not_opened(port, tmp_path, monkeypatch):
    port.plug_in()
    fd = tmp_path / 'proc' / '4242' / 'fd'
    fd.mkdir(parents=True)
    (fd.parent / 'comm').write_text('imu_driver\n')
    (fd / '7').symlink_to(os.path.realpath(port.path))
    assert port_scan.holder(str(port.path), tmp_path / 'proc') == 'process 4242 (imu_driver)'
    assert port_scan.holder('/dev/null', tmp_path / 'proc') == ''
    monkeypatch.setattr(port_scan, 'holder', lambda path: 'process 4242 (imu_driver)')
    monkeypatch.setattr(port_scan, 'open_port', lambda *_: pytest.fail('opened'))
    found = scan_port(str(port.path), (9600,), True)
    assert found.holder == 'process 4242 (imu_driver)' and not found.problem


def test_several_ports_are_scanned_at_the_same_time(port):
    with device(port.plug_in(), lambda chunk: radio_bytes()):
        found = port_scan.scan({str(port.path): (115200,), '/dev/missing': (9600,)})
    assert [(one.protocol, one.problem) for one in found] == [
        ('tire_radio', ''), ('', 'does not exist')]


def test_a_version_with_a_wrong_crc_or_address_is_refused():
    reply = encode_text_reply(0x80, READ_VERSION, 'v4')
    assert decode_text_reply(0x80, READ_VERSION, reply) == 'v4'
    for wrong in (reply[:-1], reply[:-1] + b'\0', b'', b'v4\n', reply + b'\0'):
        with pytest.raises(FrameError):
            decode_text_reply(0x80, READ_VERSION, wrong)
    with pytest.raises(FrameError):
        decode_text_reply(0x81, READ_VERSION, reply)
