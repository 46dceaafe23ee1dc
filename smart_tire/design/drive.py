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
What a drive shows of the ground without films, and what patch crossings on it add.

A drive is simulated. The measurements in each window of the ground estimator are then replaced by
those that its model predicts for the truth, so that its fit stays there: derivatives, noise,
priors and random walks are the estimator's. The information of the motion does not depend on the
films. That of the crossings is added to it, window by window, as the estimator does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.contact.trajectory import WheelTrajectory
from smart_tire.estimation.ground import body_model as model
from smart_tire.estimation.ground.measurements import (
    MeasuredCrossing, Measurements, WindowData, WindowMotion)
from smart_tire.estimation.ground.unknowns import (
    CURVE_ERROR, DYNAMIC, FILM_ERRORS, HOP, Hypothesis, initial, LENGTH,
    OLD_GROUND, OWN, priors, SETTLING, SIZE, Tension, Unknown, WindowPrior)
from smart_tire.estimation.ground.window import Solution
from smart_tire.estimation.ground.window_fit import start_of, WindowFit
from smart_tire.models.vehicle.skid_steer import SIDE_SIGNS
from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.simulation import SimulatorParams, SurfaceParams
from smart_tire.samples import ImuSample, NS_PER_S, WHEELS, WheelSample
from smart_tire.simulation.offline import simulate

EXACT_COUNTS = 1e6  # encoder counts per revolution of the simulated drive
AVERAGED = 6        # ends of windows, the last 3 s of a drive: all angles of the wheels


class Ground(NamedTuple):
    """A surface."""

    name: str
    stiffness: float  # N, C_x of a tire on it
    friction: float   # -, mu
    drag: float       # -, rolling resistance over the load


class DriveSchedule(NamedTuple):
    """Set points of the wheel speeds."""

    name: str
    legs: tuple[tuple[float, float, float], ...]  # start [s], left and right [rpm]
    duration: float  # s


DRIVES = {name: DriveSchedule(name, legs, 10.0) for name, legs in {
    'turn': ((1.0, 60.0, 80.0),), 'fast_turn': ((1.0, 120.0, 60.0),),
    's_curves': ((1.0, 100.0, 60.0), (2.5, 60.0, 100.0), (4.0, 100.0, 60.0), (5.5, 60.0, 100.0),
                 (7.0, 100.0, 60.0), (8.5, 60.0, 100.0)),
    'straight': ((1.0, 80.0, 80.0), (3.0, 0.0, 0.0), (4.0, 80.0, 80.0), (6.0, 0.0, 0.0),
                 (7.0, 80.0, 80.0), (9.0, 0.0, 0.0))}.items()}


class Place(NamedTuple):
    """An instant of a wheel on a drive."""

    time: float   # s
    speed: float  # m/s, r w
    slip: float   # -, B(3)
    normalized_slip: float  # -, t


class Window(NamedTuple):
    """A window of the estimator at the truth, without films."""

    first: float        # s, begin of the measurements that are used
    leaving: float      # s, begin of those of the next window
    solution: Solution
    relaxed: WindowMotion  # with a relaxation length
    predicted: dict[tuple[tuple[float, int, bool], ...], tuple[Array, ...]]  # of crossings


class _TrueFit(WindowFit):
    """The fit with the local derivative by the friction, as a bound has it."""

    def _friction_step(self, x: Array, covariance: Array) -> float:
        return float(self.steps[Unknown.FRICTION])


