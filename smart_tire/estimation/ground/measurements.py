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
Measurements of a window, and what the model of the motion predicts for them.

Block means over ``BLOCK`` steps of yaw rate, of the specific force of the IMU along both axes and
of the four motor torques; slip and normalized slip of each crossing of a wheel's films.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.estimation.ground import body_model as model
from smart_tire.estimation.ground.unknowns import (
    BLOCK, BLOCK_TIME, DYNAMIC, FILM_ERRORS, FILM_NORMALIZED_ERROR, FILM_SLIP_ERROR, GAINS,
    Interval, LEAST_FORCE, LEAST_FRICTION, LEAST_NORMALIZED, MODEL_ERROR,
    MODEL_TIME, MOTORS, OFFSETS, RELAXATION_ERROR, SIZE, SLIDING_WEIGHT, START,
    TIME_STEP, TIMING_ERROR, TRANSIENT_SHARE, Unknown, UNMEASURED)
from smart_tire.estimation.ground.wheel_motion import (
    block_means, block_spread, rate_weights, sample_means, smoothed)
from smart_tire.models.tire.brush_tire import slope_at
from smart_tire.models.vehicle.drive import DRY_FRICTION_SPEED, friction_torque, torque_errors
from smart_tire.models.vehicle.skid_steer import MIN_LOAD, SLIP_FLOOR
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GRAVITY, WHEELS

YAW_RATE, FORCE_X, FORCE_Y, TORQUE = range(4)  # streams of block means; four of torques
STREAMS = TORQUE + len(WHEELS)
LOGARITHMS = [*range(Unknown.LATERAL_SHARE), Unknown.LATERAL_RATIO, Unknown.RADIUS,
              *range(Unknown.SIDE_STIFFNESS, Unknown.DELAY)]  # of parameters of the model
CROSSING_STEPS = np.arange(-3, 3)  # around a crossing, over which its motion is averaged: 0.1 s


class MeasuredCrossing(NamedTuple):
    """Slip and normalized slip of a film pair in the patch."""

    time: float        # s, in the middle of the patch
    wheel: int         # index in WHEELS
    slip: float        # -, B(3)
    normalized_slip: float  # -, t = |s| / lambda_cr
    covariance: Array  # (2, 2)
    sliding: bool      # the whole patch slides: only slip / t is determined

    @property
    def measured(self) -> tuple[float, float]:
        """Return the slip, and its product with the normalized slip if that is determined."""
        return self.slip, self.normalized_slip * (1.0 if self.sliding else self.slip)

    def by_slips(self, slip: float, normalized: float) -> Array:
        """Return the derivatives (2, 2) of the measured quantities by slip and normalized slip."""
        return np.array([[1.0, 0.0], [0.0, 1.0] if self.sliding else [normalized, slip]])


@dataclass(frozen=True, eq=False)
class WindowData:
    """Samples of a window, times in s in ascending order."""

    imu: Array       # (n, 4): time, yaw rate [rad/s], specific force x, y [m/s2] in base axes
    wheels: Array    # (m, 9): time, angles [rad], motor torques [N m], NaN where not measured
    crossings: list[MeasuredCrossing]


@dataclass(frozen=True, eq=False)
class WindowMotion:
    """Simulated motion of all runs."""

    events: Array      # (runs, 10), as in ``Hypothesis``
    parameters: Array  # (groups, PARAMETERS, lanes), of the model
    states: Array      # (groups, n, OUTPUTS, lanes)
    means: Array       # (OUTPUTS, runs, blocks)

    @property
    def velocities(self) -> Array:
        """Return the velocity (n, 3) of the center of mass in the first run."""
        return self.states[0, :, :model.W + 1, 0]


