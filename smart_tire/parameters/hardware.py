# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters of the drivers: ports and device settings (``config/hardware.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import inlined, param, realtime_priority
from smart_tire.samples import WHEELS

IMU_PROTOCOLS = ('vectornav_binary', 'vectornav_ascii', 'xsens')


@dataclass(frozen=True, kw_only=True)
class DriverParams:
    """A device on a serial port."""

    port: str = param('', '-', 'serial port')
    baud_rate: int = param(115200, 'baud', 'rate of the port', (300, 12_000_000))
    realtime_priority: int = realtime_priority()
    robot: RobotParams = inlined(RobotParams)


@dataclass(frozen=True, kw_only=True)
class TireReceiverParams(DriverParams):
    """XBee coordinator and the sensor nodes that it receives from."""

    port: str = param('/dev/ttyUSB0', '-', 'serial port of the XBee coordinator')
    units: tuple[str, ...] = param(
        ('0013A20040A1B2C3=front_right',), '-', 'sensor nodes, 64-bit address=wheel')
    radio_latency: float = param(
        0.0, 's', 'constant part of the radio delay, which is not observable', (-1.0, 1.0))

    def __post_init__(self) -> None:
        self.wheel_of()

    def wheel_of(self) -> dict[int, str]:
        """Return 64-bit address -> wheel; raise ValueError for a malformed entry of ``units``."""
        found: dict[int, str] = {}
        for entry in self.units:
            address, equals, wheel = entry.partition('=')
            try:
                number = int(address, 16)
            except ValueError:
                number = -1
            if not equals or len(address) != 16 or number < 0 or wheel not in WHEELS:
                raise ValueError(f'units: {entry!r}, expected 16 hex digits = one of '
                                 + ', '.join(WHEELS))
            if number in found or wheel in found.values():
                raise ValueError(f'units: {entry!r} repeats an address or a wheel')
            found[number] = wheel
        return found


@dataclass(frozen=True, kw_only=True)
class ImuDriverParams(DriverParams):
    """IMU."""

    port: str = param('/dev/ttyUSB1', '-', 'serial port of the IMU')
    protocol: str = param('vectornav_binary', '-', 'protocol of the IMU', choices=IMU_PROTOCOLS)
    latency: float = param(
        0.0, 's', 'constant part of the delay, which is not observable', (-1.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class MotorDriverParams(DriverParams):
    """Two RoboClaw boards, front and rear; motor M1 left, M2 right."""

    port: str = param('/dev/ttyACM0', '-', 'serial port that both boards share')
    addresses: tuple[int, ...] = param(
        (128, 129), '-', 'packet serial addresses, front and rear', (128, 135), length=2)
    rate: float = param(16.0, 'Hz', 'polling rate of the encoders', (1.0, 200.0))
    command_timeout: float = param(
        0.25, 's', 'zero duty if no motor_commands arrive for this long', (0.02, 2.5))
    command_max_age: float = param(
        0.5, 's', 'motor_commands older or further in the future are refused', (0.02, 60.0))
    board_timeout: float = param(
        0.2, 's', 'serial time-out of the boards, in steps of 0.1 s', (0.2, 2.5))
    start_stopped: bool = param(
        False, '-', 'start with the emergency stop latched, e.g. after a crash')
    require_arming: bool = param(False, '-', 'zero duty until the service arm is called')
    release_hold_off: float = param(
        1.0, 's', 'from an emergency stop or a request to release it to a release', (0.1, 60.0))
    low_battery: float = param(
        10.5, 'V', 'zero duty while the supply of a board is below', (0.0, 40.0))
    tolerated_status: int = param(
        0, '-', 'bits of the board status (command 90) that do not stop the motors', (0, 65535))
    free_speed: float = param(22.0, 'rad/s', 'wheel speed at full duty without load', (0.1, 1e3))
    stall_torque: float = param(
        5.0, 'N m', 'torque at the wheel at full duty and standstill', (1e-3, 1e3))
    motor_tolerance: float = param(
        0.2, '-', 'relative error of free_speed and stall_torque, by supply and heat, too',
        (0.0, 0.9))
    stall_duty: float = param(
        0.3, '-', 'duty at which every wheel turns unless blocked', (0.05, 1.0))
    stall_time: float = param(
        0.2, 's', 'zero duty if a wheel contradicts its duty for this long', (0.05, 5.0))
    max_current: float = param(
        30.0, 'A', 'a larger measured motor current is rejected', (0.1, 300.0))
    signs: tuple[int, ...] = param(
        (1, 1, 1, 1), '-', 'per wheel, -1 if motor and encoder count backwards', (-1, 1), length=4)

    def __post_init__(self) -> None:
        if 0 in self.signs:
            raise ValueError(f'signs: {list(self.signs)}, expected 1 or -1 for each wheel')
        if self.addresses[0] == self.addresses[1]:
            raise ValueError(f'addresses: {list(self.addresses)}, expected two different ones')
