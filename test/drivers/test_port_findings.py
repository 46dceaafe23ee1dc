# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Findings on ports: configured and other devices, and what is to be done."""

from __future__ import annotations

import pytest
from smart_tire.drivers.port_scan import (
    BAUD_RATES, Device, expected_ports, port_findings, ports_to_scan, ScannedPort)
from smart_tire.findings import Level
from smart_tire.parameters import ImuDriverParams, MotorDriverParams, TireReceiverParams

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
