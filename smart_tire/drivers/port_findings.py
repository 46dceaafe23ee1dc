# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Findings on scanned ports: which configured device is absent, silent or another one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from smart_tire.drivers.port_scan import BAUD_RATES, Device, MOTOR_BOARDS, ScannedPort, TIRE_RADIO
from smart_tire.findings import Finding, Level
from smart_tire.parameters import ImuDriverParams, MotorDriverParams, TireReceiverParams

NAMES = {TIRE_RADIO: 'XBee coordinator with sensor nodes', MOTOR_BOARDS: 'RoboClaw',
         'vectornav_binary': 'VectorNav (binary)', 'vectornav_ascii': 'VectorNav (ASCII)',
         'xsens': 'Xsens'}


@dataclass(frozen=True)
class Expected:
    """A configured port."""

    node: str
    path: str
    baud_rate: int
    protocol: str
    addresses: tuple[int, ...] = ()  # of motor boards or sensor nodes


def expected_ports(tire: TireReceiverParams, imu: ImuDriverParams,
                   motor: MotorDriverParams) -> list[Expected]:
    """Return the ports that the parameters of the drivers name."""
    return [Expected('tire_receiver', tire.port, tire.baud_rate, TIRE_RADIO,
                     tuple(tire.wheel_of())),
            Expected('imu_driver', imu.port, imu.baud_rate, imu.protocol),
            Expected('motor_driver', motor.port, motor.baud_rate, MOTOR_BOARDS,
                     tuple(motor.addresses))]


def ports_to_scan(expected: Sequence[Expected],
                  devices: Sequence[Device]) -> tuple[dict[str, tuple[int, ...]], list[str]]:
    """Return path -> baud rates, configured ones first, and the ports that may be RoboClaws."""
    rates: dict[str, tuple[int, ...]] = {device.path: BAUD_RATES for device in devices}
    for one in expected:
        rates[one.path] = (one.baud_rate, *(rate for rate in BAUD_RATES
                                            if rate != one.baud_rate))
    boards = [one.path for one in expected if one.protocol == MOTOR_BOARDS]
    return rates, boards + [device.path for device in devices if device.roboclaw]


def port_findings(expected: Sequence[Expected], devices: Sequence[Device],
                  scanned: Sequence[ScannedPort]) -> Iterator[Finding]:
    """Yield a finding on each configured port, then on each other device."""
    found = {port.path: port for port in scanned}
    links = {device.path: device.by_id for device in devices if device.by_id}
    if not devices and not any(not port.problem for port in scanned):
        yield Finding(Level.WARNING, 'ports', 'this machine has no serial port',
                      ', '.join(one.path for one in expected), 'plug in the devices')
        return
    for one in expected:
        yield _configured(one, found[one.path], scanned)
        if found[one.path].protocol == one.protocol:
            yield from _addresses(one, found[one.path])
    used = {one.path for one in expected}
    for device in devices:
        if device.path not in used:
            yield _other(device, found[device.path])
    for path, link in links.items():
        if path in used:
            yield Finding(Level.INFO, path, 'its number may change when devices are plugged in',
                          action=f'use {link}')


def _configured(one: Expected, port: ScannedPort, scanned: Sequence[ScannedPort]) -> Finding:
    where, name = f'{one.node} on {one.path}', NAMES[one.protocol]
    if port.problem:
        return Finding(Level.ERROR, where, port.problem, name, _remedy(one, port, scanned))
    if port.holder:
        return Finding(Level.INFO, where, f'in use by {port.holder}: not opened')
    if port.protocol == one.protocol and port.baud_rate == one.baud_rate:
        return Finding(Level.OK, where, f'{name} answers at {port.baud_rate} baud '
                       f'({port.details})')
    if port.protocol == one.protocol:
        return Finding(Level.ERROR, where, f'{name} answers at {port.baud_rate} baud',
                       f'{one.baud_rate} as configured', f'set baud_rate: {port.baud_rate}')
    if port.protocol:
        return Finding(Level.ERROR, where, f'{NAMES[port.protocol]} answers', name,
                       _remedy(one, port, scanned))
    found = f'{port.received} bytes without a valid frame' if port.received else 'silent'
    return Finding(Level.ERROR, where, found, name, 'check supply, wiring, baud rate and protocol')


def _addresses(one: Expected, port: ScannedPort) -> Iterator[Finding]:
    """Yield boards and sensor nodes that are silent, or not configured."""
    where, boards = f'{one.node} on {one.path}', one.protocol == MOTOR_BOARDS
    name, parameter = ('board', 'addresses') if boards else ('sensor node', 'units')

    def text(address: int) -> str:
        return str(address) if boards else f'{address:016X}'

    for address in one.addresses:
        if address not in port.addresses:
            yield Finding(Level.ERROR if boards else Level.WARNING, where,
                          f'{name} {text(address)} is silent', f'{parameter} lists it',
                          f'check its supply, and {parameter}')
    for address in port.addresses:
        if address not in one.addresses:
            yield Finding(Level.WARNING, where, f'{name} {text(address)} answers',
                          ', '.join(map(text, one.addresses)), f'add it to {parameter}')


def _remedy(one: Expected, port: ScannedPort, scanned: Sequence[ScannedPort]) -> str:
    for other in scanned:
        if other.protocol == one.protocol and other.path != one.path:
            return f'set port: {other.path}, where it answers at {other.baud_rate} baud'
    if port.problem.startswith('no permission'):
        group = port.problem.rpartition(' ')[2]
        return f'sudo usermod -aG {group} $USER, then log in again'
    if port.protocol in NAMES and one.node == 'imu_driver' and port.protocol not in (
            TIRE_RADIO, MOTOR_BOARDS):
        return f'set protocol: {port.protocol}'
    return 'plug it in, or correct port'


def _other(device: Device, port: ScannedPort) -> Finding:
    state: Mapping[bool, str] = {True: f'in use by {port.holder}', False: port.problem}
    if port.protocol:
        text = f'{NAMES[port.protocol]} answers at {port.baud_rate} baud ({port.details})'
    else:
        text = state[bool(port.holder)] or (
            f'{port.received} bytes, no known device' if port.received else 'silent')
    return Finding(Level.INFO, device.path, f'{text}, no driver is configured for it '
                   f'({device.description or "no description"})')
