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
State vector of the slip filter and its prior, inputs of its equations, all constants.

Each constant has its unit, its origin and the runs that are worse without it: rows of
``benchmarks.robots``, recordings of ``benchmarks.slip.field``, or a test.
"""

from __future__ import annotations

from enum import IntEnum
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.models.tire.brush_tire import LN_RESISTANCE
from smart_tire.parameters import SlipEstimatorParams
from smart_tire.parameters.robot import MOUNTING_TILT
from smart_tire.samples import GRAVITY


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
    IMU_X = 18             # m, error of the position of the IMU
    IMU_Y = 19             # m
    LN_STIFFNESS = 20      # -, ln of C_x over the value that is given
    LN_FRICTION = 21       # -, ln of mu over the value that is given
    RESISTANCE = 22        # -, error of the rolling resistance coefficient
    LATERAL_SHARE = 23     # -, error of the lateral share of the rolling resistance
    LN_LATERAL = 24        # -, ln of C_y / C_x over the value that is given
    COM_X = 25             # m, error of the center of mass
    COM_Y = 26             # m


N = len(State)
ESTIMATED = int(State.LN_STIFFNESS)  # number of states that are corrected
GROUND = slice(State.LN_STIFFNESS, N)
SUDDEN = slice(State.LN_STIFFNESS, State.LATERAL_SHARE)  # what changes with the ground
SLIP_VELS = (State.SLIP_VEL_L, State.SLIP_VEL_R)
TRAVELS = (State.TRAVEL_L, State.TRAVEL_R)
ICRS = (State.ICR_L, State.ICR_R)

# prior
MIN_SIGMA = 1e-5              # m, rad: origin and new travel are exact, but P must be regular
START_SIGMA = 0.2             # m/s, of velocity and slip velocities, assumed; start_in_motion
START_SLIP = 0.3              # -, sigma of the slip of a robot that starts in motion, assumed; ice
ICR_SHARES = 0.25, 0.2        # of the track, mean and sigma of ICR_L, ICR_R: effective tracks of
# 1 to 2.2 times the track are published for skid-steer robots; field

# ln of the rolling resistance of any ground: the window finds it, and begins with firm ground,
# where its errors are smaller (concrete without films); the filter does not (starvation, sand)
UNKNOWN_RESISTANCE = LN_RESISTANCE._replace(value=math.log(0.035))

# process noise
BIAS_WALK_SHARE = 0.002        # of the turn-on biases of the IMU, per sqrt(s), assumed; field
SLIP_CORRELATION_TIME = 1.0    # s, of slip and lateral speed beyond the ICR kinematics; all rows
ICR_WALK_SHARE = 0.05          # of the track per sqrt(rad), assumed: the ground changes; jumps
SLOPE_LENGTH = 2.0             # m, correlation length of the slope, assumed; hills
COMMON_SLIP_SHARE = 3.0        # common slip over the difference of the sides, mu unknown; ice
LEARNING_TIME = 10.0           # s of driving, of noises, assumed; ice, field
SLIP_LEARNING_TIME = 25.0      # s of driving, of slip, slope and delay, assumed; jumps, field

# corrections
OUTLIER_SIGMAS = 3.0          # beyond, variances grow with the square (Huber); pushes
MAX_NIS = OUTLIER_SIGMAS * OUTLIER_SIGMAS  # of an innovation that a level is learned from
SPEED_SIGMA = 0.003           # m/s, of a side, beyond quantization and stamps, or of a robot that
# stands, assumed; learned
MAX_STATIONARY_WHEEL_SPEED = OUTLIER_SIGMAS * SPEED_SIGMA

# balance of forces
MIN_SLIP_SPEED = 0.1          # m/s, of wheels; below, forces and noise do not follow slip ratios
BALANCE_SIGMA = 0.03          # m/s2, least lasting error of the balance, which is learned; all
# rows
FORCE_ERROR = 0.07            # of traction forces: torque constant, tire curve, assumed; jumps
MODEL_TIME = 0.3              # s, a robot length: of lasting errors of the forces, of compared
# innovations, and in which tires build up the slip of a turn; jumps, pushes
PUSH_TIME = 0.05              # s, in which tires follow a push: mass times speed over their
# lateral stiffness; pushes, lifted
PUSH_SIGMAS = 4.0             # of a change of the mean innovation in that time: once in minutes,
# assumed; pushes, jumps
MAX_REPEATS = 2               # of a measured torque; a stuck value is none; stuck
EXPIRY_TIME = 2.5             # s, in which the window finds a ground: without ground_state, its
# errors grow to the prior after it; after a change, an old one is refused; jumps
EVIDENCE = 8.0                # twice the log likelihood ratio of a change of the ground; jumps

# IMU and wheels
TYPICAL_PERIOD = 0.05         # s, of samples, until there are two; locked wheels slide for longer
PERIOD_GAIN = 0.1             # of a new one in the smoothed period; lost messages
IMU_WINDOW = 1.0              # s, of the vibration level, of the mean yaw rate of a turn, and of
# the settling of tires and body after one
DRIVE_JERK = 1.0              # m/s2 per sqrt(s), random walk of a robot's acceleration; field
DROPOUT_ACCEL_SIGMA = 0.3     # m/s2, of the acceleration of a robot whose IMU is missing, over
# the correlation time of slip; dropouts
IMU_DROPOUT = 0.1             # s without IMU samples (or 3 periods), then predict by the wheels
SPEED_WALK = 0.2              # m/s per sqrt(s), least random walk of the speed of a side between
# messages, without positions: robots start and stop within seconds; lost messages, learned
MIN_WHEEL_PERIOD = 0.03       # s, of wheel samples that are used; those between are merged: the
# noise of stamps makes speeds of shorter periods; wheels at 200 Hz
MAX_SAMPLE_GAP = 2.0          # s; after a longer gap positions are not differenced
RESIDUAL_GAIN = 0.5           # of a new sample in the smoothed difference of a wheel and its side:
# the counts of single samples differ by one; without, single wheels are 7 % worse; demo

# continuous pose of the output
AGREEMENT_SIGMAS = 2.0        # of the twist, by which the velocity of the pose differs from it
CORRECTION_TIME = 0.3         # s, a few wheel samples: their corrections often alternate; demo
MAX_CORRECTION_SPEED = 0.24   # m/s; 1.9 mm in 8 ms, half the speed of a small robot; demo

# delay of the wheels behind the gyroscope, beyond the known latency
LAG_SIGMA = 0.1               # s, prior: buses and drivers between wheels and message; field
MIN_LAG = 0.04                # s, of slip that follows the wheels late; below, none is used;
# simulated slip with a lag of 0.1 s
LAG_WINDOW = 0.1              # s, of compared turns: below the delays, above the noise of counts
MAX_LAG_RATE = 0.02           # s per s, of its change: wheel speeds are wrong by as much then

# standstill
QUIET_TIME = 0.2              # s for which the IMU must have been quiet; sand_straight
UNWINDING_SHARE = 0.1         # of the last yaw rate, right after the wheels have stopped ...
UNWINDING_TIME = 1.5          # s, ... and its decay time; simulated tires with linear springs
TRUSTED_STANDSTILL = 3.0      # s; longer standstill overrules a state that has diverged

# outputs
MIN_YAW_RATE = 0.05           # rad/s; below, the ICR is too far away to be observable
PLANAR_VARIANCE = 1e-6        # m^2, rad^2 and per s: height and its rate, zero in the plane


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


def common_slip(size: int) -> Array:
    """Return the covariance (size, size) of 1 m/s slip of both sides, which no wheel shows."""
    sign = np.zeros(size)
    sign[State.V_X], sign[list(SLIP_VELS)] = -1.0, 1.0
    return np.outer(sign, sign)


def initial_state(params: SlipEstimatorParams) -> tuple[list[float], Array]:
    """Return state (N,) and covariance (N, N) of a robot at the origin of ``odom``."""
    robot = params.robot
    x, sigma = [0.0] * N, np.full(N, MIN_SIGMA)
    sigma[State.ROLL] = sigma[State.PITCH] = params.slope_sigma
    sigma[[State.V_X, State.V_Y, *SLIP_VELS]] = START_SIGMA
    sigma[State.GYRO_BIAS_Z] = robot.imu.gyro_bias
    sigma[State.ACCEL_BIAS_X] = sigma[State.ACCEL_BIAS_Y] = math.hypot(
        robot.imu.accel_bias, GRAVITY * MOUNTING_TILT)
    x[State.ICR_X], sigma[State.ICR_X] = params.icr_x, params.icr_x_sigma * robot.wheelbase
    sigma[State.RADIUS] = max(robot.wheel_radius_sigma, 1e-9)
    sigma[[State.IMU_X, State.IMU_Y]] = max(robot.imu.position_sigma, 1e-9)
    mean, spread = (share * robot.track_width for share in ICR_SHARES)
    for row in ICRS:
        x[row], sigma[row] = mean, spread
    P = np.diag(sigma ** 2)
    P[State.ICR_L, State.ICR_R] = P[State.ICR_R, State.ICR_L] = 0.5 * spread ** 2
    return x, P