class DriveInformation:
    """Information of a drive on one ground; ``torque``: motor torques are measured."""

    def __init__(self, robot: RobotParams, ground: Ground, drive: DriveSchedule,
                 torque: bool = True) -> None:
        self.robot = replace(robot, imu=replace(
            robot.imu, rotation=(0.0, 0.0, 0.0), gyro_scale=1.0))
        self.ground, self.drive, self.torque = ground, drive, torque
        data, self.trajectories = self._simulated()
        self._rows = priors(self.robot)
        self._fit = _TrueFit(self.robot, self._rows)
        self._prior = initial(self._rows).covariance
        x = initial(self._rows).mean
        x[:OLD_GROUND.start] = x[OLD_GROUND] = np.log(ground[1:])
        begin, end = data.wheels[0, 0], min(data.imu[-1, 0], data.wheels[-1, 0])
        self._whole = Measurements(self.robot, data, begin, begin, end)
        heading = self._whole.heading(0.0, (begin, 0.0))
        self._truth = Hypothesis(WindowPrior(x, self._prior), x)
        self._events = self._truth.events[np.newaxis]
        self._motion = self._whole.simulate(x[np.newaxis], np.zeros(3), heading, self._events)
        self._truth = replace(self._truth, times=self._whole.times,
                              velocities=self._motion.velocities)
        self.windows = [self._window(data, heading, float(one))
                        for one in np.arange(begin + LENGTH, end, HOP)]

    def _window(self, data: WindowData, heading: Array, end: float) -> Window:
        begin = max(end - LENGTH - SETTLING, self._whole.begin)
        first = max(begin, end - LENGTH)
        leaving = first + HOP if begin < first else -math.inf  # as in the estimator
        measurements = Measurements(self.robot, data, begin, first, end)
        truth = replace(self._truth, heading=(measurements.begin, float(np.interp(
            measurements.begin, self._whole.times, heading))))
        x = truth.x[np.newaxis]
        motion, relaxed = (
            measurements.simulate(x, *start_of(truth, measurements), self._events, length)
            for length in (0.0, 0.5 * self.robot.tire.contact_length))
        measurements.values = measurements.predict(x, motion)[0]
        fit = self._fit.fit(truth, measurements, leaving, near=True)
        return Window(first, leaving, Solution(end, measurements, truth, fit, Tension('', 0.0)),
                      relaxed, {})

    def covariances(self, crossings: Sequence[MeasuredCrossing], products: Array
                    ) -> list[Array]:
        """
        Return the covariance of the unknowns at the end of each window, with ``crossings``.

        ``products`` (4,) are standard deviations of ``Unknown.FILM_ERROR`` in addition to the
        prior, by wheel.
        """
        found, prior = [], self._prior.copy()
        prior[range(SIZE)[FILM_ERRORS], range(SIZE)[FILM_ERRORS]] += products**2
        for window in self.windows:
            information, measurements = np.linalg.inv(prior), window.solution.measurements
            fit, end = window.solution.fit, window.solution.end
            inside = [one for one in crossings if window.first < one.time <= end]
            films, leaving = self._of_films(window, inside)
            found.append(np.linalg.inv(
                information + fit.rows.jacobian.T @ fit.rows.jacobian + films))
            travel = measurements.travel * HOP / (end - measurements.begin)
            prior = WindowPrior(self._truth.x, np.asarray(np.linalg.inv(
                information + fit.leaving[0] + leaving))).after(
                HOP, travel, self._rows).without(OWN, self._rows).covariance
        return found

    def sigmas(self, crossings: Sequence[MeasuredCrossing], products: Array, wheels: Sequence[int]
               ) -> list[float]:
        """
        Return the relative standard deviation of mu after the drive, and that of the slip.

        They are rms over the indices ``wheels`` and over the ends of the last windows: at one end,
        they depend on the angle of the wheels.
        """
        variances = []
        for covariance, window in zip(
                self.covariances(crossings, products)[-AVERAGED:], self.windows[-AVERAGED:]):
            _, slopes = window.solution.values_at(window.solution.end, wheels)
            rows = np.zeros((2, len(wheels), SIZE))
            rows[:, :, :DYNAMIC] = slopes[:, [model.LOSS, model.SLIP]].transpose(1, 0, 2)
            rows[0, :, Unknown.FRICTION] += 1.0
            rows[0, :, Unknown.SIDE_FRICTION] += [SIDE_SIGNS[wheel] for wheel in wheels]
            variances.append(np.mean(np.sum(rows @ covariance * rows, axis=2), axis=1))
        friction, slip = np.sqrt(np.mean(variances, axis=0)).tolist()
        return [math.hypot(friction, CURVE_ERROR), slip]

    def _of_films(self, window: Window, crossings: list[MeasuredCrossing]
                  ) -> tuple[Array, Array]:
        """Return the information matrices of ``crossings`` in ``window``, and of those leaving."""
        if not crossings:
            return np.zeros((SIZE, SIZE)), np.zeros((SIZE, SIZE))
        values, relaxed, load, columns = self._predicted(window, crossings)
        noise = window.solution.measurements.crossing_noise(values, relaxed - values, load)
        early = np.repeat([one.time < window.leaving for one in crossings], 2)
        whole: Array = columns.T @ np.linalg.solve(noise, columns)
        return whole, columns[early].T @ np.linalg.solve(
            noise[np.ix_(early, early)], columns[early])

    def _predicted(self, window: Window, crossings: list[MeasuredCrossing]) -> tuple[Array, ...]:
        """
        Return values (2 n,), those with a relaxation length, loads [N] (n,), derivatives.

        They depend on the places of the crossings, but not on their covariance.
        """
        fit, measurements = window.solution.fit, window.solution.measurements
        measurements.set_crossings(crossings)
        key = tuple((one.time, one.wheel, one.sliding) for one in crossings)
        if key not in window.predicted:
            varied = measurements.at_crossings(fit.varied)[fit.shown]
            relaxed = measurements.at_crossings(window.relaxed)
            values = measurements.crossing_values(fit.varied_x, varied)
            steps = np.append(np.diagonal(fit.varied_x[1:] - fit.varied_x[0]), 1.0)
            window.predicted[key] = (
                values[0], measurements.crossing_values(fit.varied_x[:1], relaxed)[0],
                varied[0, :, model.LOAD],
                self._fit.film_columns(  # the last row is the secant, which is not used
                    self._truth.x, np.vstack([values, values[:1]]), np.zeros(values.shape[1]),
                    measurements, steps)[:, :SIZE])
        return window.predicted[key]

    def places(self, wheel: int, position: float, turn: float = 0.0) -> list[Place]:
        """
        Return where a film at ``position`` [m] on the circumference is at the patch center.

        ``turn`` is the angle of the wheel at the start, in revolutions.
        """
        whole, circumference = self._whole, math.tau * self.robot.wheel_radius
        turns = (np.cumsum(whole.rolling[:, wheel]) * (whole.times[1] - whole.times[0])
                 - position) / circumference - turn
        before = np.flatnonzero(np.diff(np.floor(turns)))
        level = np.maximum(np.floor(turns[before]), np.floor(turns[before + 1]))
        times = whole.times[before] + (level - turns[before]) / (
            turns[before + 1] - turns[before]) * (whole.times[1] - whole.times[0])
        values = whole.at(times, np.full(len(times), wheel), self._motion)[0]
        speeds = np.interp(times, whole.times, whole.rolling[:, wheel])
        moving = np.abs(speeds) > self.robot.slip.standstill_speed
        return [Place(*row) for row in np.column_stack(
            [times, speeds, values[:, :model.LOAD]])[moving].tolist()]

    def _simulated(self) -> tuple[WindowData, list[WheelTrajectory]]:
        """Return samples of IMU and wheels, times [s] from the start, and the wheels' paths."""
        name, stiffness, friction, drag = self.ground
        encoder, imu, wheels = self.robot.encoder, [], []
        paths = [WheelTrajectory(self.robot.wheel_radius, encoder.counts_per_revolution,
                                 encoder.stamp_jitter) for _ in WHEELS]
        params = SimulatorParams(
            robot=replace(self.robot, film=replace(self.robot.film, wheels=()), encoder=replace(
                encoder, stamp_jitter=0.0, latency=0.0, counts_per_revolution=EXACT_COUNTS)),
            ground=SurfaceParams(names=(name,), friction=(friction,), stiffness=(stiffness,),
                                 drag=(drag,), base=name, patches=()))
        for _, _, one in simulate(params, self.drive.legs, self.drive.duration, start_ns=0,
                                  torque=self.torque):
            if isinstance(one, ImuSample):
                imu.append((one.stamp_ns / NS_PER_S, one.rate[2], *one.acceleration[:2]))
            elif isinstance(one, WheelSample) and one.position:
                wheels.append((one.stamp_ns / NS_PER_S, *one.position,
                               *(one.effort or (math.nan,) * 4)))
                for path, speed, angle in zip(paths, one.velocity, one.position):
                    path.add_wheel(one.stamp_ns, speed, angle)
        return WindowData(np.array(imu), np.array(wheels), []), paths
