# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Scan of ports: what is recognized and written to, the findings, and what is to be done."""

from __future__ import annotations

import os
from types import SimpleNamespace

import numpy as np
import pytest
from smart_tire.drivers import port_scan
from smart_tire.drivers.port_scan import (
    BAUD_RATES, Device, expected_ports, identify, port_findings, ports_to_scan, scan_port,
    ScannedPort)
from smart_tire.errors import FrameError
from smart_tire.findings import Level
from smart_tire.parameters import ImuDriverParams, MotorDriverParams, TireReceiverParams
from smart_tire.parameters.film import FilmDriverParams, FilmSimulatorParams
from smart_tire.protocol.roboclaw import decode_text_reply, encode_text_reply, READ_VERSION
from smart_tire.samples import ImuSample
from smart_tire.simulation.device_emulators import (
    ImuEmulator, RadioEmulator, RoboclawEmulator, SensorNodeEmulator)
from smart_tire.simulation.film import SimulatedFilm

NODE = 0x13A20040A1B2C3


class ListPortInfo(SimpleNamespace):
    """What pyserial lists of a port."""

    description = ''
    vid = pid = None

    def __lt__(self, other):
        return self.device < other.device


VERSION = 'USB Roboclaw 2x15a v4.1.34'


def imu_frames(protocol, count=20):
    """Return frames of an IMU at rest."""
    device = ImuEmulator(protocol)
    return [device.frame(ImuSample(10_000_000 * k, (0.0, 0.0, 9.81), (0.0,) * 3))
            for k in range(count)]


def radio_frames(count=8):
    """Return batches of a sensor node."""
    radio = RadioEmulator({'front_left': SensorNodeEmulator(NODE)}, np.random.default_rng(0))
    frames = []
    for k in range(count):
        radio.send('front_left', 16 * k, [(512, 512)] * 16, 40_000_000 * k)
        frames.append(radio.due(10**12))
    return frames


class Port:
    """
    A port with its device, for which time passes only while it is read.

    The device sends ``frames`` every ``period`` [s] from the opening on, and its ``reply`` to what
    is written ``delay`` [s] later.
    """

    def __init__(self, frames=(), period=0.04, reply=lambda request: b'', delay=0.004):
        self.frames, self.period, self.reply, self.delay = frames, period, reply, delay
        self.now, self.written, self.opened, self.due = 0.0, b'', [], []

    def begin(self, path, baud_rate, timeout):
        """Begin to send; ``timeout`` [s] is that of reading."""
        self.opened.append(baud_rate)
        self.timeout, begin = timeout, self.now
        self.due = [(begin + self.period * k, one) for k, one in enumerate(self.frames, 1)]
        return self

    @property
    def in_waiting(self):
        return sum(len(data) for time, data in self.due if time <= self.now)

    def read(self, size):
        end = self.now + self.timeout
        while self.in_waiting < size and self.now < end:
            self.now = min([end, *(time for time, _ in self.due if time > self.now)])
        data = b''.join(data for time, data in self.due if time <= self.now)
        self.due = [(self.now, data[size:]), *self._later()]
        return data[:size]

    def write(self, data):
        self.written += data
        self.due.append((self.now + self.delay, self.reply(data)))

    def reset_input_buffer(self):
        self.due = self._later()

    def _later(self):
        return [(time, data) for time, data in self.due if time > self.now]

    def close(self):
        self.due = []


@pytest.fixture
def scanned(monkeypatch, tmp_path):
    """Return a function that scans a port."""
    path = tmp_path / 'port'
    path.touch()

    def scan(device, baud_rates=(115200, 9600), *, ask):
        monkeypatch.setattr(port_scan, 'open_port', device.begin)
        monkeypatch.setattr(port_scan, 'time', SimpleNamespace(monotonic=lambda: device.now))
        return scan_port(str(path), baud_rates, ask)
    return scan


@pytest.mark.parametrize('protocol', ['vectornav_binary', 'vectornav_ascii', 'xsens'])
def test_an_imu_is_recognized_by_its_frames(protocol):
    found, frames = identify(b'\x00\xfa' + b''.join(imu_frames(protocol))[3:])
    assert (found, len(frames)) == (protocol, 19)


def test_the_amplifier_of_a_film_is_recognized(scanned):
    film = SimulatedFilm(FilmSimulatorParams(loss=0.0))
    frames = [film.next_instant().frame for _ in range(100)]
    found = scanned(Port(frames, 0.004), ask=False)
    assert (found.protocol, found.baud_rate) == ('film_amplifier', 115200)
    assert found.details == '74 frames'


def test_a_film_is_expected_where_it_is_configured():
    film = FilmDriverParams(port='/dev/ttyUSB7')
    port = expected_ports(TireReceiverParams(), ImuDriverParams(), MotorDriverParams(), film)[3]
    assert (port.path, port.protocol) == ('/dev/ttyUSB7', 'film_amplifier')
    assert len(EXPECTED) == 3


