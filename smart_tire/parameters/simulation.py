"""The simulated robot and its ground (``config/simulation.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.parameters.hardware import MotorDriverParams, TireReceiverParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import group, param, part

Rectangle = tuple[float, float, float, float]  # m: x from, y from, x to, y to


@dataclass(frozen=True, kw_only=True)
class GroundParams:
    """Surfaces: a base that is everywhere, and rectangles on it."""

    names: tuple[str, ...] = param(('concrete', 'sand'), '-', 'surfaces')
    friction: tuple[float, ...] = param(
        (0.47, 0.35), '-', 'friction coefficient mu of each surface', low=0.0)
    stiffness: tuple[float, ...] = param(
        (52.7, 30.0), 'N', 'C_x of a tire on each surface, per unit slip', low=1e-3)
    drag: tuple[float, ...] = param(
        (0.015, 0.16), '-', 'rolling drag of a wheel over its load on each surface', low=0.0)
    base: str = param('sand', '-', 'surface outside all patches')
    patches: tuple[str, ...] = param(
        ('concrete=-3,-3,3,3',), 'm', 'surface=x from, y from, x to, y to; later ones on top')

    def __post_init__(self) -> None:
        for name in ('friction', 'stiffness', 'drag'):
            if len(getattr(self, name)) != len(self.names):
                raise ValueError(f'ground.{name} has {len(getattr(self, name))} values, expected '
                                 f'one for each of {list(self.names)}')
        if self.base not in self.names:
            raise ValueError(f'ground.base: {self.base!r}, expected one of {list(self.names)}')
        self.rectangles()

    def rectangles(self) -> list[tuple[str, Rectangle]]:
        """Return (surface, rectangle) of each patch; raise ValueError for a malformed one."""
        return [self._rectangle(patch) for patch in self.patches if patch]

    def _rectangle(self, patch: str) -> tuple[str, Rectangle]:
        name, _, corners = patch.partition('=')
        try:
            x_from, y_from, x_to, y_to = (float(number) for number in corners.split(','))
        except ValueError:
            x_from = y_from = x_to = y_to = math.nan
        if name not in self.names or not (x_from < x_to and y_from < y_to):
            raise ValueError(f'ground.patches: {patch!r}, expected surface=x from, y from, x to, '
                             f'y to with a surface of {list(self.names)}')
        return name, (x_from, y_from, x_to, y_to)


@dataclass(frozen=True, kw_only=True)
class DriveParams:
    """Geared DC motor of each wheel; chosen, for the paper gives none."""

    stall_torque: float = param(4.0, 'N m', 'at the wheel, at full duty', low=1e-3)
    free_speed: float = param(20.0, 'rad/s', 'of the wheel, unloaded at full duty', low=1e-2)
    inertia: float = param(0.02, 'kg m2', 'of wheel, gear and rotor at the wheel', low=1e-5)
    friction: float = param(0.05, 'N m', 'dry friction at the wheel', low=0.0)


@dataclass(frozen=True, kw_only=True)
class RadioParams:
    """Radio between wheel units and receiver."""

    batch: int = param(16, '-', 'samples per packet', low=1, high=255)
    delay: float = param(0.005, 's', 'shortest from last sample to receiver', low=0.0, high=1.0)
    jitter: float = param(0.003, 's', 'mean of the delay beyond the shortest', low=0.0, high=1.0)
    longest: float = param(0.020, 's', 'longest delay of a packet that arrives', low=0.0, high=1.0)
    loss: float = param(0.005, '-', 'share of packets that get lost', low=0.0, high=1.0)
    clock_error: float = param(
        50e-6, '-', 'standard deviation of the clock rate of a wheel unit', low=0.0, high=0.01)


@dataclass(frozen=True, kw_only=True)
class SensorErrorParams:
    """Errors that nobody calibrates; all others are those of ``RobotParams``."""

    imu_tilt: float = param(
        0.0087, 'rad', 'standard deviation of the tilt (roll, pitch) of the IMU', low=0.0)
    imu_clock: float = param(
        20e-6, '-', 'standard deviation of the clock rate of the IMU', low=0.0, high=0.01)
    bending_variation: float = param(
        0.15, '-', 'half range of the bending peak from cycle to cycle', low=0.0, high=1.0)
    bumps: tuple[float, ...] = param(
        (0.10, 0.15), '-', 'range of the bumps outside the contact over the bending peak',
        low=0.0, high=1.0, length=2)


@dataclass(frozen=True, kw_only=True)
class PortsParams:
    """Where the simulator's pseudo-terminals appear, as links."""

    tire_radio: str = param('/tmp/smart_tire/tire_radio', '-', 'link to the XBee coordinator')
    imu: str = param('/tmp/smart_tire/imu', '-', 'link to the IMU')
    motors: str = param('/tmp/smart_tire/motors', '-', 'link to the motor boards')


@dataclass(frozen=True, kw_only=True)
class SimulatorParams:
    """Simulated robot on its ground; ``units``, ``protocol``, ``addresses`` as the drivers'."""

    seed: int = param(1, '-', 'of every random number', low=0)
    start: tuple[float, ...] = param(
        (0.0, 0.0, 0.0), 'm, m, rad', 'x, y, yaw of odom in the world of the ground', length=3)
    imu_rate: float = param(100.0, 'Hz', 'samples per second of the IMU', low=1.0, high=1000.0)
    units: tuple[str, ...] = param(
        ('0013A20040A1B2C2=front_left', '0013A20040A1B2C3=front_right',
         '0013A20040A1B2C4=rear_left', '0013A20040A1B2C5=rear_right'),
        '-', '64-bit address = wheel of every wheel unit')
    protocol: str = param('vectornav_binary', '-', 'what the IMU sends',
                          choices=('vectornav_binary', 'vectornav_ascii', 'xsens'))
    addresses: tuple[int, ...] = param(
        (128, 129), '-', 'packet serial addresses, front and rear', low=128, high=135, length=2)
    truth_log: str = param(
        '', '-', 'CSV file for wheel, sequence, loss and true instants [ns] of each batch')
    ground: GroundParams = group(GroundParams)
    drive: DriveParams = group(DriveParams)
    radio: RadioParams = group(RadioParams)
    errors: SensorErrorParams = group(SensorErrorParams)
    ports: PortsParams = group(PortsParams)
    robot: RobotParams = part(RobotParams)

    def __post_init__(self) -> None:
        MotorDriverParams(addresses=self.addresses)
        silent = set(self.robot.film.wheels) - set(self.address_of())
        if silent:
            raise ValueError(f'units: none for the instrumented {", ".join(sorted(silent))}')

    def address_of(self) -> dict[str, int]:
        """Return wheel -> 64-bit address of its unit."""
        receiver = TireReceiverParams(units=self.units)
        return {wheel: address for address, wheel in receiver.wheel_of().items()}
