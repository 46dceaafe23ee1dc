"""
Rolling radius from the ways that a reference of the pose and the wheels went.

A stretch's way is what the reference moved along its own heading: so the noise of its positions
does not add up, as it would in distances between neighbouring poses. The wheels' mean angle makes
the same way, but for three things that are fitted with what is known of them beforehand:

- The reference may not be ``base_link`` itself.
- In turns both sides slide. Their forces balance at equal slips, so the body goes with less than
  the mean of the sides: ``v = u - k (u_R - u_L)^2 / (4 u)``, u the mean, k = 1 - track / effective
  track. Stretches with a turn in place, where this is no longer small, are left out.
- A body that gains speed lags behind its wheels by a slip: mass over stiffness times acceleration.

What rolling straight ahead takes of slip is in the radius: it is the rolling one.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.recording import PoseRecord, WheelRecord
from smart_tire.calibration.robot.rolled_distance import RolledWheels
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay_regression import noise_beside, sandwich
from smart_tire.numerics.robust import noise_level
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain


STRETCH = 2.0        # s of motion that make a stretch: several lengths of a robot
LONGEST_GAP = 0.5    # s between poses within a stretch
FEW = 5              # stretches, below which their scatter tells nothing
TURN_SLIP = 0.3      # sigma of k, and of what single stretches differ from it; 0.3 is usual
PIVOTED = 0.1        # share of a stretch's angle that may be turns in place
SLIP = 0.01          # share of a way: slip that comes and goes while rolling straight; chosen
OFFSET = 0.3         # tracks: how far the reference may sit off the middle, one sigma; assumed
RADIUS_LIMIT = 0.02  # relative standard error above which a radius is not given: slip of 0.02
LAGS = 2             # stretches whose slips depend on each other
MOST_AGAINST = 0.49  # correlation of neighbours; one half where poses make all the noise
HUBER = 2.0          # sigmas; stretches further off count less
ROUNDS = 8           # of reweighting


@dataclass(frozen=True)
class WayFit:
    """The rolling radius and the stretches that tell it."""

    radius: Uncertain   # m, mean of both sides
    time: Array        # (n,) s, middles of the stretches by the stamps of the wheels
    rolled: Array      # (n,) m, of the wheels with that radius, without what they slid
    way: Array         # (n,) m, of the reference along its heading


@dataclass(frozen=True)
class _Ways:
    begin: Array   # (n,) s
    end: Array     # (n,) s
    angle: Array   # (n,) rad
    lost: Array    # (n,) rad
    gained: Array  # (n,) rad2/s2
    way: Array     # (n,) m
    turned: Array  # (n,) rad

    @property
    def follows(self) -> NDArray[np.bool_]:
        """Return whether a stretch begins where the one before ended, (n,)."""
        return np.append(False, self.begin[1:] == self.end[:-1])[:len(self.end)]


def fit_radius(wheels: WheelRecord, reference: PoseRecord, latency: float,
               robot: RobotParams, turn_slip: float = TURN_SLIP) -> WayFit:
    """
    Return the mean rolling radius; raise EstimatorError where the ways do not tell it.

    ``latency`` [s] is how much later the stamps of the wheels are than those of the reference,
    ``turn_slip`` the k above.
    """
    ways = _ways(wheels, reference, latency, robot)
    if len(ways.end) < FEW:
        raise EstimatorError(f'{len(ways.end)} stretches of {STRETCH:g} s that roll ahead with a '
                             f'reference, expected at least {FEW}')
    lost, radius = robot.wheel_radius * ways.lost, robot.wheel_radius
    hold = robot.mass / (4.0 * robot.tire.longitudinal_stiffness)  # s2/m: slip per acceleration
    matrix = np.column_stack([ways.angle, -lost, -radius ** 2 * ways.gained,
                              robot.track_width * ways.turned])
    mean = np.array([0.0, turn_slip, hold, 0.0])
    prior = np.array([np.inf, TURN_SLIP, hold, OFFSET])
    doubt = np.linalg.norm([TURN_SLIP * lost, SLIP * ways.way, np.full(
        len(lost), math.sqrt(2.0) * _noise(reference))], axis=0)
    coefficients, covariance = _regression(matrix, ways, doubt, mean, prior)
    found = Uncertain(float(coefficients[0]), float(np.sqrt(covariance[0, 0])))
    _check(found)
    return WayFit(found, 0.5 * (ways.begin + ways.end), matrix @ coefficients, ways.way)


def _check(radius: Uncertain) -> None:
    if not radius.value > 0.0:
        raise EstimatorError('the reference moves against the wheels')
    if radius.sigma > RADIUS_LIMIT * radius.value:
        raise EstimatorError(
            f'standard error of {100.0 * radius.sigma / radius.value:.2g} %, expected at most '
            f'{100.0 * RADIUS_LIMIT:g} %')


def _ways(wheels: WheelRecord, reference: PoseRecord, latency: float,
          robot: RobotParams) -> _Ways:
    """Return the stretches of ``STRETCH`` seconds in which the wheels roll ahead."""
    heading = 0.5 * (reference.yaw[1:] + reference.yaw[:-1])
    step = np.diff(reference.position, axis=0)
    forward = step[:, 0] * np.cos(heading) + step[:, 1] * np.sin(heading)
    gone = np.concatenate([[0.0], np.cumsum(forward)])
    wheel, still = RolledWheels(wheels), robot.slip.standstill_speed / robot.wheel_radius
    time = reference.time + latency
    rows = []
    for first, last in reference.stretches(STRETCH, LONGEST_GAP):
        rolled = wheel.between(time[first], time[last])
        if rolled is not None and abs(rolled.angle) > max(
                still * STRETCH, rolled.pivoted / PIVOTED):
            rows.append((time[first], time[last], rolled.angle, rolled.lost, rolled.gained,
                         gone[last] - gone[first], reference.yaw[last] - reference.yaw[first]))
    return _Ways(*np.array(rows).reshape(-1, 7).T)


def _noise(reference: PoseRecord) -> float:
    """Return the noise [m] of the reference's positions, from pose to pose."""
    return max(noise_level(axis) for axis in reference.position.T)


