"""
How late the stamps of ``wheel_states`` are, and the effective track, from wheels and gyro.

The yaw rate W follows the sides' speed difference: ``B W = r (w_R - w_L)`` with the effective
track B; what slips beside it disturbs W, so it is W that is explained. It follows late, too, for a
force takes slip: the yaw inertia holds back the body in proportion to the wheels' speed u (by
``I u / (4 C_x (h^2 + l^2))`` for a brush tire in its linear range, h and l half of track and
wheelbase), which alone would look like stamps that are early. That lag is fitted with the delay,
from what the parameters say of it; where it may be large the readings count less, and a share of
it stays in the standard error.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import (
    period, Recording, Signal, wheel_intervals, WheelIntervals)
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay_regression import (
    DelayFit, fit_delay, noise_beside, Problem, Rows, sandwich)
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain


SHORTEST = 0.15        # s; within less robots hardly change how they turn, and noise prevails
READINGS = 3.0         # of the inertial unit in a stretch: between them it is guessed
REACH = 1.0            # s, of the delays that are tried: as the parameter allows
FINEST = 0.02          # s, of their grid, or a quarter of the wheels' period
LAG_PRIOR = 1.0        # relative sigma of the lag that the parameters give: C_x is the ground's
LAG_LEFT = 1.0         # share of the lag found that stays unknown: tires slide in steep changes
UNEQUAL = 0.05         # relative sigma of the difference of the sides' radii, assumed
LATENCY_LIMIT = 0.03   # s, standard error above which a latency is not given: half of 16 Hz
UNRELATED = 3.0        # sigmas, below which yaw rate and wheels have nothing to do with each other
MISFIT_TIME = 2.0      # s over which slip, and so the track, stays what it is
SLOPE, LAG, HELD, UNLIKE, OFFSET = range(5)  # coefficients


@dataclass(frozen=True)
class TurnFit:
    """What the wheels' difference against the gyro tells, and what it looks like."""

    latency: Uncertain    # s
    slope: Uncertain      # rad of the wheels' difference per rad of yaw: track over radius
    unlike: Uncertain     # (r_R - r_L) / r
    time: Array          # (n,) s, middles of the stretches by the stamps
    turning: Array       # (n,) rad/s, gyro, moved by the latency, without bias and lag
    difference: Array    # (n,) rad/s, of the sides


def fit_turns(recording: Recording, robot: RobotParams) -> TurnFit:
    """Return latency and slope; raise EstimatorError with the reason where they do not show."""
    turns = _Turns(recording, robot)
    fit = fit_delay(turns.problem(), delay_grid(recording))
    latency = Uncertain(fit.delay, math.hypot(fit.sigma, LAG_LEFT * turns.lag(fit)))
    if not latency.sigma <= LATENCY_LIMIT:
        raise EstimatorError(
            f'standard error of {latency.sigma:.2g} s, expected at most {LATENCY_LIMIT:g} s: the '
            "wheels' difference hardly changes together with the yaw rate")
    return turns.result(fit, latency)


def delay_grid(recording: Recording) -> Array:
    """Return the delays [s] to try first."""
    step = min(FINEST, 0.25 * max(shortest_stretch(recording), period(recording.wheels.time)))
    return np.asarray(np.arange(-REACH, REACH + step, step))


def shortest_stretch(recording: Recording) -> float:
    """Return how long [s] stretches must be for the inertial unit to resolve them."""
    return max(SHORTEST, READINGS * period(recording.imu.time))


