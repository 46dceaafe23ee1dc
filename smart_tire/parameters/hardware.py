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
    signs: tuple[int, ...] = param(
        (1, 1, 1, 1), '-', '-1 for a wheel whose motor and encoder count backwards', low=-1,
        high=1, length=4)
    robot: RobotParams = part(RobotParams)

    def __post_init__(self) -> None:
        if 0 in self.signs:
            raise ValueError(f'signs: {list(self.signs)}, expected 1 or -1 for each wheel')
        if self.addresses[0] == self.addresses[1]:
            raise ValueError(f'addresses are the same: {list(self.addresses)}')