def _regression(matrix: Array, ways: _Ways, doubt: Array, mean: Array,
                prior: Array) -> tuple[Array, Array]:
    """
    Return robust coefficients and their covariance; rows are noisier by their ``doubt``.

    Beforehand the coefficients are known to be ``mean``, with ``prior`` as sigma. A pose that is
    off makes one way longer and the next one shorter: neighbours err against each other.
    """
    size, against = np.hypot(0.1 * np.median(np.abs(ways.way)), doubt), 0.0
    for _ in range(ROUNDS):
        scaled = _apart(matrix / size[:, None], ways.follows, against)
        wanted = _apart(ways.way / size, ways.follows, against)
        coefficients = np.linalg.lstsq(np.vstack([scaled, np.diag(1.0 / prior)]),
                                       np.append(wanted, mean / prior), rcond=None)[0]
        residual = ways.way - matrix @ coefficients
        plain = np.hypot(noise_beside(residual, doubt), doubt)
        share = np.clip(residual / plain, -HUBER, HUBER)
        against = -float(np.sum((share[1:] * share[:-1])[ways.follows[1:]]) / np.sum(share ** 2))
        size = plain * np.sqrt(np.maximum(1.0, np.abs(residual) / plain / HUBER))
    left = wanted - scaled @ coefficients
    return np.asarray(coefficients, float), sandwich(scaled, left, prior, LAGS)


def _apart(values: Array, follows: NDArray[np.bool_], against: float) -> Array:
    """
    Return rows (n, ...) of which each is free of the noise that it shares with the one before.

    Rows that follow on each other have unit noise correlated by minus ``against``: Cholesky's
    factor of that covariance, solved row by row.
    """
    link, result, scale = min(max(against, 0.0), MOST_AGAINST), np.array(values), 1.0
    for index in range(1, len(values)):
        share = -link / scale if follows[index] else 0.0
        scale = math.sqrt(1.0 - share ** 2)
        result[index] = (values[index] - share * result[index - 1]) / scale
    return result
