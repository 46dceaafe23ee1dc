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

"""State vector of the slip filter and the inputs of its equations."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class State(IntEnum):
    """Rows of the filter state; those from ``LN_STIFFNESS`` on are considered, not corrected."""

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
    TRAVEL_L = 12          # m, rolled distance of the left side since the last wheel sample
    TRAVEL_R = 13          # m
    ICR_X = 14             # m, S: x of the ICRs in base_link
    ICR_L = 15             # m, y of the ICR of the left side, beyond its wheels
    ICR_R = 16             # m, of the right side, to the right
    RADIUS = 17            # -, relative error of the wheel radius
    IMU_X = 18             # m, error of the x position of the IMU
    LN_STIFFNESS = 19      # -, ln of C_x over the value that is given
    LN_FRICTION = 20       # -, ln of mu over the value that is given
    RESISTANCE = 21        # -, error of the rolling resistance coefficient
    LATERAL_SHARE = 22     # -, error of the lateral share of the rolling resistance
    LN_LATERAL = 23        # -, ln of C_y / C_x over the value that is given
    COM_X = 24             # m, error of the center of mass
    COM_Y = 25             # m


N = len(State)
ESTIMATED = int(State.LN_STIFFNESS)  # number of states that are corrected
GROUND = slice(State.LN_STIFFNESS, N)
SLIP_VELS = (State.SLIP_VEL_L, State.SLIP_VEL_R)
TRAVELS = (State.TRAVEL_L, State.TRAVEL_R)
ICRS = (State.ICR_L, State.ICR_R)

SPEED_RANDOM_WALK = 0.002      # m/s per sqrt(s), errors of the planar model; assumed
GYRO_BIAS_RANDOM_WALK = 2e-5   # rad/s per sqrt(s): 10 degrees per hour after five minutes
ACCEL_BIAS_RANDOM_WALK = 5e-4  # m/s2 per sqrt(s), data sheets of industrial IMUs
SLIP_CORRELATION_TIME = 1.0    # s, of the slip beyond the ICR kinematics; assumed
SLOPE_LENGTH = 2.0             # m, correlation length of the slope; some robot lengths
MIN_SLIP_SPEED = 0.1           # m/s, below which the noise of slip velocities is constant
SLIP_FLOOR = 0.05              # m/s, smallest denominator of a slip
MIN_RESISTED_SPEED = 0.02      # m/s, below which rolling resistance is proportional to the speed
MIN_LOAD = 0.1                 # N, of a wheel that is lifted
OUTLIER_SIGMAS = 3.0  # beyond, the variance of an innovation grows with its square; Huber's share


class ImuReading(NamedTuple):
    """IMU measurement in base axes; the biases of yaw rate and forces are included."""

    yaw_rate: float  # rad/s
    force_x: float   # m/s2, specific force
    force_y: float   # m/s2


class ImuStep(NamedTuple):
    """IMU input of one prediction step."""

    dt: float              # s
    mean: ImuReading
    gyro_variance: float   # (rad/s)^2 s, noise density
    accel_variance: float  # (m/s2)^2 s, noise density
    begin_rate: float      # rad/s, smoothed yaw rate at the begin and at the end of the step
    end_rate: float
