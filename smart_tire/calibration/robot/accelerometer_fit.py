"""
Latency and rolling radius from changes of speed: wheels against the accelerometer.

The forward specific force, integrated, is the speed over ground but for a slow drift by bias and
slope; from one stretch to the next its mean changes by the rolling radius times the change of the
wheels' mean speed. The body lags behind its wheels by slip, mass over stiffness times speed: more
than it lags in turning (``wheel_latency``), and tires slide harder, so that all of the lag counts
as error of the latency. A body that pitches as it gains speed changes what the unit feels: the
radius is a rough one.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.recording import Recording, Signal, wheel_intervals, WheelIntervals
from smart_tire.calibration.robot.rolling_radius import TURN_SLIP
from smart_tire.calibration.robot.wheel_latency import (
    delay_grid, LAG_PRIOR, LATENCY_LIMIT, REACH, shortest_stretch)
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay_regression import DelayFit, fit_delay, Problem, Rows
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain


CHANGE = 1.0    # s over which changes are taken: as long as a robot takes to change its speed
LEANING = 0.1   # relative error by a body that pitches as it gains speed: 0.6 degrees at 1 m/s2
RADIUS, LAG = 0, 1  # coefficients


@dataclass(frozen=True)
class SpeedFit:
    """What changes of the wheels' mean speed against the accelerometer tell."""

    latency: Uncertain  # s
    radius: Uncertain   # m, mean of the sides
    time: Array        # (n,) s, between neighbouring stretches
    gained: Array      # (n,) m/s, by the accelerometer, moved by the latency, without its bias
    rolled: Array      # (n,) m/s, by the wheels, without what they slip


def fit_speed_changes(recording: Recording, robot: RobotParams) -> SpeedFit:
    """Return latency and radius; raise EstimatorError with the reason where they do not show."""
    changes = _Changes(recording, robot)
    fit = fit_delay(changes.problem(), delay_grid(recording))
    latency = Uncertain(fit.delay, math.hypot(fit.sigma, changes.lag(fit)))
    if not latency.sigma <= LATENCY_LIMIT:
        raise EstimatorError(f'standard error of {latency.sigma:.2g} s, expected at most '
                             f'{LATENCY_LIMIT:g} s: the speed hardly changes')
    share = Uncertain(float(fit.coefficients[RADIUS]), fit.coefficient_sigma(RADIUS))
    radius = Uncertain(robot.wheel_radius * share.value, robot.wheel_radius * math.hypot(
        share.sigma, LEANING * share.value))
    rows = changes.rows(fit.delay)
    known = rows.matrix[:, RADIUS + 1:] @ fit.coefficients[RADIUS + 1:]
    return SpeedFit(latency, radius, changes.time, rows.wanted - known,
                    rows.matrix[:, RADIUS] * share.value)


class _Changes:
    """Changes of speed from stretch to stretch, as a problem for ``fit_delay``."""

    def __init__(self, recording: Recording, robot: RobotParams) -> None:
        imu = recording.imu
        # The unit sits off the middle: what turning makes it feel is not a change of speed.
        force = imu.force[:, 0] + robot.imu.position[0] * imu.rate[:, 2] ** 2
        force = force - float(np.median(force))
        rate = Signal(imu.time, force)
        self._speed = Signal(imu.time, rate.integral(imu.time))
        stretches = wheel_intervals(recording.wheels, shortest_stretch(recording))
        still = robot.slip.standstill_speed / robot.wheel_radius
        stretches = stretches.where(stretches.around_motion(still) & (
            stretches.begin > imu.time[0] + REACH) & (stretches.end < imu.time[-1] - REACH))
        self._begin, self._end = stretches.begin, stretches.end
        middle = 0.5 * (stretches.begin + stretches.end)
        self._before, self._after = _pairs(stretches)
        if len(self._after) < 2:
            raise EstimatorError('the wheels do not turn')
        mean = robot.wheel_radius * stretches.sides.mean(axis=1)
        apart = 0.5 * np.abs(np.diff(stretches.sides, axis=1)[:, 0]) * robot.wheel_radius
        lost = np.sign(mean) * apart * np.minimum(1.0, apart / np.maximum(np.abs(mean), 1e-9))
        pace = robot.wheel_radius * np.abs(stretches.sides).mean(axis=1)
        self._rolled = self._steps(mean)
        self._slipped = self._steps(pace * np.gradient(mean, middle))  # m2/s3
        self._lost = self._steps(lost)
        self._lasted, self.time = self._steps(middle), middle[self._after]
        self._pace = pace[self._after]
        self._hold = robot.mass / (4.0 * robot.tire.longitudinal_stiffness)  # s2/m

    def _steps(self, values: Array) -> Array:
        return values[self._after] - values[self._before]

    def rows(self, delay: float) -> Rows:
        """Return the regression of gained speed on that of the wheels at a ``delay`` [s]."""
        gained = self._steps(self._speed.mean(self._begin - delay, self._end - delay))
        return Rows(np.column_stack(
            [self._rolled, -self._slipped, self._lasted, -self._lost]), gained)

    def doubt(self, delay: float) -> Array:
        """Return how much [m/s] of each row may be slip that the lag does not describe."""
        return np.hypot(self._hold * self._slipped, TURN_SLIP * self._lost)

    def problem(self) -> Problem:
        """Return the rows and what is known beforehand."""
        mean = np.array([1.0, self._hold, 0.0, TURN_SLIP])
        sigma = np.array([np.inf, LAG_PRIOR * self._hold, np.inf, TURN_SLIP])
        return Problem(self.rows, self.doubt, self.time, mean, sigma, overlapping=True)

    def lag(self, fit: DelayFit) -> float:
        """Return the lag [s] in the readings that the delay comes from."""
        weight = (self._rolled / np.hypot(fit.noise, self.doubt(fit.delay))) ** 2
        return abs(float(fit.coefficients[LAG] * np.sum(weight * self._pace) / np.sum(weight)))


def _pairs(stretches: WheelIntervals) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return indices of stretches about ``CHANGE`` apart in time, without a hole between."""
    after = np.arange(len(stretches.end))
    before = np.searchsorted(stretches.end, stretches.end - CHANGE)
    apart = stretches.end - stretches.end[before]
    good = (apart > 0.5 * CHANGE) & (apart < 1.5 * CHANGE)
    return before[good], after[good]
