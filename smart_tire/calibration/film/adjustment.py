"""
All passages of a recording together: one set of gains, contact length and film places.

Weighted least squares over what each passage tells. The error of the slip multiplies the gains; it
is taken apart in what is new in every passage and what lasts through a manoeuvre, that is as long
as a wheel goes on with the same slip: passages of one steady turn do not tell more than the slip
estimator knows of that turn. A wheel radius that is wrong adds the same to all slips, which runs
with both signs of it tell. Errors of the wheel radius and of the films' length, the two rulers
that there are, stretch all that is measured in metres. Passages and manoeuvres that stray count
less (Huber), and where manoeuvres scatter more than expected, all of them are widened.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.calibration.film.observations import GainObservation
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S


# shares of the smoothed slip's sigma, from simulated runs with default sensors: 0.55 of it lasts
# through a manoeuvre and hardly any longer; 0.2 is new in every passage while steady, 0.6 else
LASTING, PASSING = 0.6, 0.5
ALIKE = 0.03           # -, of slip, within which a manoeuvre goes on ...
LONGEST_PAUSE = 3.0    # s, ... and between two passages in it; a turn of a slow wheel
LEAST_SIGMA = 1e-6     # -, of what is said to be exact
OUTLIER = 2.5          # sigmas, beyond which a passage or manoeuvre counts less
ROUNDS = 8             # of reweighting; it settles in three
GAIN_SIGMA, LENGTH_SIGMA, ALPHA_SIGMA, PLACE_SIGMA = 10.0, 1.0, 0.3, 1.0  # -, -, -, m: ignorance
FILM_LENGTH_SIGMA = 0.005  # relative, of film.length: a tenth of a millimetre of 20; assumed


@dataclass(frozen=True, slots=True, eq=False)
class ParameterIndex:
    """Where the parameters stand that all passages share."""

    wheels: tuple[str, ...]
    count: int  # films of a wheel

    def gain(self, wheel: str, film: int) -> int:
        """Return the index of the relative error of a film's gain."""
        return self.count * self.wheels.index(wheel) + film

    @property
    def length(self) -> int:
        """Return the index of ln(contact length over the nominal one)."""
        return self.count * len(self.wheels)

    @property
    def alpha(self) -> int:
        """Return the index of ln(alpha of the bending shape over the nominal one)."""
        return self.length + 1

    @property
    def radius(self) -> int:
        """Return the index of the relative error of the wheel radius ..."""
        return self.length + 2

    @property
    def film(self) -> int:
        """Return the index of that of the films' length."""
        return self.length + 3

    def place(self, film: int) -> int:
        """Return the index of a film's place [m] on the circumference, beyond the nominal one."""
        return self.film + 1 + film

    @property
    def size(self) -> int:
        """Return the number of these parameters."""
        return self.place(self.count)


@dataclass(frozen=True, slots=True, eq=False)
class Adjustment:
    """What all passages tell together."""

    layout: ParameterIndex
    value: Array       # (n,), in the order of ``layout``
    covariance: Array  # (n, n)
    manoeuvres: int
    spread: float      # mean square of the slip's errors in them over that expected, at least 1

    def estimate(self, index: int) -> tuple[float, float]:
        """Return a parameter with its standard error."""
        return float(self.value[index]), math.sqrt(float(self.covariance[index, index]))


def combine(told: Sequence[GainObservation], runs: Sequence[int], robot: RobotParams
            ) -> Adjustment:
    """Return what passages tell together; ``runs`` says of which recording each is."""
    return _Combiner(told, runs, robot).run()


def manoeuvres(told: Sequence[GainObservation], runs: Sequence[int]) -> NDArray[np.intp]:
    """Return for each passage the number of its manoeuvre, -1 where it tells no gains."""
    found = np.full(len(told), -1, dtype=np.intp)
    number, last = -1, None
    for i in sorted((i for i, one in enumerate(told) if one.gains), key=lambda i: (
            runs[i], told[i].known.wheel, told[i].known.stamp_ns)):
        known = told[i].known
        here = runs[i], known.wheel
        pause = math.inf if last is None else (known.stamp_ns - last[1]) / NS_PER_S
        if last is None or here != last[0] or pause > LONGEST_PAUSE or abs(
                known.slip[0] - last[2] / last[3]) > ALIKE:
            number, last = number + 1, (here, 0, 0.0, 0)
        last = here, known.stamp_ns, last[2] + known.slip[0], last[3] + 1
        found[i] = number
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """What one passage tells, by all parameters but those of manoeuvres, and by its own."""

    by_common: Array  # (k, n)
    by_slip: Array    # (k,), per sigma of what lasts through the manoeuvre
    value: Array      # (k,), relative to what is nominal
    precision: Array  # (k, k)


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    common: Array      # (n,)
    covariance: Array  # (n, n)
    strayed: Array     # (manoeuvres,) sigmas, of what lasts
    variance: Array    # (manoeuvres,)


