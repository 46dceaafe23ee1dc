# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters of the simulated robot and its ground (``config/simulation.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.hardware import IMU_PROTOCOLS, MotorDriverParams, TireReceiverParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import inlined, named, nested, param


@dataclass(frozen=True, kw_only=True)
class PatchParams:
    """Rectangle of one surface, in the world frame of the ground."""

    name: str
    surface: str = param('', '-', 'one of ground.names')
    x: tuple[float, ...] = param((0.0, 0.0), 'm', 'minimum and maximum', (-1e4, 1e4), length=2)
    y: tuple[float, ...] = param((0.0, 0.0), 'm', 'minimum and maximum', (-1e4, 1e4), length=2)

    def check(self, surfaces: tuple[str, ...]) -> None:
        """Raise ValueError if the surface is none of ``surfaces`` or the rectangle is empty."""
        prefix = f'ground.patches.{self.name}'
        if self.surface not in surfaces:
            raise ValueError(f'{prefix}.surface: {self.surface!r}, expected one of '
                             f'{list(surfaces)}')
        for axis, limits in (('x', self.x), ('y', self.y)):
            if not limits[0] < limits[1]:
                raise ValueError(f'{prefix}.{axis}: {list(limits)}, expected [minimum, maximum]')


@dataclass(frozen=True, kw_only=True)
class SurfaceParams:
    """Surfaces: a base surface everywhere, and rectangular patches on it."""

    names: tuple[str, ...] = param(('concrete', 'sand'), '-', 'surfaces')
    friction: tuple[float, ...] = param(
        (0.47, 0.35), '-', 'friction coefficient mu of each surface', (0.0, 5.0))
    stiffness: tuple[float, ...] = param(
        (52.7, 30.0), 'N', 'per unit slip, C_x of a tire on each surface', (1e-3, 1e6))
    drag: tuple[float, ...] = param(
        (0.015, 0.16), '-', 'rolling resistance coefficient of a wheel on each surface',
        (0.0, 1.0))
    base: str = param('sand', '-', 'surface outside all patches')
    patches: tuple[PatchParams, ...] = named(
        PatchParams,
        (PatchParams(name='start_area', surface='concrete', x=(-3.0, 3.0), y=(-3.0, 3.0)),),
        'names of the patches; where patches overlap, the last one applies')

    def __post_init__(self) -> None:
        for name in ('friction', 'stiffness', 'drag'):
            if len(getattr(self, name)) != len(self.names):
                raise ValueError(f'ground.{name} has {len(getattr(self, name))} values, expected '
                                 f'one for each of {list(self.names)}')
        if self.base not in self.names:
            raise ValueError(f'ground.base: {self.base!r}, expected one of {list(self.names)}')
        for patch in self.patches:
            patch.check(self.names)


@dataclass(frozen=True, kw_only=True)
class DriveParams:
    """Geared DC motor of each wheel; all other properties are those of ``motor.*``."""

    stall_torque: float = param(5.0, 'N m', 'stall torque at the wheel at full duty', (1e-3, 1e4))
    free_speed: float = param(
        22.0, 'rad/s', 'wheel speed at full duty without load and friction', (1e-2, 1e3))


@dataclass(frozen=True, kw_only=True)
class RadioParams:
    """Radio link from the sensor nodes to the receiver."""

    batch: int = param(16, '-', 'samples per packet', (1, 255))
    delay: float = param(
        0.005, 's', 'minimum delay from the last sample to the receiver', (0.0, 1.0))
    jitter: float = param(
        0.003, 's', 'mean of the exponentially distributed additional delay', (0.0, 1.0))
    max_delay: float = param(0.020, 's', 'maximum delay of a packet', (0.0, 1.0))
    loss: float = param(0.005, '-', 'share of lost packets', (0.0, 1.0))
    clock_error: float = param(
        50e-6, '-', 'standard deviation of the relative clock rate error of a sensor node',
        (0.0, 0.01))


