"""The ports: what is plugged in where (``config/hardware.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import param, part
from smart_tire.samples import WHEELS


@dataclass(frozen=True, kw_only=True)
class TireReceiverParams:
    """XBee coordinator and the wheel units it listens to."""

    port: str = param('/dev/ttyUSB0', '-', 'serial port of the XBee coordinator')
    baud_rate: int = param(115200, 'baud', 'of the port', low=300)
    units: tuple[str, ...] = param(
        ('0013A20040A1B2C3=front_right',), '-', '64-bit address = wheel, one per unit')
    radio_latency: float = param(
        0.0, 's', 'constant part of the radio delay, which cannot be observed', low=-1.0, high=1.0)
    robot: RobotParams = part(RobotParams)

    def __post_init__(self) -> None:
        self.wheel_of()

    def wheel_of(self) -> dict[int, str]:
        """Return 64-bit address -> wheel; raise ValueError naming a unit that is malformed."""
        found: dict[int, str] = {}
        for unit in self.units:
            address, equals, wheel = unit.partition('=')
            try:
                number = int(address, 16)
            except ValueError:
                number = -1
            if not equals or len(address) != 16 or number < 0 or wheel not in WHEELS:
                raise ValueError(f'units: {unit!r}, expected 16 hex digits = one of '
                                 + ', '.join(WHEELS))
            if number in found or wheel in found.values():
                raise ValueError(f'units: {unit!r} repeats an address or a wheel')
            found[number] = wheel
        return found


@dataclass(frozen=True, kw_only=True)
class ImuDriverParams:
    """Inertial unit."""

    port: str = param('/dev/ttyUSB1', '-', 'serial port of the IMU')
    baud_rate: int = param(115200, 'baud', 'of the port', low=300)
    protocol: str = param('vectornav_binary', '-', 'what the unit sends',
                          choices=('vectornav_binary', 'vectornav_ascii', 'xsens'))
    latency: float = param(0.0, 's', 'constant part of the delay', low=-1.0, high=1.0)
    robot: RobotParams = part(RobotParams)


@dataclass(frozen=True, kw_only=True)
class MotorDriverParams:
    """Two RoboClaw boards: front and rear, M1 left, M2 right."""

    port: str = param('/dev/ttyACM0', '-', 'serial port that both boards share')
    baud_rate: int = param(115200, 'baud', 'of the port', low=300)
    addresses: tuple[int, ...] = param(
        (128, 129), '-', 'packet serial addresses, front and rear', low=128, high=135, length=2)
    rate: float = param(16.0, 'Hz', 'encoder polls per second', low=1.0, high=200.0)
    command_timeout: float = param(
        0.25, 's', 'zero duty when no command came for so long', low=0.02, high=2.5)
    command_max_age: float = param(
        0.5, 's', 'motor_commands older or further ahead are refused', low=0.02, high=60.0)
    board_timeout: float = param(
        0.2, 's', 'time-out of the boards themselves, in steps of 0.1 s', low=0.2, high=2.5)
    start_stopped: bool = param(
        False, '-', 'begin with the emergency stop latched; for a restart by a supervisor')
    require_arming: bool = param(
        False, '-', 'no duty before the service arm was called')
    low_battery: float = param(
        10.5, 'V', 'zero duty when the supply of a board is lower', low=0.0, high=40.0)
    tolerated_status: int = param(
        0, '-', 'bits of the board status (command 90) that do not stop the motors', low=0,
        high=65535)
    free_speed: float = param(
        20.0, 'rad/s', 'of a wheel, unloaded at full duty', low=0.1)
    stall_duty: float = param(
        0.3, '-', 'duty at which every wheel turns that is not blocked', low=0.05, high=1.0)
    stall_time: float = param(
        0.2, 's', 'zero duty when a wheel contradicts its duty for so long', low=0.05, high=5.0)
    signs: tuple[int, ...] = param(
        (1, 1, 1, 1), '-', '-1 for a wheel whose motor and encoder count backwards', low=-1,
        high=1, length=4)
    robot: RobotParams = part(RobotParams)

    def __post_init__(self) -> None:
        if 0 in self.signs:
            raise ValueError(f'signs: {list(self.signs)}, expected 1 or -1 for each wheel')
        if self.addresses[0] == self.addresses[1]:
            raise ValueError(f'addresses are the same: {list(self.addresses)}')
