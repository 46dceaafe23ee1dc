# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The robot: geometry, mass, tire, films and sensors (``config/robot.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass
import math

from smart_tire.parameters.spec import nested, param
from smart_tire.samples import four, WHEELS

SIDES = 'left', 'right'
MOUNTING_TILT = 0.009    # rad, standard deviation of that of an IMU: half a degree
MAX_GROUP_EXTENT = 0.5  # of the circumference; all films of a group leave before one enters again


@dataclass(frozen=True, kw_only=True)
class ImuParams:
    """Mounting and errors of the IMU."""

    position: tuple[float, ...] = param(
        (0.05, 0.02, 0.10), 'm', 'position of imu_link in base_link', (-10.0, 10.0), length=3)
    position_sigma: float = param(
        0.0, 'm', 'standard deviation of x and y, where they were not measured', (0.0, 10.0))
    rotation: tuple[float, ...] = param(
        (0.0, 0.0, 0.0), 'rad', 'roll, pitch, yaw of imu_link in base_link', (-math.tau, math.tau),
        length=3)
    gyro_scale: float = param(1.0, '-', 'measured yaw rate over the true one', (0.5, 2.0))
    gyro_scale_sigma: float = param(
        0.001, '-', 'standard deviation of its error; data sheets: 0.1 %', (0.0, 0.5))
    gyro_noise: float = param(0.01, 'rad/s', 'standard deviation of one sample', (1e-6, 1.0))
    accel_noise: float = param(0.05, 'm/s2', 'standard deviation of one sample', (1e-6, 10.0))
    gyro_bias: float = param(0.01, 'rad/s', 'standard deviation of the turn-on bias', (0.0, 1.0))
    accel_bias: float = param(0.05, 'm/s2', 'standard deviation of the turn-on bias', (0.0, 10.0))


