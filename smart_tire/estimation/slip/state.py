"""What the slip filter keeps, and what it is told of each step."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class State(IntEnum):
    """Rows of the filter state."""

    X = 0          # m, base_link in odom
    Y = 1          # m
    YAW = 2        # rad
    ROLL = 3       # rad, of the ground under the robot
    PITCH = 4      # rad
    V_X = 5        # m/s, velocity of the IMU over ground, body axes
    V_Y = 6        # m/s
    GYRO_BIAS_Z = 7       # rad/s, bias about z
    ACCEL_BIAS_X = 8    # m/s2, bias, with the tilt of the mounting
    ACCEL_BIAS_Y = 9    # m/s2
    SLIP_VEL_L = 10   # m/s, r w - v_x of the left side
    SLIP_VEL_R = 11   # m/s
    ICR_X = 12       # m, S: x of the instantaneous centres of rotation
    STAMP_ERROR = 13     # s, error of the stamp of the last wheel reading
    PREV_STAMP_ERROR = 14  # s, of the one before


N = len(State)
SLIP_VELS = (State.SLIP_VEL_L, State.SLIP_VEL_R)
SLIP_VEL_ROWS = slice(State.SLIP_VEL_L, State.SLIP_VEL_R + 1)
SIDE_SIGNS = (-1.0, 1.0)  # sign of the yaw rate in v_x of the left and of the right side


@dataclass(frozen=True, slots=True)
class ImuStep:
    """What the inertial unit says of one step: base axes, biases not removed."""

    yaw_rate: float  # rad/s
    force_x: float   # m/s2, specific force
    force_y: float   # m/s2
    gyro_variance: float   # (rad/s)^2 s, of the integral per second
    accel_variance: float  # (m/s2)^2 s
    slope_sigma: float     # rad, of the ground, or of a body that pitches and rolls on it


@dataclass(frozen=True, slots=True)
class DelayedSpeed:
    """The speed over ground of one side at an earlier time, and what has happened since."""

    side: int        # 0 left, 1 right
    speed: float     # m/s, v_x of the wheel centres
    variance: float  # m2/s2, with that of ``gained``
    since: float     # s
    gained: float    # m/s, by which the state's V_X was moved by the inertial unit since
    turned: float    # rad, since
    gyro_z: float    # rad/s, then, bias not removed


@dataclass(frozen=True, slots=True)
class WheelMeasurement:
    """Mean speeds between two wheel readings and what the state made of the same time."""

    duration: float             # s
    speed: tuple[float, float]  # m/s, r w of the left and of the right side
    ground_speed: float         # m/s, mean of V_X as filtered
    yaw_rate: float             # rad/s, mean as filtered
    variance: float             # (m/s)^2, of a side's speed by quantisation
    stamped: bool               # stamps make the speeds: positions were differenced
