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

"""State vector and measurements of the slip EKF."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
import math
from typing import NamedTuple


class State(IntEnum):
    """Rows of the filter state."""

    X = 0                  # m, base_link in odom
    Y = 1                  # m
    YAW = 2                # rad
    ROLL = 3               # rad, of the ground under the robot
    PITCH = 4              # rad
    V_X = 5                # m/s, velocity of the IMU over ground, body axes
    V_Y = 6                # m/s
    GYRO_BIAS_Z = 7        # rad/s
    ACCEL_BIAS_X = 8       # m/s2, including the tilt of the mounting
    ACCEL_BIAS_Y = 9       # m/s2
    SLIP_VEL_L = 10        # m/s, slip velocity r w - v_x of the left side
    SLIP_VEL_R = 11        # m/s
    ICR_X = 12             # m, S: x of the instantaneous centers of rotation
    TRAVEL_L = 13          # m, rolled distance of the left side since the last wheel sample
    TRAVEL_R = 14          # m
    FORCE_X = 15           # m/s2, specific force at the IMU without bias, body axes
    FORCE_Y = 16           # m/s2
    YAW_RATE = 17          # rad/s
    YAW_ACCEL = 18         # rad/s2
    LN_STIFFNESS = 19      # -, ln of C_x on the present ground over its calibrated value
    LN_RATIO = 20          # -, ln of mu / C_x on the present ground over its prior
    DRAG = 21              # -, rolling resistance coefficient of the present ground
    TORQUE_SCALE = 22      # -, ln of the true over the nominal torque constant
    TORQUE_OFFSET_FL = 23  # N m, of the measured torque of each motor
    TORQUE_OFFSET_FR = 24
    TORQUE_OFFSET_RL = 25
    TORQUE_OFFSET_RR = 26


N = len(State)
SLIP_VELS = (State.SLIP_VEL_L, State.SLIP_VEL_R)
SLIP_VEL_ROWS = slice(State.SLIP_VEL_L, State.SLIP_VEL_R + 1)
TRAVELS = (State.TRAVEL_L, State.TRAVEL_R)
TORQUE_OFFSETS = slice(State.TORQUE_OFFSET_FL, State.TORQUE_OFFSET_RR + 1)
SIDE_SIGNS = (-1.0, 1.0)  # sign of the yaw rate in v_x of the left and of the right side


class ImuReading(NamedTuple):
    """Planar IMU measurement in base axes, biases included."""

    yaw_rate: float  # rad/s
    force_x: float   # m/s2, specific force
    force_y: float   # m/s2
    roll_rate: float = 0.0   # rad/s; without bias in the mean of a step
    pitch_rate: float = 0.0  # rad/s


@dataclass(frozen=True, slots=True)
class ImuStep:
    """IMU input of one prediction step."""

    mean: ImuReading
    gyro_variance: float   # (rad/s)^2 s, noise density
    accel_variance: float  # (m/s2)^2 s, noise density
    slope_sigma: float     # rad, of the ground, or of a body that pitches and rolls on it
    tilt_variance: float = math.inf  # (rad/s)^2 s, noise density of roll and pitch rate
    tilt_gain: float = 0.0           # -, share of the slope that they show, at most


@dataclass(frozen=True, slots=True)
class DelayedSpeed:
    """Speed over ground of one side at an earlier time, and the motion since then."""

    side: int            # 0 left, 1 right
    speed: float         # m/s, v_x of the wheel centers
    variance: float      # m2/s2, including that of ``speed_change``
    elapsed: float       # s, since then
    speed_change: float  # m/s, integrated acceleration of V_X since then
    yaw_change: float    # rad, since then
    gyro_z: float        # rad/s, at that time, bias included
    lateral_change: float = 0.0  # m/s, integrated acceleration of V_Y since then


@dataclass(frozen=True, slots=True)
class WheelMeasurement:
    """Mean side speeds between two wheel samples, and the filtered motion over that period."""

    duration: float                    # s
    side_speeds: tuple[float, float]   # m/s, r w of the left and of the right side
    ground_speed: float                # m/s, mean of the filtered V_X
    yaw_rate: float                    # rad/s, mean of the filtered yaw rate
    variance: float                    # (m/s)^2, of a side's speed due to quantization
    lag: float                         # s, from the sample to the state's time
    travel_change: tuple[float, float]  # m, travel in that time beyond that at the present speed
    from_positions: bool               # positions were differenced; otherwise velocities
