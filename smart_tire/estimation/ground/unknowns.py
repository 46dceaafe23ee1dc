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
What the window estimates: names, priors, how fast each quantity may change; all constants.

Each constant has its unit, its origin and the runs that are worse without it: rows of
``benchmarks.robots``, or a test.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.ground.body_model import LIFT, PARAMETERS
from smart_tire.estimation.streams import GROUND_STATE_PERIOD_NS
from smart_tire.models.tire.brush_tire import (
    LATERAL_SHARE, LN_FRICTION, LN_LATERAL_RATIO, LN_RESISTANCE, LN_STIFFNESS)
from smart_tire.models.vehicle.drive import torque_errors
from smart_tire.models.vehicle.skid_steer import SIDE_SIGNS
from smart_tire.parameters.robot import MOUNTING_TILT, RobotParams
from smart_tire.samples import GRAVITY, NS_PER_S, WHEELS
from smart_tire.uncertain import Uncertain


class Unknown(IntEnum):
    """Rows of the vector of unknowns; the motion depends on those before ``GYRO_BIAS``."""

    STIFFNESS = 0         # ln C_x [N]
    FRICTION = 1          # ln mu
    RESISTANCE = 2        # ln f, rolling resistance over the load
    OLD_STIFFNESS = 3     # of a second ground, while the window has one: the sides change
    OLD_FRICTION = 4
    OLD_RESISTANCE = 5
    LATERAL_SHARE = 6     # logit, of the rolling resistance along the velocity
    LATERAL_RATIO = 7     # ln C_y / C_x
    COM_X = 8             # m, center of mass in base_link
    COM_Y = 9
    RADIUS = 10           # ln of the true over the nominal wheel radius
    SLOPE_X = 11          # rad, rise of the ground along the axes of the start
    SLOPE_Y = 12
    SIDE_STIFFNESS = 13   # ln of C_x under the left side over the geometric mean of both sides
    SIDE_FRICTION = 14
    SIDE_RESISTANCE = 15
    DELAY = 16            # s, of the wheels' stamps, and of the forces by the relaxation length
    FALL = 17             # -, share of the friction that is lost at the largest slip
    MOVED_LOAD = 18       # -, of the load of a lifted wheel, to the one across from it
    BEND_X = 19           # rad, change of the slope over the window
    BEND_Y = 20
    START_U = 21          # m/s, error of the velocity at the start of the window
    START_V = 22
    START_W = 23          # rad/s
    GYRO_BIAS = 24        # rad/s
    ACCEL_BIAS_X = 25     # m/s2, including the tilt of the mounting
    ACCEL_BIAS_Y = 26
    TORQUE_SCALE = 27     # ln of the true over the nominal torque constant, of all motors
    MOTOR_FRICTION = 28   # ln of the true over the nominal friction of gears and axles
    MOTOR_INERTIA = 29    # ln of the true over the nominal inertia of wheel, gear and rotor
    IMU_X = 30            # m, error of the position of the IMU
    IMU_Y = 31
    MOTOR_SCALE = 32      # four rows: the same of each motor
    TORQUE_OFFSET = 36    # four rows: N m, of the measured torque, with the friction of the motor
    FILM_GAIN = 40        # four rows, by wheel: ln of the true over the nominal stretch gain
    FILM_ERROR = 44       # four rows, by wheel: lasting error of slip times normalized slip


SIZE = Unknown.FILM_ERROR + len(WHEELS)
DYNAMIC = int(Unknown.GYRO_BIAS)
GROUND = slice(Unknown.STIFFNESS, Unknown.OLD_STIFFNESS)
OLD_GROUND = slice(Unknown.OLD_STIFFNESS, Unknown.LATERAL_SHARE)
SIDES = slice(Unknown.SIDE_STIFFNESS, Unknown.DELAY)
START = slice(Unknown.START_U, Unknown.GYRO_BIAS)
MOVED = slice(Unknown.MOVED_LOAD, Unknown.BEND_X)
CURVE = (
    Unknown.STIFFNESS, Unknown.FRICTION, Unknown.OLD_STIFFNESS, Unknown.OLD_FRICTION,
    Unknown.SIDE_STIFFNESS, Unknown.SIDE_FRICTION, Unknown.FALL)  # of the force over the slip
