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
Samples: frozen records in SI units, exchanged between all parts of the package.

Times are integers [ns]. Axes are those of REP-103: x forward, y left, z up. Wheels are always in
the order of ``WHEELS``, wheels 1 to 4 of paper B.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
import math
from typing import TypeVar

from smart_tire.uncertain import Uncertain, UNKNOWN

NS_PER_S = 1_000_000_000
FIRST_DATE_NS = 946_684_800 * NS_PER_S  # 2000-01-01; earlier times are of a simulation
WHEELS = ('front_left', 'front_right', 'rear_left', 'rear_right')
LEFT = (0, 2)   # indices into WHEELS
RIGHT = (1, 3)  # indices into WHEELS
NAN = math.nan
PLANAR = (0, 1, 5)  # rows of x, y and yaw in the covariances of ROS, 6x6; their entries:
PLANAR_COVARIANCE = tuple(6 * row + column for row in PLANAR for column in PLANAR)
GRAVITY = 9.80665  # m/s2, standard acceleration of free fall (ISO 80000-3)

# Bounds of valid measurements of any wheeled robot:
MAX_WHEEL_SPEED = 1e3     # rad/s, 10 000 rpm; 87 m/s with the wheels of paper B
MAX_SPECIFIC_FORCE = 1e3  # m/s2, 100 g; IMUs of robots measure up to 16 g
MAX_SPEED = 1e2           # m/s, of a ground vehicle
MAX_POSITION = 1e7        # m, of a pose; northings of UTM are below
MAX_WHEEL_ANGLE = 1e9     # rad; a wheel of paper B after a way of 87 000 km
MAX_WHEEL_TORQUE = 1e5    # N m
MAX_FILM_VOLTAGE = 1e3    # V, of an amplifier; squares of a fit are finite
MAX_ANGULAR_RATE = 1e2    # rad/s; gyroscopes of robots measure up to 35 rad/s (2000 deg/s)

Vector3 = tuple[float, float, float]
Four = tuple[float, float, float, float]
STOPPED: Four = (0.0, 0.0, 0.0, 0.0)  # speeds or duties
Value = TypeVar('Value')


def four(values: Iterable[Value]) -> tuple[Value, Value, Value, Value]:
    """Return one value per wheel; raise ValueError unless there are four."""
    front_left, front_right, rear_left, rear_right = values
    return front_left, front_right, rear_left, rear_right


@dataclass(frozen=True, slots=True)
class ImuSample:
    """One reading of the IMU, in ``imu_link``."""

    stamp_ns: int
    acceleration: Vector3  # m/s2, specific force: +g on z when stationary
    rate: Vector3          # rad/s
    orientation: tuple[float, float, float, float] | None = None  # quaternion x, y, z, w


@dataclass(frozen=True, slots=True)
class WheelSample:
    """One reading of the four wheels, positive rolling forward on both sides."""

    stamp_ns: int
    velocity: Four                 # rad/s, mean over the period that ends at the timestamp
    position: Four | None = None   # rad, unwrapped, at the timestamp
    # Both are NaN for a wheel without encoder; one wheel of each side is measured.
    # N m, motor torque at the wheel, gear included, positive driving forward, from the current at
    # the timestamp; NaN where not measured
    effort: Four | None = None


@dataclass(frozen=True, slots=True)
class TireSample:
    """One A/D conversion of the films of one wheel."""

    stamp_ns: int              # time of the conversion
    wheel: str                 # one of WHEELS
    volts: tuple[float, ...]   # V, one per film; rolling forward, film 1 enters the patch first


@dataclass(frozen=True, slots=True)
class TireSamples:
    """Consecutive A/D conversions of the films of one wheel: a radio batch."""

    stamp_ns: int    # time of the first conversion
    wheel: str       # one of WHEELS
    period_ns: int   # between two conversions
    volts: tuple[tuple[float, ...], ...]  # V, conversions x films
    saturated: bool  # whether a conversion is at a limit of the converter

    @property
    def samples(self) -> list[TireSample]:
        """Return the conversions."""
        return [TireSample(self.stamp_ns + index * self.period_ns, self.wheel, volts)
                for index, volts in enumerate(self.volts)]