def test_the_radio_is_recognized_and_one_frame_is_not_enough():
    for count in (2, 8):
        assert identify(b''.join(radio_frames(count))) == ('tire_radio', [NODE] * count)
    assert identify(radio_frames(1)[0]) == identify(bytes(range(256)) * 8) == ('', [])


def test_the_sensor_nodes_of_a_radio_are_listed(scanned):
    found = scanned(Port(radio_frames(), 0.04), ask=False)
    assert (found.addresses, found.protocol, found.details) == ((NODE,), 'tire_radio', '7 frames')
    assert found.received == len(b''.join(radio_frames(7)))


def test_a_device_that_sends_is_recognized_and_never_written_to(scanned):
    device = Port(imu_frames('xsens'), 0.025)
    found = scanned(device, (57600, 115200), ask=True)
    assert (found.protocol, found.baud_rate, found.problem) == ('xsens', 57600, '')
    assert (device.opened, device.written) == ([57600], b'')


def boards(addresses, delay=0.004):
    """Return motor boards with these addresses."""
    emulator = RoboclawEmulator(addresses)
    return Port(reply=lambda request: emulator.replies(request, 0, (0,) * 4), delay=delay)


@pytest.mark.parametrize('delay', [0.004, 0.035])
def test_motor_boards_are_asked_for_their_version_only(scanned, delay):
    device = boards((128, 130), delay)
    found = scanned(device, ask=True)
    assert (found.protocol, found.baud_rate, found.addresses) == ('roboclaw', 115200, (128, 130))
    assert found.details == f'128 {VERSION}, 130 {VERSION}'
    assert device.written == bytes(
        byte for address in range(0x80, 0x88) for byte in (address, 21))
    # all listening time, six time-outs, and no more than the replies of two boards need
    assert device.now < 0.3 + 6 * 0.041 + 2 * (delay + 0.001)


def test_a_silent_port_that_is_not_configured_for_boards_is_not_written_to(scanned):
    device = boards((128, 129))
    found = scanned(device, ask=False)
    assert (found.protocol, found.problem, found.received) == ('', '', 0)
    assert (device.opened, device.written) == ([115200, 9600], b'')


def test_bytes_without_frames_are_counted_and_not_answered(scanned):
    device = Port([b'U' * 50] * 30)
    found = scanned(device, ask=True)
    assert (found.protocol, found.received) == ('', 2 * 7 * 50)
    assert device.written == b''


def test_only_the_ports_named_are_asked_for_boards(monkeypatch):
    monkeypatch.setattr(port_scan, 'scan_port', lambda path, rates, ask: (path, rates, ask))
    assert port_scan.scan({'a': [9600], 'b': [1, 2]}, ['b', 'c']) == [
        ('a', (9600,), False), ('b', (1, 2), True)]


def test_ports_with_a_device_are_listed_and_roboclaws_known_by_their_usb_numbers(
        monkeypatch, tmp_path):
    (tmp_path / 'usb-imu').symlink_to('/dev/ttyUSB3')
    monkeypatch.setattr(port_scan, 'BY_ID', tmp_path)
    monkeypatch.setattr(port_scan.list_ports, 'comports', lambda: [
        ListPortInfo(device='/dev/ttyS0', hwid='n/a'),
        ListPortInfo(device='/dev/ttyUSB3', hwid='USB', description='FT232R', vid=0x0403,
                     pid=0x6001),
        ListPortInfo(device='/dev/ttyACM0', hwid='USB', description=None, vid=0x03EB, pid=0x2404),
        ListPortInfo(device='/dev/ttyACM1', hwid='USB', vid=0x03EB, pid=0x2405),
        ListPortInfo(device='/dev/ttyACM2', hwid='USB', vid=0x03EC, pid=0x2404)])
    assert port_scan.serial_devices() == [
        Device('/dev/ttyACM0', '', '', True), Device('/dev/ttyACM1'), Device('/dev/ttyACM2'),
        Device('/dev/ttyUSB3', 'FT232R', str(tmp_path / 'usb-imu'))]


def test_a_missing_and_a_forbidden_port_are_reported(port, monkeypatch):
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


def test_several_ports_are_scanned_one_of_which_is_a_terminal_without_device(port):
    found = port_scan.scan({str(port.plug_in().path): (115200,), '/dev/missing': (9600,)})
    assert [(one.protocol, one.problem, one.received) for one in found] == [
        ('', '', 0), ('', 'does not exist', 0)]


def test_a_version_with_a_wrong_crc_or_address_is_refused():
    reply = encode_text_reply(0x80, READ_VERSION, 'v4')
    assert decode_text_reply(0x80, READ_VERSION, reply) == 'v4'
    for wrong in (reply[:-1], reply[:-1] + b'\0', b'', b'v4\n', reply + b'\0'):
        with pytest.raises(FrameError):
            decode_text_reply(0x80, READ_VERSION, wrong)
    with pytest.raises(FrameError):
        decode_text_reply(0x81, READ_VERSION, reply)