OWN = slice(Unknown.BEND_X, Unknown.GYRO_BIAS)  # of each window: not known from the one before
MOTORS = slice(Unknown.MOTOR_SCALE, Unknown.TORQUE_OFFSET)
OFFSETS = slice(Unknown.TORQUE_OFFSET, Unknown.FILM_GAIN)
GAINS = slice(Unknown.FILM_GAIN, Unknown.FILM_ERROR)
FILM_ERRORS = slice(Unknown.FILM_ERROR, SIZE)
ROBOT = [*range(Unknown.LATERAL_RATIO, Unknown.SLOPE_X), *range(Unknown.TORQUE_SCALE, SIZE)]

# priors, in the unit of the unknown; those of the ground are in ``models.tire.brush_tire``
FALL = Uncertain(0.15, 0.1)         # 0 (a brush) to .45, assumed
SLOPE_SIGMA = 0.03                  # rad, and of their change over a window; assumed; hills
SIDE_SIGMA = 0.03                   # differences of the sides: uneven tires and ground; split
START_SIGMA = 0.1                   # m/s, rad/s, assumed
DELAY_SIGMA = 0.008                 # s, unknown latency; slow_turn
MIN_RADIUS_SIGMA = 0.006            # the radius of a loaded tire, assumed
MOTOR_SIGMA = 0.5                   # friction and inertia of a drive: data sheet; gears
MOTOR_SCALE_SIGMA = 0.015           # torque constant of a motor: magnets, assumed
MOVED_LOAD = Uncertain(-0.4, 0.5)   # -1: the others carry the load; 0: what lifts the wheel does;
# .2: and lifts its corner; lifted
# random walks in sigmas of the prior, assumed: a ground without a sudden change and ...
GROUND_WALK = 0.04                  # per sqrt(m); jumps
PLACE_WALK = 0.3                    # ... slopes and differences of the sides, per sqrt(m); hills
WALK = 0.03                         # of sensors and robot, per sqrt(s)
DERIVATIVE_STEP = 0.001             # numerical; friction on ice changes with it

# window
LENGTH = 3.0            # s, of the window, assumed; concrete
SETTLING = 0.5          # s before, in which the model forgets its start; before that, of samples
# that are smoothed with it; assumed
MAX_GAP = 0.6           # s, of a stream: after a longer one the window restarts; assumed
TIME_STEP = 0.016       # s, of the model
BLOCK = 8               # steps of a block mean, slower than a wheel period; slow_readings
BLOCK_TIME = TIME_STEP * BLOCK

# fit
MAX_ITERATIONS = 10     # Gauss-Newton steps, and changes of the times of an event; ice
CONVERGED = 1.0         # twice the log likelihood that a step gains, at least, for a further one
FREEDOM = 5.0           # degrees of freedom of the Student distribution; lifted, pushes
REWEIGHTINGS = 4        # iterations of such weights in a linear fit
MAX_STEP = 0.7          # change of the ground in one step; beyond, the model is not linear
HOP = GROUND_STATE_PERIOD_NS / NS_PER_S  # s, between two windows
CANDIDATES = 3          # hops before the end, when something may have happened: events are tried
# from a hop before on; jumps, lifted
DISTURBANCE_TIME = 1.0  # s, of a push, assumed; pushes
TIME_ERROR = 0.15       # s, of the time of an event, by blocks: before and after it is not used
EVENT_EVIDENCE = 8.0    # twice the log likelihood ratio of an event, and of one that is tried: 2
# ln 55, assumed; jumps, pushes, lifted, slow_readings