@dataclass(frozen=True, kw_only=True)
class SensorErrorParams:
    """Sensor errors without a parameter in ``RobotParams``; no calibration removes them."""

    imu_tilt: float = param(
        0.0087, 'rad', 'standard deviation of the mounting error in roll and pitch', (0.0, 1.0))
    imu_clock: float = param(
        20e-6, '-', 'standard deviation of the relative clock rate error of the IMU', (0.0, 0.01))
    bending_variation: float = param(
        0.15, '-', 'half range of the relative bending peak variation', (0.0, 1.0))
    bumps: tuple[float, ...] = param(
        (0.10, 0.15), '-', 'range of bump amplitudes outside the patch, over the bending peak',
        (0.0, 1.0), length=2)
    torque_constant: float = param(
        0.04, '-', 'relative standard deviation of the torque constant of all motors', (0.0, 0.3))
    torque_constant_spread: float = param(
        0.01, '-', 'relative standard deviation of single torque constants', (0.0, 0.3))
    torque_offset: float = param(
        0.015, 'N m', 'standard deviation of the offset of measured motor torques', (0.0, 100.0))
    torque_noise: float = param(
        0.05, 'N m', 'standard deviation of one motor torque measurement', (0.0, 100.0))
    motor_friction: float = param(
        0.1, '-', 'relative standard deviation of the friction of each motor and axle', (0.0, 0.3))
    bump_distance: tuple[float, ...] = param(
        (0.010, 0.010), 'm', 'from film to patch at the maximum of a bump; before, after',
        (0.0, 0.05), length=2)
    bump_width: tuple[float, ...] = param(
        (0.009, 0.009), 'm', 'full width at half height of the bumps; before, after', (1e-4, 0.05),
        length=2)
    bump_shape: str = param(
        'raised_cosine', '-', 'shape',
        choices=('raised_cosine', 'gaussian', 'asymmetric', 'exponential'))
    release_share: float = param(
        0.0, '-', 'share of the release convention other than film.release in the signal',
        (0.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class PortsParams:
    """Links to the simulated devices: paths, or names in this namespace and ROS domain."""

    tire_radio: str = param('simulated:tire_radio', '-', 'XBee coordinator')
    imu: str = param('simulated:imu', '-', 'IMU')
    motors: str = param('simulated:motors', '-', 'motor boards')


@dataclass(frozen=True, kw_only=True)
class SimulatorParams:
    """Simulated robot; ``units``, ``protocol`` and ``addresses`` must equal the drivers'."""

    seed: int = param(1, '-', 'seed of all random numbers', (0, 2**32 - 1))
    start: tuple[float, ...] = param(
        (0.0, 0.0, 0.0), 'm, m, rad', 'x, y, yaw of odom in the world frame of the ground',
        (-1e4, 1e4), length=3)
    imu_rate: float = param(100.0, 'Hz', 'sampling rate of the IMU', (1.0, 1000.0))
    units: tuple[str, ...] = param(

        ('0013A20040A1B2C2=front_left', '0013A20040A1B2C3=front_right',
         '0013A20040A1B2C4=rear_left', '0013A20040A1B2C5=rear_right'),
        '-', 'sensor nodes, 64-bit address=wheel')
    protocol: str = param('vectornav_binary', '-', 'protocol of the IMU', choices=IMU_PROTOCOLS)
    addresses: tuple[int, ...] = param(
        (128, 129), '-', 'packet serial addresses, front and rear', (128, 135), length=2)
    truth_log: str = param(
        '', '-', 'CSV file for wheel, sequence, loss and true sampling instants [ns] of batches')
    ground: SurfaceParams = nested(SurfaceParams)
    drive: DriveParams = nested(DriveParams)
    radio: RadioParams = nested(RadioParams)
    errors: SensorErrorParams = nested(SensorErrorParams)
    ports: PortsParams = nested(PortsParams)
    robot: RobotParams = inlined(RobotParams)

    def __post_init__(self) -> None:
        MotorDriverParams(addresses=self.addresses)
        missing = set(self.robot.film.wheels) - set(self.address_of())
        if missing:
            raise ValueError('units: no sensor node for the instrumented wheels '
                             + ', '.join(sorted(missing)))

    def address_of(self) -> dict[str, int]:
        """Return wheel -> 64-bit address of its sensor node."""
        receiver = TireReceiverParams(units=self.units)
        return {wheel: address for address, wheel in receiver.wheel_of().items()}
