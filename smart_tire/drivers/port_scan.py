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
Which serial ports exist, who holds them, which device answers on them, and what is to be done.

Sensors are recognized by listening. Only the port that is configured for the motor boards, and
those with the USB identifier of a RoboClaw, are written to: a read request for the firmware
version, which moves nothing in the packet serial mode that the driver requires. A board in another
mode could take any byte for a motor command, so no other port is written to. A port that another
process holds is not opened.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass, replace
import grp
import os
from pathlib import Path
import time
from typing import Any

from serial.tools import list_ports

from smart_tire.drivers.sample_stream import FILM_CHARGE, IMU_PROTOCOLS
from smart_tire.drivers.serial_port import open_port, PORT_ERRORS
from smart_tire.errors import FrameError, LinkError
from smart_tire.findings import Finding, Level
from smart_tire.parameters import ImuDriverParams, MotorDriverParams, TireReceiverParams
from smart_tire.parameters.film import FilmDriverParams
from smart_tire.protocol.deframer import Deframer
from smart_tire.protocol.roboclaw import (
    ADDRESSES, decode_text_reply, encode_request, READ_VERSION, TEXT_END)
from smart_tire.protocol.tire_payload import decode_batch
from smart_tire.protocol.xbee import decode_receive_packet, XBeeDeframer

TIRE_RADIO, MOTOR_BOARDS, FILM_AMPLIFIER = 'tire_radio', 'roboclaw', 'film_amplifier'
NAMES = {TIRE_RADIO: 'XBee coordinator with sensor nodes', MOTOR_BOARDS: 'RoboClaw',
         FILM_AMPLIFIER: 'charge amplifier of a film',
         'vectornav_binary': 'VectorNav (binary)', 'vectornav_ascii': 'VectorNav (ASCII)',
         'xsens': 'Xsens'}
BAUD_RATES = (115200, 57600, 230400, 921600, 38400, 9600)  # of these devices, most usual first
LISTEN_TIME = 0.3      # s at each baud rate: 7 batches of a sensor node, 12 frames of an IMU
MIN_FRAMES = 2         # a checksum may fit by chance once
READ_TIMEOUT = 0.02    # s
REPLY_TIMEOUT = 0.04   # s; a board replies within a few ms
NO_HARDWARE = 'n/a'    # of pyserial
ROBOCLAW_USB = (0x03EB, 0x2404)  # vendor and product
PROC, BY_ID = Path('/proc'), Path('/dev/serial/by-id')


@dataclass(frozen=True)
class Device:
    """A serial port of this machine."""

    path: str
    description: str = ''
    by_id: str = ''  # link that stays the same when devices are plugged in in another order
    roboclaw: bool = False  # by its USB identifier


@dataclass(frozen=True)
class ConfiguredPort:
    """A configured port."""

    node: str
    path: str
    baud_rate: int
    protocol: str
    addresses: tuple[int, ...] = ()  # of motor boards or sensor nodes

    @property
    def where(self) -> str:
        """Return the node and its port, for a finding."""
        return f'{self.node} on {self.path}'


@dataclass(frozen=True)
class ScannedPort:
    """What was found on a port."""

    path: str
    problem: str = ''       # why it could not be opened
    holder: str = ''        # process that has it open: it was not opened
    protocol: str = ''      # one of ``NAMES``; '' if none
    baud_rate: int = 0      # at which it answers
    details: str = ''       # number of frames, or versions of the motor boards
    received: int = 0       # bytes at all baud rates
    addresses: tuple[int, ...] = ()  # of motor boards or sensor nodes


def serial_devices() -> list[Device]:
    """Return the serial ports of this machine that have a device; UARTs of PCs may have none."""
    links = {os.path.realpath(link): str(link) for link in BY_ID.glob('*')}
    return [Device(port.device, port.description or '', links.get(port.device, ''),
                   (port.vid, port.pid) == ROBOCLAW_USB)
            for port in sorted(list_ports.comports()) if port.hwid != NO_HARDWARE]


def holder(path: str, proc: Path = PROC) -> str:
    """Return the process that has ``path`` open; '' if none is visible to this user."""
    target = os.path.realpath(path)
    for folder in proc.glob('[0-9]*'):
        if folder.name == str(os.getpid()):
            continue
        with suppress(OSError):  # the process has ended, or belongs to another user
            for link in (folder / 'fd').iterdir():
                if os.readlink(link) == target:
                    name = (folder / 'comm').read_text(encoding='utf-8').strip()
                    return f'process {folder.name} ({name})'
    return ''