# errors
MODEL_ERROR = 0.05      # of forces, yaw rates and torques: tire curve, uneven tires, assumed
MODEL_TIME = 1.0        # s, correlation time of the errors of the model, assumed; NEES
LEAST_FORCE = 0.3       # m/s2, on which that share is taken at least; torques: the same force
TIMING_ERROR = 0.006    # s, of the model: latencies that differ; slow_turn
RELAXATION_ERROR = 2.0  # of the effect of a relaxation length of half the contact, that of a
# brush: the carcass adds to it, and close to standstill no such law holds; straight
NOISE_SIGMAS = 3.0      # of the effect of errors of wheel speeds on a torque, beyond which its
# derivatives by the curve of a tire count: below, they are the effect of these errors; straight
TRANSIENT_SHARE = 0.3   # of the change of acceleration within a wheel period: error of torques
FILM_SLIP_ERROR = 0.02, 0.002  # relative and absolute error of a film's slip; NEES
FILM_NORMALIZED_ERROR = 0.04  # relative error of a normalized slip; NEES
FILM_SHAPE_ERROR = 0.0026  # of the bending peak, over the stretch at full slip: systematic part of
# the covariance of waveform fits at small slip, and spread of their means; straight
LEAST_NORMALIZED = 0.1  # -, on which such shares are taken at least; low slip
SLIDING_WEIGHT = 10.0   # of a crossing in full sliding: sigma over its slip along slip / t
TENSION = 2.0           # sigmas of a prior, beyond which an error of sensors or robot takes what
# the model cannot: the covariance grows by the square of their ratio; beyond which a difference
# of the sides has a wider prior; gears, straight, split
CURVE_ERROR = 0.03      # of mu: it varies with the slip where the tire is not a brush; NEES
MAX_SIGMA = 0.35        # of ln mu, and of what films measure: above, a quantity is unknown

# bounds
UNMEASURED = 1e6        # standard deviation of a block without measurement
LEAST_FRICTION = 0.2    # share of the friction that is left at the largest slip, at least


Interval = tuple[float, float]  # s


class Row(NamedTuple):
    """Prior of one unknown, all in its unit."""

    mean: float
    sigma: float
    walk: float = 0.0    # standard deviation of its change in one second
    ground: float = 0.0  # ... and over one meter of travel