@dataclass(frozen=True, slots=True)
class BatterySample:
    """Battery voltage of a sensor node."""

    stamp_ns: int
    wheel: str
    volts: float  # V


@dataclass(frozen=True, slots=True)
class VelocityCommand:
    """Commanded velocity of the body in ``base_link``."""

    stamp_ns: int
    v_x: float       # m/s, forward
    yaw_rate: float  # rad/s, counter-clockwise


@dataclass(frozen=True, slots=True)
class WheelCommand:
    """Set points of the wheel speeds."""

    stamp_ns: int
    velocity: Four  # rad/s


@dataclass(frozen=True, slots=True)
class MotorCommand:
    """Duties for the motors."""

    stamp_ns: int
    duty: Four  # -1 to 1


@dataclass(frozen=True, slots=True)
class PlannedPath:
    """Path to follow, in the frame ``frame``."""

    stamp_ns: int
    frame: str
    # m, m, rad: x, y, yaw of base_link; yaw is NaN where the message gives no orientation
    poses: tuple[Vector3, ...]


@dataclass(frozen=True, slots=True)
class GoalPose:
    """Pose to drive to, in the frame ``frame``."""

    stamp_ns: int
    frame: str
    pose: Vector3  # m, m, rad: x, y, yaw of base_link; yaw NaN: any


@dataclass(frozen=True, slots=True)
class PathProgress:
    """Progress along the path; distances are NaN while none is followed."""

    stamp_ns: int
    remaining_distance: float  # m, along the path
    cross_track_error: float   # m, of the robot from the path, positive to the left
    state: int                 # see control.trajectory_control.State


@dataclass(frozen=True, slots=True)
class Odometry:
    """
    Pose of ``base_link`` in ``odom`` and its twist in ``base_link``.

    Covariances are row-major 6x6 in the order of ROS: x, y, z, and rotation about x, y, z.
    """

    stamp_ns: int
    position: Vector3                                # m
    orientation: tuple[float, float, float, float]   # quaternion x, y, z, w
    linear: Vector3                                  # m/s
    angular: Vector3                                 # rad/s
    pose_covariance: tuple[float, ...]               # 36 numbers
    twist_covariance: tuple[float, ...]              # 36 numbers


@dataclass(frozen=True, slots=True)
class WheelSlip:
    """Longitudinal slip of the four wheels."""

    stamp_ns: int
    # -, B(3) in [-1, 1]; NaN where neither wheel nor robot moves, or the wheel is not measured
    ratio: Four
    # m/s, r*omega - v_x of the wheel center, never clipped; NaN if the wheel is not measured
    slip_velocity: Four
    sigma: Four          # -, standard deviation of the ratio; 1 where it is NaN


@dataclass(frozen=True, slots=True)
class Icr:
    """Instantaneous center of rotation of the body in ``base_link``."""

    stamp_ns: int
    x: float  # m, S in paper B
    y: float  # m


@dataclass(frozen=True, slots=True)
class GroundState:
    """
    Tire on the present ground, and properties of the robot that show with it.

    A quantity that is not observable is ``UNKNOWN``: mu without films.
    """

    stamp_ns: int
    stiffness: Uncertain                          # N, C_x of the present ground
    friction_coefficient: Uncertain = UNKNOWN     # -, mu
    rolling_resistance: Uncertain = UNKNOWN       # -, over the load
    # -, of that resistance: 0 along the wheel heading, 1 along the velocity of the wheel center
    lateral_share: Uncertain = UNKNOWN
    lateral_stiffness_ratio: Uncertain = UNKNOWN  # -, C_y / C_x
    center_of_mass_x: Uncertain = UNKNOWN         # m, in base_link
    center_of_mass_y: Uncertain = UNKNOWN         # m
    imu_x: Uncertain = UNKNOWN                    # m, position of the IMU in base_link
    imu_y: Uncertain = UNKNOWN                    # m
    motor_friction: Uncertain = UNKNOWN           # -, of gears and axles, over the nominal one
    torque_scale: Uncertain = UNKNOWN             # -, true over measured motor torque
    stiffness_friction_correlation: float = 0.0  # -, of the errors of ln C_x and ln mu
    # -, relative standard deviation of mu by errors of the robot and its sensors, which all its
    # estimates share; infinite: unknown
    friction_common_sigma: float = math.inf
    # s, since the ground under the wheels of a side changed; infinite: not in the window
    change_age_left: float = math.inf
    change_age_right: float = math.inf