def permission_problem(path: str) -> str:
    """Return why this user must not open ``path``; '' if it may."""
    if os.access(path, os.R_OK | os.W_OK):
        return ''
    group = os.stat(path).st_gid
    try:
        name = grp.getgrgid(group).gr_name
    except KeyError:
        name = str(group)
    return f'no permission; its group is {name}'


def scan(ports: Mapping[str, Iterable[int]], boards: Iterable[str] = ()) -> list[ScannedPort]:
    """
    Return what answers on ``ports`` (path -> baud rates to try), all at the same time.

    Of these, ``boards`` are asked for a RoboClaw if they are silent, at their first baud rate.
    """
    asked = set(boards)
    with ThreadPoolExecutor(max(1, len(ports))) as threads:
        futures = [threads.submit(scan_port, path, tuple(rates), path in asked)
                   for path, rates in ports.items()]
        return [future.result() for future in futures]


def scan_port(path: str, baud_rates: tuple[int, ...], ask: bool) -> ScannedPort:
    """Return what answers on one port."""
    port = ScannedPort(path)
    if not os.path.exists(path):
        return replace(port, problem='does not exist')
    if problem := permission_problem(path):
        return replace(port, problem=problem)
    if process := holder(path):
        return replace(port, holder=process)
    try:
        for baud_rate in baud_rates:
            asked = ask and not port.received and baud_rate == baud_rates[0]
            port = _tried(port, baud_rate, asked)
            if port.protocol:
                break
    except LinkError as error:
        return ScannedPort(path, str(error))
    except PORT_ERRORS as error:
        return ScannedPort(path, f'lost: {error}')
    return port


def _tried(scanned: ScannedPort, baud_rate: int, ask: bool) -> ScannedPort:
    """Return ``scanned`` with what answers at ``baud_rate``; a silent port may be asked."""
    with closing(open_port(scanned.path, baud_rate, timeout=READ_TIMEOUT)) as port:
        data = _listen(port)
        scanned = replace(scanned, received=scanned.received + len(data))
        protocol, frames = identify(data)
        if protocol:
            addresses = sorted(set(frames)) if protocol == TIRE_RADIO else ()
            return replace(scanned, protocol=protocol, baud_rate=baud_rate,
                           details=f'{len(frames)} frames', addresses=tuple(addresses))
        if ask and not data and (versions := _versions(port)):
            details = ', '.join(f'{address} {text}' for address, text in versions.items())
            return replace(scanned, protocol=MOTOR_BOARDS, baud_rate=baud_rate, details=details,
                           addresses=tuple(versions))
    return scanned


def identify(data: bytes) -> tuple[str, list[Any]]:
    """Return protocol and decoded frames in ``data``; '' if it is none of these."""
    found = {name: _decoded(protocol.deframer(), data, protocol.decode)
             for name, protocol in {**IMU_PROTOCOLS, FILM_AMPLIFIER: FILM_CHARGE}.items()}
    found[TIRE_RADIO] = _decoded(XBeeDeframer(), data, _sensor_node)
    name = max(found, key=lambda name: len(found[name]))
    return (name, found[name]) if len(found[name]) >= MIN_FRAMES else ('', [])


def _sensor_node(body: bytes) -> int:
    """Return the 64-bit address of the sensor node that sent a batch."""
    packet = decode_receive_packet(body)
    decode_batch(packet.data)
    return packet.source


def _decoded(deframer: Deframer, data: bytes, decode: Callable[[bytes], Any]) -> list[Any]:
    frames = []
    for body in deframer.extract(data):
        with suppress(FrameError):
            frames.append(decode(body))
    return frames


def _listen(port: Any) -> bytes:
    data, end = b'', time.monotonic() + LISTEN_TIME
    while time.monotonic() < end:
        data += port.read(port.in_waiting or 1)
    return data


def _versions(port: Any) -> dict[int, str]:
    """Return address -> firmware version of the boards that reply."""
    found = {}
    for address in ADDRESSES:
        port.reset_input_buffer()
        port.write(encode_request(address, READ_VERSION))
        reply, end = b'', time.monotonic() + REPLY_TIMEOUT
        while time.monotonic() < end and not reply[:-2].endswith(TEXT_END):
            reply += port.read(port.in_waiting or 1)
        with suppress(FrameError):
            found[address] = decode_text_reply(address, READ_VERSION, reply)
    return found


def expected_ports(tire: TireReceiverParams, imu: ImuDriverParams, motor: MotorDriverParams,
                   film: FilmDriverParams | None = None) -> list[ConfiguredPort]:
    """Return the ports that the parameters of the drivers name; a robot may be without film."""
    amplifier = [] if film is None else [
        ConfiguredPort('film_driver', film.port, film.baud_rate, FILM_AMPLIFIER)]
    return [ConfiguredPort('tire_receiver', tire.port, tire.baud_rate, TIRE_RADIO,
                           tuple(tire.wheel_of())),
            ConfiguredPort('imu_driver', imu.port, imu.baud_rate, imu.protocol),
            ConfiguredPort('motor_driver', motor.port, motor.baud_rate, MOTOR_BOARDS,
                           tuple(motor.addresses)), *amplifier]