class Measurements:
    """
    The measurements from ``begin`` to ``end`` [s], and their model.

    Those before ``first`` are not used: the model forgets its start there.
    """

    def __init__(self, robot: RobotParams, data: WindowData, begin: float, first: float,
                 end: float) -> None:
        self._robot, motor = robot, robot.motor
        self._torque_noise, _ = torque_errors(motor)
        blocks = int((end - begin) / BLOCK_TIME + 1e-6)
        self.begin = begin = end - blocks * BLOCK_TIME
        self.times: Array = begin + TIME_STEP * np.arange(1.0, blocks * BLOCK + 1.0)
        self.edges: Array = begin + BLOCK_TIME * np.arange(blocks + 1.0)
        self.centers: Array = self.edges[1:] - 0.5 * BLOCK_TIME
        self.used = self.edges[:-1] > first - 0.5 * BLOCK_TIME
        near = data.wheels[(data.wheels[:, 0] > begin - 0.3) & (data.wheels[:, 0] <= end)]
        motion = smoothed(near[:, 0], near[:, 1:5], robot.encoder.stamp_jitter,
                          math.tau / robot.encoder.counts_per_revolution / math.sqrt(12.0))
        radius = robot.wheel_radius
        weights = rate_weights(motion.times, np.append(begin, self.times))
        self.rates = weights[1:] @ motion.angles
        self.rolling = np.ascontiguousarray(radius * self.rates)
        self.acceleration = np.gradient(self.rates, TIME_STEP, axis=0)
        period = float(np.median(np.diff(motion.times)))
        self._speed_errors = motion.errors(radius * weights[::BLOCK])
        self.spread = block_spread(self.acceleration, self.edges, self.times, period)
        mean_imu, self.imu_count = sample_means(data.imu, self.edges)
        mean_wheels, self.torque_count = sample_means(
            near[np.isfinite(near[:, 5:]).all(axis=1)], self.edges)
        self.values = np.vstack([mean_imu.T, mean_wheels[:, 4:].T])  # (STREAMS, blocks)
        self.set_crossings([one for one in data.crossings if first < one.time <= end])
        self._heading_data = data.imu
        self._inertia_torque = motor.inertia * block_means(self.acceleration).T
        self._moving = block_means(self.rates).T
        mean = 0.5 * np.abs(np.diff(np.eye(blocks + 1), axis=0))
        self._difference = mean @ self._speed_errors[1] @ mean.T  # (m/s)^2, of the sides
        # m^2, (4, blocks): an encoder count of a stationary wheel is a large slip. The robot
        # follows the mean of its wheels and the difference of its sides, but not the other two
        self._slip_noise = 2.0 * np.diag(self._difference) * (radius / np.maximum(
            np.abs(radius * self._moving), SLIP_FLOOR)) ** 2
        self.robot_constants = np.array([
            TIME_STEP, robot.mass, robot.yaw_inertia, 0.5 * robot.wheelbase,
            0.5 * robot.track_width, robot.center_of_mass[2] + radius, SLIP_FLOOR,
            DRY_FRICTION_SPEED, GRAVITY])
        self._delayed = radius * 0.5 * (self.acceleration[:, :2] + self.acceleration[:, 2:])

    def set_crossings(self, crossings: list[MeasuredCrossing]) -> None:
        """Set the crossings of films in the window."""
        self.crossings = crossings
        self.crossing_measured = np.array([value for one in crossings for value in one.measured])
        self._products = np.array([not one.sliding for one in crossings], dtype=bool)
        self._times = np.array([one.time for one in crossings])
        self._wheels = np.array([one.wheel for one in crossings], dtype=np.intp)
        self._row_times = np.concatenate([np.tile(self.centers, STREAMS),
                                          np.repeat(self._times, 2)])

    @property
    def travel(self) -> float:
        """Return the mean distance [m] that the wheels roll over the whole window."""
        return float(np.abs(self.rolling).mean()) * TIME_STEP * len(self.rolling)

    def heading(self, gyro_bias: float, reference: tuple[float, float]) -> Array:
        """
        Return the heading [rad] at ``times``.

        ``reference``: time [s] and heading there.
        """
        time, rate = self._heading_data[:, 0], self._heading_data[:, 1]
        turned = np.concatenate([[0.0], np.cumsum(
            0.5 * (rate[1:] + rate[:-1]) * np.diff(time))]) - gyro_bias * time
        at = np.interp([reference[0], *self.times], time, turned)
        heading: Array = reference[1] + at[1:] - at[0]
        return heading

    def simulate(self, x: Array, start: Array, heading: Array, events: Array,
                 relaxation: float | Array = 0.0) -> WindowMotion:
        """
        Return the motion for each row of ``x`` (runs, SIZE).

        ``start`` (3,): velocity of the center of mass at ``begin``; ``heading`` (n,) [rad];
        ``events`` (runs, 10) as in ``Hypothesis``; ``relaxation`` length of the tires [m],
        of all runs or of each (runs,).
        """
        runs = self._parameters(x, events)
        runs[:, model.RELAXATION] = relaxation
        runs[:, START] += start
        parameters = model.grouped(runs)
        states, means = (
            np.empty((len(parameters), n, model.OUTPUTS, parameters.shape[2]))
            for n in (len(self.times), len(self.centers)))
        model.simulate(
            self.rolling, self._delayed, np.column_stack([np.cos(heading), np.sin(heading)]),
            parameters, self.robot_constants, states, means)
        return WindowMotion(
            events, parameters, states, model.ungrouped(means, len(x)).transpose(2, 0, 1))

    def _parameters(self, x: Array, events: Array) -> Array:
        """Return the parameters of the model (runs, PARAMETERS) without its start."""
        runs = np.zeros((len(x), model.PARAMETERS))
        runs[:, :DYNAMIC] = x[:, :DYNAMIC]
        runs[:, LOGARITHMS] = np.exp(x[:, LOGARITHMS])
        runs[:, model.LATERAL_SHARE] = 1.0 / (1.0 + np.exp(-x[:, Unknown.LATERAL_SHARE]))
        runs[:, model.NEW:model.LIFT] = np.searchsorted(self.times, events[:, :4])
        lifts = events[:, 4:].reshape(len(x), 2, 3).copy()
        lifts[:, :, 1:] = np.searchsorted(self.times, lifts[:, :, 1:])
        runs[:, model.LIFT:] = lifts.reshape(len(x), 6)
        return runs

    def predict(self, x: Array, motion: WindowMotion) -> Array:
        """Return the block means (runs, STREAMS, blocks) for ``x`` (runs, SIZE)."""
        means, robot = motion.means, self._robot
        arm_x, arm_y = (
            robot.imu.position[axis] + (x[:, Unknown.IMU_X + axis]
                                        - x[:, Unknown.COM_X + axis])[:, np.newaxis]
            for axis in (0, 1))
        square = means[model.SQUARE]
        found = np.empty((len(x), STREAMS, len(self.centers)))
        a_x, a_y, w_dot = means[model.A_X:model.FORCE]
        found[:, YAW_RATE] = means[model.W]
        found[:, FORCE_X] = a_x - w_dot * arm_y - square * arm_x
        found[:, FORCE_Y] = a_y + w_dot * arm_x - square * arm_y
        found[:, :TORQUE] += x[:, Unknown.GYRO_BIAS:Unknown.ACCEL_BIAS_Y + 1, np.newaxis]
        radius = robot.wheel_radius * np.exp(x[:, Unknown.RADIUS])[:, np.newaxis, np.newaxis]
        force, loads = means[model.FORCE:model.SQUARE].reshape(
            2, 4, *means.shape[1:]).transpose(0, 2, 1, 3)
        torque = radius * force + (
            np.exp(x[:, Unknown.MOTOR_FRICTION, np.newaxis, np.newaxis]) * friction_torque(
                self._moving, loads, robot.motor, robot.wheel_radius)
            + np.exp(x[:, Unknown.MOTOR_INERTIA, np.newaxis, np.newaxis]) * self._inertia_torque)
        scale = np.exp(-x[:, Unknown.TORQUE_SCALE, np.newaxis] - x[:, MOTORS])
        found[:, TORQUE:] = scale[:, :, np.newaxis] * torque + x[:, OFFSETS, np.newaxis]
        return found

    def linear(self, x: Array, predicted: Array, motion: WindowMotion) -> Array:
        """
        Return the derivatives (STREAMS, blocks, SIZE - DYNAMIC) by the other unknowns.

        ``motion`` is that of ``x`` (SIZE,), its first run.
        """
        found = np.zeros((*predicted.shape, SIZE - DYNAMIC))
        for stream in range(TORQUE):
            found[stream, :, stream] = 1.0
        for i in range(4):
            motor = x[Unknown.TORQUE_OFFSET + i] - predicted[TORQUE + i]
            found[TORQUE + i, :, Unknown.TORQUE_SCALE - DYNAMIC] = motor
            found[TORQUE + i, :, Unknown.MOTOR_SCALE - DYNAMIC + i] = motor
            found[TORQUE + i, :, Unknown.TORQUE_OFFSET - DYNAMIC + i] = 1.0
        means = motion.means[:, 0]
        square = means[model.SQUARE]
        by_arm = found[FORCE_X:TORQUE, :, Unknown.IMU_X - DYNAMIC:]
        by_arm[0, :, 0], by_arm[0, :, 1] = -square, -means[model.W_DOT]
        by_arm[1, :, 0], by_arm[1, :, 1] = means[model.W_DOT], -square
        scale = np.exp(-x[Unknown.TORQUE_SCALE] - x[MOTORS])[:, np.newaxis]
        loads = means[model.LOADS:model.SQUARE]
        friction = friction_torque(
            self._moving, loads, self._robot.motor, self._robot.wheel_radius)
        for row, torque in ((Unknown.MOTOR_FRICTION, friction),
                            (Unknown.MOTOR_INERTIA, self._inertia_torque)):
            found[TORQUE:, :, row - DYNAMIC] = math.exp(x[row]) * scale * torque
        return found

    def crossing_values(self, x: Array, values: Array) -> Array:
        """
        Return the measured quantities of the crossings (runs, 2 * crossings) for ``x``.

        ``values`` are those of ``at_crossings``.
        """
        found, wheels = values[:, :, :2].copy(), self._wheels
        found[:, :, 0] *= np.exp(x[:, GAINS])[:, wheels]
        found[:, self._products, 1] *= found[:, self._products, 0]
        found[:, :, 1] += self._products * x[:, FILM_ERRORS][:, wheels]
        return found.reshape(len(x), -1)

    def slip_noise(self, x: Array, predicted: Array) -> Array:
        """
        Return the variances [(N m)^2] (4, blocks) of torques by errors of wheel speeds.

        ``predicted`` (STREAMS, blocks).
        """
        limit = 0.25 * self._robot.mass * GRAVITY * self._robot.wheel_radius * math.exp(
            x[Unknown.FRICTION])
        slope = math.exp(x[Unknown.STIFFNESS]) * slope_at(
            np.minimum(np.abs(predicted[TORQUE:]) / limit, 1.0))
        return slope ** 2 * self._slip_noise

    def noise(self, predicted: Array, transient: Array, biases: Array, slip_noise: Array) -> Array:
        """
        Return the covariances (STREAMS, blocks, blocks) of the block means.

        ``predicted`` (STREAMS, blocks), ``transient`` (STREAMS, blocks) its change by a relaxation
        length, ``biases`` (3,) those of the IMU, ``slip_noise`` as of the method of that name.
        """
        robot, count = self._robot, len(self.centers)
        imu = np.maximum(self.imu_count, 1)
        force = np.maximum(np.hypot(*(predicted[FORCE_X:TORQUE] - biases[1:, np.newaxis])),
                           LEAST_FORCE)
        least_torque = 0.25 * robot.mass * robot.wheel_radius * LEAST_FORCE
        size = np.vstack([predicted[:1] - biases[0], force[np.newaxis], force[np.newaxis],
                          np.maximum(np.abs(predicted[TORQUE:]), least_torque)])
        change = np.diff(np.eye(count + 1), axis=0) / BLOCK_TIME
        common, difference = self._speed_errors[0], self._difference
        effective = robot.motor.inertia + 0.25 * robot.mass * robot.wheel_radius ** 2
        white = np.hypot(TIMING_ERROR * np.gradient(predicted, BLOCK_TIME, axis=1),
                         RELAXATION_ERROR * transient)
        white[YAW_RATE] = np.hypot(white[YAW_RATE], np.hypot(
            robot.imu.gyro_noise / np.sqrt(imu), 1e-3))
        white[FORCE_X:TORQUE] = np.hypot(
            white[FORCE_X:TORQUE], robot.imu.accel_noise / np.sqrt(imu))
        white[TORQUE:] = np.sqrt(
            white[TORQUE:] ** 2 + self._torque_noise ** 2 / np.maximum(self.torque_count, 1)
            + (TRANSIENT_SHARE * effective * self.spread.T) ** 2 + slip_noise)
        white[:TORQUE, self.imu_count == 0] = UNMEASURED
        white[TORQUE:, self.torque_count == 0] = UNMEASURED
        white[:, ~self.used] = UNMEASURED
        lasting = MODEL_ERROR * size
        found = (np.exp(-np.abs(self.centers[:, np.newaxis] - self.centers) / MODEL_TIME)
                 * lasting[:, :, np.newaxis] * lasting[:, np.newaxis])
        found[YAW_RATE] += difference / (0.5 * robot.track_width) ** 2
        found[FORCE_X] += change @ common @ change.T
        found[FORCE_Y] += difference
        found[:, range(count), range(count)] += white ** 2
        return found

    def within(self, interval: Interval) -> NDArray[np.bool_]:
        """Return whether each row of block means and crossings lies in ``interval`` [s]."""
        found: NDArray[np.bool_] = (self._row_times >= interval[0]) & (
            self._row_times <= interval[1])
        return found

    def crossing_noise(self, predicted: Array, transient: Array, loads: Array) -> Array:
        """
        Return the covariance of the crossings; ``predicted`` (2 * crossings,).

        ``transient`` (2 * crossings,) is its change by a relaxation length. ``loads`` (crossings,)
        [N]: a normalized slip is that of the load on the wheel.
        """
        times, wheels = self._times, self._wheels
        lasting = np.exp(-np.abs(times[:, np.newaxis] - times) / MODEL_TIME) * (
            wheels[:, np.newaxis] == wheels)
        slip = predicted[::2]
        normalized = np.maximum(np.divide(predicted[1::2], slip, out=predicted[1::2].copy(),
                                          where=self._products & (slip != 0.0)), LEAST_NORMALIZED)
        found = np.zeros((len(predicted), len(predicted)))
        found[::2, ::2] = lasting * (FILM_SLIP_ERROR[0] ** 2 * np.outer(slip, slip)
                                     + FILM_SLIP_ERROR[1] ** 2)
        own = FILM_NORMALIZED_ERROR * normalized * np.maximum(
            0.25 * self._robot.mass * GRAVITY / loads, 1.0)
        found[1::2, 1::2] = lasting * np.outer(own, own)
        for i, one in enumerate(self.crossings):
            rows, by_slips = slice(2 * i, 2 * i + 2), one.by_slips(slip[i], normalized[i])
            found[rows] = by_slips @ found[rows]
            found[:, rows] = found[:, rows] @ by_slips.T
            at = one.by_slips(one.slip, one.normalized_slip)
            measured = np.array([one.slip, one.normalized_slip])
            found[rows, rows] += at @ one.covariance @ at.T + (
                one.sliding * SLIDING_WEIGHT ** 2 * np.outer(measured, measured)
                + (np.outer(transient[rows], transient[rows]) if one.sliding  # slip / t stays
                   else np.diag(transient[rows] ** 2)))
        return found

    def at_crossings(self, motion: WindowMotion) -> Array:
        """Return the values of ``at`` (runs, crossings, 5) at the crossings of the window."""
        return self.at(self._times, self._wheels, motion)

    def at(self, times: Array, wheels: NDArray[np.intp], motion: WindowMotion) -> Array:
        """
        Return slip, normalized slip, load [N], traction force [N], ln loss (runs, m, 5).

        They are those of ``wheels`` (m,) around ``times`` (m,) [s]. The last one is the logarithm
        of the friction at this slip over the largest one.
        """
        count = motion.means.shape[1]
        if not len(wheels):
            return np.empty((count, 0, model.VALUES))
        near = np.searchsorted(self.times, times)[:, np.newaxis] + CROSSING_STEPS  # (m, k)
        begins, ends = (motion.events[:, 2 * (wheels % 2) + one] for one in (0, 1))
        after = ((begins <= times) & (times < ends)).astype(float)
        groups, _, width = motion.parameters.shape
        found = np.empty((groups, len(wheels), model.VALUES, width))
        model.average_crossings(
            motion.states, self.rolling, self._delayed, model.grouped(after),
            np.minimum(np.maximum(near, 0), len(self.times) - 1), wheels, MIN_LOAD,
            LEAST_FRICTION, motion.parameters, self.robot_constants, found)
        values = model.ungrouped(found, count)
        values[:, :, model.LOSS] = np.log(values[:, :, model.LOSS]) / len(CROSSING_STEPS)
        return values