@dataclass(frozen=True, slots=True)
class Friction:
    """
    Estimates of one patch crossing of a wheel's films.

    A quantity that is not observable is ``UNKNOWN``: NaN with an infinite standard deviation.
    """

    stamp_ns: int  # films' common center at the patch center
    wheel: str
    friction_coefficient: Uncertain = UNKNOWN         # -, from this and earlier revolutions
    friction_coefficient_single: Uncertain = UNKNOWN  # -, from this revolution alone
    adhesion_ratio: Uncertain = UNKNOWN    # -, L_a / L
    adhesion_length: Uncertain = UNKNOWN   # m, L_a
    stretch_voltage: Uncertain = UNKNOWN   # V, q_sm of film 1
    peak_interval: Uncertain = UNKNOWN     # s, Delta t_a of film 1
    slip: Uncertain = UNKNOWN              # -, B(3)'s lambda
    film_slip: Uncertain = UNKNOWN         # -, lambda from the films alone
    total_slip: Uncertain = UNKNOWN        # -, |s|
    normal_load: Uncertain = UNKNOWN       # N, F_z
    stiffness: Uncertain = UNKNOWN         # N, C_x
    critical_slip: Uncertain = UNKNOWN     # -
    traction_force: Uncertain = UNKNOWN    # N, on the robot, positive forward

    def quantity(self, name: str) -> Uncertain:
        """Return the quantity with a name of ``FRICTION_QUANTITIES``."""
        found: Uncertain = getattr(self, name)
        return found


@dataclass(frozen=True, slots=True)
class FrictionGrid:
    """
    Friction of the square cells of a map; the first one has the smallest x and y.

    ``values`` has a byte for each cell, row by row along x: 100 times mu, at most 100; 255 is
    unknown.
    """

    stamp_ns: int
    frame: str
    resolution: float             # m, edge of a cell
    origin: tuple[float, float]   # m, x and y of the corner of the first cell
    columns: int
    values: bytes


@dataclass(frozen=True, slots=True)
class FilmCharge:
    """One conversion of the charge amplifier of a buckling film."""

    stamp_ns: int
    charge: float             # C, output of the amplifier
    saturated: bool = False   # the output is at a limit of the converter
    discharged: bool = False  # the amplifier has lost charge: reset or overload


@dataclass(frozen=True, slots=True)
class FilmTemperature:
    """Temperature of a buckling film."""

    stamp_ns: int
    value: float        # degree Celsius
    sigma: float = 0.0  # K, 0: unknown


@dataclass(frozen=True, slots=True)
class FilmDeflection:
    """Deflection of a buckling film, from flat."""

    stamp_ns: int
    deflection: Uncertain  # m, approach of its ends


FRICTION_QUANTITIES = tuple(one.name for one in fields(Friction) if one.default is UNKNOWN)
GROUND_ESTIMATES = ('stiffness', *(one.name for one in fields(GroundState)
                                   if one.default is UNKNOWN))
GROUND_NUMBERS = {  # without a standard deviation: name -> default
    one.name: one.default for one in fields(GroundState) if isinstance(one.default, float)}


Sample = (ImuSample | WheelSample | TireSample | TireSamples | BatterySample | VelocityCommand
          | WheelCommand | MotorCommand | PlannedPath | GoalPose | PathProgress | Odometry
          | WheelSlip | Icr | GroundState | Friction | FrictionGrid | FilmCharge | FilmTemperature
          | FilmDeflection)