TIRE, IMU, MOTORS = '/dev/ttyUSB0', '/dev/ttyUSB1', '/dev/ttyACM0'
EXPECTED = expected_ports(TireReceiverParams(), ImuDriverParams(), MotorDriverParams(
    baud_rate=38400))
DEVICES = [Device(path) for path in (TIRE, IMU, MOTORS)]
UNIT = 0x0013A20040A1B2C3  # the default of units
GOOD = (ScannedPort(TIRE, protocol='tire_radio', baud_rate=115200, details='7 frames',
                    addresses=(UNIT,)),
        ScannedPort(IMU, protocol='vectornav_binary', baud_rate=115200),
        ScannedPort(MOTORS, protocol='roboclaw', baud_rate=38400, addresses=(128, 129)))


def found(*changed, devices=DEVICES):
    """Return the findings with some ports changed."""
    ports = {port.path: port for port in (*GOOD, *changed)}
    return list(port_findings(EXPECTED, devices, list(ports.values())))


def test_configured_devices_that_answer_are_ok():
    assert [one.level for one in found()] == [Level.OK] * 3
    assert found()[0].text == ('tire_receiver on /dev/ttyUSB0: XBee coordinator with sensor nodes '
                               'answers at 115200 baud (7 frames)')


@pytest.mark.parametrize('port, level, text', [
    (ScannedPort(IMU, 'does not exist'), Level.ERROR, 'does not exist'),
    (ScannedPort(IMU, 'no permission; its group is dialout'), Level.ERROR,
     'sudo usermod -aG dialout $USER'),
    (ScannedPort(IMU, holder='process 7 (imu_driver)'), Level.INFO, 'process 7 (imu_driver)'),
    (ScannedPort(IMU), Level.ERROR, 'silent'),
    (ScannedPort(IMU, received=80), Level.ERROR, '80 bytes without a valid frame'),
    (ScannedPort(IMU, protocol='vectornav_binary', baud_rate=921600), Level.ERROR,
     'set baud_rate: 921600'),
    (ScannedPort(IMU, protocol='xsens', baud_rate=115200), Level.ERROR, 'set protocol: xsens')])
def test_a_configured_port_with_another_state_is_reported(port, level, text):
    finding = found(port)[1]
    assert finding.level is level and text in finding.text
    assert finding.where == 'imu_driver on /dev/ttyUSB1'


def test_silent_and_unknown_boards_and_sensor_nodes_are_named():
    lines = [one.text for one in found(
        ScannedPort(MOTORS, protocol='roboclaw', baud_rate=38400, addresses=(128, 130)),
        ScannedPort(TIRE, protocol='tire_radio', baud_rate=115200, addresses=(5,)))]
    assert len(lines) == 7
    assert 'sensor node 0013A20040A1B2C3 is silent' in lines[1]
    assert 'sensor node 0000000000000005 answers (expected 0013A20040A1B2C3)' in lines[2]
    assert 'board 129 is silent' in lines[5]
    assert 'board 130 answers (expected 128, 129); add it to addresses' in lines[6]


def test_exchanged_ports_name_the_right_one():
    first, second, _ = found(
        ScannedPort(TIRE, protocol='vectornav_binary', baud_rate=115200),
        ScannedPort(IMU, protocol='tire_radio', baud_rate=57600))
    assert 'set port: /dev/ttyUSB1, where it answers at 57600 baud' in first.text
    assert 'set port: /dev/ttyUSB0' in second.text


def test_other_devices_are_listed_and_stable_names_proposed():
    devices = [*DEVICES, Device('/dev/ttyUSB9', 'FT232R')]
    finding = found(ScannedPort('/dev/ttyUSB9', protocol='xsens', baud_rate=9600),
                    devices=devices)[3]
    assert finding.level is Level.INFO
    assert 'Xsens answers at 9600 baud' in finding.text and 'FT232R' in finding.text
    finding = found(ScannedPort('/dev/ttyUSB9', holder='process 7 (x)'), devices=devices)[3]
    assert 'in use by process 7 (x)' in finding.text
    devices = [Device(IMU, by_id='/dev/serial/by-id/usb-imu')]
    assert 'use /dev/serial/by-id/usb-imu' in found(devices=devices)[3].text


def test_a_machine_without_ports_is_one_warning():
    missing = [ScannedPort(one.path, 'does not exist') for one in EXPECTED]
    finding, = port_findings(EXPECTED, [], missing)
    assert finding.level is Level.WARNING and MOTORS in finding.expected


def test_the_configured_rate_is_tried_first_and_only_board_ports_are_asked():
    rates, boards = ports_to_scan(EXPECTED, [*DEVICES, Device('/dev/ttyACM7', roboclaw=True)])
    assert rates[MOTORS][0] == 38400 and sorted(rates[MOTORS]) == sorted(BAUD_RATES)
    assert rates['/dev/ttyACM7'] == BAUD_RATES
    assert boards == [MOTORS, '/dev/ttyACM7']
