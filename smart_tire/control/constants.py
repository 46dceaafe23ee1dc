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
Constants of the control: value, unit, meaning; origin; the run that needs it.

What a user may want to change is a parameter. Runs are files of ``test/control``, and scenarios of
``benchmarks.control``.
"""

import math

import numpy as np

from smart_tire.arrays import Array, Instants
from smart_tire.samples import NS_PER_S

TINY = 1e-9  # in any unit, of denominators

# -- time ----------------------------------------------------------------------------------------
CLOCK_JUMP_NS = NS_PER_S  # by which timestamps of a new clock go back; assumed; test_traction
MAX_GAP_NS = 500_000_000  # between estimates or readings whose difference is a rate of change;
#                           assumed: wheel_states at 4 Hz; test_ground_motion
HISTORY_NS = 3 * NS_PER_S  # kept of past values; more than two readings at 1 Hz; test_wheel_servo
MAX_STEP_PERIODS = 4  # time step of a controller; assumed; test_wheel_control: a late step

# -- validity of commands ------------------------------------------------------------------------
MIN_STALL_NS = 250_000_000    # between ticks of a stopped process; assumed; safety: stopped nodes
QUEUE_DRAIN_NS = 100_000_000  # after it, to read queued messages; assumed; the same
# after it, until the transport repeats a lost message; period of the heartbeats of Fast DDS
REPAIR_NS = 3 * NS_PER_S
TICK_PERIOD = 0.025           # s, a tenth of the shortest stall that must be detected; derived
MIN_PUBLISHER_WINDOW = 1.5    # s after its latest message that a publisher counts, longer than a
#                               line fault; assumed; test_publishers
PUBLISHER_WINDOW_TIMEOUTS = 2.0  # the same in time-outs: a slow publisher counts; assumed
MAX_PUBLISHERS = 64           # of one topic, whose transit times are known; assumed; fuzz
MIN_PAUSE_NS = NS_PER_S       # without a duty, to reset a trip; above their period; test_duty_gate
MAX_SEQUENCE_GAP = 1000       # numbers of one publisher: its lost messages; assumed; test_commands

# -- standstill ----------------------------------------------------------------------------------
# m/s and rad/s, of estimates; three sigma at rest; test_path_follower
STANDSTILL_SPEED, STANDSTILL_RATE = 0.02, 0.05
STANDSTILL_WHEEL_SPEED = 0.1  # rad/s; resolution of readings; test_wheel_hold
# -, holds on slopes of 35 degrees, and is below ``stall_duty`` of motor_driver: a wheel that
# stands at this duty is not taken for a blocked one; derived; test_wheel_hold
MAX_HOLD_DUTY = 0.25

# -- readings of the wheels ----------------------------------------------------------------------
MAX_READING = 100.0  # rad/s, of a measurement; as motor_driver; test_wheel_feedback
# gaps whose median is the period, arrivals of which the earliest relates both clocks; assumed
PERIODS, ARRIVALS = 5, 32
MAX_LATENESS_NS = 100_000_000  # after the earliest arrival; more: the clocks differ; assumed
MIN_PERIOD_NS, MAX_PERIOD_NS = 100_000, 2 * NS_PER_S  # between plausible timestamps; assumed
MAX_GAP_RATIO = 1.5    # gap over period, above: a reading was lost; derived; lost readings
MAX_AGE_PERIODS = 2.0  # of a reading that advances integrals; assumed; test_wheel_servo
LINE_DELAY = 0.005     # s, of a duty or a reading on the serial line; assumed; test_wheel_servo
# Of the wheel's own inertia, added by the derivative. With a delay the loop is stable below 1 for
# the true acceleration; readings give its mean of the past, with noise; derived; test_drive_model
MAX_DERIVATIVE_SHARE = 0.25

# -- motors -------------------------------------------------------------------------------------
MOTOR_EVIDENCE = 0.1   # s, squared duties times time, that is kept: 0.7 for 0.2 s; assumed
MOTOR_MARGIN = 0.002   # s, by which another delay must be likelier; assumed; test_motor_response
MODEL_ERROR = 0.2      # of a duty, by supply and heat: motor_tolerance of motor_driver; assumed
DUTY_ERROR = 0.05      # -, by friction and mean speeds; assumed; test_motor_response

# -- motion in odom ------------------------------------------------------------------------------
YAW_JUMP = 0.5  # rad, more than the yaw rates explain; assumed; test_ground_motion
TWIST_WINDOW_NS = 800_000_000  # of poses that contradict the twist; named within 1 s; derived
MAX_TWIST_ERROR = 0.03, 0.1  # m, rad, in half of it: noise of poses; assumed; test_ground_motion

# -- friction of the ground ----------------------------------------------------------------------
# -: wet ice 0.02; rubber on asphalt 0.8 to 0.9 (Wong, Theory of Ground Vehicles, table 1.3), above
# 1 only for soft compounds; wrong_estimates
MIN_FRICTION, MAX_FRICTION = 1e-3, 1.2
PRIOR_SIGMA = 0.15         # -, friction of unknown ground; assumed; slippery_unknown

# -- traction control ----------------------------------------------------------------------------
ONSET_DELAY = 0.05  # s, from an onset until the robot accelerates; measured; split, sand_unknown

# -- motion along a path -------------------------------------------------------------------------
# s, of bases and motors, that are learned; the step, below the period of commands, also of
# predictions; assumed; test_base_response, test_motor_response
DELAY_STEP = 0.025
DELAYS: Array = DELAY_STEP * np.arange(25, dtype=np.float64)
DELAYS_NS: Instants = np.round(NS_PER_S * DELAYS).astype(np.int64)
# (m/s)^2 s, unexplained by the present delay beyond this multiple of what another leaves: noise of
# odom, slips that are not of first order; assumed; test_base_response, reverse parking on sand
DELAY_MARGIN, DELAY_RATIO = 1e-4, 2.0
# s, lags of speed and yaw rate that the given delay contains: control of the wheels, relaxation of
# the tires; measured, 6 robots; drawn
USUAL_LAGS = 0.05, 0.2
LATERAL_SHARE = 0.8   # of friction for lateral acceleration, on a circle; test_motion_limits
PLANNED_SHARE = 0.85  # of deceleration in plans, the rest is for control; assumed; tracking
COMMAND_SHARE = 1.1   # of the largest speed and yaw rate, commanded; assumed; test_command_bounds
DONE_SHARE = 0.5      # of the yaw tolerance; the rest is for the rotation that is left; corners
# In turns in place, of the motion that leads to the position to hold: m/s, bound; rad of the turn
# at whose end a distance left costs as much as a speed; steps of the rest; tuned; drawn: square
MAX_HOLD_SPEED, HOLD_ANGLE, HOLD_STEPS = 0.2, 0.33, 12
PROJECTION_WINDOW = 0.2  # m, and twice the distance driven since; assumed; crossings of a path
# s, for standstill between maneuvers, and after the last command: longer than the time-outs of
# bases (0.25 to 0.5 s), after which they release the motors and twisted tires unwind; assumed;
# test_path_follower, test_stop_conditions
RELEASE_TIME = 1.0
# of the tolerances, within which it has arrived: noise of poses, and motion on slopes after the
# motors are released, of 5 mm/s; measured, 200 goals; test_stop_conditions
ARRIVED_SHARE = 0.9
MAX_APPROACHES = 2       # that are repeated; assumed; test_stop_conditions
MAX_ALIGN_FACTOR = 2.0   # of align_angle, while driving; assumed; test_path_follower

# -- geometry of paths ---------------------------------------------------------------------------
GRID_STEP = 0.02         # m, between the points of a segment; assumed; test_path_geometry
SMOOTHING_WINDOW = 0.15  # m, of averages of the direction; tuned; test_path_geometry
# Points of a grid: m, its largest cells, and of a cell, error of the positions; assumed. Points
# that are averaged: two stairs of a line that rises by one cell in five; test_path_geometry
MAX_CELL, CELL_TOLERANCE, SMOOTHED_CELLS = 0.1, 0.05, 9
MIN_SPACING = 0.002      # m; nearer poses have one position; assumed; test_path_plan
CHORD_LENGTH = 0.03      # m, about a point, for the angle of a corner; assumed; test_path_plan
YAW_AGREEMENT, MIN_SPIN = math.radians(30.0), math.radians(10.0)  # rad; assumed; test_path_plan
MIN_AGREEING_SHARE = 0.75  # of the length; assumed; test_path_plan

# -- compensation of slip ------------------------------------------------------------------------
GATE = 5.0         # -, spreads to which innovations are clipped; assumed; one outlier
SPREAD_TIME = 1.0  # s, of the mean over squared innovations; assumed; change of ground
# m/s, of slip velocities and v_y around the model: least, at the start; measured; tracking
MIN_SPREAD, SPREAD = 5e-3, 0.02
# averaged for one correction; ten estimates at 125 Hz, and motion that belongs to a slip; CPU time
SLIP_WINDOW_NS = 80_000_000
# of the wanted speed and the largest yaw rate, by which feedback changes them; assumed;
# test_command_bounds
MAX_SPEED_SHARE, MAX_YAW_SHARE = 0.5, 0.3
TURNING_LENGTH = 0.2  # -, of the turning share, correlation length of tires; tuned; tracking
# slip velocity over speed: mean, sigma and range of the prior, firm ground to sand; assumed; sand
RESISTANCE = 0.01, 0.15, -0.05, 0.5
WIDENING_SIGMA, MAX_WIDENING = 0.5, 2.5  # of the track, over it; most in narrow turns on sand
# Of motions in the fit of the slide: difference of the share of the turn within which they are
# similar, and m/s around the model; tuned; drawn. rad, slip angle on a slope: 4 degrees over C_y
# of the softest ground; derived
SIMILAR_TURNING, SLIDE_SPREAD, SLIDE_SIGMA = 0.08, 0.01, 0.05
# In turns in place, where tires are near the limit of friction: sigma of the slide, beyond that of
# the way before, and of the point about which the robot turns, m; measured, 30 robots; drawn
SPIN_SLIDE_SIGMA, PIVOT_SIGMA = 0.2, 0.03
AHEAD_WEIGHT = 0.3  # of slips, which changes of speed cause, too; tuned; square on sand
MAX_SLIDE = 0.4  # of the speed of the wheels: a fit to the onset may be more; tuned; drawn: square

# -- conditions to stop --------------------------------------------------------------------------
WINDOW_NS = 500_000_000  # of the comparison: a stop within 1 s also with readings at 4 Hz; derived
# m in the window, from which on it is judged. A start with 0.5 m/s2 takes 0.45 s for it, in which
# odometry that lags by 0.2 s, with plausible stamps, has seen 0.3 of it: more than 1 - max_slip.
MIN_DISTANCE = 0.05  # derived; test_stop_conditions
MIN_ADVANCE, MIN_TURN = 0.02, 0.04  # m, rad, of progress; resolution of odom; test_stop_conditions
MAX_WAIT = 10.0  # s, for the first odometry; start of the estimators; test_stop_conditions