@dataclass(frozen=True, kw_only=True)
class EncoderParams:
    """Wheel encoders."""

    counts_per_revolution: float = param(2000.0, '-', 'counts per wheel revolution', (1.0, 1e7))
    stamp_jitter: float = param(
        0.001, 's', 'standard deviation of timestamp errors of wheel_states', (0.0, 0.1))
    latency: float = param(
        0.0, 's', 'delay of wheel_states timestamps after the measurement', (-1.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class JointParams:
    """
    Joints of the wheels in wheel_states, by their names in the message.

    '' is a wheel that is not measured, such as a caster: its slip is unknown. left and right are
    for two-wheel drives, and for wheels of a side coupled by belt, chain or track. Names that
    differ from the defaults are recognized if unambiguous, such as wheel_left_front_joint.
    """

    front_left: str = param('front_left', '-', "joint of the front left wheel; '': not measured")
    front_right: str = param(
        'front_right', '-', "joint of the front right wheel; '': not measured")
    rear_left: str = param('rear_left', '-', "joint of the rear left wheel; '': not measured")
    rear_right: str = param('rear_right', '-', "joint of the rear right wheel; '': not measured")
    left: str = param('', '-', 'of both left wheels, in place of front_left and rear_left')
    right: str = param('', '-', 'of both right wheels, in place of front_right and rear_right')
    inverted: tuple[str, ...] = param(
        (), '-', 'joints whose angle decreases when the robot drives forward')

    def __post_init__(self) -> None:
        for side in SIDES:
            own, pair = getattr(self, side), [f'{end}_{side}' for end in ('front', 'rear')]
            names = [getattr(self, wheel) for wheel in pair]
            if own and any(name not in ('', wheel) for name, wheel in zip(names, pair)):
                raise ValueError(f'joints.{side} is given ({own}): leave out '
                                 + ' and '.join(f'joints.{wheel}' for wheel in pair))
            if not own and not any(names):
                raise ValueError(f'joints.{pair[0]} and joints.{pair[1]} are both empty: one '
                                 f'wheel of the {side} side must be measured')
        left, right = (set(self.names[side::2]) - {''} for side in range(2))
        if common := left & right:
            raise ValueError(f'joints: {min(common)} is on both sides')
        if not self.is_standard and (unknown := set(self.inverted) - left - right):
            raise ValueError(f'joints.inverted: {min(unknown)} is not the joint of a wheel')

    @property
    def names(self) -> tuple[str, str, str, str]:
        """Return the joint of each of ``WHEELS``; '' if it is not measured."""
        return (self.left or self.front_left, self.right or self.front_right,
                self.left or self.rear_left, self.right or self.rear_right)

    @property
    def is_standard(self) -> bool:
        """Return whether the joints have the names of the wheels."""
        return self.names == WHEELS

    @property
    def encoders_per_side(self) -> int:
        """Return the number of encoders per side, 1 or 2: the smaller one if they differ."""
        return min(len(set(self.names[side::2]) - {''}) for side in range(2))

    @property
    def measured(self) -> tuple[bool, bool, bool, bool]:
        """Return whether each of ``WHEELS`` is measured."""
        return four(map(bool, self.names))


STANDARD_JOINTS = JointParams()


@dataclass(frozen=True, kw_only=True)
class TireParams:
    """Contact patch and stiffness of a tire."""

    contact_length: float = param(0.046, 'm', 'length L of the contact patch', (1e-3, 1.0))
    contact_width: float = param(0.089, 'm', 'width B of the contact patch', (1e-3, 1.0))
    longitudinal_stiffness: float = param(
        52.7, 'N', 'per unit slip and wheel, C_x of the tire-ground pair', (1e-3, 1e6))
    longitudinal_stiffness_sigma: float = param(
        0.1, '-', 'relative standard deviation of C_x; grounds add theirs', (0.0, 2.0))


@dataclass(frozen=True, kw_only=True)
class TreadFilmParams:
    """PVDF films and signal chain; lists: one value per film, for one wheel or for all wheels."""

    wheels: tuple[str, ...] = param(('front_right',), '-', 'instrumented wheels', choices=WHEELS)
    length: float = param(0.020, 'm', 'length l of a film', (1e-3, 0.5))
    width: float = param(0.003, 'm', 'width b of a film', (1e-4, 0.5))
    spacing: float = param(
        0.030, 'm', 'distance between film centers along the circumference', (0.0, 10.0))
    positions: tuple[float, ...] = param(
        (), 'm', 'film centers along the circumference; []: two, film.spacing apart', (0.0, 10.0))
    stretch_gain: tuple[float, ...] = param(
        (307.5, 242.5), 'V/m', 'per film, stretch voltage over overlap integral', (1e-3, 1e6))
    stretch_gain_tolerance: float = param(
        0.03, '-', 'relative standard deviation of the gains', (0.0, 1.0))
    bending_peak: tuple[float, ...] = param(
        (0.83, 0.66), 'V', 'per film, peak q_bm of the bending voltage', (0.0, 100.0))
    bending_alpha: float = param(67.0, '1/m', 'shape of the bending charge, B(15)', (1e-3, 1e4))
    release: str = param(
        'fig8', '-', 'convention for the voltage when the film leaves the patch',
        choices=('fig8', 'state'))
    noise: float = param(0.005, 'V', 'standard deviation of one sample', (0.0, 10.0))
    rest_voltage: float = param(1.65, 'V', 'output without deformation', (0.0, 100.0))
    voltage_range: float = param(3.3, 'V', 'full scale of the A/D converter', (1e-3, 100.0))
    bits: int = param(10, '-', 'resolution of the A/D converter', (1, 24))
    sample_rate: float = param(400.0, 'Hz', 'sampling rate of a sensor node', (1.0, 1e5))

    def __post_init__(self) -> None:
        films = self.count
        for name in ('stretch_gain', 'bending_peak'):
            count = len(getattr(self, name))
            if count not in (films, films * len(self.wheels)):
                raise ValueError(f'film.{name} has {count} values, expected {films} for all '
                                 f'wheels or {films} for each of {len(self.wheels)} in '
                                 'film.wheels')
        if list(self.positions) != sorted(self.positions):
            raise ValueError(f'film.positions: {list(self.positions)}, expected ascending numbers '
                             'in the order in which the films enter the patch')
        if len(set(self.wheels)) != len(self.wheels):
            raise ValueError(f'film.wheels contains a wheel twice: {list(self.wheels)}')

    @property
    def centers(self) -> tuple[float, ...]:
        """Return the centers of a wheel's films [m] along the circumference, film 1 first."""
        return self.positions or (0.0, self.spacing)

    @property
    def count(self) -> int:
        """Return the number of films per wheel."""
        return len(self.centers)

    @property
    def code_voltage(self) -> float:
        """Return the voltage of one converter step [V]."""
        return self.voltage_range / (2**self.bits - 1)

    @property
    def sample_variance(self) -> float:
        """Return the variance of one sample [V^2]: noise and quantization."""
        return self.noise**2 + self.code_voltage**2 / 12.0

    def gains(self, wheel: str) -> tuple[float, ...]:
        """Return the stretch gains [V/m] of the films of ``wheel``."""
        return self._own(self.stretch_gain, wheel)

    def bending(self, wheel: str) -> tuple[float, ...]:
        """Return the bending peaks [V] of the films of ``wheel``."""
        return self._own(self.bending_peak, wheel)

    def _own(self, values: tuple[float, ...], wheel: str) -> tuple[float, ...]:
        count = self.count
        start = 0 if len(values) == count else count * self.wheels.index(wheel)
        return values[start:start + count]


@dataclass(frozen=True, kw_only=True)
class MotorParams:
    """Motor, gear and losses of each wheel; assumed values of a robot of this size."""

    torque_constant: float = param(
        1.2, 'N m/A', 'motor torque at the wheel over current, gear included', (1e-4, 100.0))
    torque_constant_sigma: float = param(
        0.05, '-', 'relative standard deviation of the torque constant', (0.0, 1.0))
    coulomb_friction: float = param(0.15, 'N m', 'dry friction torque at the wheel', (0.0, 100.0))
    viscous_friction: float = param(
        0.0, 'N m s/rad', 'friction torque over wheel speed', (0.0, 100.0))
    axle_friction: float = param(
        0.015, '-', 'friction torque over wheel load and radius', (0.0, 1.0))
    inertia: float = param(
        0.008, 'kg m2', 'inertia of wheel, gear and rotor about the wheel axis', (1e-5, 100.0))
    current_sign: str = param(
        'draw', '-', 'currents: positive along the duty (draw) or a positive duty (signed)',
        choices=('draw', 'signed'))


@dataclass(frozen=True, kw_only=True)
class SlipParams:
    """Definition and inputs of the slip estimate."""

    standstill_speed: float = param(
        0.05, 'm/s', 'slip is NaN while both wheel and robot are slower', (1e-4, 1.0))


@dataclass(frozen=True, kw_only=True)
class RobotParams:
    """The robot, common to all nodes; the defaults are those of paper B where it gives them."""

    wheel_radius: float = param(0.087, 'm', 'effective rolling radius', (1e-3, 2.0))
    wheel_radius_sigma: float = param(
        0.002, '-', 'relative standard deviation of the initial wheel radius', (0.0, 0.3))
    track_width: float = param(
        0.38, 'm', 'distance between left and right wheel centers', (1e-2, 10.0))
    wheelbase: float = param(
        0.26, 'm', 'distance between front and rear wheel centers', (1e-2, 10.0))
    mass: float = param(10.9, 'kg', 'mass of the robot', (1e-2, 1e4))
    yaw_inertia: float = param(
        0.35, 'kg m2', 'moment of inertia about the vertical axis', (1e-4, 1e5))
    center_of_mass: tuple[float, ...] = param(
        (0.0, 0.0, 0.023), 'm', 'center of mass in base_link, so above the axles', (-5.0, 5.0),
        length=3)
    center_of_mass_sigma: tuple[float, ...] = param(
        (0.005, 0.005), 'm', 'standard deviation of its x and y: an unknown load', (1e-4, 1.0),
        length=2)
    odom_frame: str = param('odom', '-', 'frame of the estimated pose')
    base_frame: str = param('base_link', '-', 'frame of the body, at the center of the wheels')
    frame_prefix: str = param(
        '', '-', 'before the names of all frames, for example robot1/, where robots share /tf')
    publish_tf: bool = param(
        True, '-', 'publish the pose on /tf; false if another node, as robot_localization, does')
    imu: ImuParams = nested(ImuParams)
    encoder: EncoderParams = nested(EncoderParams)
    joints: JointParams = nested(JointParams)
    tire: TireParams = nested(TireParams)
    film: TreadFilmParams = nested(TreadFilmParams)
    motor: MotorParams = nested(MotorParams)
    slip: SlipParams = nested(SlipParams)

    def __post_init__(self) -> None:
        for wheel in self.film.wheels:
            if not self.joints.names[WHEELS.index(wheel)]:
                raise ValueError(f'film.wheels: {wheel} is not measured (joints.{wheel} is '
                                 'empty), so its patch crossings are unknown; [] without films')
        circumference, centers = 2.0 * math.pi * self.wheel_radius, self.film.centers
        if centers[-1] - centers[0] >= circumference:
            raise ValueError(f'film.positions: {list(centers)} span more than the wheel '
                             f'circumference of {circumference:.3f} m')

    @property
    def frames(self) -> dict[str, str]:
        """Return frame of REP-105 -> its name on this robot."""
        return {'odom': self.frame_prefix + self.odom_frame,
                'base_link': self.frame_prefix + self.base_frame,
                'imu_link': f'{self.frame_prefix}imu_link'}

    @property
    def film_groups(self) -> list[tuple[int, ...]]:
        """
        Return the films of a wheel (indices) grouped by patch crossing.

        Films form a group if neighbors are closer than the distance over which a film is in
        contact, and if all of them leave the patch before the first one enters it again.
        """
        contact, centers = self.tire.contact_length + self.film.length, self.film.centers
        max_extent = MAX_GROUP_EXTENT * 2.0 * math.pi * self.wheel_radius - contact
        groups: list[tuple[int, ...]] = []
        for film, center in enumerate(centers):
            if groups and center - centers[groups[-1][-1]] <= contact and (
                    center - centers[groups[-1][0]] <= max_extent):
                groups[-1] += (film,)
            else:
                groups.append((film,))
        return groups