def ports_to_scan(expected: Sequence[ConfiguredPort],
                  devices: Sequence[Device]) -> tuple[dict[str, tuple[int, ...]], list[str]]:
    """Return path -> baud rates, configured ones first, and the ports that may be RoboClaws."""
    rates: dict[str, tuple[int, ...]] = {device.path: BAUD_RATES for device in devices}
    for one in expected:
        rates[one.path] = tuple(dict.fromkeys((one.baud_rate, *BAUD_RATES)))
    boards = [one.path for one in expected if one.protocol == MOTOR_BOARDS]
    return rates, boards + [device.path for device in devices if device.roboclaw]


def port_findings(expected: Sequence[ConfiguredPort], devices: Sequence[Device],
                  scanned: Sequence[ScannedPort]) -> Iterator[Finding]:
    """Yield a finding on each configured port, then on each other device."""
    found, used = {port.path: port for port in scanned}, {one.path for one in expected}
    if not devices and all(port.problem for port in scanned):
        yield Finding(Level.WARNING, 'ports', 'this machine has no serial port',
                      ', '.join(one.path for one in expected), 'plug in the devices')
        return
    for one in expected:
        yield _configured(one, found[one.path], scanned)
        if found[one.path].protocol == one.protocol:
            yield from _addresses(one, found[one.path])
    for device in devices:
        if device.path not in used:
            yield Finding(Level.INFO, device.path, f'{_state(found[device.path])}, no driver is '
                          f'configured for it ({device.description or "no description"})')
    for device in devices:
        if device.path in used and device.by_id:
            yield Finding(Level.INFO, device.path,
                          'its number may change when devices are plugged in',
                          action=f'use {device.by_id}')


def _configured(one: ConfiguredPort, port: ScannedPort, scanned: Sequence[ScannedPort]) -> Finding:
    name = NAMES[one.protocol]
    if port.holder:
        return Finding(Level.INFO, one.where, f'in use by {port.holder}: not opened')
    if port.protocol != one.protocol:
        remedy = ('check supply, wiring, baud rate and protocol'
                  if not (port.problem or port.protocol) else _remedy(one, port, scanned))
        found = f'{NAMES[port.protocol]} answers' if port.protocol else _state(port)
        return Finding(Level.ERROR, one.where, found, name, remedy)
    if port.baud_rate != one.baud_rate:
        return Finding(Level.ERROR, one.where, f'{name} answers at {port.baud_rate} baud',
                       f'{one.baud_rate} as configured', f'set baud_rate: {port.baud_rate}')
    return Finding(Level.OK, one.where, _state(port))


def _state(port: ScannedPort) -> str:
    if port.protocol:
        return f'{NAMES[port.protocol]} answers at {port.baud_rate} baud ({port.details})'
    if port.holder:
        return f'in use by {port.holder}'
    return port.problem or (
        f'{port.received} bytes without a valid frame' if port.received else 'silent')


def _addresses(one: ConfiguredPort, port: ScannedPort) -> Iterator[Finding]:
    """Yield boards and sensor nodes that are silent, or not configured."""
    boards = one.protocol == MOTOR_BOARDS
    name, parameter = ('board', 'addresses') if boards else ('sensor node', 'units')
    text = str if boards else '{:016X}'.format
    for address in one.addresses:
        if address not in port.addresses:
            yield Finding(Level.ERROR if boards else Level.WARNING, one.where,
                          f'{name} {text(address)} is silent', f'{parameter} lists it',
                          f'check its supply, and {parameter}')
    for address in port.addresses:
        if address not in one.addresses:
            yield Finding(Level.WARNING, one.where, f'{name} {text(address)} answers',
                          ', '.join(map(text, one.addresses)), f'add it to {parameter}')


def _remedy(one: ConfiguredPort, port: ScannedPort, scanned: Sequence[ScannedPort]) -> str:
    for other in scanned:
        if other.protocol == one.protocol and other.path != one.path:
            return f'set port: {other.path}, where it answers at {other.baud_rate} baud'
    if port.problem.startswith('no permission'):
        group = port.problem.rpartition(' ')[2]
        return f'sudo usermod -aG {group} $USER, then log in again'
    if one.node == 'imu_driver' and port.protocol in IMU_PROTOCOLS:
        return f'set protocol: {port.protocol}'
    return 'plug it in, or correct port'