class _Turns:
    """The stretches of a recording in which it moves, as a problem for ``fit_delay``."""

    def __init__(self, recording: Recording, robot: RobotParams) -> None:
        imu = recording.imu
        self._gyro = Signal(imu.time, imu.rate[:, 2])
        self._robot = robot
        stretches = wheel_intervals(recording.wheels, shortest_stretch(recording))
        still = robot.slip.standstill_speed / robot.wheel_radius
        stretches = stretches.where(stretches.around_motion(still) & (
            stretches.begin > imu.time[0] + REACH) & (stretches.end < imu.time[-1] - REACH))
        if len(stretches.end) < 2:
            raise EstimatorError('the wheels do not turn')
        self._set_rows(stretches, 2.0 * period(imu.time))

    def _set_rows(self, stretches: WheelIntervals, shortest_reach: float) -> None:
        robot = self._robot
        self._begin, self._end = stretches.begin, stretches.end
        self.time = 0.5 * (stretches.begin + stretches.end)
        self._reach = max(0.5 * float(np.median(stretches.duration)), shortest_reach)
        sides = stretches.sides
        self.difference, self._mean = sides[:, 1] - sides[:, 0], sides.mean(axis=1)
        self._pace = robot.wheel_radius * np.abs(sides).mean(axis=1)  # m/s
        gained = np.gradient(robot.wheel_radius * self._mean, self.time)  # m/s2
        self._held = (np.abs(sides[:, 1]) - np.abs(sides[:, 0])) * gained
        self._nominal = robot.track_width / robot.wheel_radius
        half_track, half_base = 0.5 * robot.track_width, 0.5 * robot.wheelbase
        stiffness = 4.0 * robot.tire.longitudinal_stiffness
        self._lag = robot.yaw_inertia / (stiffness * (half_track ** 2 + half_base ** 2))
        self._hold = robot.mass / stiffness  # s2/m: slip per acceleration

    def rows(self, delay: float) -> Rows:
        """Return the regression of the yaw rate on the wheels at a ``delay`` [s]."""
        turning = self._gyro.mean(self._begin - delay, self._end - delay)
        matrix = np.column_stack([
            self.difference, -self._pace * self._spin(delay), -self._held / self._nominal,
            self._mean / self._nominal, np.ones(len(turning))])
        return Rows(matrix, turning)

    def _spin(self, delay: float) -> Array:
        """Return the angular acceleration [rad/s2] over the stretches."""
        begin, end = self._begin - delay, self._end - delay
        return (self._gyro.around(end, self._reach) - self._gyro.around(begin, self._reach)) / (
            end - begin)

    def doubt(self, delay: float) -> Array:
        """Return how much [rad/s] of each row may be slip that the lag does not describe."""
        return np.hypot(self._lag * self._pace * self._spin(delay),
                        self._hold * self._held / self._nominal)

    def problem(self) -> Problem:
        """Return the rows and what is known beforehand."""
        mean = np.array([0.0, self._lag, self._hold, 0.0, 0.0])
        sigma = np.array([np.inf, LAG_PRIOR * self._lag, LAG_PRIOR * self._hold, UNEQUAL,
                          self._robot.imu.gyro_bias])
        return Problem(self.rows, self.doubt, self.time, mean, sigma)

    def lag(self, fit: DelayFit) -> float:
        """Return the lag [s] in the readings that the delay comes from."""
        weight = (self._spin(fit.delay) / np.hypot(fit.noise, self.doubt(fit.delay))) ** 2
        return abs(float(fit.coefficients[LAG] * np.sum(weight * self._pace) / np.sum(weight)))

    def result(self, fit: DelayFit, latency: Uncertain) -> TurnFit:
        """Return what the fit tells; the slope with its changes over the run in its error."""
        rows = self.rows(fit.delay)
        share, aside = self._steady(fit, rows)
        if not share.value > UNRELATED * share.sigma:
            raise EstimatorError("the yaw rate does not follow the wheels' difference: are left "
                                 'and right swapped?')
        slope = Uncertain(1.0 / share.value, share.sigma / share.value ** 2)
        scale = slope.value / self._nominal
        unlike = Uncertain(scale * aside.value, scale * aside.sigma)
        beside = rows.matrix[:, SLOPE + 1:] @ fit.coefficients[SLOPE + 1:]
        return TurnFit(latency, slope, unlike, self.time, rows.wanted - beside, self.difference)

    def _steady(self, fit: DelayFit, rows: Rows) -> tuple[Uncertain, Uncertain]:
        """
        Return yaw per wheels' difference, and per mean over the nominal slope, over whole turns.

        The delay shows in changes; the track is that of lasting turns, so here rows count as
        they are, and their errors may last for ``MISFIT_TIME``.
        """
        problem, size = self.problem(), np.hypot(fit.noise, self.doubt(fit.delay))
        coefficients = fit.coefficients
        for _ in range(5):
            residuals = rows.wanted - rows.matrix @ coefficients
            size = np.hypot(noise_beside(residuals, self.doubt(fit.delay)),
                            self.doubt(fit.delay))
            weight = np.sqrt(np.minimum(1.0, 2.0 * size / np.maximum(np.abs(residuals), 1e-12)))
            scaled = rows.matrix * (weight / size)[:, None]
            matrix = np.vstack([scaled, np.diag(1.0 / problem.prior_sigma)])
            wanted = np.concatenate([rows.wanted * weight / size,
                                     problem.prior_mean / problem.prior_sigma])
            coefficients, *_ = np.linalg.lstsq(matrix, wanted, rcond=None)
        lags = math.ceil(MISFIT_TIME / float(np.median(np.diff(self.time))))
        covariance = sandwich(scaled, residuals * weight / size, problem.prior_sigma, lags)
        sigma = np.sqrt(np.diag(covariance))
        return (Uncertain(float(coefficients[SLOPE]), float(sigma[SLOPE])),
                Uncertain(float(coefficients[UNLIKE]), float(sigma[UNLIKE])))
