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
Limits of the checks of a recording, where robot and data do not give them.

Values are assumed, between what clean simulated drives and real recordings show and what the
faults in the tests of the checks show, unless another origin is given.
"""

import math

MIN_READINGS = 20       # of a stream or in motion, for a statistic of it
SIGMAS = 3.0            # standard errors beyond which a value is a contradiction
TOLERANCE = 0.1         # relative, of a parameter that is reported and of a ratio of units
MIN_CORRELATION = 0.5   # of yaw rate and wheel difference, in magnitude, and of both films
CORRELATION_TIME = 2.0  # s over which slip and motor torques are correlated
REST_MARGIN = 1.0       # s before and after motion in which the body may settle
MIN_SPEED = 0.5         # rad/s, of the wheel that shows motion
RATIO_TOLERANCE = 0.03  # relative, of two quantities of one message; 60 and 57.3 are units
SCALE_RATIO = 1.4        # of wheels that turn equally; 1.2 of worn tires or slip on one side
MIN_TICKS_PER_RAD = 80.0  # of wheel speeds in ticks/s: 500 per revolution; above deg/s
MIN_CARRIED_RATE = 0.1  # rad/s, standard deviation of the yaw rate of a robot that turns
MAX_STILL_FACTOR = 1.5  # of the spread at rest, of an IMU that does not move

# Messages
MIN_RATE = {'imu/data': 20.0, 'wheel_states': 4.0}  # Hz, docs/topics.md; two periods are a gap
RATE_TOLERANCE = 0.2         # relative, from the nominal rate; beyond, it is worth a line
FILM_RATE_TOLERANCE = 0.02   # relative, from film.sample_rate
MAX_REJECTED_SHARE = 0.01    # of the messages of a topic; above, it is an error
MIN_GAP_PERIODS = 1.5        # of the median period: a lost message gives 2, jitter rarely 1.5
MAX_MISSED_SHARE = 0.05      # of film samples lost, one crossing in twenty; of IMU samples held
MAX_JITTER = 0.3             # standard deviation of the period over the period
MAX_DELAY = 0.5              # s, from timestamp to reception, and between those of two inputs
MAX_LEAD = 0.05              # s, of a timestamp before reception: clocks differ
MAX_LATENESS = 0.25          # s after the promptest message; cmd_vel_timeout of wheel_controller
MIN_STALL = 0.1              # s; a radio batch of 16 samples is collected for 0.04 s
MIN_WARNINGS = 2             # equal ones of a node, one a second; a single one is a transient
MAX_DRIFT = 200e-6           # s/s; crystals differ by up to 100e-6
MIN_DRIFT_CHANGE = 0.010     # s, over the recording
DRIFT_BLOCKS = 20            # whose smallest delays give the drift

MIN_STAMP_STEP = 0.01        # of the mean time between receptions: stamps of another unit
MAX_OTHER_SHARE = 0.05       # of the messages from a second publisher
OTHER_FACTOR = 5.0           # of what it differs by, over the change between its neighbors
MAX_HELD_TIME = 0.25         # s for which a device of 4 Hz holds a sample; longer: it is stuck

# IMU, wheels and tire
MIN_FROZEN_TIME = 0.5        # s for which no sensor with noise repeats a value ...
FROZEN_YAW_RATE = 0.3        # rad/s ... while the wheels change their yaw rate by this much ...
FROZEN_SPEED = 0.3           # m/s ... or their speed by this much from a constant acceleration
MIN_PINNED = 5               # samples in a row at the largest value of a saturated gyro
SATURATED_SHARE = 0.8        # of the yaw rate over that of the wheels below saturation
GRAVITY_TOLERANCE = 0.03     # relative: bias and scale error of a consumer-grade accelerometer
REMOVED_GRAVITY = 0.3        # of gravity; a smaller specific force is that without gravity
MAX_TILT = math.radians(10.0)  # of the mounting and of the ground
BIAS_SIGMAS = 5.0            # of imu.gyro_bias
EXCHANGED_SHARE = 0.3        # of the speed difference of the wheels of a side, if exchanged
STUCK_SHARE = 0.02           # of the speed of the other wheel of its side
MIN_TORQUE_CORRELATION = 0.2  # of motor torques and acceleration; 0.4 to 0.7 in simulated drives
MAX_FORCE_WEIGHTS = 3.0      # of the motors over the weight: friction coefficients are below 2
# C_x / F_z. Below 3 mu, 3 mu F_z / C_x exceeds 1: the patch never slides fully, so that friction
# is not observable. The other limit is twice the 30 of passenger car tires.
ASSUMED_FRICTION, MAX_STIFFNESS_RATIO = 0.5, 60.0

# Wheels against IMU
MAX_SIGMA = 0.3          # relative standard error above which a value says nothing
MAX_SLIP = 0.3           # slip on soft ground: the body is slower than its wheels, not faster
MIN_SIGNAL = 0.1         # m/s2 or m/s per s, rms: what 0.6 degrees of slope mimic
MIN_FOLLOWING = 0.95     # correlation of wheels and yaw rate that shows a delay; 0.86 on ice
MIN_FIRM_FOLLOWING = 0.99  # the same on firm ground; 0.97 on simulated ice
MIN_YAW_RATE = 0.1       # rad/s rms of a recording with turns
MAX_YAW = math.radians(25.0)  # of the IMU; forces in real drives are within 10 degrees of x
CLEAR_CORRELATION = 0.8  # of yaw rate and mean speed, if one side is reversed; 0.86 on ice
CLEAR_RESIDUAL = 0.85    # of the residual with the other sign of the yaw rate
MIN_TURN_SHARE = 0.1     # of the turns, to the side to which there are fewer
NO_TURN = 0.1            # of the yaw rate of the wheels; robots turn with a third of it at least
MIN_TRACK_RATIO, MAX_TRACK_RATIO = 0.9, 4.0  # effective over geometric track: skid-steer 1 to 3
MIN_LATENCY_ERROR = 0.03  # s; half a period of wheel_states at 16 Hz
MAX_LEVER_ERROR = 0.1    # m, also of its standard error: in steady turns radius and lever mix
UNIT_TOLERANCE = 0.4     # relative, of a radius ratio that names a unit of the wheel speeds: slip

# Films
REST_TOLERANCE = 0.1        # V
CLIPPED_SHARE, MOSTLY_CLIPPED = 0.01, 0.1  # of the samples; a crossing is an eighth of them
MIN_REVOLUTIONS = 3.0       # for the checks of crossings
DEAD_SIGMAS = 4.0           # spread of the signal of a rolling wheel, in standard deviations
CROSSING_SIGMAS = 10.0      # of the noise, of the signal of a crossing
QUIET_TIME_SHARE = 0.2      # of a mean revolution, that separates two crossings
MIN_RUN = 1.2               # revolutions in one direction
LOW_BATTERY = 3.3           # V; a lithium-ion cell is nearly empty