class _Combiner:
    def __init__(self, told: Sequence[GainObservation], runs: Sequence[int],
                 robot: RobotParams) -> None:
        self._told, self._runs = told, runs
        self._layout = layout = ParameterIndex(robot.film.wheels, robot.film.count)
        self._places = robot.film.places
        self._manoeuvre = manoeuvres(told, runs)
        self._count = int(self._manoeuvre.max(initial=-1)) + 1
        radius = max(robot.wheel_radius_sigma, LEAST_SIGMA)
        # behind what ``layout`` names, what is added to the slips of each recording
        sigma = np.full(layout.size + max(runs, default=-1) + 1, radius)
        sigma[:layout.length] = GAIN_SIGMA
        sigma[layout.length:layout.place(0)] = LENGTH_SIGMA, ALPHA_SIGMA, radius, FILM_LENGTH_SIGMA
        sigma[layout.place(0):layout.size] = PLACE_SIGMA
        self._prior = sigma ** -2.0
        relative = np.array([one.known.slip[1] / abs(one.known.slip[0]) for one in told])
        self._relative = [float(np.median(relative[self._manoeuvre == number]))
                          for number in range(self._count)]  # sigma of slip, by manoeuvre
        self._rows = [self._row(i) for i in range(len(told))]

    def _row(self, i: int) -> _Row:
        one, layout = self._told[i], self._layout
        rows, gains = np.zeros((len(one.value), len(self._prior))), np.zeros(len(one.value))
        value, precision, count = one.value.copy(), one.precision, len(one.films) * one.gains
        length, alpha = count, count + 1
        # distances that are too short, or a film that is too long: the fit must not know
        rows[:, layout.radius], rows[:, layout.film] = -one.by_scale, one.by_scale
        rows[length, [layout.length, layout.film]] += 1.0, -1.0
        rows[alpha, [layout.alpha, layout.film]] += 1.0, 1.0
        first = one.films[0]
        for row, film in enumerate(one.films[1:], count + 2):
            apart = self._places[film] - self._places[first]
            rows[row, [layout.place(film), layout.place(first), layout.film]] += 1.0, -1.0, -apart
            value[row] -= apart
        if not one.gains:
            return _Row(rows, gains, value, precision)
        slip, (lasting, new) = one.known.slip[0], self._slip_errors(i)
        gains[:count] = 1.0
        for row, film in enumerate(one.films):
            rows[row, layout.gain(one.known.wheel, film)] = 1.0
        rows[:, layout.size + self._runs[i]] = gains * (1.0 - slip) / slip
        through = precision @ (new * gains)
        return _Row(rows, lasting * gains, value, precision - np.outer(through, through) / (
            1.0 + new * gains @ through))

    def _slip_errors(self, i: int) -> tuple[float, float]:
        """
        Return the relative error of the slip that lasts in the manoeuvre, and what is new in it.

        The first is the same for all of a manoeuvre: were it larger where sigma is, then from
        two passages one could tell it, as if errors did follow their sigmas so closely.
        """
        known = self._told[i].known
        slip, sigma = known.slip
        lasting = self._relative[self._manoeuvre[i]]
        new = math.hypot(PASSING * sigma, known.stray) / abs(slip)
        beyond = LASTING * max(sigma / abs(slip) - lasting, 0.0)
        return LASTING * lasting, math.hypot(new, beyond)

    def run(self) -> Adjustment:
        """Solve and weigh until outliers are known."""
        size = self._layout.size
        weight, held = np.ones(len(self._told)), np.ones(self._count)
        excess = spread = 1.0
        freedom = np.array([len(row.value) for row in self._rows])
        for _ in range(ROUNDS):
            found = self._solve(weight / excess, held / spread)
            squares = self._squares(found)
            excess = max(1.0, float(np.median(squares / freedom)) / _middle(freedom))
            weight = _huber(np.sqrt(squares / (freedom * excess)))
            spread = _spread(found, spread)
            held = _huber(np.abs(found.strayed) / math.sqrt(spread))
        return Adjustment(self._layout, found.common[:size], found.covariance[:size, :size],
                           self._count, spread)

    def _solve(self, weight: Array, held: Array) -> _Solution:
        """Return the least squares, where manoeuvres are solved for one by one."""
        n = len(self._prior)
        normal, right = np.diag(self._prior), np.zeros(n)
        across, own, own_right = np.zeros((n, self._count)), held.copy(), np.zeros(self._count)
        for w, row, number in zip(weight, self._rows, self._manoeuvre):
            weighted = row.by_common.T @ (w * row.precision)
            normal += weighted @ row.by_common
            right += weighted @ row.value
            if number >= 0:
                through = w * row.precision @ row.by_slip
                across[:, number] += row.by_common.T @ through
                own[number] += row.by_slip @ through
                own_right[number] += row.value @ through
        share = across / own
        covariance = np.linalg.inv(normal - share @ across.T)
        common = covariance @ (right - share @ own_right)
        return _Solution(common, covariance, own_right / own - share.T @ common,
                         1.0 / own + np.sum(share * (covariance @ share), axis=0))

    def _squares(self, found: _Solution) -> Array:
        """Return the squared normalised residual of each passage."""
        squares = np.zeros(len(self._rows))
        for i, (row, number) in enumerate(zip(self._rows, self._manoeuvre)):
            left = row.value - row.by_common @ found.common
            if number >= 0:
                left = left - row.by_slip * found.strayed[number]
            squares[i] = left @ row.precision @ left
        return squares


def _huber(size: Array) -> Array:
    """Return the weights of residuals of so many sigmas."""
    weights: Array = OUTLIER / np.maximum(size, OUTLIER)
    return weights


def _spread(found: _Solution, before: float) -> float:
    """Return the variance of what lasts through manoeuvres, in that expected; at least 1."""
    freedom = float(np.sum(1.0 - found.variance / before))
    if freedom < 1.0:
        return before
    return max(1.0, float(np.sum(np.minimum(found.strayed ** 2, OUTLIER ** 2 * before))) / freedom)


def _middle(freedom: NDArray[np.intp]) -> float:
    """Return the median of chi-squared over its degrees of freedom, about."""
    return float((1.0 - 2.0 / (9.0 * np.median(freedom))) ** 3)
