"""
All passages of a recording together: one set of gains, contact length and film places.

Weighted least squares over what each passage tells. The error of the slip multiplies the gains; it
is taken apart in what is new in every passage and what lasts through a manoeuvre, that is as long
as a wheel goes on with the same slip: passages of one steady turn do not tell more than the slip
estimator knows of that turn. Errors of the wheel radius and of the films' length, the two rulers
that there are, stretch all that is measured in metres. Passages and manoeuvres that stray count
less (Huber), and where manoeuvres scatter more than expected, all of them are widened.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.estimation.gain_evidence import Told
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S

Array = NDArray[np.float64]

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
class Layout:
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
class Combination:
    """What all passages tell together."""

    layout: Layout
    value: Array       # (n,), in the order of ``layout``
    covariance: Array  # (n, n)
    weight: Array      # (passages,), 1 but for outliers
    manoeuvre: NDArray[np.intp]  # (passages,), number of it, -1 where no gains are told
    manoeuvres: int
    excess: float      # of passages: typical square of their normalised residuals, at least 1
    spread: float      # of the slip's errors in manoeuvres: likewise

    def estimate(self, index: int) -> tuple[float, float]:
        """Return a parameter with its standard error."""
        return float(self.value[index]), math.sqrt(float(self.covariance[index, index]))


def combine(told: Sequence[Told], runs: Sequence[int], robot: RobotParams) -> Combination:
    """Return what passages tell together; ``runs`` says of which recording each is."""
    return _Combiner(told, runs, robot).run()


def manoeuvres(told: Sequence[Told], runs: Sequence[int]) -> NDArray[np.intp]:
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


class _Combiner:
    def __init__(self, told: Sequence[Told], runs: Sequence[int], robot: RobotParams) -> None:
        self._told, self._layout = told, Layout(robot.film.wheels, robot.film.count)
        self._places = robot.film.places
        self._manoeuvre = manoeuvres(told, runs)
        self._count = int(self._manoeuvre.max(initial=-1)) + 1
        layout = self._layout
        sigma = np.full(layout.size, GAIN_SIGMA)
        sigma[layout.length:layout.place(0)] = (
            LENGTH_SIGMA, ALPHA_SIGMA, max(robot.wheel_radius_sigma, LEAST_SIGMA),
            FILM_LENGTH_SIGMA)
        sigma[layout.place(0):] = PLACE_SIGMA
        self._prior = sigma
        relative = np.array([one.known.slip[1] / abs(one.known.slip[0]) for one in told])
        self._relative = [float(np.median(relative[self._manoeuvre == number]))
                          for number in range(self._count)]  # sigma of slip, by manoeuvre
        self._rows = [self._passage(i) for i in range(len(told))]

    def _passage(self, i: int) -> tuple[Array, Array, Array]:
        """Return slopes by all parameters, what is told relative to them, and its precision."""
        one, layout = self._told[i], self._layout
        rows = np.zeros((len(one.value), layout.size + self._count))
        value, precision = one.value.copy(), one.precision
        shared = len(one.films) if one.gains else 0
        # distances that are too short, or a film that is too long: the fit must not know
        rows[:, layout.radius], rows[:, layout.film] = -one.by_scale, one.by_scale
        rows[[shared, shared + 1], [layout.length, layout.alpha]] = 1.0
        rows[[shared, shared + 1], layout.film] += -1.0, 1.0
        first = one.films[0]
        for row, film in enumerate(one.films[1:], shared + 2):
            apart = self._places[film] - self._places[first]
            rows[row, [layout.place(film), layout.place(first)]] = 1.0, -1.0
            rows[row, layout.film] -= apart
            value[row] -= apart
        if one.gains:
            lasting, new = self._slip_errors(i)
            gains = np.zeros(len(value))
            gains[:shared] = 1.0
            for row, film in enumerate(one.films):
                rows[row, layout.gain(one.known.wheel, film)] = 1.0
            rows[:, layout.size + self._manoeuvre[i]] = lasting * gains
            through = precision @ (new * gains)
            precision = precision - np.outer(through, through) / (1.0 + new * gains @ through)
        return rows, value, precision

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

    def run(self) -> Combination:
        layout, size = self._layout, self._layout.size
        weight, held = np.ones(len(self._told)), np.ones(self._count)
        excess = spread = 1.0
        for _ in range(ROUNDS):
            prior = np.concatenate([self._prior ** -2.0, held / spread])
            normal, right = np.diag(prior), np.zeros(len(prior))
            for w, (rows, value, precision) in zip(weight, self._rows):
                weighted = rows.T @ (w / excess * precision)
                normal += weighted @ rows
                right += weighted @ value
            covariance = np.linalg.inv(normal)
            found = covariance @ right
            squares = np.array([self._square(one, found) for one in self._rows])
            freedom = np.array([len(value) for _, value, _ in self._rows])
            excess = max(1.0, float(np.median(squares / freedom)) / _middle(freedom))
            weight = np.minimum(1.0, OUTLIER * np.sqrt(freedom * excess / np.maximum(
                squares, np.finfo(float).tiny)))
            strayed = found[size:]
            spread = self._spread(strayed, np.diag(covariance)[size:], spread)
            held = np.minimum(1.0, OUTLIER * math.sqrt(spread) / np.maximum(
                np.abs(strayed), np.finfo(float).tiny))
        return Combination(layout, found[:size], covariance[:size, :size], weight,
                           self._manoeuvre, self._count, excess, spread)

    @staticmethod
    def _square(passage: tuple[Array, Array, Array], found: Array) -> float:
        rows, value, precision = passage
        left = value - rows @ found
        return float(left @ precision @ left)

    @staticmethod
    def _spread(strayed: Array, variance: Array, before: float) -> float:
        """Return the variance of what lasts through manoeuvres, in that expected; at least 1."""
        freedom = float(np.sum(1.0 - variance / before))
        if freedom < 1.0:
            return before
        return max(1.0, float(np.sum(np.minimum(strayed ** 2, OUTLIER ** 2 * before))) / freedom)


def _middle(freedom: NDArray[np.intp]) -> float:
    """Return the median of chi-squared over its degrees of freedom, about."""
    typical = float(np.median(freedom)) if len(freedom) else 1.0
    return (1.0 - 2.0 / (9.0 * typical)) ** 3
