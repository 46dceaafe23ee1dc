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
    block_means, block_spread, central_differences, rate_weights, sample_means, smoothed)
from smart_tire.models.tire.brush_tire import slope_at
from smart_tire.models.vehicle.drive import DRY_FRICTION_SPEED, friction_torque, torque_errors
from smart_tire.models.vehicle.skid_steer import MIN_LOAD, SLIP_FLOOR
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GRAVITY, WHEELS

YAW_RATE, FORCE_X, FORCE_Y, TORQUE = range(4)  # streams of block means; four of torques
STREAMS = TORQUE + len(WHEELS)
LOGARITHMS = np.isin(np.arange(DYNAMIC), [  # of parameters of the model
    *range(Unknown.LATERAL_SHARE), Unknown.LATERAL_RATIO, Unknown.RADIUS,
    *range(Unknown.SIDE_STIFFNESS, Unknown.DELAY)])
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

    @property
    def noise(self) -> Array:
        """Return the covariance (2, 2) of the measured quantities."""
        if self.sliding:
            return self.covariance + SLIDING_WEIGHT ** 2 * np.outer(self.measured, self.measured)
        by_slips = np.array([[1.0, 0.0], [self.normalized_slip, self.slip]])
        return by_slips @ self.covariance @ by_slips.T


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
        self._robot, motor, imu = robot, robot.motor, robot.imu
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
        self.rolling: Array = radius * self.rates
        self.acceleration = central_differences(self.rates, TIME_STEP)
        gaps = np.sort(np.diff(motion.times))
        period = 0.5 * float(gaps[len(gaps) // 2] + gaps[(len(gaps) - 1) // 2])  # the median
        self.spread = block_spread(self.acceleration, self.edges, self.times, period)
        mean_imu, self.imu_count = sample_means(data.imu, self.edges)
        mean_wheels, self.torque_count = sample_means(
            near[np.isfinite(near[:, 5:]).all(axis=1)], self.edges)
        self.values = np.vstack([mean_imu.T, mean_wheels[:, 4:].T])  # (STREAMS, blocks)
        self.set_crossings([one for one in data.crossings if first < one.time <= end])
        self._heading_data = data.imu
        self._inertia_torque = motor.inertia * block_means(self.acceleration).T
        moving = block_means(self.rates).T
        self._idle, loaded = (friction_torque(moving, load, motor, radius) for load in (0.0, 1.0))
        self._by_load = loaded - self._idle  # m, change of the friction torque
        common, sides = motion.errors(radius * weights[::BLOCK])
        # (m/s2)^2 and (m/s)^2, of the blocks: acceleration of the mean, difference of the sides
        self._common = np.diff(np.diff(common, axis=0), axis=1) / BLOCK_TIME ** 2
        sides = 0.5 * (sides[1:] + sides[:-1])
        self._difference = 0.5 * (sides[:, 1:] + sides[:, :-1])
        # m^2, (4, blocks): an encoder count of a stationary wheel is a large slip. The robot
        # follows the mean of its wheels and the difference of its sides, but not the other two
        self._slip_noise = 2.0 * np.diagonal(self._difference) * (radius / np.maximum(
            np.abs(radius * moving), SLIP_FLOOR)) ** 2
        # variances of the values by their sensors, and by what happens within a wheel period
        effective = motor.inertia + 0.25 * robot.mass * radius ** 2
        self._variance = np.empty_like(self.values)
        self._variance[:TORQUE] = np.array([
            [imu.gyro_noise], [imu.accel_noise], [imu.accel_noise]]) ** 2 / np.maximum(
                self.imu_count, 1)
        self._variance[YAW_RATE] += 1e-6
        self._variance[TORQUE:] = (
            torque_errors(motor)[0] ** 2 / np.maximum(self.torque_count, 1)
            + (TRANSIENT_SHARE * effective * self.spread.T) ** 2)
        self._variance[:TORQUE, self.imu_count == 0] = UNMEASURED ** 2
        self._variance[TORQUE:, self.torque_count == 0] = UNMEASURED ** 2
        self._variance[:, ~self.used] = UNMEASURED ** 2
        self.robot_constants = np.array([
            TIME_STEP, robot.mass, robot.yaw_inertia, 0.5 * robot.wheelbase,
            0.5 * robot.track_width, robot.center_of_mass[2] + radius, SLIP_FLOOR,
            DRY_FRICTION_SPEED, GRAVITY])
        self._delayed = radius * 0.5 * (self.acceleration[:, :2] + self.acceleration[:, 2:])

    def set_crossings(self, crossings: list[MeasuredCrossing]) -> None:
        """Set the crossings of films in the window."""
        self.crossings = crossings
        self.crossing_measured = np.array([value for one in crossings for value in one.measured])
        self._crossing_noise = np.array([one.noise for one in crossings]).reshape(-1, 2, 2)
        self._products = np.array([not one.sliding for one in crossings], dtype=bool)
        self._times = np.array([one.time for one in crossings])
        self._wheels = np.array([one.wheel for one in crossings], dtype=np.intp)
        self.row_times = np.concatenate([np.tile(self.centers, STREAMS),
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
        turned = -gyro_bias * time
        turned[1:] += np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time))
        at = np.interp(np.append(reference[0], self.times), time, turned)
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
        runs = np.zeros((len(x), model.PARAMETERS))
        runs[:, :DYNAMIC] = np.where(LOGARITHMS, np.exp(x[:, :DYNAMIC]), x[:, :DYNAMIC])
        runs[:, model.LATERAL_SHARE] = 1.0 / (1.0 + np.exp(-x[:, Unknown.LATERAL_SHARE]))
        runs[:, START] += start
        runs[:, model.RELAXATION] = relaxation
        runs[:, model.NEW:] = np.searchsorted(self.times, events)
        runs[:, model.LIFT::3] = events[:, 4::3]  # the wheels
        parameters = model.grouped(runs)
        states, means = (
            np.empty((len(parameters), n, model.OUTPUTS, parameters.shape[2]))
            for n in (len(self.times), len(self.centers)))
        model.simulate(
            self.rolling, self._delayed, np.stack([np.cos(heading), np.sin(heading)], axis=1),
            parameters, self.robot_constants, states, means)
        return WindowMotion(events, parameters, states, means.transpose(2, 0, 3, 1).reshape(
            model.OUTPUTS, -1, len(self.centers))[:, :len(x)])

    def predict(self, x: Array, motion: WindowMotion) -> Array:
        """Return the block means (runs, STREAMS, blocks) for ``x`` (runs, SIZE)."""
        means, robot, rows = motion.means, self._robot, x.T[:, :, np.newaxis]
        arm_x, arm_y = (
            robot.imu.position[axis] + rows[Unknown.IMU_X + axis] - rows[Unknown.COM_X + axis]
            for axis in (0, 1))
        square = means[model.SQUARE]
        found = np.empty((STREAMS, *means.shape[1:]))
        a_x, a_y, w_dot = means[model.A_X:model.FORCE]
        found[YAW_RATE] = means[model.W]
        found[FORCE_X] = a_x - w_dot * arm_y - square * arm_x
        found[FORCE_Y] = a_y + w_dot * arm_x - square * arm_y
        found[:TORQUE] += rows[Unknown.GYRO_BIAS:Unknown.ACCEL_BIAS_Y + 1]
        torque = (
            robot.wheel_radius * np.exp(rows[Unknown.RADIUS]) * means[model.FORCE:model.LOADS]
            + np.exp(rows[Unknown.MOTOR_FRICTION]) * self._friction(motion)
            + np.exp(rows[Unknown.MOTOR_INERTIA]) * self._inertia_torque[:, np.newaxis])
        found[TORQUE:] = (np.exp(-rows[Unknown.TORQUE_SCALE] - rows[MOTORS]) * torque
                          + rows[OFFSETS])
        return found.transpose(1, 0, 2)

    def _friction(self, motion: WindowMotion) -> Array:
        """Return the friction torques [N m] of the drives (4, runs, blocks)."""
        return (self._idle[:, np.newaxis]
                + self._by_load[:, np.newaxis] * motion.means[model.LOADS:model.SQUARE])

    def linear(self, x: Array, predicted: Array, motion: WindowMotion) -> Array:
        """
        Return the derivatives (STREAMS, blocks, SIZE - DYNAMIC) by the other unknowns.

        ``motion`` is that of ``x`` (SIZE,), its first run.
        """
        found = np.zeros((*predicted.shape, SIZE - DYNAMIC))
        streams, motors = np.arange(TORQUE), np.arange(len(WHEELS))
        found[streams, :, streams] = 1.0
        torques = found[TORQUE:]
        by_scale = x[OFFSETS, np.newaxis] - predicted[TORQUE:]
        torques[:, :, Unknown.TORQUE_SCALE - DYNAMIC] = by_scale
        torques[motors, :, Unknown.MOTOR_SCALE - DYNAMIC + motors] = by_scale
        torques[motors, :, Unknown.TORQUE_OFFSET - DYNAMIC + motors] = 1.0
        means = motion.means[:, 0]
        square = means[model.SQUARE]
        by_arm = found[FORCE_X:TORQUE, :, Unknown.IMU_X - DYNAMIC:]
        by_arm[0, :, 0], by_arm[0, :, 1] = -square, -means[model.W_DOT]
        by_arm[1, :, 0], by_arm[1, :, 1] = means[model.W_DOT], -square
        scale = np.exp(-x[Unknown.TORQUE_SCALE] - x[MOTORS])[:, np.newaxis]
        for row, torque in ((Unknown.MOTOR_FRICTION, self._friction(motion)[:, 0]),
                            (Unknown.MOTOR_INERTIA, self._inertia_torque)):
            torques[:, :, row - DYNAMIC] = math.exp(x[row]) * scale * torque
        return found

    def crossing_values(self, x: Array, values: Array) -> Array:
        """
        Return the measured quantities of the crossings (runs, 2 * crossings) for ``x``.

        ``values`` are those of ``at_crossings``.
        """
        found, wheels = values[:, :, :2].copy(), self._wheels
        found[:, :, 0] *= np.exp(x[:, GAINS])[:, wheels]
        found[:, :, 1] *= np.where(self._products, found[:, :, 0], 1.0)
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
        robot = self._robot
        size = predicted.copy()
        size[YAW_RATE] -= biases[0]
        size[FORCE_X:TORQUE] = np.maximum(np.hypot(
            *(predicted[FORCE_X:TORQUE] - biases[1:, np.newaxis])), LEAST_FORCE)
        size[TORQUE:] = np.maximum(
            np.abs(predicted[TORQUE:]), 0.25 * robot.mass * robot.wheel_radius * LEAST_FORCE)
        lasting = MODEL_ERROR * size
        found: Array = (np.exp(-np.abs(self.centers[:, np.newaxis] - self.centers) / MODEL_TIME)
                        * lasting[:, :, np.newaxis] * lasting[:, np.newaxis])
        found[YAW_RATE] += self._difference / (0.5 * robot.track_width) ** 2
        found[FORCE_X] += self._common
        found[FORCE_Y] += self._difference
        own = found.reshape(STREAMS, -1)[:, ::len(self.centers) + 1]  # the diagonals
        own += (TIMING_ERROR * central_differences(predicted.T, BLOCK_TIME).T) ** 2
        own += (RELAXATION_ERROR * transient) ** 2 + self._variance
        own[TORQUE:] += slip_noise
        return found

    def within(self, interval: Interval) -> NDArray[np.bool_]:
        """Return whether each row of block means and crossings lies in ``interval`` [s]."""
        found: NDArray[np.bool_] = (self.row_times >= interval[0]) & (
            self.row_times <= interval[1])
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
        slips = lasting * (FILM_SLIP_ERROR[0] ** 2 * np.outer(slip, slip)
                           + FILM_SLIP_ERROR[1] ** 2)
        own = FILM_NORMALIZED_ERROR * normalized * np.maximum(
            0.25 * self._robot.mass * GRAVITY / loads, 1.0)
        # derivatives of the second of the measured quantities by both slips
        by_slip = np.where(self._products, normalized, 0.0)
        own *= np.where(self._products, slip, 1.0)
        found = np.empty((len(slip), 2, len(slip), 2))
        found[:, 0, :, 0] = slips
        found[:, 0, :, 1] = slips * by_slip
        found[:, 1, :, 0] = found[:, 0, :, 1].T
        found[:, 1, :, 1] = by_slip[:, np.newaxis] * found[:, 0, :, 1] + lasting * np.outer(
            own, own)
        changes = transient.reshape(-1, 2, 1) * transient.reshape(-1, 1, 2)
        changes[self._products] *= np.eye(2)  # of those that slide, slip / t stays
        index = np.arange(len(slip))
        found[index, :, index] += self._crossing_noise + changes
        return found.reshape(len(predicted), len(predicted))

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
        new = motion.events[:, :4].reshape(-1, 2, 2)[:, wheels % 2]
        after = ((new[:, :, 0] <= times) & (times < new[:, :, 1])).astype(float)
        groups, _, width = motion.parameters.shape
        found = np.empty((groups, len(wheels), model.VALUES, width))
        model.average_crossings(
            motion.states, self.rolling, self._delayed, model.grouped(after),
            np.minimum(np.maximum(near, 0), len(self.times) - 1), wheels, MIN_LOAD,
            LEAST_FRICTION, motion.parameters, self.robot_constants, found)
        values = model.ungrouped(found, count)
        values[:, :, model.LOSS] = np.log(values[:, :, model.LOSS]) / len(CROSSING_STEPS)
        return values