def priors(robot: RobotParams) -> list[Row]:
    """Return the priors of all unknowns in the order of ``Unknown``, for this robot."""
    imu, motor, tire, film, u = robot.imu, robot.motor, robot.tire, robot.film, Unknown
    found: dict[int, Row] = {}

    def add(rows: Iterable[int], mean: float, sigma: float, walk: float = 0.0,
            ground: float = 0.0) -> None:
        found.update(dict.fromkeys(rows, Row(mean, sigma, walk * sigma, ground * sigma)))

    # the stiffness as known, on a ground that differs
    add((u.STIFFNESS, u.OLD_STIFFNESS),
        math.log(tire.longitudinal_stiffness) + LN_STIFFNESS.value,
        math.hypot(LN_STIFFNESS.sigma, tire.longitudinal_stiffness_sigma), ground=GROUND_WALK)
    add((u.FRICTION, u.OLD_FRICTION), *LN_FRICTION, ground=GROUND_WALK)
    add((u.RESISTANCE, u.OLD_RESISTANCE), *LN_RESISTANCE, ground=GROUND_WALK)
    add((u.LATERAL_SHARE,), *LATERAL_SHARE, ground=GROUND_WALK)
    add((u.FALL,), *FALL, ground=GROUND_WALK)
    add((u.SLOPE_X, u.SLOPE_Y), 0.0, SLOPE_SIGMA, ground=PLACE_WALK)
    add(_rows(SIDES), 0.0, SIDE_SIGMA, ground=PLACE_WALK)
    add((u.LATERAL_RATIO,), *LN_LATERAL_RATIO, WALK)
    add((u.DELAY,), 0.0, DELAY_SIGMA, WALK)
    add((u.RADIUS,), 0.0, max(robot.wheel_radius_sigma, MIN_RADIUS_SIGMA), WALK)
    add((u.GYRO_BIAS,), 0.0, imu.gyro_bias, WALK)
    add((u.ACCEL_BIAS_X, u.ACCEL_BIAS_Y), 0.0, math.hypot(
        imu.accel_bias, GRAVITY * MOUNTING_TILT), WALK)
    add((u.TORQUE_SCALE,), 0.0, motor.torque_constant_sigma, WALK)
    add((u.MOTOR_FRICTION, u.MOTOR_INERTIA), 0.0, MOTOR_SIGMA)
    add(_rows(MOTORS), 0.0, MOTOR_SCALE_SIGMA, WALK)
    add(_rows(OFFSETS), 0.0, torque_errors(motor)[1], WALK)
    add(_rows(GAINS), 0.0, film.stretch_gain_tolerance / math.sqrt(film.count), WALK)
    add(_rows(FILM_ERRORS), 0.0, _product_error(robot))
    for row, value, sigma in zip(
            (u.COM_X, u.COM_Y), robot.center_of_mass, robot.center_of_mass_sigma):
        add((row,), value, sigma)
    add((u.IMU_X, u.IMU_Y), 0.0, max(imu.position_sigma, 1e-6))
    add((u.MOVED_LOAD,), *MOVED_LOAD)
    add((u.BEND_X, u.BEND_Y), 0.0, SLOPE_SIGMA)
    add(_rows(START), 0.0, START_SIGMA)
    return [found[row] for row in range(SIZE)]


def _rows(part: slice) -> range:
    return range(SIZE)[part]


def _product_error(robot: RobotParams) -> float:
    """Return the lasting error of slip times normalized slip: of the shape of a waveform."""
    film = robot.film
    return FILM_SHAPE_ERROR / robot.tire.contact_length * max((
        peak / gain for wheel in film.wheels
        for peak, gain in zip(film.bending(wheel), film.gains(wheel))), default=1.0)


# names of the rows of sensors and robot
ERRORS = {row: first.name.lower() + f'_{row - first}' * (row > first)
          for row in (*range(Unknown.COM_X, Unknown.SLOPE_X), Unknown.DELAY,
                      *range(Unknown.GYRO_BIAS, SIZE))
          for first in [max(one for one in Unknown if one <= row)]}


class Tension(NamedTuple):
    """The error of a sensor or of the robot that is largest over the sigma of its prior."""

    name: str
    size: float  # sigmas

    @classmethod
    def of(cls, x: Array, rows: Sequence[Row]) -> Tension:
        """Return that of the unknowns ``x`` (SIZE,) with the priors ``rows``."""
        sizes = {row: abs(float(x[row]) - rows[row].mean) / rows[row].sigma for row in ERRORS}
        most = max(sizes, key=sizes.__getitem__)
        return cls(ERRORS[most], sizes[most])


class WindowPrior(NamedTuple):
    """Mean and covariance of the unknowns."""

    mean: Array        # (SIZE,)
    covariance: Array  # (SIZE, SIZE)

    def without(self, part: slice, rows: list[Row]) -> WindowPrior:
        """Return this prior if of the unknowns ``part`` no more is known than in ``rows``."""
        mean, covariance = self.mean.copy(), self.covariance.copy()
        covariance[part], covariance[:, part] = 0.0, 0.0
        for row in range(part.start, part.stop):
            mean[row], covariance[row, row] = rows[row].mean, rows[row].sigma ** 2
        return WindowPrior(mean, covariance)

    def with_change(self, rows: list[Row]) -> WindowPrior:
        """Return this prior if the ground changes to an unknown one: the present becomes old."""
        mean, covariance = self.mean.copy(), self.covariance.copy()
        mean[OLD_GROUND] = mean[GROUND]
        covariance[OLD_GROUND] = covariance[GROUND]
        covariance[:, OLD_GROUND] = covariance[:, GROUND]
        return WindowPrior(mean, covariance).without(GROUND, rows)

    def after(self, seconds: float, travel: float, rows: list[Row]) -> WindowPrior:
        """Return this prior after a random walk for ``seconds`` and ``travel`` [m]."""
        variance = [row.walk ** 2 * seconds + row.ground ** 2 * travel for row in rows]
        return WindowPrior(self.mean, self.covariance + np.diag(variance))


