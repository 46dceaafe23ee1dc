"""
S, the x of the centres of rotation, by a fit of lateral motion against yaw rate: B(4), B(8).

The paper fits a curve to experimental data. In the axes of REP-103 B(4) is ``v_y = -S W``, so the
way to the left over a stretch is ``-S`` times its turn: that is fitted where a reference tells the
way. Without one, the inertial unit at x_M, y_M feels B(8)'s ``v_y,M = (x_M - S) W`` change:
``a_y = (x_M - S) dW/dt + W (v_x - y_M W)``, with the speed of the wheels for v_x. What else may be
in either is fitted beside, from what is known of it beforehand. An error of x_M is one of S, as is
one of the place of the reference.

S is not quite a constant: tires slip sideways to carry the centripetal force, so it moves forward
with the square of the speed. How much it differs from turn to turn is told, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.recording import period, PoseRecord, Recording, Signal, wheel_intervals
from smart_tire.calibration.robot.gyro_scale import usable_reference
from smart_tire.calibration.robot.wheel_latency import shortest_stretch
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay_regression import noise_beside, sandwich
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.uncertain import Uncertain, weighted_mean


STRETCH = 0.5       # s over which a reference's way is taken: shorter than a turn
LONGEST_GAP = 0.5   # s between poses within a stretch
TURNING = 0.1       # rad/s; slower is no turn
AROUND = 0.3        # s before and after a turn that belong to it: there the yaw rate changes
ENOUGH = 2.0        # rad that a run must turn in all: a third of a circle
ICR_LIMIT = 0.2     # wheelbases, standard error above which S is not given
ASKEW = 0.05        # rad, how far the reference may look aside, one sigma; assumed
SPEED_ERROR = 0.1   # relative sigma of the wheels' mean as speed over ground, in turns
LEANING = 0.03      # s, by which a body that leans feels turns early or late; assumed
SQUARES = 0.2       # m, sigma of the error of y_M, and of what else goes with W^2
LASTING = 2.0       # s over which errors may last: as long as a turn
HUBER, ROUNDS = 2.0, 8  # sigmas, and rounds of reweighting


@dataclass(frozen=True)
class IcrFit:
    """S over the run, and turn by turn."""

    icr: Uncertain         # m, in base_link
    source: str           # what it comes from
    spread: float         # m, standard deviation from turn to turn, beyond the errors
    turn_time: Array      # (k,) s, middles of the turns
    turn_icr: Array       # (k,) m
    turn_sigma: Array     # (k,) m
    regressor: Array      # (n,) rad or rad/s2, that S times gives
    explained: Array      # (n,) m or m/s2, what it should give, all else removed
    unit: str             # of the latter

    @property
    def start_sigma(self) -> float:
        """Return what is known of S at the start of another run [m]: error and spread."""
        return math.hypot(self.icr.sigma, self.spread)

    def parameters(self, robot: RobotParams) -> list[Identified]:
        """Return what goes into a parameter file; the sigma is one over the wheelbase."""
        return [Identified('icr', self.icr.value, self.icr.sigma, f'from {self.source}'),
                Identified('icr_sigma', self.start_sigma / robot.wheelbase,
                           note='standard error and spread over the wheelbase')]


@dataclass(frozen=True)
class _Rows:
    """``wanted = matrix @ (S, ...)`` over stretches of time."""

    time: Array         # (n,) s
    matrix: Array       # (n, p)
    wanted: Array       # (n,)
    doubt: Array        # (n,)
    mean: Array         # (p,) what is known beforehand
    sigma: Array        # (p,)
    source: str
    unit: str
    lasting: float      # m, what S may be off by in all rows alike


def identify_icr(recording: Recording, robot: RobotParams) -> IcrFit:
    """
    Return S from the reference, or from the inertial unit where that tells nothing.

    Raises EstimatorError with the reasons where neither does.
    """
    gyro = Signal(recording.imu.time, recording.imu.rate[:, 2])
    turns = _turns(recording)
    turned = sum(abs(float(gyro.integral(np.array([end]))[0] - gyro.integral(
        np.array([begin]))[0])) for begin, end in turns)
    if turned < ENOUGH:
        raise EstimatorError(f'the run turns by {turned:.2g} rad in all, expected at least '
                             f'{ENOUGH:g}')
    reasons = []
    for rows_of in (_by_reference, _by_unit):
        try:
            return _fit(rows_of(recording, robot), turns, robot)
        except EstimatorError as error:
            reasons.append(str(error))
    raise EstimatorError('; '.join(reasons))


def together(fits: Sequence[IcrFit]) -> IcrFit:
    """Return what several runs tell together; for figures, the rows of the first."""
    time, value, sigma = (np.concatenate([getattr(fit, name) for fit in fits])
                          for name in ('turn_time', 'turn_icr', 'turn_sigma'))
    return replace(fits[0], icr=weighted_mean([fit.icr for fit in fits]), turn_time=time,
                   turn_icr=value, turn_sigma=sigma, spread=_spread(value, sigma))


def _turns(recording: Recording) -> list[tuple[float, float]]:
    """Return begin and end [s] of the turns."""
    imu = recording.imu
    smooth = Signal(imu.time, imu.rate[:, 2]).around(imu.time, AROUND)
    way = np.where(np.abs(smooth) > TURNING, np.sign(smooth), 0.0)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(way)) + 1, [len(way)]])
    return [(float(imu.time[first]), float(imu.time[last - 1]))
            for first, last in zip(edges[:-1], edges[1:]) if way[first]]


def _by_reference(recording: Recording, robot: RobotParams) -> _Rows:
    """Return the rows: ways to the left of a reference over its turns."""
    poses = usable_reference(recording)
    ends = np.array(list(poses.stretches(STRETCH, LONGEST_GAP)), int).reshape(-1, 2)
    if not len(ends):
        raise EstimatorError('the reference is too short')
    first, last = ends.T
    ahead, left = _ways(poses)
    matrix = np.column_stack([poses.yaw[first] - poses.yaw[last], ahead[last] - ahead[first]])
    return _Rows(0.5 * (poses.time[first] + poses.time[last]), matrix, left[last] - left[first],
                 np.zeros(len(first)), np.zeros(2), np.array([np.inf, ASKEW]),
                 'the lateral way of the reference', 'm', 0.0)


def _ways(poses: PoseRecord) -> tuple[Array, Array]:
    """Return what was gone ahead and to the left [m] until each pose, along its headings."""
    heading = 0.5 * (poses.yaw[1:] + poses.yaw[:-1])
    cos, sin = np.cos(heading), np.sin(heading)
    x, y = np.diff(poses.position, axis=0).T
    return (np.concatenate([[0.0], np.cumsum(cos * x + sin * y)]),
            np.concatenate([[0.0], np.cumsum(cos * y - sin * x)]))


def _by_unit(recording: Recording, robot: RobotParams) -> _Rows:
    """Return the rows: lateral specific force over stretches between wheel readings."""
    imu, late = recording.imu, robot.encoder.latency
    stretches = wheel_intervals(recording.wheels, shortest_stretch(recording))
    still = robot.slip.standstill_speed / robot.wheel_radius
    stretches = stretches.where(stretches.around_motion(still) & (
        stretches.begin - late > imu.time[0] + AROUND) & (
        stretches.end - late < imu.time[-1] - AROUND))
    if len(stretches.end) < 2:
        raise EstimatorError('the wheels do not turn')
    begin, end = stretches.begin - late, stretches.end - late
    gyro, force = Signal(imu.time, imu.rate[:, 2]), Signal(imu.time, imu.force[:, 1])
    rate = gyro.mean(begin, end)
    reach = 2.0 * period(imu.time)
    spin = (gyro.around(end, reach) - gyro.around(begin, reach)) / (end - begin)
    speed = robot.wheel_radius * stretches.sides.mean(axis=1)
    pull = rate * speed  # m/s2, centripetal
    x, y, _ = robot.imu.position
    matrix = np.column_stack([-spin, pull, -rate ** 2, np.ones(len(rate))])
    return _Rows(0.5 * (begin + end), matrix, force.mean(begin, end) - x * spin + y * rate ** 2,
                 SPEED_ERROR * np.abs(pull), np.array([0.0, 1.0, 0.0, 0.0]),
                 np.array([np.inf, SPEED_ERROR, SQUARES, np.inf]),
                 'the lateral acceleration of the unit', 'm/s2',
                 LEANING * float(np.average(np.abs(speed), weights=np.abs(rate) + 1e-9)))


def _fit(rows: _Rows, turns: list[tuple[float, float]], robot: RobotParams) -> IcrFit:
    """Return S over the run and turn by turn; raise EstimatorError where it does not show."""
    of_turn = np.array([(rows.time > begin - AROUND) & (rows.time < end + AROUND)
                        for begin, end in turns])
    chosen = np.asarray(of_turn.any(axis=0))
    if chosen.sum() < 2 * len(rows.mean):
        raise EstimatorError(f'{rows.source}: {int(chosen.sum())} stretches in turns')
    matrix, wanted = rows.matrix[chosen], rows.wanted[chosen]
    coefficients, sigma, size = _regression(rows, matrix, wanted, chosen)
    icr = Uncertain(float(coefficients[0]), math.hypot(sigma, rows.lasting))
    limit = ICR_LIMIT * robot.wheelbase
    if not icr.sigma <= limit:
        raise EstimatorError(f'{rows.source}: standard error of {icr.sigma:.2g} m, expected at '
                             f'most {limit:.2g} m')
    explained = wanted - matrix[:, 1:] @ coefficients[1:]
    table = _turn_by_turn(of_turn[:, chosen], matrix[:, 0], explained, size, turns)
    return IcrFit(icr, rows.source, _spread(table[1], table[2]), *table, matrix[:, 0], explained,
                  rows.unit)


def _regression(rows: _Rows, matrix: Array, wanted: Array, chosen: NDArray[np.bool_]
                ) -> tuple[Array, float, Array]:
    """Return robust coefficients, the standard error of the first, and the noise of the rows."""
    doubt = rows.doubt[chosen]
    size = np.hypot(max(float(np.std(wanted)), 1e-9), doubt)
    weight = np.ones(len(wanted))
    for _ in range(ROUNDS):
        scale = np.sqrt(weight) / size
        scaled = matrix * scale[:, None]
        coefficients = np.linalg.lstsq(
            np.vstack([scaled, np.diag(1.0 / rows.sigma)]),
            np.append(wanted * scale, rows.mean / rows.sigma), rcond=None)[0]
        residuals = wanted - matrix @ coefficients
        size = np.hypot(noise_beside(residuals, doubt), doubt)
        weight = np.minimum(1.0, HUBER * size / np.maximum(np.abs(residuals), 1e-12))
    lags = math.ceil(LASTING / float(np.median(np.diff(rows.time))))
    covariance = sandwich(scaled, residuals * scale, rows.sigma, lags)
    return np.asarray(coefficients, float), math.sqrt(covariance[0, 0]), size


def _turn_by_turn(of_turn: NDArray[np.bool_], regressor: Array, explained: Array, size: Array,
                  turns: list[tuple[float, float]]) -> tuple[Array, Array, Array]:
    """Return middles [s], S and standard errors [m] of the turns that tell it."""
    told = []
    for inside, (begin, end) in zip(of_turn, turns):
        weight = (regressor / size)[inside]
        known = float(weight @ weight)
        if known > 0.0 and end - begin > AROUND and inside.sum() > 2:
            value = float(weight @ (explained / size)[inside]) / known
            told.append((0.5 * (begin + end), value, known ** -0.5))
    time, value, sigma = np.array(told).reshape(-1, 3).T
    return time, value, sigma


def _spread(values: Array, sigmas: Array) -> float:
    """Return the standard deviation of values beyond their errors; 0 where there is none."""
    if len(values) < 2:
        return 0.0
    weight = sigmas ** -2.0
    mean = np.sum(weight * values) / np.sum(weight)
    beyond = np.sum(weight * ((values - mean) ** 2 - sigmas ** 2)) / np.sum(weight)
    return math.sqrt(max(0.0, float(beyond)))