def initial(rows: list[Row]) -> WindowPrior:
    """Return the prior on an unknown ground."""
    return WindowPrior(np.array([row.mean for row in rows]),
                       np.diag([row.sigma ** 2 for row in rows]))


ALWAYS, NEVER = (-math.inf, math.inf), (math.inf, math.inf)  # intervals
ONE_GROUND = ALWAYS, ALWAYS  # of both sides


class Lift(NamedTuple):
    """A wheel without load."""

    wheel: int = -1          # index in WHEELS; -1: none
    begin: float = math.inf  # s
    end: float = math.inf    # s


MAX_LIFTS = (PARAMETERS - LIFT) // len(Lift._fields)  # in a window: the model has as many


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What is known before a window."""

    prior: WindowPrior
    x: Array                    # start of the fit
    new: tuple[Interval, Interval] = ONE_GROUND  # s, in which the left and the right side are on
    # GROUND; else they are on OLD_GROUND
    lifts: tuple[Lift, ...] = ()  # in the window, two at most
    disturbances: tuple[Interval, ...] = ()  # with errors of unknown size
    times: Array | None = None  # s, of the velocities in the window before; None without one
    velocities: Array | None = None  # (n, 3), of the center of mass
    heading: tuple[float, float] = (0.0, 0.0)  # s, rad: a time and the heading there

    @property
    def events(self) -> Array:
        """Return begin and end of both sides' ``new``, and of lifts wheel, begin and end (10,)."""
        lifts = (*self.lifts, *[Lift()] * MAX_LIFTS)[:MAX_LIFTS]
        return np.array([value for one in (*self.new, *lifts) for value in one])

    def ground(self, side: int, time: float) -> slice:
        """Return the unknowns of the ground under a side, 0 left, 1 right, at ``time`` [s]."""
        begin, end = self.new[side]
        return GROUND if begin <= time < end else OLD_GROUND

    def is_disturbed(self, time: float) -> bool:
        """Return whether measurements at ``time`` [s] are not used: an event, or a disturbance."""
        return any(begin <= time <= end for begin, end in self.disturbances)

    def settled(self, begin: float, rows: list[Row]) -> Hypothesis:
        """
        Return this for a window from ``begin`` [s] on that has no change of ground any more.

        Sides on two grounds are then one ground with a difference of the sides.
        """
        if self.new == ONE_GROUND or any(begin <= time < math.inf for one in self.new
                                         for time in one):
            return self
        to_one = self.one_ground(begin)
        mean, covariance = self.prior
        prior = WindowPrior(to_one @ mean, to_one @ covariance @ to_one.T)
        return replace(self, new=ONE_GROUND, prior=prior.without(OLD_GROUND, rows),
                       x=to_one @ self.x)

    def one_ground(self, time: float) -> Array:
        """
        Return the matrix (SIZE, SIZE) to unknowns of which ``GROUND`` is that at ``time`` [s].

        That of the sides is its mean and the difference of the sides.
        """
        found, rows = np.eye(SIZE), np.arange(SIZE)
        found[GROUND] = 0.0
        for side, sign in enumerate(SIDE_SIGNS[:2]):
            own = rows[self.ground(side, time)]
            found[rows[GROUND], own] += 0.5
            found[rows[SIDES], own] += 0.5 * sign
        return found
